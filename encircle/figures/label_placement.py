"""Where small labels and a legend go in a picture: beside what they tell of, on nothing else.

Labels are placed one after the other. Each tries eight directions, near first, and takes the place
that covers the least of what is drawn; it never covers another label, and one that finds no place
at all is left out. All lengths are in one unit, pixels or points, with y upwards.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from math import cos, pi, sin

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Box = tuple[float, float, float, float]
"""Left, bottom, right, top."""
DIRECTIONS = 8
REACHES = (1.0, 2.2, 3.6)
"""How far from its place a label may go, as multiples of the gap."""


@dataclass
class Page:
    """A picture that labels are put into: its ``frame``, and what is drawn there.

    ``ink``: (M, 2) points of lines, close enough together for the smallest label to meet one;
    ``taken``: boxes that no label may touch.
    """

    frame: Box
    ink: Floats
    taken: list[Box] = field(default_factory=list)

    def put(self, at: tuple[float, float], size: tuple[float, float], gap: float) -> Box | None:
        """Find a box of a size beside a place, and keep it; None if there is none."""
        best: Box | None = None
        least = np.inf
        for far, reach in enumerate(REACHES):
            for k in range(DIRECTIONS):
                box = _beside(at, size, reach * gap, 2.0 * pi * k / DIRECTIONS)
                if not within(box, self.frame) or any(overlap(box, other) for other in self.taken):
                    continue
                covered = covers(box, self.ink) + 0.5 * far
                if covered < least:
                    best, least = box, covered
        if best is not None:
            self.taken.append(best)
        return best


def _beside(
    at: tuple[float, float], size: tuple[float, float], gap: float, direction_rad: float
) -> Box:
    """A box whose nearest edge or corner is ``gap`` away from a place, in a direction."""
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


def free_corner(page: Page, size: tuple[float, float]) -> str | None:
    """The corner of the frame in which a box of a size covers nothing, None if it does in all."""
    left, bottom, right, top = page.frame
    width, height = size
    for side, x in (("right", right - width), ("left", left)):
        for end, y in (("upper", top - height), ("lower", bottom)):
            box = (x, y, x + width, y + height)
            touching = any(overlap(box, other) for other in page.taken)
            if within(box, page.frame) and not touching and not covers(box, page.ink):
                return f"{end} {side}"
    return None


def within(box: Box, frame: Box) -> bool:
    """Whether a box is inside a frame."""
    return box[0] >= frame[0] and box[1] >= frame[1] and box[2] <= frame[2] and box[3] <= frame[3]


def overlap(one: Box, other: Box) -> bool:
    """Whether two boxes have an area in common."""
    apart = one[2] <= other[0] or other[2] <= one[0] or one[3] <= other[1] or other[3] <= one[1]
    return not apart


def covers(box: Box, ink: Floats) -> int:
    """How many of the points a box covers."""
    inside = (ink >= box[:2]) & (ink <= box[2:])
    return int(inside.all(axis=1).sum())


def along(lines: Sequence[Floats], step: float) -> Floats:
    """Points along polylines, ``step`` apart or less."""
    points = [np.zeros((0, 2))]
    for line in lines:
        points.append(line[:1])
        for a, b in pairwise(line):
            count = int(np.ceil(np.hypot(*(b - a)) / step))
            points.append(a + (b - a) * np.linspace(0.0, 1.0, count + 1)[1:, None])
    return np.concatenate(points)
