"""Closing the ring: when to shrink and with which deviation (Eq. 4-7).

Left and right are those of a robot that *faces the target*. Seen from the target, a peer at a
positive (counter-clockwise) angle from this robot is then on its right, one at a negative angle on
its left. A positive deviation beta turns the heading counter-clockwise and so moves the robot
clockwise around the target, to its left; beta is therefore negative when the left neighbour is the
nearer one, as the paper says, and the robot always drifts into the larger of its two gaps.

The printed arctan of a quotient folds angles beyond 90 degrees; the signed angle atan2(cross, dot)
in (-pi, pi] is what is meant. A side without robots counts as 0 in the enclosure test (the ring is
open there); in Eq. 6 the nearest neighbour in that direction is the farthest one on the other side.
"""

from collections.abc import Sequence
from math import atan2, cos, pi, sin
from typing import NamedTuple


class Sides(NamedTuple):
    """Magnitudes of the smallest and largest angles to the left and right, rad (Eq. 4-5)."""

    left_min: float
    left_max: float
    right_min: float
    right_max: float
    left_count: int
    right_count: int
    widest: float


def sides(own_ray: tuple[float, float], rays: Sequence[tuple[float, float]]) -> Sides:
    """Angles about the target from this robot to the others; rays are target-to-robot, in m."""
    ox, oy = own_ray
    left, right = [], []
    for x, y in rays:
        angle = atan2(ox * y - oy * x, ox * x + oy * y)
        if angle >= 0.0:
            right.append(angle)
        else:
            left.append(-angle)
    return Sides(
        min(left, default=0.0),
        max(left, default=0.0),
        min(right, default=0.0),
        max(right, default=0.0),
        len(left),
        len(right),
        _widest([0.0, *right, *[2.0 * pi - angle for angle in left]]),
    )


def _widest(angles: list[float]) -> float:
    angles.sort()
    return max([b - a for a, b in zip(angles, [*angles[1:], 2.0 * pi], strict=True)])


def encloses(angles: Sides, enclosure_rad: float, reading: str) -> bool:
    """The enclosure test of Sec. II-C, by one of three readings of its angle (see above)."""
    if reading == "printed":
        return angles.right_max + angles.left_min >= enclosure_rad
    if reading == "gap":
        return 2.0 * pi - angles.widest >= enclosure_rad
    return angles.right_max + angles.left_max >= enclosure_rad


def deviation(
    angles: Sides, team_size: int, allowance_rad: float, gain: float, deviation_rad_max: float
) -> float:
    """The deviation angle beta in rad (Eq. 6 with its sign), capped in magnitude."""
    if angles.left_count + angles.right_count == 0:
        return 0.0
    left = angles.left_min if angles.left_count else 2.0 * pi - angles.right_max
    right = angles.right_min if angles.right_count else 2.0 * pi - angles.left_max
    low = 2.0 * pi / team_size - allowance_rad
    high = 2.0 * pi / team_size + allowance_rad
    wide, narrow = max(left, right), min(left, right)
    if wide > high and narrow < high:
        size = gain * (wide - high)
    elif narrow < low and low <= wide <= high:
        size = gain * (low - narrow)
    else:
        return 0.0
    size = min(size, deviation_rad_max)
    return -size if left < right else size


def turned(direction: tuple[float, float], angle_rad: float) -> tuple[float, float]:
    """A direction turned counter-clockwise: Eq. 7 as printed, without a length of the step."""
    c, s = cos(angle_rad), sin(angle_rad)
    x, y = direction
    return c * x - s * y, s * x + c * y
