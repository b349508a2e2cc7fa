"""``encircle export RUN --to mp4``, ``gif`` and ``png``: a hunt as a video, or a tick of it.

The pictures are those of ``encircle.exports.pictures``. A video lasts as long as the run, divided
by the speed, and a second more, in which the end stands still.
"""

import re
from collections.abc import Iterator
from math import inf
from pathlib import Path

from encircle.exports.pictures.canvas import Pixels
from encircle.exports.pictures.layout import size_problem
from encircle.exports.pictures.picture import Picture, PictureStyle
from encircle.exports.pictures.timeline import PICTURES_MAX, Timeline, timeline_of
from encircle.exports.refused_option import OptionRefused
from encircle.progress import Progress
from encircle.protocol.errors import did_you_mean
from encircle.protocol.process.interrupts import check
from encircle.scene.builder import scene_of_recording
from encircle.scene.palette import THEMES
from encircle.world.recording.recording import Recording
from encircle.world.recording.run_directory import RunDirectoryError

SAMPLES_MAX = 12
"""From how many pictures a GIF's palette is taken."""
FPS_MAX, GIF_FPS_MAX, SPEED_RANGE = 120.0, 50.0, (0.01, 100.0)


class VideoError(RunDirectoryError):
    """A video that cannot be made; the message says why, and what to do."""


def export_mp4(
    recording: Recording,
    out: Path,
    *,
    fps: float = 30.0,
    speed: float = 1.0,
    size: str = "1280x720",
    belief: str = "",
    packets: bool = True,
    theme: str = "light",
) -> None:
    """Write a recording as a video in MP4.

    ``fps``: pictures per second; ``speed``: seconds of the run in a second of the video; ``size``:
    width and height in pixels; ``belief``: the robot whose belief is drawn over the truth;
    ``packets``: whether packets are drawn; ``theme``: light or dark. Raises ``OptionRefused``
    and ``VideoError``.
    """
    # Imported here: a GIF needs no PyAV, and a video no Pillow.
    from encircle.exports.pictures.mp4 import ENCODERS, video_encoder, write_mp4

    if video_encoder() is None:
        raise VideoError(f"this PyAV has none of the encoders {', '.join(ENCODERS)}: use --to gif")
    picture, timeline, style = _prepared(
        recording, FPS_MAX, fps, speed, size, belief, packets, theme
    )
    write_mp4(_pictures(picture, timeline), out, style.size, timeline.fps)


def export_gif(
    recording: Recording,
    out: Path,
    *,
    fps: float = 12.0,
    speed: float = 1.0,
    size: str = "800x450",
    belief: str = "",
    packets: bool = True,
    theme: str = "light",
) -> None:
    """Write a recording as an animation in GIF that repeats for ever; options as for MP4."""
    from encircle.exports.pictures.gif import write_gif

    picture, timeline, style = _prepared(
        recording, GIF_FPS_MAX, fps, speed, size, belief, packets, theme
    )
    moments = list(timeline.moments())
    samples = [picture.at(t) for t in moments[:: -(-len(moments) // SAMPLES_MAX)]]
    write_gif(_pictures(picture, timeline), out, timeline.times_s(), samples, style.colours)


def export_png(
    recording: Recording,
    out: Path,
    *,
    tick: float | None = None,
    size: str = "1280x720",
    belief: str = "",
    packets: bool = True,
    theme: str = "light",
) -> None:
    """Write the picture of one moment of a recording.

    ``tick``: which, and the share of one that has passed: at 20.5 packets are half-way; the last
    one if left out. The other options are those of ``export_mp4``, as is what it raises.
    """
    from PIL import Image

    picture, timeline, _ = _prepared(recording, FPS_MAX, 30.0, 1.0, size, belief, packets, theme)
    first, last = timeline.first_tick, timeline.first_tick + timeline.ticks
    if tick is not None and not first <= tick <= last:
        raise OptionRefused("tick", f"{tick:g}", f"must be from {first} to {last}")
    pixels = picture.at(last if tick is None else tick)
    Image.fromarray(pixels).save(out, format="PNG", optimize=True)


def _prepared(
    recording: Recording,
    fps_max: float,
    fps: float,
    speed: float,
    size: str,
    belief: str,
    packets: bool,
    theme: str,
) -> tuple[Picture, Timeline, PictureStyle]:
    """What draws the pictures, and when they are shown; ``OptionRefused`` for a wrong option."""
    _check_number("fps", fps, 1.0, fps_max)
    _check_number("speed", speed, *SPEED_RANGE)
    if theme not in THEMES:
        raise OptionRefused("theme", theme, f"must be {' or '.join(THEMES)}")
    robots = recording.scenario.ids
    if belief and belief not in robots:
        hint = did_you_mean(belief, robots)
        raise OptionRefused("belief", belief, f"no such robot{hint}; there are {', '.join(robots)}")
    if belief and recording.scenario.clock == "wall":
        raise OptionRefused(
            "belief", belief, "of a run by the clock it is not known what robots saw"
        )
    believer = robots.index(belief) if belief else None
    style = PictureStyle(_size(size), theme, believer, packets, speed)
    scene = scene_of_recording(recording, beliefs=bool(belief))
    ticks = scene.frames[0].tick, scene.frames[-1].tick
    timeline = timeline_of(*ticks, scene.stage.tick_s, fps, speed)
    if timeline.count > PICTURES_MAX:
        raise VideoError(
            f"{timeline.count} pictures are more than {PICTURES_MAX}: raise speed or lower fps"
        )
    return Picture(scene, style), timeline, style


def _check_number(name: str, value: float, low: float, high: float) -> None:
    if not low <= value <= high < inf:
        raise OptionRefused(name, f"{value:g}", f"must be from {low:g} to {high:g}")


def _size(text: str) -> tuple[int, int]:
    """``1280x720`` as width and height."""
    found = re.fullmatch(r"(\d{1,5})x(\d{1,5})", text)
    if found is None:
        raise OptionRefused("size", text, "must be WIDTHxHEIGHT in pixels, such as 1280x720")
    width, height = int(found[1]), int(found[2])
    if problem := size_problem(width, height):
        raise OptionRefused("size", text, problem)
    return width, height


def _pictures(picture: Picture, timeline: Timeline) -> Iterator[Pixels]:
    """The pictures of a video; one that is shown several times in a row is drawn once."""
    last, drawn = None, None
    with Progress("drawn", "pictures") as tell:
        for k, moment in enumerate(timeline.moments()):
            check(f" at picture {k} of {timeline.count}")
            if drawn is None or moment != last:
                last, drawn = moment, picture.at(moment)
            yield drawn
            tell(k + 1, timeline.count)
