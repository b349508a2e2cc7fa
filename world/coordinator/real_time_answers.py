"""What robots have sent in a run by the clock, and what of it counts at the end of a tick.

A command for an earlier tick is late, and counted; its step is made all the same as long as no
newer one is there and ``team.hold_ticks_max`` allows it (``encircle.world.coordinator.deadlines``).
A packet goes on the modelled channel in the tick in which it reaches the world. Of several from one
robot the newest goes; the others are counted as superseded.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from encircle.protocol.errors import OutOfTurn
from encircle.protocol.messages import Command, CommandMode, Pose
from encircle.world.coordinator.answers import Answer, digested_part
from encircle.world.coordinator.deadlines import ZERO_STEP, HeldCommand, step_at

STAND_IN = b"-"
"""In the place of a command that has not come: the robot takes part all the same."""
LATE, HELD, STOOD_STILL, SUPERSEDED = COUNTED = ("late", "held", "stood_still", "superseded")


@dataclass(slots=True)
class _RobotMessages:
    """The newest messages of one robot. ``newest_tick``: when the last of them came.

    ``packet``, ``command``: those of the open tick, each with what the digest takes of it.
    """

    newest_tick: int | None = None
    held_command: HeldCommand | None = None
    sequence: int = -1
    packet: tuple[bytes, bytes] | None = None
    command: tuple[bytes, bytes] | None = None


@dataclass
class RealTimeAnswers:
    """The newest messages of all robots of a run, and by robot the counts of ``COUNTED``."""

    robots: Sequence[str]
    run: str
    hold_ticks_max: int
    counts: dict[str, Counter[str]] = field(init=False)
    _messages: dict[str, _RobotMessages] = field(init=False)

    def __post_init__(self) -> None:
        self.counts = {robot: Counter() for robot in self.robots}
        self._messages = {robot: _RobotMessages() for robot in self.robots}

    def begin_anew(self, robot: str, tick: int) -> None:
        """A robot has got a setup, with which it begins at a tick."""
        messages = self._messages[robot]
        messages.held_command = None
        messages.sequence, messages.newest_tick = tick - 1, tick

    def take_pose(self, pose: Pose, packet: bytes, tick: int) -> None:
        """A packet has come at a tick; ``OutOfTurn`` if a later one of its robot came before."""
        messages = self._messages[pose.robot]
        if pose.sequence <= messages.sequence:
            raise OutOfTurn(
                f"packet {pose.sequence} of {pose.robot} after packet {messages.sequence}"
            )
        messages.sequence, messages.newest_tick = pose.sequence, tick
        if messages.packet is not None:
            self.counts[pose.robot][SUPERSEDED] += 1
        messages.packet = packet, digested_part(pose, packet, self.run)

    def take_command(self, command: Command, payload: bytes, tick: int) -> None:
        """A command has come at a tick; ``OutOfTurn`` if one that is as new came before.

        An order to stand still may follow the command of its tick.
        """
        messages, stops = self._messages[command.robot], command.mode == CommandMode.STOP
        held = messages.held_command
        stands_still = stops and command.step == ZERO_STEP and not command.published
        if held is not None and (
            command.tick < held.tick or (command.tick == held.tick and not stands_still)
        ):
            raise OutOfTurn(
                f"command of {command.robot} for tick {command.tick} after that for {held.tick}"
            )
        if command.tick < tick and not stops:
            self.counts[command.robot][LATE] += 1
        messages.newest_tick = tick
        messages.held_command = HeldCommand(command.tick, command.step)
        if command.tick == tick:
            messages.command = payload, digested_part(command, payload, self.run)

    def answer_at(self, robot: str, tick: int) -> Answer:
        """What a robot does at a tick that ends, and what it sends; later ticks begin without."""
        answer, messages = Answer(), self._messages[robot]
        held = messages.held_command
        step = step_at(held, tick, self.hold_ticks_max)
        answer.step = ZERO_STEP if step is None else step
        if held is None or held.tick < tick:
            self.counts[robot][STOOD_STILL if step is None else HELD] += 1
        answer.command, answer.digested_command = messages.command or (STAND_IN, b"")
        if messages.packet is not None:
            answer.packet, answer.digested_pose = messages.packet
        return answer

    def end_tick(self) -> None:
        """The tick is over: what came in it has been used."""
        for messages in self._messages.values():
            messages.packet = messages.command = None

    def ticks_without_message(self, robot: str, tick: int) -> int:
        """For how many ticks nothing has come from a robot; 0 before it has begun."""
        newest_tick = self._messages[robot].newest_tick
        return 0 if newest_tick is None else tick - newest_tick

    def newest_command_tick(self, robot: str) -> int | None:
        """The tick of the newest command that has come from a robot since its setup."""
        held = self._messages[robot].held_command
        return None if held is None else held.tick

    def summary(self) -> dict[str, Any]:
        """The counts by robot, those that are zero included."""
        return {
            robot: {**dict.fromkeys(COUNTED, 0), **counts} for robot, counts in self.counts.items()
        }
