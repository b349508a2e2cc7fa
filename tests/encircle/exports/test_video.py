"""Videos, read back by PyAV and Pillow: pictures, lengths, sizes, colours; and what is refused."""

import os
import sys
from dataclasses import replace

import numpy as np
import pytest
from helpers_exports import lossy_hunt
from helpers_waiting import completed

from encircle.cli.exporting import FORMATS, main
from encircle.exports import video
from encircle.exports.refused_option import OptionRefused
from encircle.exports.video import VideoError, export_gif, export_mp4, export_png
from encircle.protocol.process.interrupts import Interrupted
from encircle.runner.hunts import run
from encircle.scene.palette import LIGHT, ROBOTS

av = pytest.importorskip("av")
Image = pytest.importorskip("PIL.Image")
SMALL = "480x270"
TICKS = 24


def rgb(colour):
    return tuple(bytes.fromhex(colour[1:]))


def decoded(path):
    """The stream's facts and all pictures (height, width, 3) of a video."""
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        facts = (
            stream.codec_context.name,
            stream.codec_context.pix_fmt,
            stream.average_rate,
            float(stream.duration * stream.time_base),
        )
        return facts, [f.to_ndarray(format="rgb24") for f in container.decode(stream)]


def animated(path):
    """Size, loops, length in ms and all pictures of a GIF."""
    with Image.open(path) as image:
        pictures, length_ms = [], 0
        for k in range(image.n_frames):
            image.seek(k)
            length_ms += image.info["duration"]
            pictures.append(np.array(image.convert("RGB")))
        return image.size, image.info["loop"], length_ms, pictures


def test_an_mp4_has_a_picture_for_each_moment_and_plays_in_browsers(tmp_path):
    recording = lossy_hunt()
    export_mp4(recording, tmp_path / "a.mp4", size=SMALL, fps=20.0)
    (codec, pixel_format, rate, length_s), pictures = decoded(tmp_path / "a.mp4")
    assert codec in ("h264", "libvpx-vp9", "vp9")
    assert pixel_format == "yuv420p"
    assert rate == 20
    assert len(pictures) == TICKS * 2 + 20
    assert length_s == pytest.approx(TICKS * 0.1 + 1.0)
    assert {picture.shape for picture in pictures} == {(270, 480, 3)}
    # The index stands before the pictures, or a browser must load all to begin.
    data = (tmp_path / "a.mp4").read_bytes()
    assert data.index(b"moov") < data.index(b"mdat")


def test_an_mp4_has_the_colours_of_the_palette(tmp_path):
    """To within what 4:2:0 and compression do to an even ground."""
    export_mp4(lossy_hunt(), tmp_path / "a.mp4", size=SMALL, fps=5.0, theme="dark")
    _, pictures = decoded(tmp_path / "a.mp4")
    corner = pictures[0][:6, -3:].reshape(-1, 3).astype(int)
    assert np.abs(corner - rgb("#12161C")).max() <= 4


def test_the_end_stands_for_a_second(tmp_path):
    export_mp4(lossy_hunt(), tmp_path / "a.mp4", size=SMALL, fps=10.0)
    _, pictures = decoded(tmp_path / "a.mp4")
    last = pictures[-1].astype(int)
    assert all(np.abs(p.astype(int) - last).mean() < 1.0 for p in pictures[-10:])
    assert np.abs(pictures[-12].astype(int) - last).mean() > 0.01


def test_twice_the_speed_is_half_the_length(tmp_path):
    export_mp4(lossy_hunt(), tmp_path / "a.mp4", size=SMALL, fps=10.0, speed=2.0)
    (*_, length_s), pictures = decoded(tmp_path / "a.mp4")
    assert len(pictures) == TICKS / 2 + 10
    assert length_s == pytest.approx(TICKS * 0.1 / 2 + 1.0)


def test_a_gif_lasts_as_long_as_the_run_repeats_and_has_the_colours_exactly(tmp_path):
    export_gif(lossy_hunt(), tmp_path / "a.gif", size=SMALL, fps=12.0)
    size, loops, length_ms, pictures = animated(tmp_path / "a.gif")
    assert size == (480, 270)
    assert loops == 0
    # 29 pictures of the run, at a twelfth of a second each, and twelve of its end.
    assert length_ms == pytest.approx((29 + 12) * 1000 / 12, abs=10)
    whole = np.unique(np.concatenate([p.reshape(-1, 3) for p in pictures]), axis=0).tolist()
    for colour in (*(LIGHT[r] for r in ("background", "panel", "arrived", "chance")), ROBOTS[2]):
        assert list(rgb(colour)) in whole
    assert len(whole) <= 256


