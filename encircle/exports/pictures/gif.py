"""Pictures one after the other into an animated GIF, by Pillow.

All pictures share one palette: the colours that are drawn, exactly, then those in between, taken
from pictures throughout the run.
"""

from collections.abc import Iterable, Iterator, Sequence
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from encircle.exports.pictures.canvas import Pixels

GIF_COLOURS = 96
"""More would make a larger file, and no better a picture of lines and flat colours."""
UNKNOWN = -1
GIF_TIMES_PER_S = 100
"""A GIF counts time in hundredths of a second."""


def write_gif(
    pictures: Iterable[Pixels],
    out: Path,
    times_s: Sequence[Fraction],
    samples: Sequence[Pixels],
    colours: Sequence[str],
) -> None:
    """Write an animation that repeats for ever.

    ``times_s``: when each picture is shown, and the end. ``samples``: pictures from which the
    palette is taken; ``colours``: ``#RRGGBB`` that are in it exactly.
    """
    palette = SharedPalette(samples, colours)
    images = map(palette.image, pictures)
    first = next(images)
    first.save(
        out,
        format="GIF",
        save_all=True,
        append_images=images,
        duration=list(_durations_ms(times_s)),
        loop=0,
        optimize=False,
    )


class SharedPalette:
    """At most 256 colours for all pictures of an animation.

    The given colours are exactly in it; the others are the most frequent ones of the samples.
    """

    def __init__(self, samples: Sequence[Pixels], colours: Sequence[str]) -> None:
        exact = list(dict.fromkeys(int(colour[1:], 16) for colour in colours))
        codes = np.concatenate([_codes(sample)[::2, ::2].ravel() for sample in samples])
        others = codes[~np.isin(codes, exact)]
        entries = _rgb(np.array(exact)).ravel().tolist()
        if len(others):
            mosaic = Image.fromarray(_rgb(others).reshape(1, -1, 3))
            count = GIF_COLOURS - len(exact)
            found = mosaic.quantize(colors=count, dither=Image.Dither.NONE).getpalette() or []
            entries += found[: 3 * count]
        self._entries = entries
        self._colours = np.array(entries, dtype=float).reshape(-1, 3)
        # Of every colour that has been met, the index of the nearest one: Pillow's own search is
        # coarse, and would not find a colour that is there exactly.
        self._nearest = np.full(1 << 24, UNKNOWN, dtype=np.int16)

    def image(self, picture: Pixels) -> Image.Image:
        """A picture in the palette's colours."""
        codes = _codes(picture)
        indices = self._nearest[codes]
        if (indices == UNKNOWN).any():
            new = np.unique(codes[indices == UNKNOWN])
            away = _rgb(new)[:, None, :].astype(float) - self._colours
            self._nearest[new] = (away**2).sum(axis=2).argmin(axis=1)
            indices = self._nearest[codes]
        image = Image.fromarray(indices.astype(np.uint8), mode="P")
        image.putpalette(self._entries)
        return image


def _codes(picture: Pixels) -> NDArray[np.int32]:
    """(height, width) colours as one number each."""
    return picture.astype(np.int32) @ np.array([1 << 16, 1 << 8, 1], dtype=np.int32)


def _rgb(codes: NDArray[np.int32]) -> Pixels:
    """(M, 3) red, green and blue of numbers (M,)."""
    return np.stack([codes >> 16, codes >> 8 & 255, codes & 255], axis=-1).astype(np.uint8)


def _durations_ms(times_s: Sequence[Fraction]) -> Iterator[int]:
    """How long each picture is shown, such that the whole has its length."""
    units = [round(time_s * GIF_TIMES_PER_S) for time_s in times_s]
    return (1000 // GIF_TIMES_PER_S * (after - before) for before, after in pairwise(units))
