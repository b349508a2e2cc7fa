"""What was sent and what arrived, message by message: the ledger that link measures are made from.

The world keeps it while a run goes on by the clock; the same ledger is read back from a recording.
Four times belong to each answered observation (``encircle.protocol.clocks``). What was lost is
known from gaps. Packets of a robot are numbered one by one from the tick at which it joined, so a
missing number is a lost packet. What a robot has received itself is known from the receipts in its
commands, which it repeats until they are acknowledged (``encircle.protocol.real_time``). Commands
also say how many observations their robot has passed over or never received, so that for a tick
without a command it is known whether the command was lost or never given. A robot that joins again
begins anew: nothing is concluded from one participation on another.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from encircle.protocol.clocks import Exchange
from encircle.protocol.messages import Command, CommandMode, Pose, Radio
from encircle.protocol.real_time import ReceiptKind, ReceptionCount
from encircle.world.channel.loss_causes import CAUSES

ROWS_MAX = 1_000_000
"""A ledger's limit: some 100 MB. What comes later is left out, which the report says."""


class PacketTimes(NamedTuple):
    """A packet that has reached the world: its tick, and when it was sent and arrived, in us.

    The time of sending is by the robot's clock, that of arrival by the world's.
    """

    tick: int
    sent_us: int
    arrival_us: int


@dataclass(slots=True)
class Participation:
    """One robot's time in the run, from one joining to the next.

    ``packets``: those that have reached the world, by number; ``packet_arrivals_us``: by sender and
    number, when each packet arrived that the robot has received itself; ``asked_us`` and
    ``arrived_us``: by tick, when each observation was sent and arrived. What the robot has received
    after ``known_tick`` is not known.
    """

    first_tick: int
    last_tick: int = -1
    commands: int = 0
    passed_over: int = 0
    missed: int = 0
    exchanges: list[Exchange] = field(default_factory=list)
    packets: dict[int, PacketTimes] = field(default_factory=dict)
    packet_arrivals_us: dict[str, dict[int, int]] = field(default_factory=dict)
    asked_us: dict[int, int] = field(default_factory=dict)
    arrived_us: dict[int, int] = field(default_factory=dict)
    known_tick: int = -1


@dataclass(slots=True)
class Injected:
    """What the channel model did on one link; ``ticks``: numbers of packets by delay in ticks."""

    sent: int = 0
    copied: int = 0
    lost: dict[str, int] = field(default_factory=dict)
    ticks: dict[int, int] = field(default_factory=dict)


class MessageLedger:
    """The ledger of one run. ``full_tick``: from which tick on it was full, None if it was not.

    ``direct``: whether packets go from robot to robot, not through the world.
    """

    def __init__(
        self, robots: Sequence[str], tick_s: float, direct: bool, rows_max: int = ROWS_MAX
    ) -> None:
        self.robots = tuple(robots)
        self.tick_s = tick_s
        self.direct = direct
        self.participations: dict[str, list[Participation]] = {robot: [] for robot in robots}
        self.injected: dict[tuple[str, str], Injected] = {}
        self.full_tick: int | None = None
        self._rows_left = rows_max

    def joined(self, robot: str, first_tick: int) -> None:
        """A robot begins, or begins anew, with the observation of this tick."""
        self.participations[robot].append(Participation(first_tick))

    def asked(self, robot: str, tick: int, sent_us: int) -> None:
        """The world has sent an observation at a time by its clock."""
        if self.participations[robot] and not self._is_full(tick):
            self.participations[robot][-1].asked_us[tick] = sent_us
            self._rows_left -= 1

    def answered(self, command: Command, arrival_us: int) -> None:
        """A command has reached the world."""
        participation = self._participation_at(command.robot, command.tick)
        if participation is None or command.timing is None or self._is_full(command.tick):
            return
        timing = command.timing
        for receipt in timing.receipts:
            is_packet = receipt.kind is ReceiptKind.PACKET
            arrivals_us = (
                participation.packet_arrivals_us.setdefault(receipt.source, {})
                if is_packet
                else participation.arrived_us
            )
            if receipt.number not in arrivals_us:
                arrivals_us[receipt.number] = receipt.arrival_us
                self._rows_left -= 1
            if not is_packet:
                participation.known_tick = max(participation.known_tick, receipt.number)
        if command.mode == CommandMode.STOP:
            return
        participation.last_tick = command.tick
        participation.passed_over, participation.missed = (
            command.refused.get(name, 0)
            for name in (ReceptionCount.PASSED_OVER, ReceptionCount.MISSED)
        )
        participation.commands += 1
        asked_us = participation.asked_us.get(command.tick)
        if asked_us is not None:
            participation.exchanges.append(
                Exchange(asked_us, timing.observation_us, timing.sent_us, arrival_us)
            )
        self._rows_left -= 1

    def packet(self, pose: Pose, arrival_us: int) -> None:
        """A packet has reached the world."""
        participation = self._participation_at(pose.robot, pose.tick)
        if participation is not None and pose.sent_us is not None and not self._is_full(pose.tick):
            times = PacketTimes(pose.tick, pose.sent_us, arrival_us)
            participation.packets.setdefault(pose.sequence, times)
            self._rows_left -= 1

    def fates_drawn(self, radio: Radio) -> None:
        """The channel model has drawn the fates of the packets of a tick."""
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

    def _participation_at(self, robot: str, tick: int) -> Participation | None:
        """The participation that a message of a tick is from, None if it is an earlier one."""
        participations = self.participations.get(robot)
        return (
            participations[-1] if participations and tick >= participations[-1].first_tick else None
        )

    def _is_full(self, tick: int) -> bool:
        if self._rows_left <= 0 and self.full_tick is None:
            self.full_tick = tick
        return self.full_tick is not None