@pytest.mark.parametrize(("export", "name"), [(export_mp4, "a.mp4"), (export_gif, "a.gif")])
def test_equal_recordings_make_equal_files(tmp_path, export, name):
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
        export(lossy_hunt(), tmp_path / folder / name, size=SMALL, fps=4.0)
    assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()


def test_a_video_does_not_depend_on_what_was_in_memory_before(tmp_path):
    """glibc fills what is allocated with this number's complement; elsewhere it does nothing."""
    run("sim1", link="memory", overrides=["ticks_max=24"], out=tmp_path / "hunt")
    for number in ("1", "85"):
        out = tmp_path / f"{number}.mp4"
        arguments = ["--to", "mp4", "--size", SMALL, "--fps", "4", "--out", str(out)]
        command = [sys.executable, "-m", "encircle", "export", str(tmp_path / "hunt"), *arguments]
        done = completed(command, env={**os.environ, "MALLOC_PERTURB_": number})
        assert done.returncode == 0, done.stderr
    assert (tmp_path / "1.mp4").read_bytes() == (tmp_path / "85.mp4").read_bytes()


def test_a_belief_makes_another_video(tmp_path):
    export_gif(lossy_hunt(), tmp_path / "truth.gif", size=SMALL, fps=2.0)
    export_gif(lossy_hunt(), tmp_path / "belief.gif", size=SMALL, fps=2.0, belief="r3")
    truth, belief = (animated(tmp_path / f"{name}.gif")[3] for name in ("truth", "belief"))
    assert len(truth) == len(belief)
    assert all((one != other).any() for one, other in zip(truth, belief, strict=True))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"size": "1280"}, "size 1280: must be WIDTHxHEIGHT"),
        ({"size": "1281x720"}, "size 1281x720: width and height must be even"),
        ({"size": "20x20"}, "size 20x20: must be from 480x270"),
        ({"fps": 0.0}, "fps 0: must be from 1 to 120"),
        ({"fps": float("nan")}, "fps nan: must be"),
        ({"speed": -1.0}, "speed -1: must be from 0.01 to 100"),
        ({"belief": "r9"}, "belief r9: no such robot"),
        ({"theme": "blue"}, "theme blue: must be light or dark"),
    ],
)
def test_options_that_cannot_be_are_named(tmp_path, options, words):
    with pytest.raises(OptionRefused) as refused:
        export_mp4(lossy_hunt(), tmp_path / "a.mp4", **options)
    assert str(refused.value).startswith(words)
    assert "\n" not in str(refused.value)
    assert list(tmp_path.iterdir()) == []


def test_a_video_that_would_never_end_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(video, "PICTURES_MAX", 50)
    with pytest.raises(VideoError, match="pictures are more than 50"):
        export_mp4(lossy_hunt(), tmp_path / "a.mp4")


def test_what_robots_believed_by_the_clock_is_not_known(tmp_path):
    recording = lossy_hunt()
    by_clock = recording.scenario.model_copy(update={"clock": "wall"})
    with pytest.raises(OptionRefused, match="belief r1: of a run by the clock"):
        export_mp4(replace(recording, scenario=by_clock), tmp_path / "a.mp4", belief="r1")


def test_without_an_encoder_for_browsers_a_line_names_gif(tmp_path, monkeypatch):
    from encircle.exports.pictures import mp4

    monkeypatch.setattr(mp4, "ENCODERS", {"no-such-encoder": {}})
    with pytest.raises(VideoError, match="none of the encoders no-such-encoder: use --to gif"):
        export_mp4(lossy_hunt(), tmp_path / "a.mp4")


