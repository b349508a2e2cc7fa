"""A robot that decides nothing: ROS 2 tells it what to do, tick by tick.

It is a robot as any other: the same core takes in what it senses and hears, limits its steps, and
sends its packet and its command. In the place of a policy stands the newest command that has come.
At every tick it tells ROS 2 what a policy would be given: its own position, the target and the
peers as it believes them.

**By the clock** the newest command holds until another one comes, a velocity for
``command_s_max`` at most: then the robot stands. A goal holds until there is a newer command.

**In lock-step** nothing is known of clocks. The run waits for this robot, and the robot for ROS 2:
it answers a tick with the first command that comes after it has told of that tick, so that whoever
answers each tick with one command decides tick by tick. It waits for ``wait_s_max`` at most; then
the command before holds as by the clock, in the run's own time. After ``VAIN_WAITS_MAX`` such
waits it waits no more until there is a command again, so that a run without a driver goes on.
"""

import threading
import time
from collections.abc import Callable
from typing import NamedTuple

from encircle.agents.brain.brain import Action, Perception
from encircle.agents.brain.robot_core import RobotCore
from encircle.agents.policies.interface import Decision, Policy, View
from encircle.protocol.messages import CommandMode, Observation, Setup
from encircle.protocol.plugins import PluginFailed
from encircle.ros2.commands import RobotCommand, Velocity, step_of

COMMAND_S_MAX = 0.5
"""How long a velocity holds, in s, unless another length is asked for."""
WAIT_S_MAX = 1.0
"""How long a tick of a run in lock-step waits for a command, in s, unless another length is asked
for. The world has to wait for longer."""
VAIN_WAITS_MAX = 3
SHORTEST_S = 1e-9
"""Times that differ by less are equal."""
REFUSED = "ros2-command"
"""Under which a robot's command counts what it has refused of ROS 2."""


class NewestCommand(NamedTuple):
    """A command, its number from 1, and when it came, in s by ``time.monotonic``."""

    command: RobotCommand | None
    number: int
    arrival_s: float


class CommandMail:
    """The newest command, from the threads that receive to the one that decides."""

    def __init__(self, clock_s: Callable[[], float] = time.monotonic) -> None:
        self._changed = threading.Condition()
        self._clock_s = clock_s
        self._newest = NewestCommand(None, 0, 0.0)
        self.refused = 0

    def put(self, command: RobotCommand) -> None:
        """A command has come."""
        with self._changed:
            number = self._newest.number + 1
            self._newest = NewestCommand(command, number, self._clock_s())
            self._changed.notify_all()

    def refuse(self) -> None:
        """Something has come that is no command."""
        with self._changed:
            self.refused += 1

    def newest(self) -> NewestCommand:
        """The newest command; number 0 if none has come."""
        with self._changed:
            return self._newest

    def comes_after(self, number: int, s_max: float) -> bool:
        """Whether a command after that of a number comes, waited for; False if not in time."""
        with self._changed:
            return self._changed.wait_for(lambda: self._newest.number > number, s_max)


class Steering:
    """Makes decisions of commands.

    ``tell(perception, by_clock)`` is called at every tick before it is decided. ``command_s_max``:
    how long a velocity holds, in s; ``wait_s_max``: how long a tick waits for a command in
    lock-step. ``say``: gets a line when commands begin and when they stop.
    """

    def __init__(
        self,
        mail: CommandMail,
        tell: Callable[[Perception, bool], None],
        command_s_max: float = COMMAND_S_MAX,
        wait_s_max: float = WAIT_S_MAX,
        say: Callable[[str], None] = lambda _line: None,
        clock_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self.mail = mail
        self._tell = tell
        self._command_s_max, self._wait_s_max = command_s_max, wait_s_max
        self._say = say
        self._clock_s = clock_s
        self._tick = -1

    def _begin(self) -> None:
        """A robot begins, or begins anew."""
        # A velocity of before is over: whoever said it may be gone.
        self._number = self.mail.newest().number
        self._command_tick: int | None = None
        self._vain_waits = 0
        self._strafed_rad: float | None = None
        self._stood = True

    def decide(self, perception: Perception, by_clock: bool) -> Decision:
        """What the robot does at a tick."""
        observation, view = perception.observation, perception.view
        if self._tick < 0 or observation.tick <= self._tick:
            self._begin()
        self._tick = observation.tick
        before = self.mail.newest().number
        self._tell(perception, by_clock)
        if not by_clock and self._vain_waits < VAIN_WAITS_MAX:
            came = self.mail.comes_after(before, self._wait_s_max)
            self._vain_waits = 0 if came else self._vain_waits + 1
        newest = self.mail.newest()
        if newest.number != self._number:
            self._number, self._command_tick, self._vain_waits = newest.number, self._tick, 0
        command = newest.command
        if command is None or self._is_stale(newest, by_clock, view.tick_s):
            self._note(stands=True)
            self._strafed_rad = None
            return _standing(observation)
        self._note(stands=False)
        x, y = observation.position
        # A robot that moves sideways has the direction of its way for its heading in the arena, and
        # is all the same to look where it did.
        heading_rad = observation.heading_rad if self._strafed_rad is None else self._strafed_rad
        step, heading_rad = step_of(command, observation.position, heading_rad, view.tick_s)
        sideways = isinstance(command, Velocity) and not command.in_arena and command.y_mps != 0.0
        self._strafed_rad = heading_rad if sideways else None
        return Decision(CommandMode.STEERED, step, (x + step[0], y + step[1]))

    def _is_stale(self, newest: NewestCommand, by_clock: bool, tick_s: float) -> bool:
        if not isinstance(newest.command, Velocity):
            return False
        if by_clock:
            return self._clock_s() - newest.arrival_s > self._command_s_max
        if self._command_tick is None:
            return True
        # What is moved in a tick is over at the next one. Ticks times their length are rounded.
        over_s = (self._tick - self._command_tick) * tick_s
        return over_s > 0.0 and over_s >= self._command_s_max - SHORTEST_S

    def _note(self, stands: bool) -> None:
        if stands != self._stood:
            self._stood = stands
            self._say(
                f"tick {self._tick}: no command for {self._command_s_max:g} s, standing"
                if stands
                else f"tick {self._tick}: steered by ROS 2"
            )


class SteeredRobot(RobotCore):
    """A robot's core that decides by commands; the scenario's policy is not asked, nor loaded."""

    def __init__(
        self,
        steering: Steering,
        robot: str,
        run: str,
        log: Callable[[str], None] = lambda _line: None,
        report_failure: Callable[[PluginFailed], None] = lambda _failure: None,
    ) -> None:
        super().__init__(robot, run, log, report_failure)
        self._steering = steering

    def decide(self, observation: Observation) -> Action:
        """Answer an observation, by the newest command; raises as ``check``."""
        perception = self.perceive(observation)
        if self.setup is not None and observation.tick < self.setup.answer_tick:
            # It is told its past, of which nobody can still decide anything.
            return self.act(perception, _standing(observation))
        decision = self._steering.decide(perception, observation.sent_us is not None)
        if self._steering.mail.refused:
            self.refused[REFUSED] = self._steering.mail.refused
        return self.act(perception, decision)

    def _policy_of(self, _setup: Setup) -> tuple[Policy, PluginFailed | None]:
        return _no_policy, None


def _standing(observation: Observation) -> Decision:
    return Decision(CommandMode.STEERED, (0.0, 0.0), observation.position)


def _no_policy(_memory: None, view: View) -> tuple[None, Decision]:
    raise AssertionError(f"a steered robot asks no policy: {view}")
