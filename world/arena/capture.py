"""When the target is captured, and who can capture at all.

No gap between the bearings of those within the stop distance may be pi or more. The gaps around
the target sum to 2 pi, so one robot has a gap of 2 pi and the larger gap of two is pi at least: it
takes three. And bodies are solid: only so many have room within the stop distance.
``robots_within_max`` bounds their number from above by two arguments, each true of every placement:
neighbours in bearing are a least angle apart, and discs of one size in a larger disc obey
Oler's inequality (Acta Math. 105, 1961).
"""

from math import acos, floor, pi, sqrt

import numpy as np
from numpy.typing import NDArray

ROBOTS_MIN = 3
_ROUNDING = 1e-9


def is_captured(rays: NDArray[np.float64], stop_distance_m: float, count: int) -> bool:
    """Whether the target is captured: enough robots close, and no gap of pi or more between them.

    ``rays``: (N, 2) from the target to each robot, in m.
    """
    close = rays[(rays * rays).sum(axis=1) <= stop_distance_m**2]
    return len(close) >= max(ROBOTS_MIN, count) and bool(encloses(close))


def encloses(rays: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether no gap between the bearings of N >= 1 rays, (..., N, 2), is pi or more; (...,).

    It is so if every ray has another one counter-clockwise of it by less than pi, which the sign of
    their cross product tells. Angles would not do: rounding decides whether robots on opposite
    sides of the target are pi apart, while equal products are equal in doubles, too.
    """
    x, y = rays[..., 0], rays[..., 1]
    left = x[..., :, None] * y[..., None, :] > y[..., :, None] * x[..., None, :]
    return np.asarray(left.any(axis=-1).all(axis=-1))


def robots_within_max(stop_distance_m: float, radius_m: float, target_radius_m: float) -> int:
    """No more robots than this, of ``radius_m``, are ever within the stop distance of the target.

    Distances are between centres, all in m; not every such number of robots has room.
    """
    nearest_m = min(radius_m + target_radius_m, stop_distance_m)
    ratio = stop_distance_m / radius_m
    # Oler: centres in a disc of radius D, each pair at least 2 r apart.
    by_area = pi * ratio * ratio / (2.0 * sqrt(3.0)) + pi * ratio / 2.0 + 1.0
    angle_rad = min(
        _angle_rad(stop_distance_m, stop_distance_m, radius_m),
        _angle_rad(nearest_m, stop_distance_m, radius_m),
    )
    by_angle = 2.0 * pi / angle_rad if angle_rad > 0.0 else by_area
    # A single robot has no neighbour.
    return max(1, floor(min(by_area, by_angle) + _ROUNDING))


def _angle_rad(a_m: float, b_m: float, radius_m: float) -> float:
    """The least angle between two bodies at distances a and b from the target: they touch then.

    In either distance its cosine is convex, so that over a range it is greatest at an end.
    """
    cosine = (a_m * a_m + b_m * b_m - 4.0 * radius_m * radius_m) / (2.0 * a_m * b_m)
    return acos(max(-1.0, min(1.0, cosine)))
