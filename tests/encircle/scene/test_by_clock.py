"""Frames of runs by the clock, over made-up networks: beliefs are those of the robots."""

import numpy as np
import pytest
from helpers_networks import delays_us
from helpers_real_time import Simulated, by_clock

from encircle.agents.teamwork.peers import planning_team
from encircle.runlog.ground_truth import ground_truth_of
from encircle.runlog.runlog import belief_of
from encircle.scene.builder import BeliefsLeftOut, SceneBuilder, scene_of_recording
from encircle.world.recording.recording import read_recording

CHANNEL = (
    'channel.loss={model="bernoulli",rate=0.3}',
    'channel.delay={model="exponential",mean_s=0.05}',
)
CRASH = 'events=[{kind="crash",robot="r3",tick=20,ticks=30}]'


class Watched(Simulated):
    """A run whose robots' beliefs are noted as they decide. ``believed``: by tick and robot."""

    def __post_init__(self):
        super().__post_init__()
        self.believed, self.heard = {}, {}

    def _answer(self, robot, now_us):
        before = self.cores[robot].tick
        super()._answer(robot, now_us)
        core = self.cores[robot]
        if core.tick != before:
            belief = belief_of(core)
            team = planning_team(
                belief.peers, core.config.own, belief.position, core.tick, core.config.parameters
            )
            self.believed[core.tick, robot] = belief, team
            self.heard[core.tick, robot] = [p and p.tick for p in core.state.packets]


def watched(out, *changes, delay=delays_us, frozen=None):
    run = Watched(by_clock(*changes), delay, frozen_us=frozen or {}, out=out)
    run.run()
    return run, scene_of_recording(read_recording(out))


def assert_believed(run, scene):
    """Every belief that is shown is the robot's own; returns how many are."""
    shown = 0
    for frame in scene.frames:
        for k, belief in enumerate(frame.beliefs):
            if belief is None:
                continue
            shown += 1
            own, team = run.believed[frame.tick, scene.stage.robots[k]]
            assert belief.position == own.position
            places = {p.robot: (p.x, p.y) for p in belief.peers if p.planned_with}
            expected = dict(zip(team.members, team.positions, strict=True))
            del expected[k]
            assert places == expected
            assert belief.estimate == (own.estimate and own.estimate[:4])
    return shown


@pytest.mark.parametrize("radio", ["world", "direct"])
@pytest.mark.parametrize("changes", [(), CHANNEL, (*CHANNEL, CRASH)])
def test_beliefs_are_those_of_the_robots(tmp_path, radio, changes):
    run, scene = watched(tmp_path, f"radio={radio}", *changes)
    shown = assert_believed(run, scene)
    # What a robot decided at the very end may not have come to the world.
    assert len(run.believed) - 8 <= shown <= len(run.believed)
    assert not any(frame.beliefs_unsure for frame in scene.frames)


@pytest.mark.parametrize("radio", ["world", "direct"])
def test_a_robot_that_passes_ticks_over_has_no_belief_at_them(tmp_path, radio):
    frozen = {"r2": (300_000, 700_000)}
    run, scene = watched(tmp_path, f"radio={radio}", *CHANNEL, frozen=frozen)
    assert assert_believed(run, scene) >= len(run.believed) - 8
    gap = [f.tick for f in scene.frames[:-3] if f.beliefs[1] is None]
    assert 18 <= len(gap) <= 22
    assert not any(frame.beliefs_unsure for frame in scene.frames)
    assert not any(any(frame.lost) for frame in scene.frames)


def test_where_robots_hear_each_other_ages_are_of_what_they_have_heard(tmp_path):
    def losing(sender, receiver, channel, number):
        lost = (sender, receiver, channel) == ("r1", "r2", "pose") and 30 <= number < 60
        return None if lost else delays_us(sender, receiver, channel, number)

    run, scene = watched(tmp_path, "radio=direct", delay=losing)
    assert scene.frames[58].ages[1][0] >= 25
    assert max(scene.frames[58].ages[0]) < 5
    for frame in scene.frames[:-3]:
        for k, robot in enumerate(scene.stage.robots):
            if (frame.tick, robot) in run.heard:
                heard = run.heard[frame.tick, robot]
                expected = [-1 if sent is None else frame.tick - sent for sent in heard]
                expected[k] = 0
                assert list(frame.ages[k]) == expected


def test_a_packet_that_the_world_never_got_makes_its_receiver_unsure_and_no_other(tmp_path):
    def losing(sender, receiver, channel, number):
        lost = (sender, receiver, channel, number) == ("r1", "world", "pose", 30)
        late = sender == "r1" and channel == "pose" and number == 30 and receiver in ("r3", "r4")
        return None if lost or late else delays_us(sender, receiver, channel, number)

    with pytest.warns(BeliefsLeftOut, match="what r2 believed is left out"):
        run, scene = watched(tmp_path, "radio=direct", delay=losing)
    assert_believed(run, scene)
    unsure = [f.beliefs_unsure for f in scene.frames]
    assert set(unsure[:30]) == {()}
    assert set(unsure[33:-1]) == {("r2",)}
    (told,) = [e for f in scene.frames for e in f.events if e.kind == "unsure"]
    assert "packet 30 of r1, which it received, did not reach the world" in told.text


def test_truth_and_lost_robots_are_those_of_the_ground_truth(tmp_path):
    _, scene = watched(tmp_path, "radio=world", CRASH)
    shown = ground_truth_of(read_recording(tmp_path))
    assert np.array_equal([f.robots for f in scene.frames], shown.robots)
    assert np.array_equal([f.lost for f in scene.frames], shown.lost)
    kinds = [(f.tick, e.kind) for f in scene.frames for e in f.events if e.kind in ("lost", "back")]
    assert kinds == [(20, "lost"), (50, "back")]


def test_a_viewer_that_comes_later_is_sure_of_who_begins_anew(tmp_path):
    _, scene = watched(tmp_path, "radio=world", CRASH)
    recording = read_recording(tmp_path)
    builder, frames = SceneBuilder(recording.scenario, recording.seed, recording.run), []
    for tick, topic, payload in recording.messages:
        if tick >= 10:
            frames += builder.take(tick, topic, payload)
    frames += builder.finish()
    assert frames[0].tick == 10
    assert set(frames[0].beliefs_unsure) == {"r1", "r2", "r3", "r4"}
    assert set(frames[60].beliefs_unsure) == {"r1", "r2", "r4"}
    assert frames[60].beliefs[2] == scene.frames[70].beliefs[2] is not None
