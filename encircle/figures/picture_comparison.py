"""Two PNG pictures compared: all that a viewer may go by, and not only the pixels.

The same pixels can be packed into other bytes. But a further frame, a chunk that changes colours,
or other numbers for the same colours, which viewers read each in its way, would show the reader
another picture than the one that is compared here: all chunks but those of packed pixels and of
texts must be as ours are.
"""

import io
import zlib

import numpy as np
from PIL import Image

from encircle.protocol.plugins import error_line

PIXELS_MAX = 2**26
PLACE = b"pHYs"
"""How large a pixel is, in metres, which tools that pack a picture anew may leave out."""
SIGNATURE = b"\x89PNG\r\n\x1a\n"
FREE = (b"IDAT", b"tEXt")
"""Chunks that may be otherwise: the packed pixels, and texts that nobody is shown."""


def picture_problem(given: bytes, made: bytes) -> str:
    """How two pictures differ; empty if they show the same."""
    if given == made:
        return ""
    try:
        own = _chunks(made)
        theirs = _chunks(given, len(own))
        for kind, content in theirs:
            if (kind, content) not in own:
                return f"has a part {kind!r} of {len(content)} bytes, which ours has not"
        if theirs != [chunk for chunk in own if chunk in theirs or chunk[0] != PLACE]:
            return "has not the parts that ours has"
        with (
            Image.open(io.BytesIO(made)) as mine,
            Image.open(io.BytesIO(given), formats=["PNG"]) as it,
        ):
            if it.size != mine.size or it.size[0] * it.size[1] > PIXELS_MAX:
                return f"{it.size[0]} by {it.size[1]} pixels, not {mine.size[0]} by {mine.size[1]}"
            one, other = (np.asarray(picture.convert("RGBA")) for picture in (it, mine))
    except Exception as error:
        # It is a stranger's, and there are many ways in which a picture can be none.
        return f"cannot be read: {error_line(error)}"
    pixels = int((one != other).any(axis=-1).sum())
    return f"{pixels} of {one.shape[0] * one.shape[1]} pixels differ" if pixels else ""


def _chunks(picture: bytes, most: int | None = None) -> list[tuple[bytes, bytes]]:
    """Kind and content of each chunk that is not free; ``ValueError`` if it is no whole PNG.

    After the end there is nothing. ``most``: one more than so many are enough to tell.
    """
    if not picture.startswith(SIGNATURE):
        raise ValueError("it is no PNG picture")
    found, at, kind = [], len(SIGNATURE), b""
    while at < len(picture):
        if kind == b"IEND":
            raise ValueError("it goes on after its end")
        length = int.from_bytes(picture[at : at + 4], "big")
        kind, content = picture[at + 4 : at + 8], picture[at + 8 : at + 8 + length]
        checked = picture[at + 8 + length : at + 12 + length]
        if len(checked) < 4 or zlib.crc32(kind + content) != int.from_bytes(checked, "big"):
            raise ValueError(f"its part {kind!r} is damaged")
        at += 12 + length
        if kind not in FREE:
            found.append((kind, content))
            if most is not None and len(found) > most:
                return found
    return found
