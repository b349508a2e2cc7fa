"""Placement of small labels and a legend in a picture, so that they cover as little as possible.

Labels are placed one after the other. Each label tries eight directions at several distances, near
ones first, and takes the box that covers the fewest drawn points. It never covers another label; if
no box is free, it is left out. All lengths are in one unit, pixels or points, with y upwards.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from math import cos, pi, sin

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Box = tuple[float, float, float, float]
"""Coordinates of the left, bottom, right and top edge."""
DIRECTIONS = 8
GAP_MULTIPLES = (1.0, 2.2, 3.6)
"""Distances from the labelled point that are tried, as multiples of the gap."""


@dataclass
class LabelCanvas:
    """A picture that labels are put into.

    ``frame``: the box that labels must stay in. ``drawn_points``: (M, 2) points on what is
    drawn, so dense that the smallest label cannot miss a line. ``occupied``: boxes that no
    label may overlap.
    """

    frame: Box
    drawn_points: Floats
    occupied: list[Box] = field(default_factory=list)

    def place(self, at: tuple[float, float], size: tuple[float, float], gap: float) -> Box | None:
        """Find a free box of a size near a point, and mark it as occupied.

        None if there is no such box.
        """
        best: Box | None = None
        least = np.inf
        for far, reach in enumerate(GAP_MULTIPLES):
            for k in range(DIRECTIONS):
                box = _beside(at, size, reach * gap, 2.0 * pi * k / DIRECTIONS)
                if not is_inside(box, self.frame) or any(
                    boxes_overlap(box, other) for other in self.occupied
                ):
                    continue
                covered = points_covered(box, self.drawn_points) + 0.5 * far
                if covered < least:
                    best, least = box, covered
        if best is not None:
            self.occupied.append(best)
        return best


def _beside(
    at: tuple[float, float], size: tuple[float, float], gap: float, direction_rad: float
) -> Box:
    """A box whose nearest edge or corner is ``gap`` away from a point, in a direction."""
    (x, y), (width, height) = at, size
    to_x, to_y = round(cos(direction_rad), 9), round(sin(direction_rad), 9)
    centre_x = x + gap * to_x + np.sign(to_x) * width / 2.0
    centre_y = y + gap * to_y + np.sign(to_y) * height / 2.0
    return (
        centre_x - width / 2.0,
        centre_y - height / 2.0,
        centre_x + width / 2.0,
        centre_y + height / 2.0,
    )


def free_corner(canvas: LabelCanvas, size: tuple[float, float]) -> str | None:
    """The corner of the frame in which a box of a size covers nothing; None if there is none."""
    left, bottom, right, top = canvas.frame
    width, height = size
    for side, x in (("right", right - width), ("left", left)):
        for end, y in (("upper", top - height), ("lower", bottom)):
            box = (x, y, x + width, y + height)
            touching = any(boxes_overlap(box, other) for other in canvas.occupied)
            if (
                is_inside(box, canvas.frame)
                and not touching
                and not points_covered(box, canvas.drawn_points)
            ):
                return f"{end} {side}"
    return None


def is_inside(box: Box, frame: Box) -> bool:
    """Whether a box is inside a frame."""
    return box[0] >= frame[0] and box[1] >= frame[1] and box[2] <= frame[2] and box[3] <= frame[3]


def boxes_overlap(one: Box, other: Box) -> bool:
    """Whether two boxes have a common area."""
    apart = one[2] <= other[0] or other[2] <= one[0] or one[3] <= other[1] or other[3] <= one[1]
    return not apart


def points_covered(box: Box, ink: Floats) -> int:
    """How many of the points (M, 2) a box covers."""
    inside = (ink >= box[:2]) & (ink <= box[2:])
    return int(inside.all(axis=1).sum())


def points_along(lines: Sequence[Floats], step: float) -> Floats:
    """Points (M, 2) along polylines (K, 2), at most ``step`` apart."""
    points = [np.zeros((0, 2))]
    for line in lines:
        points.append(line[:1])
        for a, b in pairwise(line):
            count = int(np.ceil(np.hypot(*(b - a)) / step))
            points.append(a + (b - a) * np.linspace(0.0, 1.0, count + 1)[1:, None])
    return np.concatenate(points)
