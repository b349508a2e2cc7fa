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

FEW_MAX = 24
"""Up to so many robots plain floats are quicker than arrays."""


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
    (rx, ry), length_m = (_farthest_of_many if len(team) > FEW_MAX else _farthest)(team, target)
    offsets = _rotations(len(team)) * (ring_radius_m / length_m * complex(rx, ry))
    centres = np.ascontiguousarray(predictions).view(np.complex128)
    points = (centres + offsets).view(np.float64)
    return points.reshape(len(predictions), len(team), 2)


def _farthest(team: Sequence[Point], target: Point) -> tuple[Point, float]:
    """From the target to the robot farthest from it, and how far that is; (1, 0) if all are on it.

    In plain floats, which is quicker for few robots.
    """
    tx, ty = target
    farthest, ray, length_m = 0, (1.0, 0.0), 1.0
    for x, y in team:
        dx, dy = x - tx, y - ty
        distance_m = sqrt(dx * dx + dy * dy)
        microns = round(distance_m * QUANTA_PER_M)
        if microns > farthest:
            farthest, ray, length_m = microns, (dx, dy), distance_m
    return ray, length_m


def _farthest_of_many(team: Sequence[Point], target: Point) -> tuple[Point, float]:
    """The same, bit for bit, in arrays."""
    rays = np.array(team) - target
    rays_x, rays_y = rays[:, 0], rays[:, 1]
    distances_m = np.sqrt(rays_x * rays_x + rays_y * rays_y)
    microns = np.rint(distances_m * QUANTA_PER_M)
    farthest = int(microns.argmax())
    if microns[farthest] == 0.0:
        return (1.0, 0.0), 1.0
    return (float(rays_x[farthest]), float(rays_y[farthest])), float(distances_m[farthest])
