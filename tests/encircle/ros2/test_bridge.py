"""The bridge without Zenoh: what it sends on, passes over and refuses, and how it ends."""

import pytest
from helpers_scene import frames_of, hunted

from encircle.protocol.codec import encode
from encircle.protocol.errors import ConnectionClosed
from encircle.protocol.keys import world_key
from encircle.protocol.messages import State
from encircle.ros2.bridge import STATES_MAX, Bridge, TimeSource, usual_time
from encircle.ros2.message_types import MessageTypes
from encircle.ros2.releases import RELEASES
from encircle.scene.stage import stage_of
from encircle.world.loading.load import load
from encircle.world.recording.recording import decoded

RUN = "g1"
TYPES = MessageTypes(RELEASES["jazzy"])
STAGE = stage_of(load({"team": {"robots": 2}}), 1, RUN)


def state(tick, robots=2):
    spots = tuple((float(tick + k), 0.0) for k in range(robots))
    return State(tick, spots, (0.0,) * robots, (9.0, 9.0), False, ())


@pytest.fixture(autouse=True)
def impatient(monkeypatch):
    """What is there is there at once: nothing is under way."""
    monkeypatch.setattr("encircle.ros2.bridge.LINGER_S", 0.02)
    monkeypatch.setattr("encircle.ros2.bridge.STEP_S", 0.01)


class Session:
    """The hunt's side: what the bridge listens to."""

    def subscribe(self, key, take):
        assert key == world_key(RUN, "state")
        self.take = take

    def watch(self, key, tell):
        assert key == world_key(RUN, "alive")
        self.tell = tell

    def show(self, *states):
        for shown in states:
            self.take("key", shown if isinstance(shown, bytes) else encode(shown, RUN))


class Node:
    """ROS 2's side: what the bridge says."""

    def __init__(self):
        self.sent = []
        self.closed = False

    def advertise(self, topics):
        self.topics = [topic.name for topic in topics]

    def publish(self, topic, payload):
        if self.closed:
            raise ConnectionClosed("gone")
        self.sent.append((topic.name, TYPES.decoded(payload, topic.type_name)))

    def of(self, name):
        return [message for topic, message in self.sent if topic == name]


class Bridged:
    def __init__(self, time_source=TimeSource.SIMULATED, stage=STAGE, frames=()):
        self.hunt, self.node, self.lines = Session(), Node(), []
        self.frames = list(frames)
        told = (self.hunt, RUN, stage, self._new_frames)
        self.bridge = Bridge(*told, self.node, TYPES, time_source, self.lines.append)

    def _new_frames(self):
        frames, self.frames = self.frames, []
        return frames

    def forward(self, *states, s_max=3600.0):
        """All that comes of a run whose world shows these states and ends."""
        self.hunt.tell("key", True)
        self.hunt.show(*states)
        self.hunt.tell("key", False)
        return self.bridge.forward(s_max)


def test_every_state_is_sent_on_with_the_runs_time():
    bridged = Bridged()
    report = bridged.forward(*(state(tick) for tick in range(5)))
    assert (report.sent, report.passed_over, report.refused) == (5, 0, 0)
    assert (report.ended, report.failed) == ("the world has ended", False)
    poses = bridged.node.of("/r1/pose")
    assert [message.pose.position.x for message in poses] == [0.0, 1.0, 2.0, 3.0, 4.0]
    clocks = [(m.clock.sec, m.clock.nanosec) for m in bridged.node.of("/clock")]
    assert clocks == [(0, 100_000_000 * tick) for tick in range(5)]
    assert [m.header.stamp for m in poses] == [m.clock for m in bridged.node.of("/clock")]
    assert {name for name, _ in bridged.node.sent} == {*bridged.node.topics} - {"/encircle/traffic"}


