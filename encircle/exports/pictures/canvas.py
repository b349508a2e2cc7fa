"""Lines, discs, shapes and words in an array of pixels, quickly: matplotlib's Agg without artists.

A figure of artists takes a tenth of a second to draw, this a hundredth. Lengths are in pixels, x to
the right and y down, from the top left corner. Colours are ``#RRGGBB``. What is drawn depends on
nothing but the calls, so that equal calls give equal pixels.
"""

from collections.abc import Sequence
from functools import lru_cache
from math import ceil
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import RendererAgg
from matplotlib.font_manager import FontProperties
from matplotlib.path import Path
from matplotlib.textpath import TextPath
from matplotlib.transforms import Affine2D, Bbox
from numpy.typing import ArrayLike, NDArray

Pixels = NDArray[np.uint8]
XY = tuple[float, float]
"""A place in the picture."""
Box = tuple[float, float, float, float]
"""Left, top, right and bottom edge."""
TEXTS_MAX = 4096
DOTS_PER_INCH = 72
"""A point is a pixel then."""
HALO = 3.0
"""Width in pixels of the outline of words that stand over lines."""
DARK_POWER = 0.6
"""On a dark ground what is drawn with an opacity of 0.3 is drawn with 0.3 to this power.

Colours are mixed as displays have them coded, not as light: half of a colour over black is a fifth
of its light, half of it over white takes away more than half.
"""
_MARGIN = 3
_CIRCLE = Path.unit_circle()
_ANCHORS = {"left": 0.0, "centre": 0.5, "right": 1.0}


class Canvas:
    """A picture of a width and height in pixels, filled with one colour."""

    def __init__(self, width: int, height: int, background: str) -> None:
        self.width, self.height, self.background = width, height, background
        self._agg = _agg(width, height)
        self._clip: Box | None = None
        self._power = DARK_POWER if sum(rgba(background)[:3]) < 1.5 else 1.0
        self.rectangle((0, 0, width, height), fill=background)

    def pixels(self) -> Pixels:
        """(height, width, 3) red, green and blue: a copy."""
        return np.array(np.asarray(self._agg.buffer_rgba())[:, :, :3])

    def clip(self, box: Box | None) -> None:
        """Draw only within a box from now on; with None everywhere."""
        self._clip = box

    def line(
        self,
        places: ArrayLike,
        colour: str,
        width: float = 1.0,
        alpha: float = 1.0,
        dashes: Sequence[float] = (),
    ) -> None:
        """A line through places (M, 2); ``dashes``: lengths of dash, gap, dash, ..."""
        points = np.asarray(places, dtype=float)
        if len(points) > 1:
            self._path(Path(points), Affine2D(), "", colour, width, alpha, dashes)

    def disc(
        self,
        at: XY,
        radius: float,
        fill: str = "",
        outline: str = "",
        width: float = 1.0,
        alpha: float = 1.0,
        dashes: Sequence[float] = (),
    ) -> None:
        """A disc, a circle or both: what has no colour is not drawn."""
        place = Affine2D().scale(radius).translate(*at)
        self._path(_CIRCLE, place, fill, outline, width, alpha, dashes)

    def polygon(
        self,
        places: ArrayLike,
        fill: str = "",
        outline: str = "",
        width: float = 1.0,
        alpha: float = 1.0,
    ) -> None:
        """A closed shape with corners (M, 2)."""
        corners = np.asarray(places, dtype=float)
        path = Path(np.vstack([corners, corners[:1]]), closed=True)
        self._path(path, Affine2D(), fill, outline, width, alpha, ())

    def rectangle(self, box: Box, fill: str = "", outline: str = "", alpha: float = 1.0) -> None:
        """A box, filled or outlined."""
        left, top, right, bottom = box
        corners = [(left, top), (right, top), (right, bottom), (left, bottom)]
        self.polygon(corners, fill, outline, 1.0, alpha)

    def text(
        self,
        text: str,
        at: XY,
        size: float,
        colour: str,
        align: str = "left",
        bold: bool = False,
        halo: bool = False,
        alpha: float = 1.0,
    ) -> None:
        """Words in one line; ``at``: the middle of a capital letter's height.

        ``align``: ``left``, ``centre`` or ``right`` of the words is there. ``halo``: with an
        outline of the background's colour, to stand over lines.
        """
        if not text.strip():
            return
        image = _text_image(text, size, colour, bold, self.background if halo else "", alpha)
        left = at[0] - _ANCHORS[align] * text_width(text, size, bold)
        context = self._context("", 0.0, 1.0, ())
        # Whole pixels: letters between two pixels would be blurred.
        bottom = round(self.height - at[1] - image.shape[0] / 2)
        self._agg.draw_image(context, round(left) - _MARGIN, bottom, image)

    def _path(
        self,
        path: Path,
        place: Affine2D,
        fill: str,
        outline: str,
        width: float,
        alpha: float,
        dashes: Sequence[float],
    ) -> None:
        alpha = alpha**self._power
        context = self._context(outline, width, alpha, dashes)
        upwards = place.scale(1.0, -1.0).translate(0.0, self.height)
        self._agg.draw_path(context, path, upwards, rgba(fill, alpha) if fill else None)

    def _context(self, outline: str, width: float, alpha: float, dashes: Sequence[float]) -> Any:
        context = self._agg.new_gc()
        context.set_foreground(rgba(outline or "#000000", alpha), isRGBA=True)
        context.set_linewidth(width if outline else 0.0)
        context.set_capstyle("butt" if len(dashes) else "round")
        context.set_joinstyle("round")
        if len(dashes):
            context.set_dashes(0.0, list(dashes))
        if self._clip is not None:
            left, top, right, bottom = self._clip
            box = Bbox([[left, self.height - bottom], [right, self.height - top]])
            context.set_clip_rectangle(box)
        return context


