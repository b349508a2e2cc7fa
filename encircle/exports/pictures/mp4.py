"""Pictures one after the other into a video: H.264 in MP4 by PyAV.

It plays in browsers and slides: 4:2:0, BT.709, the index at the front. How many threads encode is
given, so that equal pictures make an equal file on every machine with the same encoder.
"""

from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path

import av
from av.video.reformatter import ColorRange, Colorspace

from encircle.exports.pictures.canvas import Pixels

ENCODERS = {
    # With weighted prediction x264 looks at what lies beyond pictures whose sides are no multiples
    # of 16, and with its tree of macroblocks at memory that nothing was written to; both differ
    # from time to time. Without the tree a larger crf gives as good a picture.
    "libx264": {"crf": "22", "preset": "medium", "weightp": "0", "mbtree": "0"},
    "libvpx-vp9": {"crf": "30", "b": "0", "deadline": "good", "cpu-used": "4"},
}
"""With their options, in the order of preference; browsers play both in MP4."""
THREADS = 2
BT709 = 1
"""Its number among colour primaries and transfer characteristics (ITU-T H.273)."""


def video_encoder() -> str | None:
    """The encoder for MP4 that PyAV has here, None if it has none that browsers play."""
    return next((name for name in ENCODERS if name in av.codecs_available), None)


def write_mp4(pictures: Iterable[Pixels], out: Path, size: tuple[int, int], fps: Fraction) -> None:
    """Write a video; ``size``: width and height in pixels, both even."""
    encoder = video_encoder()
    assert encoder is not None, "asked for before"
    with av.open(str(out), "w", format="mp4", options={"movflags": "+faststart"}) as container:
        stream = container.add_stream(encoder, rate=fps, options=dict(ENCODERS[encoder]))
        assert isinstance(stream, av.VideoStream)
        stream.width, stream.height = size
        stream.pix_fmt = "yuv420p"
        context = stream.codec_context
        context.thread_count = THREADS
        context.colorspace, context.color_range = Colorspace.ITU709, ColorRange.MPEG
        context.color_primaries = context.color_trc = BT709
        for picture in pictures:
            frame = av.VideoFrame.from_ndarray(picture, format="rgb24").reformat(
                format="yuv420p", dst_colorspace=Colorspace.ITU709, dst_color_range=ColorRange.MPEG
            )
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
