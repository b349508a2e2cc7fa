"""The shapes of packets by fate, drawn about a place: in flight, and where one was lost."""

from math import cos, pi, sin

from encircle.exports.pictures.canvas import XY, Canvas
from encircle.scene.palette import PacketStyle

LINE = 0.36
"""Width of a cross's lines, as a share of its radius."""
_ARMS = {
    "x": (0.25, 0.75),
    "plus": (0.0, 0.5),
    "star": (1 / 6, 0.5, 5 / 6),
    "ring-x": (0.25, 0.75),
    "box-x": (0.25, 0.75),
}
"""Directions of a shape's arms, in half turns."""


def draw_flying(
    canvas: Canvas, style: PacketStyle, colour: str, at: XY, radius: float, alpha: float = 1.0
) -> None:
    """A packet on its way; one that will be lost is a small square, whatever the cause."""
    outline = canvas.background
    match style.shape:
        case "disc":
            canvas.disc(at, radius, colour, outline, 1.0, alpha)
        case "diamond":
            corners = [_from(at, 1.25 * radius, k / 2) for k in range(4)]
            canvas.polygon(corners, colour, outline, 1.0, alpha)
        case _:
            corners = [_from(at, 1.1 * radius, 0.25 + k / 2) for k in range(4)]
            canvas.polygon(corners, colour, outline, 1.0, alpha)


def draw_lost(
    canvas: Canvas, style: PacketStyle, colour: str, at: XY, radius: float, alpha: float = 1.0
) -> None:
    """The cross at the place where a packet was lost."""
    width, reach = LINE * radius, 1.2 * radius
    if style.shape == "ring-x":
        canvas.disc(at, 1.45 * radius, "", colour, 0.7 * width, alpha)
        reach = radius
    elif style.shape == "box-x":
        corners = [_from(at, 1.8 * radius, 0.25 + k / 2) for k in range(4)]
        canvas.polygon(corners, "", colour, 0.7 * width, alpha)
        reach = radius
    arms = _ARMS.get(style.shape, (0.5,))
    for turn in arms:
        ends = [_from(at, reach, turn), _from(at, reach, turn + 1.0)]
        canvas.line(ends, colour, width, alpha)


def draw_mark(canvas: Canvas, style: PacketStyle, colour: str, at: XY, radius: float) -> None:
    """What stands for a fate in a legend."""
    if style.shape in ("disc", "diamond"):
        draw_flying(canvas, style, colour, at, radius)
    else:
        draw_lost(canvas, style, colour, at, radius)


def _from(at: XY, radius: float, half_turns: float) -> XY:
    return at[0] + radius * cos(pi * half_turns), at[1] + radius * sin(pi * half_turns)
