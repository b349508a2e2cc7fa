"""Where things stand in a picture of a given size: title, arena, side panel, caption.

Beside each other in a wide picture; in a tall one the panel is below the arena. Words are as large
as the picture allows, and never smaller than ``LETTERS_MIN``.
"""

from dataclasses import dataclass

from encircle.exports.pictures.canvas import Box

LETTERS_MIN = 10.0
SIZE_MIN, SIZE_MAX = (480, 270), (3840, 2160)
"""Smallest and largest width and height of a picture; a tall one may have them the other way."""
PANEL_LETTERS = 20.5
"""Width of the side panel, in sizes of its letters."""
PANEL_LINES = 24
"""Height of the panel below the arena of a tall picture, in lines."""


@dataclass(frozen=True, slots=True)
class Layout:
    """Boxes in pixels; ``letters``: size of most words; ``unit``: of lines, 1 at 720 rows."""

    width: int
    height: int
    letters: float
    unit: float
    title: Box
    arena: Box
    panel: Box
    caption: Box


def layout_of(width: int, height: int) -> Layout:
    """The layout of a picture of a width and height in pixels."""
    short = min(height, width * 0.75)
    letters = max(LETTERS_MIN, round(short / 45.0, 1))
    unit = max(0.65, short / 720.0)
    edge = round(0.9 * letters)
    title = (edge, 0.5 * letters, width - edge, 2.4 * letters)
    caption = (edge, height - 2.1 * letters, width - edge, height - 0.4 * letters)
    top, bottom = round(title[3] + 0.3 * letters), round(caption[1] - 0.3 * letters)
    if width >= height:
        across = round(PANEL_LETTERS * letters)
        right = width - edge - across
        arena = (edge, top, right - edge, bottom)
        panel = (right, top, width - edge, bottom)
    else:
        down = round(PANEL_LINES * letters)
        arena = (edge, top, width - edge, bottom - down - edge)
        panel = (edge, bottom - down, width - edge, bottom)
    return Layout(width, height, letters, unit, title, arena, panel, caption)


def size_problem(width: int, height: int) -> str | None:
    """What is wrong with a size in pixels, None if nothing is."""
    short, long = sorted((width, height))
    within = SIZE_MIN[1] <= short <= SIZE_MAX[1] and SIZE_MIN[0] <= long <= SIZE_MAX[0]
    if not within:
        return f"must be from {SIZE_MIN[0]}x{SIZE_MIN[1]} to {SIZE_MAX[0]}x{SIZE_MAX[1]} pixels"
    # Videos for browsers store colours for two by two pixels together.
    return None if width % 2 == height % 2 == 0 else "width and height must be even"
