"""Frames against the log of the run, its ground truth and the measures: other ways to the same."""

import gzip
from dataclasses import replace

import numpy as np
import pytest
from helpers_interventions import hunted_with
from helpers_paths import TESTS
from helpers_scenarios import scenario_of
from helpers_scene import RUN, frames_of, hunted
from helpers_scene_log import assert_as_logged
from helpers_world import RUN as TESTED

from encircle.protocol.codec import encode
from encircle.protocol.errors import MalformedMessage
from encircle.protocol.messages import Intervention
from encircle.runlog.ground_truth import ground_truth_of
from encircle.runlog.recorded_log import log_of_recording
from encircle.scene.builder import SceneBuilder, scene_of_recording
from encircle.world.loading.interventions import as_played
from encircle.world.loading.load import load
from encircle.world.recording.recording import read_recording

LOSS = "channel.loss={model='bernoulli', rate=0.3}"
DELAY = "channel.delay={model='uniform', low_s=0.05, high_s=0.6}"
NOISE = "sensing.noise_m_std=0.05"
TWICE = "channel.duplication.rate=0.3"
EVENTS = (
    "events=[{kind='crash', tick=6, ticks=7, robot='r2'}, {kind='silence', tick=3, ticks=9,"
    " robot='r1'}, {kind='partition', tick=14, ticks=5, groups=[['r1','r2'],['r3','r4']]},"
    " {kind='move-target', tick=9, position=[1.0,1.0]}, {kind='outage', tick=2, ticks=2}]"
)
CASES = [
    ("sim1", [LOSS, DELAY, NOISE]),
    ("sim2", [LOSS, NOISE, "ticks_max=60"]),
    ("sim3", ["robot.peer_policy=hold", "robot.peer_age_ticks_max=3", "ticks_max=60", TWICE]),
    ("sim4", ["team.strategy=pursuit", "team.motion=unicycle", "ticks_max=30"]),
    ("sim1", [LOSS, EVENTS, "ticks_max=30", "team.jitter_m=0.5"]),
    ("sim1", [LOSS, "team.robots={count=4, r2={strategy='auction'}}", "ticks_max=25"]),
    ("sim1", ["team.positions=[[5.0, 0.0]]", "ticks_max=9"]),
    ("sim1", ["robot.detections=fuse", LOSS, "ticks_max=25"]),
]


@pytest.mark.parametrize(("scenario", "changes"), CASES)
def test_frames_show_what_log_and_measures_have(scenario, changes):
    recording, log = hunted(scenario, changes)
    assert_as_logged(frames_of(recording), log)


@pytest.mark.parametrize("seed", range(6))
def test_frames_of_a_drawn_run_show_what_log_and_measures_have(seed):
    recording, log = hunted(scenario_of(seed), seed=seed)
    assert_as_logged(frames_of(recording), log)


@pytest.mark.parametrize(("scenario", "changes"), CASES)
def test_frames_show_the_ground_truth(scenario, changes):
    recording, _ = hunted(scenario, changes)
    shown, frames = ground_truth_of(recording), frames_of(recording)
    assert np.array_equal([f.lost for f in frames], shown.lost)
    assert np.array_equal([f.silent for f in frames], shown.silent)
    assert tuple(f.contacts for f in frames) == shown.contacts
    moved = [f.tick for f in frames if any(e.kind == "moved" for e in f.events)]
    assert tuple(moved) == shown.moved_by_hand
    kind, text, robots = frames[-1].events[-1]
    if shown.captured:
        assert (kind, robots) == ("capture", shown.captors)
    else:
        assert (kind, text) == ("end", "the time is up")


def test_a_scene_is_made_of_the_frames_of_a_recording():
    recording, _ = hunted("sim1", [LOSS])
    scene = scene_of_recording(recording)
    assert list(scene.frames) == frames_of(recording)
    assert scene.complete
    assert scene.stage.robots == recording.scenario.ids


def test_a_recording_that_is_cut_off_gives_the_beginning():
    recording, _ = hunted("sim1", [LOSS, EVENTS, "ticks_max=20"])
    frames = frames_of(recording)
    for length in range(1, len(recording.messages)):
        short = frames_of(recording, recording.messages[:length])
        if not short:
            assert not any(topic == "world/state" for _, topic, _ in recording.messages[:length])
            continue
        *before, last = short
        assert before == frames[: last.tick]
        whole = frames[last.tick]
        assert (last.robots, last.target, last.ages) == (whole.robots, whole.target, whole.ages)
        assert not last.packets
        assert set(last.beliefs) == set(last.modes) == {None}
    cut = replace(recording, messages=(), complete=False)
    (start,) = scene_of_recording(cut).frames
    assert (start.robots, start.tick) == (frames[0].robots, 0)


BY_HAND = {
    3: [{"kind": "loss", "rate": 0.6}, {"kind": "silence", "robot": "r2", "ticks": 4}],
    6: [{"kind": "move-target", "position": [3.0, 1.0], "tick": 9}, {"kind": "heal"}],
}


def test_what_is_given_while_the_run_goes_on_shows_as_if_it_had_been_written():
    scenario = load("sim1", ["ticks_max=14"])
    _, messages = hunted_with(scenario, BY_HAND)
    told = [(tick, key.split("/", 2)[2], payload) for tick, key, payload in messages]
    shown = []
    # A viewer knows the scenario as written, or with all that was given before it came.
    for known in (scenario, played(scenario, told)):
        builder, frames = SceneBuilder(known, scenario.seed, TESTED), []
        for message in told:
            frames += builder.take(*message)
        shown.append(frames + builder.finish())
    plain = [replace(f, events=()) for f in shown[0]]
    assert plain == [replace(f, events=()) for f in shown[1]]
    written, _ = hunted(played(scenario, told), seed=scenario.seed)
    expected = frames_of(written)
    assert [f.silent for f in shown[0]] == [f.silent for f in expected]
    assert sum(f.silent[1] for f in expected) == 3
    for frames in shown:
        for frame, as_expected in zip(frames, expected, strict=True):
            texts = [event.text.removeprefix("by hand: ") for event in frame.events]
            assert texts == [event.text for event in as_expected.events]
    by_hand = [(f.tick, e.kind) for f in shown[0] for e in f.events if "by hand" in e.text]
    assert by_hand == [(4, "loss"), (4, "silence"), (7, "heal"), (9, "moved")]


def played(scenario, messages):
    for _, topic, payload in messages:
        if topic == "world/intervention":
            scenario = as_played(scenario, payload, TESTED)
    return scenario


@pytest.mark.parametrize(
    "event", [{"kind": "silence", "tick": 3, "robot": "r9"}, {"kind": "storm"}, {}]
)
def test_an_intervention_of_a_stranger_that_makes_no_sense_is_refused(event):
    builder = SceneBuilder(load("sim1"), 1, RUN)
    with pytest.raises(MalformedMessage, match="Intervention: intervention"):
        builder.take(2, "world/intervention", encode(Intervention(2, event), RUN))


@pytest.mark.parametrize("name", ["lossy", "by-the-clock"])
def test_a_recording_of_an_earlier_version_of_the_wire_is_shown_whole(name, tmp_path):
    packed = TESTS / "data" / "recorded_by_0_1_0" / name / "recording.mcap.gz"
    (tmp_path / "recording.mcap").write_bytes(gzip.decompress(packed.read_bytes()))
    recording = read_recording(tmp_path)
    frames = frames_of(recording)
    assert [frame.tick for frame in frames] == list(range(13))
    assert all(None not in frame.beliefs for frame in frames[:-1])
    if name == "lossy":
        assert_as_logged(frames, log_of_recording(recording))
