"""Shapes in the plane, of which the exports for viewers are made: discs, lines, segments, labels.

A viewer's format has its own words for them; each export translates these few. Lengths in m, in
the frame of the arena. ``z_m`` only says what covers what when one looks from above.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import TypeAlias

Point: TypeAlias = tuple[float, float]
FRAME_ID = "map"
"""The name of the arena's frame in formats that name frames."""


@dataclass(frozen=True, slots=True)
class Colour:
    """Red, green, blue and opacity from 0 to 1."""

    r: float
    g: float
    b: float
    a: float = 1.0

    def faded(self, opacity: float) -> "Colour":
        """The same colour with another opacity."""
        return Colour(self.r, self.g, self.b, opacity)

    @property
    def rgba8(self) -> tuple[int, int, int, int]:
        """The four parts from 0 to 255."""
        return (round(self.r * 255), round(self.g * 255), round(self.b * 255), round(self.a * 255))


@cache
def colour_of(code: str) -> Colour:
    """The colour with a code like ``#0072B2``."""
    return Colour(*(int(code[k : k + 2], 16) / 255 for k in (1, 3, 5)))


@dataclass(frozen=True, slots=True)
class Disc:
    """A filled disc around a centre."""

    centre: Point
    radius_m: float
    colour: Colour
    z_m: float = 0.0


@dataclass(frozen=True, slots=True)
class Line:
    """A line through points, closed or not."""

    points: tuple[Point, ...]
    colour: Colour
    width_m: float
    closed: bool = False
    z_m: float = 0.0


@dataclass(frozen=True, slots=True)
class Segments:
    """Pieces of lines: each two points that follow each other are one piece."""

    points: tuple[Point, ...]
    colour: Colour
    width_m: float
    z_m: float = 0.0


@dataclass(frozen=True, slots=True)
class Label:
    """A text that faces whoever looks at it."""

    centre: Point
    text: str
    height_m: float
    colour: Colour
    z_m: float = 0.0


Shape: TypeAlias = Disc | Line | Segments | Label


@dataclass(frozen=True, slots=True)
class Entity:
    """Shapes that belong together, by a name that is one of its kind in its layer."""

    name: str
    shapes: tuple[Shape, ...]


def segments(
    pieces: Sequence[tuple[Point, Point]], colour: Colour, width_m: float, z_m: float
) -> tuple[Segments, ...]:
    """The pieces as one shape; none if there are no pieces."""
    points = tuple([point for piece in pieces for point in piece])
    return (Segments(points, colour, width_m, z_m),) if points else ()
