"""Decisions that take too long: what is said of them, on clocks that the test sets."""

import pytest
from helpers_agents import BODIES, observation

from encircle.agents.brain.robot_core import RobotCore
from encircle.agents.process.slow_decisions import ANSWER_S_MAX, SlowDecisions
from encircle.protocol.codec import encode
from encircle.protocol.keys import robot_key
from encircle.protocol.messages import Setup
from encircle.protocol.plugins import STRATEGIES, PluginFailed

RUN = "run"


class Robot:
    """A robot whose decisions take what the test says."""

    def __init__(self):
        self.core, self.lines = RobotCore("r1", RUN), []
        self.now_s = self.processor_s = 100.0
        self.slow = SlowDecisions(
            self.core, self.lines.append, lambda: self.now_s, lambda: self.processor_s
        )
        self.hear("setup", Setup("r1", ("r1", "r2"), 0.1, "xi-star", BODIES))

    def hear(self, channel, message, took_s=0.0, processor_s=0.0, tick_s=None):
        def decide():
            self.now_s += took_s
            self.processor_s += processor_s
            return self.core.receive(robot_key(RUN, "r1", channel), encode(message, RUN))

        return self.slow.timed(decide, tick_s)

    def decide(self, tick, took_s, processor_s=0.0, tick_s=None):
        answer = self.hear("observation", observation("r1", tick), took_s, processor_s, tick_s)
        assert len(answer) == 2


def test_the_first_that_is_slow_is_told_and_the_others_counted_in_the_end():
    robot = Robot()
    for tick, took_s in enumerate([0.05, 0.1, 0.31, 0.02, 0.75, 0.11]):
        robot.decide(tick, took_s, took_s / 2, tick_s=0.1)
    first = (
        "policy 'xi-star' took 0.31 s at tick 2 (0.155 s of processor time), more than a tick of"
        " 0.1 s: its answer came late"
    )
    assert robot.lines == [first]
    robot.slow.conclude()
    assert robot.lines == [
        first,
        "policy 'xi-star' took more than a tick of 0.1 s for 3 of 6 decisions, 0.75 s at most",
    ]


def test_of_a_single_one_nothing_more_is_said():
    robot = Robot()
    robot.decide(0, 0.2, tick_s=0.1)
    robot.slow.conclude()
    assert len(robot.lines) == 1


def test_in_lock_step_it_is_what_a_world_waits_that_counts():
    robot = Robot()
    robot.decide(0, ANSWER_S_MAX - 0.5)
    assert robot.lines == []
    robot.decide(1, ANSWER_S_MAX + 0.5, 3.0)
    (line,) = robot.lines
    assert line == (
        "policy 'xi-star' took 3.5 s at tick 1 (3 s of processor time), more than the 3 s that a"
        " world waits by default: its answer came late"
    )


@pytest.mark.parametrize("tick_s", [0.1, None])
def test_what_is_no_decision_does_not_count(tick_s):
    robot = Robot()
    seen = observation("r1", 0)
    robot.hear("observation", seen, 0.0, tick_s=tick_s)
    # Asked once more it says the same; a setup may import a policy for long.
    for channel, message in (
        ("observation", seen),
        ("setup", Setup("r1", ("r1", "r2"), 0.1, "xi-star", BODIES, "world", 7, 7)),
        ("observation", observation("r1", 9)),
    ):
        robot.hear(channel, message, 60.0, tick_s=tick_s)
    assert robot.core.setups == 2
    robot.slow.conclude()
    assert robot.lines == []


def test_of_a_policy_that_failed_only_the_failure_is_told():
    robot = Robot()
    robot.core.failed = PluginFailed(STRATEGIES, "xi-star", "r1", 0, ValueError())
    robot.hear("observation", observation("r1", 0), 60.0)
    robot.slow.conclude()
    assert robot.lines == []
