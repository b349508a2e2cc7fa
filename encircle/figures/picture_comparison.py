"""Two PNG pictures compared: all that a viewer may go by, and not only the pixels.

The same pixels can be packed into other bytes. But a further frame, or a chunk that changes
colours, would show the reader another picture than the one that is compared here: a picture may
have no chunk that ours has not, but for those that pack pixels otherwise.
"""

import io
import zlib

import numpy as np
from PIL import Image

from encircle.protocol.plugins import error_line

PIXELS_MAX = 2**26
SIGNATURE = b"\x89PNG\r\n\x1a\n"
PACKING = (b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"tEXt", b"IEND")
"""Chunks that say how the pixels are packed, and texts that nobody is shown."""


def picture_problem(given: bytes, made: bytes) -> str:
    """How two pictures differ; empty if they show the same."""
    if given == made:
        return ""
    try:
        if foreign := [chunk for chunk in _chunks(given) if chunk not in _chunks(made)]:
            kind, content = foreign[0]
            return f"has a part {kind!r} of {len(content)} bytes, which ours has not"
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


def _chunks(picture: bytes) -> list[tuple[bytes, bytes]]:
    """Kind and content of each chunk that is not of ``PACKING``; ``ValueError`` if it is damaged.

    After the end there is nothing.
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
        if kind not in PACKING:
            found.append((kind, content))
    return found
