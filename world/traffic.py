"""What was sent and what came, message by message: the ledger that link measures are made from.

The world writes it as a run by the clock goes on; the same is read back from a recording. Four
times belong to each answered observation (``protocol.clocks``); what was lost is known from gaps.
Packets of a robot are numbered one by one from the tick at which it joined, so a number left out is
a packet lost. Commands say how many observations their robot has passed over or never had, so that
a tick without a command is a command lost or one that was never given. A robot that joins again
starts again: nothing is concluded across that.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

from protocol.clocks import Exchange
from protocol.messages import Command, Pose, Radio
from protocol.real_time import MISSED, PASSED_OVER, STOPPED
from world.causes import CAUSES

ROWS_MAX = 1_000_000
"""A ledger's limit: some 100 MB. What comes later is left out, which the report says."""


@dataclass(slots=True)
class Stay:
    """One robot's time in the run, from a joining on.

    ``packets``: (tick, sent, came) by number; ``heard``: by sender, when each packet came that the
    robot has heard itself, and the tick of the command that told of it; ``gaps``: ticks of the
    commands before and after some that were lost, and what those told with them.
    """

    first_tick: int
    last_tick: int = -1
    commands: int = 0
    passed_over: int = 0
    missed: int = 0
    exchanges: list[Exchange] = field(default_factory=list)
    packets: dict[int, tuple[int, int, int]] = field(default_factory=dict)
    heard: dict[str, dict[int, tuple[int, int]]] = field(default_factory=dict)
    asked_us: dict[int, int] = field(default_factory=dict)
    gaps: list[tuple[int, int]] = field(default_factory=list)


@dataclass(slots=True)
class Injected:
    """What the modelled radio did on one directed link; ``ticks``: of delay, by packets."""

    sent: int = 0
    copied: int = 0
    lost: dict[str, int] = field(default_factory=dict)
    ticks: dict[int, int] = field(default_factory=dict)


class Traffic:
    """The ledger of one run. ``full_tick``: from which tick on nothing was written, if any.

    ``direct``: whether robots hear each other themselves.
    """

    def __init__(
        self, robots: Sequence[str], tick_s: float, direct: bool, rows_max: int = ROWS_MAX
    ) -> None:
        self.robots = tuple(robots)
        self.tick_s = tick_s
        self.direct = direct
        self.stays: dict[str, list[Stay]] = {robot: [] for robot in robots}
        self.injected: dict[tuple[str, str], Injected] = {}
        self.full_tick: int | None = None
        self._rows_left = rows_max

    def joined(self, robot: str, first_tick: int) -> None:
        """A robot begins, or begins afresh, with the observation of this tick."""
        self.stays[robot].append(Stay(first_tick))

    def asked(self, robot: str, tick: int, sent_us: int) -> None:
        """The world has sent an observation at a time by its clock."""
        if self.stays[robot] and not self._is_full(tick):
            self.stays[robot][-1].asked_us[tick] = sent_us

    def answered(self, command: Command, came_us: int) -> None:
        """A command has come to the world."""
        stay = self._stay_at(command.robot, command.tick)
        if stay is None or command.timing is None or self._is_full(command.tick):
            return
        if command.mode == STOPPED:
            return
        heard_us, answered_us, heard = command.timing
        passed_over, missed = (command.refused.get(name, 0) for name in (PASSED_OVER, MISSED))
        before = stay.last_tick if stay.commands else stay.first_tick - 1
        told = passed_over - stay.passed_over + missed - stay.missed
        if command.tick - before - 1 > told:
            stay.gaps.append((before, command.tick))
        stay.last_tick, stay.passed_over, stay.missed = command.tick, passed_over, missed
        stay.commands += 1
        asked_us = stay.asked_us.pop(command.tick, None)
        if asked_us is not None:
            stay.exchanges.append(Exchange(asked_us, heard_us, answered_us, came_us))
        for old in [tick for tick in stay.asked_us if tick < command.tick]:
            del stay.asked_us[old]
        for sender, number, time_us in heard:
            stay.heard.setdefault(sender, {}).setdefault(number, (time_us, command.tick))
        self._rows_left -= 1 + len(heard)

    def packet(self, pose: Pose, came_us: int) -> None:
        """A packet has come to the world."""
        stay = self._stay_at(pose.robot, pose.tick)
        if stay is not None and pose.sent_us is not None and not self._is_full(pose.tick):
            stay.packets.setdefault(pose.sequence, (pose.tick, pose.sent_us, came_us))
            self._rows_left -= 1

    def radioed(self, radio: Radio) -> None:
        """The modelled radio has drawn the fates of the packets of a tick."""
        for sender, row in zip(self.robots, radio.fates, strict=True):
            for receiver, fate in zip(self.robots, row, strict=True):
                if fate == 0:
                    continue
                link = self.injected.setdefault((sender, receiver), Injected())
                link.sent += 1
                if fate < 0:
                    cause = CAUSES.get(-fate, f"code {-fate}")
                    link.lost[cause] = link.lost.get(cause, 0) + 1
                else:
                    ticks = fate - radio.tick
                    link.ticks[ticks] = link.ticks.get(ticks, 0) + 1
        for sender, row in zip(self.robots, radio.copies, strict=False):
            for receiver, due in zip(self.robots, row, strict=True):
                if due:
                    self.injected[sender, receiver].copied += 1

    def _stay_at(self, robot: str, tick: int) -> Stay | None:
        """The robot's stay that a message of a tick is from, None if it is from an earlier one."""
        stays = self.stays.get(robot)
        return stays[-1] if stays and tick >= stays[-1].first_tick else None

    def _is_full(self, tick: int) -> bool:
        if self._rows_left <= 0 and self.full_tick is None:
            self.full_tick = tick
        return self.full_tick is not None
