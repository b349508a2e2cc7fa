"""The ring of encirclement: N points around each predicted position of the target (Eq. 1).

The printed matrix turns counter-clockwise where the text says clockwise; the set of points is the
same. The first point lies on the line from the target's current position to the robot farthest from
it; of robots equally far, to the first in robot order. Distances count in whole microns there
(``QUANTA_PER_M``), as in ``encircle.agents.planning.assignment``, since rounding noise must not
decide.
"""

from collections.abc import Sequence
from functools import lru_cache
from math import pi, sqrt

import numpy as np
from numpy.typing import NDArray

from encircle.protocol.messages import QUANTA_PER_M, Point


@lru_cache(maxsize=256)
def _rotations(count: int) -> NDArray[np.complex128]:
    """The N rotations of Eq. 1 as complex numbers: turning a vector is one multiplication."""
    return np.asarray(np.exp(2j * pi * np.arange(count) / count), np.complex128)


def encirclement_points(
    team: Sequence[Point],
    target: Point,
    predictions: NDArray[np.float64],
    ring_radius_m: float,
) -> NDArray[np.float64]:
    """Encirclement points (G, N, 2) in m around each of G predicted positions (G, 2).

    ``team``: N robot positions in m; ``target``: the target's current position in m.
    """
    tx, ty = target
    farthest, ray, length_m = 0, (1.0, 0.0), 1.0
    for x, y in team:
        dx, dy = x - tx, y - ty
        distance_m = sqrt(dx * dx + dy * dy)
        microns = round(distance_m * QUANTA_PER_M)
        if microns > farthest:
            farthest, ray, length_m = microns, (dx, dy), distance_m
    offsets = _rotations(len(team)) * (ring_radius_m / length_m * complex(*ray))
    centres = np.ascontiguousarray(predictions).view(np.complex128)
    points = (centres + offsets).view(np.float64)
    return points.reshape(len(predictions), len(team), 2)
