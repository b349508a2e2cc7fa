"""Runs that were changed while they went on: resumed to the same digest, and read as played."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers_interventions import drawn_plan, given, hunted_with
from helpers_scenarios import scenario_of
from helpers_world import RUN, small
from hypothesis import given as drawn
from hypothesis import settings
from hypothesis import strategies as st

import encircle
from encircle.protocol.codec import decode, encode
from encircle.protocol.messages import Intervention
from encircle.replay.replaying import replay
from encircle.runlog.ground_truth import ground_truth_of
from encircle.runlog.recorded_log import log_of_recording
from encircle.runner.hunts import resume
from encircle.world.loading.interventions import as_played
from encircle.world.recording.recording import Recording, RecordingError, read_recording
from encircle.world.recording.resuming import digest_of, rebuild
from encircle.world.recording.run_directory import versions


def recording_of(scenario, messages, played=None):
    """A recording that holds these messages, as if it had been read."""
    topics = [(tick, key.split("/", 2)[2], payload) for tick, key, payload in messages]
    if played is None:
        played = scenario
        for _, _, payload in given(messages):
            played = as_played(played, payload, RUN)
    return Recording(
        Path("recording.mcap"),
        played,
        scenario.seed,
        RUN,
        tuple(topics),
        False,
        versions(),
        written=scenario,
    )


@settings(deadline=None, derandomize=True, max_examples=20)
@drawn(st.integers(0, 10**6), st.floats(0.0, 1.0))
def test_cut_anywhere_a_run_goes_on_to_the_same_digest(seed, share):
    scenario = scenario_of(seed)
    plan = drawn_plan(seed, scenario.ids, scenario.ticks_max)
    whole, messages = hunted_with(scenario, plan)
    length = int(share * len(messages))
    resumed = rebuild(recording_of(scenario, messages[:length]))
    kept = len(given(messages[:length]))
    # Whoever gave the events before the cut gives the later ones again.
    later: dict = {}
    for tick, _, payload in given(messages)[kept:]:
        later.setdefault(tick, []).append(decode(Intervention, payload, RUN).event)
    result, again = hunted_with(scenario, later, resumed)
    assert again == messages
    assert result.digest == whole.digest
    assert result.interventions == whole.interventions


PLAN = [
    {"kind": "loss", "rate": 0.7, "tick": 12},
    {"kind": "silence", "robot": "r2", "tick": 20, "ticks": 15},
    {"kind": "move-target", "position": [3.0, 1.0], "tick": 30},
    {"kind": "partition", "groups": [["r1", "r2"], ["r3", "r4"]], "tick": 41},
    {"kind": "heal", "tick": 55},
]


@pytest.fixture(scope="module")
def changed(tmp_path_factory):
    """A recorded hunt that was changed, and one whose scenario has the same events written."""
    path = tmp_path_factory.mktemp("changed")
    interventions = encircle.Interventions()
    for event in PLAN:
        interventions.give(event)
    longer = ["target.step_m_max=0.6", "ticks_max=100"]
    hunt = encircle.run(
        "sim1", link="memory", out=path / "run", overrides=longer, interventions=interventions
    )
    written = encircle.run(
        {**json.loads(hunt.scenario.model_dump_json(exclude_unset=True)), "events": PLAN},
        link="memory",
        out=path / "written",
    )
    return hunt, written, path


def test_the_recording_replays_and_its_digest_comes_out_again(changed):
    hunt, written, path = changed
    recording = read_recording(path / "run")
    assert replay(recording).same
    assert digest_of(recording) == hunt.digest != written.digest
    assert digest_of(read_recording(path / "written")) == written.digest
    assert json.loads((path / "run" / "summary.json").read_text())["interventions"] == PLAN
    assert list(hunt.result.interventions) == PLAN


def test_all_who_read_the_recording_see_the_scenario_as_played(changed):
    _, _, path = changed
    recording, expected = read_recording(path / "run"), read_recording(path / "written")
    assert recording.scenario.events == expected.scenario.events
    assert recording.scenario_as_written.events == ()
    truth, as_expected = ground_truth_of(recording), ground_truth_of(expected)
    np.testing.assert_array_equal(truth.positions, as_expected.positions)
    np.testing.assert_array_equal(truth.silent, as_expected.silent)
    assert truth.silent.sum() == 15
    assert truth.moved_by_hand == as_expected.moved_by_hand == (30,)
    log, log_expected = log_of_recording(recording), log_of_recording(expected)
    assert log.scenario.events == log_expected.scenario.events
    assert log.moved_by_hand == (30,)
    np.testing.assert_array_equal(log.due, log_expected.due)


@pytest.mark.parametrize("share", [0.2, 0.6, 0.95])
def test_a_recording_that_was_cut_off_on_disk_goes_on_as_far_as_it_is_there(
    changed, tmp_path, share
):
    hunt, _, path = changed
    whole = (path / "run" / "recording.mcap").read_bytes()
    into = tmp_path / "run"
    into.mkdir()
    (into / "recording.mcap").write_bytes(whole[: int(share * len(whole))])
    there = len(read_recording(into).scenario.events)
    interventions = encircle.Interventions()
    for event in PLAN[there:]:
        interventions.give(event)
    # The events were given at tick 0, and are in the first chunk or not recorded at all.
    assert there in (0, len(PLAN))
    resumed = resume(into, link="memory", interventions=interventions)
    assert resumed.result.interventions == hunt.result.interventions
    if there:
        assert resumed.digest == hunt.digest
    assert resumed.scenario.events == ()
    assert json.loads((into / "summary.json").read_text())["scenario"]["events"] == []


def test_an_intervention_that_was_changed_on_disk_is_refused_with_the_place():
    scenario = small("target.behaviour=flee")
    _, messages = hunted_with(scenario, {2: [{"kind": "loss", "rate": 0.5}]})
    place = next(k for k, m in enumerate(messages) if m[1].endswith("intervention"))
    tick, key, payload = messages[place]
    for event, reason in (
        ({"kind": "loss", "tick": 3, "rate": 0.9}, "radio of tick 3|pose of tick|observation"),
        ({"kind": "loss", "tick": 1, "rate": 0.5}, "tick 2: intervention.tick = 1: has begun"),
        ({"kind": "silence", "tick": 3, "robot": "r9"}, "intervention.robot = 'r9'"),
    ):
        other = encode(replace(decode(Intervention, payload, RUN), event=event), RUN)
        tampered = [*messages[:place], (tick, key, other), *messages[place + 1 :]]
        with pytest.raises(RecordingError, match=reason):
            rebuild(recording_of(scenario, tampered, played=scenario))