def test_a_recording_that_is_cut_off_is_shown_as_far_as_it_goes(tmp_path):
    recording = lossy_hunt()
    early = [message for message in recording.messages if message[0] <= 8]
    part = replace(recording, messages=tuple(early), complete=False)
    export_mp4(part, tmp_path / "a.mp4", size=SMALL, fps=10.0)
    _, pictures = decoded(tmp_path / "a.mp4")
    assert len(pictures) == 8 + 10
    nothing = replace(recording, messages=(), complete=False)
    export_mp4(nothing, tmp_path / "b.mp4", size=SMALL, fps=10.0)
    assert len(decoded(tmp_path / "b.mp4")[1]) == 10


def test_the_command_takes_the_options_of_videos(tmp_path, capsys):
    out = tmp_path / "run"
    run("sim1", link="memory", out=out, overrides=["ticks_max=3"])
    given = ["--size", SMALL, "--fps", "10", "--speed", "0.5", "--belief", "r2", "--no-packets"]
    assert main([str(out), "--to", "mp4", "--theme", "dark", *given], "encircle export") == 0
    assert "run.mp4" in capsys.readouterr().out
    _, pictures = decoded(out / "run.mp4")
    assert len(pictures) == 6 + 10
    for wrong, words in (
        (["--to", "mp4", "--fps", "many"], "--fps many: must be a number"),
        (["--to", "mp4", "--fps", "500"], "--fps 500: must be from 1 to 120"),
        (["--to", "gif", "--belief", "r9"], "--belief r9: no such robot; there are r1, r2"),
        (["--to", "gif", "--option", "belief=r9"], "--option belief=r9: no such robot"),
        (["--to", "png", "--tick", "4"], "--tick 4: must be from 0 to 3"),
        (["--to", "png", "--option", "tick=4"], "--option tick=4: must be from 0 to 3"),
        (["--to", "png", "--size", "9x9"], "--size 9x9: must be from 480x270"),
        (["--to", "parquet", "--fps", "3"], "--fps 3: --to parquet has no such option"),
    ):
        with pytest.raises(SystemExit):
            main([str(out), *wrong, "--out", str(tmp_path / "other")], "encircle export")
        assert capsys.readouterr().err.startswith(f"encircle export: error: {words}")
    assert not (tmp_path / "other").exists()


def test_a_video_that_is_stopped_leaves_nothing(tmp_path, monkeypatch):
    """As by Ctrl-C: the signal is looked for before each picture."""
    run("sim1", link="memory", out=tmp_path / "run", overrides=["ticks_max=3"])
    before = sorted((tmp_path / "run").iterdir())

    def stopped(where):
        if where.startswith(" at picture 5 "):
            raise Interrupted(f"stopped{where}")

    monkeypatch.setattr(video, "check", stopped)
    with pytest.raises(Interrupted, match="stopped at picture 5 of 39"):
        main([str(tmp_path / "run"), "--to", "mp4", "--size", SMALL], "encircle export")
    assert sorted((tmp_path / "run").iterdir()) == before


def test_all_three_formats_stand_in_the_table():
    names = ("mp4", "gif", "png")
    assert [FORMATS[name].suffix for name in names] == [".mp4", ".gif", ".png"]
    # Pillow comes with matplotlib, which is in the base install.
    assert [FORMATS[name].extra for name in names] == ["export", "", ""]


def test_a_picture_is_that_of_its_tick_in_the_video(tmp_path):
    """The last picture of a video without loss of colours: a GIF's own colours are exact."""
    export_png(lossy_hunt(), tmp_path / "a.png", size=SMALL)
    export_png(lossy_hunt(), tmp_path / "b.png", size=SMALL, tick=10.5)
    export_gif(lossy_hunt(), tmp_path / "a.gif", size=SMALL, fps=2.0)
    last, middle = (np.array(Image.open(tmp_path / name)) for name in ("a.png", "b.png"))
    assert last.shape == middle.shape == (270, 480, 3)
    shown = animated(tmp_path / "a.gif")[3][-1].astype(int)
    assert np.abs(shown - last).mean() < 1.0 < np.abs(shown - middle).mean()


@pytest.mark.parametrize("tick", [-1.0, 24.5, float("nan")])
def test_a_tick_that_the_run_does_not_have(tmp_path, tick):
    with pytest.raises(OptionRefused, match=f"tick {tick:g}: must be from 0 to 24"):
        export_png(lossy_hunt(), tmp_path / "a.png", tick=tick)