def test_what_is_said_at_a_tick_is_shown_when_it_is_known():
    recording, _ = hunted("sim1", ["ticks_max=3"])
    stage = stage_of(recording.scenario, 1, RUN)
    bridged = Bridged(stage=stage, frames=frames_of(recording)[:3])
    bridged.forward(state(0, robots=4))
    stamps = [m.markers[0].header.stamp.nanosec for m in bridged.node.of("/encircle/traffic")]
    assert stamps == [0, 100_000_000, 200_000_000]


def test_by_the_wall_there_is_no_clock_and_stamps_never_go_back():
    bridged = Bridged(TimeSource.WALL)
    bridged.forward(*(state(tick) for tick in range(5)))
    assert "/clock" not in bridged.node.topics
    assert bridged.node.of("/clock") == []
    stamps = [m.header.stamp for m in bridged.node.of("/r1/pose")]
    assert stamps == sorted(stamps, key=lambda stamp: (stamp.sec, stamp.nanosec))
    assert stamps[0].sec > 1_700_000_000


def test_a_last_state_that_was_missed_is_shown_with_what_was_said():
    recording, _ = hunted("sim1", ["ticks_max=3"])
    stage = stage_of(recording.scenario, 1, RUN)
    bridged = Bridged(stage=stage, frames=frames_of(recording))
    report = bridged.forward(*(state(tick, robots=4) for tick in range(3)))
    truth = [decoded(State, recording, 3, p) for t, _, p in recording.of_channel("state") if t == 3]
    last = bridged.node.of("/r2/pose")[-1].pose.position
    assert (last.x, last.y) == truth[0].robots[1]
    assert report.sent == 4
    assert len(bridged.node.of("/encircle/traffic")) == 4


@pytest.mark.parametrize(("clock", "source"), [("lockstep", "sim"), ("wall", "wall")])
def test_the_usual_time_is_that_of_the_run(clock, source):
    stage = stage_of(load({"team": {"robots": 2}, "clock": clock}), 1, RUN)
    assert usual_time(stage) == TimeSource(source)


def test_a_velocity_after_a_gap_is_over_the_ticks_between():
    bridged = Bridged()
    bridged.forward(state(0), state(4))
    assert bridged.node.of("/r1/odom")[1].twist.twist.linear.x == pytest.approx(10.0)


def test_a_run_that_begins_anew_has_no_velocities_from_before():
    bridged = Bridged()
    bridged.forward(state(4), state(0))
    assert bridged.node.of("/r1/odom")[1].twist.twist.linear.x == 0.0


def test_when_more_comes_than_is_sent_the_oldest_are_passed_over_and_counted():
    bridged = Bridged()
    report = bridged.forward(*(state(tick) for tick in range(STATES_MAX + 10)))
    assert (report.sent, report.passed_over) == (STATES_MAX, 10)
    assert bridged.node.of("/r1/pose")[0].pose.position.x == 10.0


def test_what_is_no_state_of_this_run_is_refused_counted_and_told():
    bridged = Bridged()
    report = bridged.forward(b"", encode(state(0), "g2"), state(0, robots=3), state(1))
    assert (report.sent, report.refused) == (1, 3)
    assert len(bridged.lines) == 3
    assert bridged.lines[2] == "ros2: refused a state: it is of 3 robots, the run has 2"


def test_a_run_without_a_world_is_not_waited_for_for_ever():
    report = Bridged().bridge.forward(world_s_max=0.01)
    assert (report.failed, report.ended) == (True, "no world of run g1 came within 0.01 s")


def test_a_signal_ends_it():
    bridged = Bridged()
    bridged.hunt.tell("key", True)
    bridged.bridge.interrupt("SIGTERM")
    report = bridged.bridge.forward()
    assert (report.ended, report.failed) == ("stopped by SIGTERM", False)


def test_without_its_connection_it_ends():
    bridged = Bridged()
    bridged.node.closed = True
    report = bridged.forward(state(0))
    assert (report.ended, report.failed) == ("the connection is closed: gone", True)
