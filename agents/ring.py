"""The ring of encirclement: N points around each predicted position of the target (Eq. 1).

The printed matrix turns counter-clockwise where the text says clockwise; the set of points is the
same. The first point lies on the line from the target's current position to the robot farthest
from it; of robots equally far, to the first in robot order.
"""

from functools import lru_cache
from math import pi

import numpy as np
from numpy.typing import NDArray


@lru_cache(maxsize=256)
def _rotations(count: int) -> NDArray[np.float64]:
    angles = np.arange(count) * (2.0 * pi / count)
    cos, sin = np.cos(angles), np.sin(angles)
    return np.stack([np.stack([cos, -sin], -1), np.stack([sin, cos], -1)], -2)


def encirclement_points(
    team: NDArray[np.float64],
    target: NDArray[np.float64],
    predictions: NDArray[np.float64],
    ring_radius_m: float,
) -> NDArray[np.float64]:
    """Encirclement points (G, N, 2) in m around each of G predicted positions (G, 2).

    ``team``: (N, 2) robot positions; ``target``: (2,) current target position.
    """
    rays = team - target
    squares = (rays * rays).sum(axis=1)
    far = rays[squares.argmax()]
    length = float(np.sqrt(squares.max()))
    direction = far / length if length > 0.0 else np.array([1.0, 0.0])
    offsets = _rotations(len(team)) @ (ring_radius_m * direction)
    points: NDArray[np.float64] = predictions[:, None, :] + offsets
    return points