def _agg(width: int, height: int) -> Any:
    """A renderer; matplotlib's has no types."""
    renderer: Any = RendererAgg
    return renderer(width, height, DOTS_PER_INCH)


def rgba(colour: str, alpha: float = 1.0) -> tuple[float, float, float, float]:
    """``#RRGGBB`` as red, green, blue and alpha from 0 to 1."""
    red, green, blue = (int(colour[k : k + 2], 16) / 255.0 for k in (1, 3, 5))
    return red, green, blue, alpha


@lru_cache(maxsize=TEXTS_MAX)
def text_width(text: str, size: float, bold: bool = False) -> float:
    """How wide words are, in pixels."""
    # Of blanks alone there is no shape.
    return (
        float(np.asarray(_text_path(text, size, bold).vertices)[:, 0].max())
        if text.strip()
        else 0.0
    )


def shortened(text: str, width: float, size: float, bold: bool = False) -> str:
    """As much of a text as fits into a width, with dots where the rest is left out."""
    if text_width(text, size, bold) <= width:
        return text
    fits = [k for k in range(len(text)) if text_width(f"{text[:k]}...", size, bold) <= width]
    return f"{text[: fits[-1]].rstrip()}..." if fits else ""


@lru_cache(maxsize=TEXTS_MAX)
def _text_path(text: str, size: float, bold: bool) -> Path:
    font = FontProperties(family="DejaVu Sans", weight="bold" if bold else "normal")
    return TextPath((0.0, 0.0), text, size=size, prop=font, usetex=False)


@lru_cache(maxsize=TEXTS_MAX)
def _text_image(text: str, size: float, colour: str, bold: bool, halo: str, alpha: float) -> Pixels:
    """(height, width, 4) words on nothing. The middle of a capital letter is the image's middle."""
    # Numbers change at each tick, words do not: most images are drawn once.
    path, capital = _text_path(text, size, bold), 0.73 * size
    width = ceil(text_width(text, size, bold)) + 2 * _MARGIN + 1
    height = 2 * ceil(0.5 * capital + 0.3 * size + _MARGIN)
    agg = _agg(width, height)
    place = Affine2D().translate(_MARGIN, round((height - capital) / 2))
    context = agg.new_gc()
    if halo:
        context.set_foreground(rgba(halo, 0.85 * alpha), isRGBA=True)
        context.set_linewidth(HALO)
        context.set_joinstyle("round")
        agg.draw_path(context, path, place, None)
    context.set_linewidth(0.0)
    agg.draw_path(context, path, place, rgba(colour, alpha))
    # Agg takes images from the lowest row on.
    return np.ascontiguousarray(np.asarray(agg.buffer_rgba())[::-1])
