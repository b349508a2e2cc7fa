"""A robot that does what ROS 2 says: in lock-step, by the clock, and when nothing is said."""

from dataclasses import replace
from math import cos, pi, sin

import pytest
from helpers_agents import BODIES, TEAM, observation
from helpers_connections import in_thread
from helpers_waiting import LONGEST_S, result_of

from encircle.protocol.codec import decode, encode
from encircle.protocol.keys import robot_key
from encircle.protocol.messages import Command, Pose, Setup
from encircle.ros2.commands import Goal, Velocity
from encircle.ros2.steered_robot import (
    COMMAND_S_MAX,
    REFUSED,
    VAIN_WAITS_MAX,
    CommandMail,
    SteeredRobot,
    Steering,
)

RUN, TICK_S = "g1", 0.1
SETUP = Setup("r1", TEAM, TICK_S, "xi-star", BODIES)
FORWARD = Velocity(1.0, 0.0, 0.0)


class Mail(CommandMail):
    """Waits for nobody: what comes while a robot waits is in ``answers``."""

    def __init__(self, clock_s):
        super().__init__(clock_s)
        self.answers = []
        self.waits = 0

    def comes_after(self, number, _s_max):
        self.waits += 1
        if self.answers:
            self.put(self.answers.pop(0))
        return self.newest().number > number


class Driven:
    """A steered robot with its clock, its mail, and what it told."""

    def __init__(self, setup=SETUP, by_clock=False, command_s_max=COMMAND_S_MAX):
        self.now_s = 100.0
        self.by_clock = by_clock
        self.mail = Mail(lambda: self.now_s)
        self.told, self.said = [], []
        self.steering = Steering(
            self.mail,
            lambda perception, by_clock: self.told.append((perception, by_clock)),
            command_s_max,
            say=self.said.append,
            clock_s=lambda: self.now_s,
        )
        self.core = SteeredRobot(self.steering, "r1", RUN)
        self.setup(setup)
        self.tick = -1

    def setup(self, setup):
        assert self.core.receive(robot_key(RUN, "r1", "setup"), encode(setup, RUN)) == []

    def step(self, position=(0.0, 0.0), heading=0.0):
        """The pose and the command of the next tick."""
        self.tick += 1
        sent_us = self.tick if self.by_clock else None
        seen = replace(observation(tick=self.tick, position=position), heading_rad=heading)
        seen = replace(seen, sent_us=sent_us)
        (_, packet), (_, payload) = self.core.receive(
            robot_key(RUN, "r1", "observation"), encode(seen, RUN)
        )
        self.now_s += TICK_S
        return decode(Pose, packet, RUN), decode(Command, payload, RUN)


def test_in_lock_step_each_tick_is_answered_by_the_command_that_comes_for_it():
    robot = Driven()
    for number in range(1, 6):
        robot.mail.answers = [Velocity(0.1 * number, 0.0, 0.0)]
        pose, command = robot.step()
        assert command.step == pytest.approx((0.01 * number, 0.0), abs=1e-6)
        assert (command.mode, pose.mode, pose.tick) == ("ros2", "ros2", command.tick)
    assert [by_clock for _, by_clock in robot.told] == [False] * 5
    assert [perception.observation.tick for perception, _ in robot.told] == list(range(5))


def test_the_scenarios_policy_is_neither_asked_nor_loaded():
    robot = Driven(replace(SETUP, strategy="no_such_file.py:policy"))
    robot.mail.answers = [FORWARD]
    assert robot.step()[1].step == pytest.approx((0.1, 0.0), abs=1e-6)


def test_the_longest_step_is_the_robots_own():
    robot = Driven()
    robot.mail.answers = [Velocity(50.0, 0.0, 0.0)]
    assert robot.step()[1].step == pytest.approx((BODIES["step_m_max"], 0.0), abs=1e-6)


def test_without_a_command_it_stands_and_the_run_waits_only_a_few_ticks():
    robot = Driven()
    for _ in range(10):
        _, command = robot.step(position=(3.0, 4.0))
        assert (command.step, command.goal, command.mode) == ((0.0, 0.0), (3.0, 4.0), "ros2")
    assert robot.mail.waits == VAIN_WAITS_MAX
    assert robot.said == []


def test_it_waits_again_once_there_is_a_command():
    robot = Driven()
    for _ in range(10):
        robot.step()
    robot.mail.put(FORWARD)
    waits = robot.mail.waits
    robot.step()
    assert robot.mail.waits == waits, "it was there"
    robot.mail.answers = [FORWARD]
    robot.step()
    assert robot.mail.waits == waits + 1


