"""What every part of a picture is drawn on and with: canvas, colours, sizes."""

from collections.abc import Mapping
from typing import NamedTuple

from encircle.exports.pictures.canvas import Canvas
from encircle.exports.pictures.layout import Layout
from encircle.scene.stage import Stage


class Sheet(NamedTuple):
    """One picture under way, and the run that it is of. ``colours``: by role, as in the palette."""

    canvas: Canvas
    stage: Stage
    layout: Layout
    colours: Mapping[str, str]

    @property
    def letters(self) -> float:
        """The size of most words in pixels."""
        return self.layout.letters

    @property
    def unit(self) -> float:
        """How many pixels count as one."""
        return self.layout.unit
