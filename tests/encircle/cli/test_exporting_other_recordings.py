"""Recordings with interventions, and of an earlier version, in every format, figure and measure."""

import gzip

import pandas as pd
import pytest
from helpers_export_readers import EVENTS_OF, TICKS_OF
from helpers_paths import TESTS
from helpers_scene import hunted
from PIL import Image

import encircle
from encircle import Interventions
from encircle.cli.exporting import FORMATS
from encircle.cli.main import main
from encircle.exports.pictures.canvas import Canvas
from encircle.figures.run_figures import draw_run, draw_snapshots, draw_trajectories
from encircle.measures.registry import measure
from encircle.runlog.recorded_log import log_of_recording
from encircle.world.loading.load import load
from encircle.world.recording.recording import read_recording
from encircle.world.scenario.model import Scenario

EARLIER = TESTS / "data" / "recorded_by_0_1_0"
EARLIER_TICKS = 12
GIVEN = [
    {"kind": "delay", "delay_s": 0.3, "tick": 2},
    {"kind": "loss", "rate": 0.7, "tick": 3, "ticks": 5},
    {"kind": "partition", "groups": [["r1", "r2"], ["r3", "r4"]], "tick": 4, "ticks": 4},
    {"kind": "range", "range_m": 5.0, "tick": 5, "ticks": 2},
    {"kind": "outage", "sender": "r1", "receiver": "r4", "tick": 5, "ticks": 2},
    {"kind": "silence", "robot": "r2", "tick": 6, "ticks": 5},
    {"kind": "crash", "robot": "r3", "tick": 7, "ticks": 4},
    {"kind": "move-target", "position": [3.0, 3.0], "tick": 8},
    {"kind": "heal", "tick": 9},
]
SHOWN = [
    (2, "by hand: every packet takes 300 ms"),
    (3, "by hand: every link loses 70 % of packets"),
    (4, "by hand: the team is cut: r1, r2 | r3, r4"),
    (5, "by hand: radios reach 5 m"),
    (5, "by hand: outage from r1 to r4"),
    (6, "by hand: r2's radio is off"),
    (7, "r3 is lost"),
    (8, "the team is whole again"),
    (8, "by hand: the target is moved towards (3, 3) m"),
    (9, "by hand: silences, outages and partitions are over"),
    (11, "r3 is back"),
]
"""What is to be seen of these, by tick."""
SMALL = ["--size", "480x270"]
VIDEOS = {"mp4": [*SMALL, "--fps", "10"], "gif": [*SMALL, "--fps", "10"], "png": SMALL}


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Directories of runs: one with interventions, two that version 0.1.0 recorded."""
    into = tmp_path_factory.mktemp("runs")
    interventions = Interventions()
    for event in GIVEN:
        interventions.give(event)
    changes = ["ticks_max=16"]
    encircle.run(
        "sim1", link="memory", overrides=changes, out=into / "hand", interventions=interventions
    )
    for name in ("lossy", "by-the-clock"):
        (into / name).mkdir()
        packed = (EARLIER / name / "recording.mcap.gz").read_bytes()
        (into / name / "recording.mcap").write_bytes(gzip.decompress(packed))
    return into


def exported(run, name, out, capsys):
    """Export a run, of which nothing is doubted and no line is told."""
    arguments = [str(run), "--to", name, "--out", str(out), *VIDEOS.get(name, ())]
    assert main(["export", *arguments]) == 0
    told = capsys.readouterr().err.splitlines()
    assert [line for line in told if not line.startswith("drawn: ")] == []
    return out


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize(
    ("run", "last_tick"), [("hand", 16), ("lossy", EARLIER_TICKS), ("by-the-clock", EARLIER_TICKS)]
)
def test_it_is_exported_whole(run, last_tick, name, runs, tmp_path, capsys):
    out = exported(runs / run, name, tmp_path / "out", capsys)
    if name in TICKS_OF:
        tick_s = read_recording(runs / run).scenario.tick_s
        assert TICKS_OF[name](out, tick_s) == list(range(last_tick + 1))


@pytest.mark.parametrize("name", EVENTS_OF)
def test_interventions_are_among_the_events(name, runs, tmp_path, capsys):
    events = EVENTS_OF[name](exported(runs / "hand", name, tmp_path / "out", capsys))
    assert [event for event in SHOWN if event not in events] == []


def test_interventions_are_told_in_pictures(runs, tmp_path, capsys, monkeypatch):
    words, text = [], Canvas.text

    def spied(canvas, content, *arguments, **options):
        words.append(content)
        text(canvas, content, *arguments, **options)

    monkeypatch.setattr(Canvas, "text", spied)
    for tick, told in SHOWN:
        words.clear()
        out = tmp_path / f"{tick}-{told[:12]}.png"
        arguments = ["--to", "png", "--tick", str(tick), "--out", str(out), *SMALL]
        assert main(["export", str(runs / "hand"), *arguments]) == 0
        assert told in words


def test_what_was_lost_by_hand_is_lost_in_the_tables(runs, tmp_path, capsys):
    out = exported(runs / "hand", "parquet", tmp_path / "out", capsys)
    packets = pd.read_parquet(out / "packets.parquet")
    cut = packets[packets["fate"] == "partition"]
    assert set(cut["tick"]) <= {4, 5, 6, 7}
    left = {"r1", "r2"}
    assert all(
        (a in left) != (b in left) for a, b in zip(cut["sender"], cut["receiver"], strict=True)
    )
    assert set(packets[packets["tick"] < 3]["fate"]) == {"arrived"}
    assert (packets[packets["tick"] == 2]["delay_ticks"] == 3).all()


@pytest.mark.parametrize("run", ["hand", "lossy", "by-the-clock"])
def test_it_is_drawn(run, runs, tmp_path):
    recording = read_recording(runs / run)
    draw_run(runs / run, tmp_path / "run.png")
    draw_trajectories(recording, tmp_path / "paths.png")
    draw_snapshots(recording, [0, 4, 8, 12], tmp_path / "snapshots.png")
    for path in tmp_path.iterdir():
        with Image.open(path) as image:
            assert len(image.convert("L").getcolors()) > 20, path.name


def test_it_is_measured_like_a_run_whose_scenario_has_these_events(runs):
    scenario = Scenario.model_validate(
        {**load("sim1").model_dump(), "ticks_max": 16, "events": GIVEN}
    )
    measured = measure(log_of_recording(read_recording(runs / "hand")))
    assert measured == pytest.approx(measure(hunted(scenario, seed=1)[1]), nan_ok=True)


@pytest.mark.parametrize("arguments", [[], ["--check"], ["--digest"], ["--robots"]])
@pytest.mark.parametrize("run", ["hand", "lossy"])
def test_it_is_read_back(run, arguments, runs, capsys):
    assert main(["replay", str(runs / run), *arguments]) == 0
    assert capsys.readouterr().err == ""


def test_of_a_run_by_the_clock_measures_are_refused_in_a_line(runs, capsys):
    assert main(["replay", str(runs / "by-the-clock"), "--check"]) == 0
    assert main(["replay", str(runs / "by-the-clock"), "--robots"]) == 2
    told = capsys.readouterr().err
    assert "clock = 'wall': in a run by the clock robots miss ticks" in told
    assert told.count("\n") == 1