@pytest.mark.parametrize(
    ("command_s_max", "held"), [(COMMAND_S_MAX, 5), (0.3, 3), (0.7, 7), (0.25, 3), (0.01, 1)]
)
def test_in_lock_step_a_velocity_holds_for_its_time_in_the_runs_ticks(command_s_max, held):
    robot = Driven(command_s_max=command_s_max)
    robot.mail.answers = [FORWARD]
    moved = [robot.step()[1].step != (0.0, 0.0) for _ in range(10)]
    assert moved == [True] * held + [False] * (10 - held)
    assert robot.said == [
        "tick 0: steered by ROS 2",
        f"tick {held}: no command for {command_s_max:g} s, standing",
    ]


def test_in_lock_step_a_velocity_from_before_the_run_moves_nothing():
    robot = Driven()
    robot.mail.put(FORWARD)
    assert [robot.step()[1].step for _ in range(2)] == [(0.0, 0.0)] * 2
    robot.mail.answers = [FORWARD]
    assert robot.step()[1].step != (0.0, 0.0)


def test_by_the_clock_a_velocity_holds_for_its_time_and_nobody_waits():
    robot = Driven(by_clock=True)
    robot.mail.put(FORWARD)
    moved = [robot.step()[1].step != (0.0, 0.0) for _ in range(10)]
    assert moved == [True] * 6 + [False] * 4
    assert robot.mail.waits == 0
    robot.mail.put(FORWARD)
    assert robot.step()[1].step != (0.0, 0.0)
    assert all(by_clock for _, by_clock in robot.told)


@pytest.mark.parametrize("by_clock", [False, True])
def test_a_goal_holds_until_there_is_another_command(by_clock):
    robot = Driven(by_clock=by_clock)
    robot.mail.put(Goal(0.0, 10.0))
    for _ in range(20):
        _, command = robot.step()
        assert command.step == pytest.approx((0.0, BODIES["step_m_max"]), abs=1e-6)
        assert (command.mode, command.goal) == ("ros2", (0.0, 10.0))
    assert robot.step(position=(0.0, 9.9))[1].step == pytest.approx((0.0, 0.1), abs=1e-6)
    assert robot.step(position=(0.0, 10.0))[1].step == (0.0, 0.0)
    robot.mail.put(FORWARD)
    assert robot.step()[1].step == pytest.approx((0.1, 0.0), abs=1e-6)


def test_a_heading_is_that_of_the_robot_in_the_arena():
    robot = Driven()
    for heading in (0.3, 2.0, -3.0):
        robot.mail.answers = [FORWARD]
        step = robot.step(heading=heading)[1].step
        assert step == pytest.approx((0.1 * cos(heading), 0.1 * sin(heading)), abs=1e-6)


def test_a_robot_that_moves_sideways_goes_on_to_look_where_it_did():
    """In the arena a heading is the direction of the last step."""
    robot = Driven()
    for heading in (0.0, pi / 2, pi / 2):
        robot.mail.answers = [Velocity(0.0, 1.0, 0.0)]
        assert robot.step(heading=heading)[1].step == pytest.approx((0.0, 0.1), abs=1e-6)


def test_what_was_refused_of_ros_2_travels_to_the_world():
    robot = Driven()
    assert robot.step()[1].refused == {}
    robot.mail.refuse()
    robot.mail.refuse()
    assert robot.step()[1].refused == {REFUSED: 2}


def test_a_robot_that_begins_anew_waits_anew():
    robot = Driven()
    for _ in range(10):
        robot.step()
    robot.setup(SETUP)
    robot.tick = -1
    for _ in range(10):
        robot.step()
    assert robot.mail.waits == 2 * VAIN_WAITS_MAX


def test_of_a_past_that_it_is_told_nothing_is_asked():
    """As of a run that a new world has taken up."""
    robot = Driven(replace(SETUP, answer_tick=3))
    robot.mail.answers = [FORWARD]
    for tick in range(3):
        past = encode(observation(tick=tick), RUN)
        assert robot.core.receive(robot_key(RUN, "r1", "observation"), past) == []
    assert (robot.told, robot.mail.waits) == ([], 0)
    robot.tick = 2
    assert robot.step()[1].step != (0.0, 0.0)


def test_a_waiting_robot_is_woken_by_a_command():
    mail = CommandMail()
    woken = in_thread(mail.comes_after, 0, LONGEST_S)
    mail.put(FORWARD)
    assert result_of(woken)
    assert mail.newest()[:2] == (FORWARD, 1)
    assert not mail.comes_after(1, 0.0)
