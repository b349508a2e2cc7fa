"""What arrives from robots in a run by the clock: when it is in turn, and the record of it.

A message counts if its robot takes part and its tick is one that the robot was asked for. It is
entered in the message ledger and recorded with the time at which it came.

The journal records a round when it is over, and knows of a robot's messages only those that
counted in it. Here they are noted as they come instead, and are recorded in front of the fates of
the round's packets.
"""

from collections.abc import Callable

from encircle.protocol.errors import OutOfTurn
from encircle.protocol.keys import channel_of, robot_key
from encircle.protocol.lockstep import LockStep, Phase
from encircle.protocol.messages import Command, Pose
from encircle.world.coordinator.real_time_answers import RealTimeAnswers
from encircle.world.network.message_ledger import MessageLedger

TimedRecord = Callable[[int, str, bytes, int], None]
"""Records one message: tick, key, payload, and when, in us of the world's clock."""
NOTED_MAX = 65_536
"""Messages of one tick that are kept for the recording; more are left out, and counted."""
UNRECORDED = "unrecorded"


class TimedJournalRecord:
    """Records what the journal gives it, at the time ``now_us``, and what robots have sent."""

    def __init__(self, record: TimedRecord, now_us: Callable[[], int]) -> None:
        self._record = record
        self._now_us = now_us
        self._noted: list[tuple[int, str, bytes, int]] = []

    def note(self, tick: int, key: str, payload: bytes, arrival_us: int) -> bool:
        """Note a robot's message as it comes; False if there is no room for it."""
        if len(self._noted) >= NOTED_MAX:
            return False
        self._noted.append((tick, key, payload, arrival_us))
        return True

    def __call__(self, tick: int, key: str, payload: bytes) -> None:
        """Record one message of the journal."""
        channel = channel_of(key)
        if channel == "radio" or (channel == "end" and self._noted):
            for message in self._noted:
                self._record(*message)
            self._noted = []
        if channel not in ("pose", "command"):
            self._record(tick, key, payload, self._now_us())


class Arrivals:
    """What arrives from the robots of one run. ``record``: what notes it, None to record nothing.

    ``table``: where each robot stands; ``answers`` and ``ledger`` take in what is in turn.
    """

    def __init__(
        self, table: LockStep, answers: RealTimeAnswers, ledger: MessageLedger, run: str
    ) -> None:
        self.record: TimedJournalRecord | None = None
        self._table = table
        self._answers = answers
        self._ledger = ledger
        self._run = run

    def take_pose(self, pose: Pose, packet: bytes, arrival_us: int) -> None:
        """A packet has come at a time; ``OutOfTurn`` if it cannot be from its robot now."""
        try:
            self._check_turn(pose)
        except OutOfTurn:
            # Peers may have heard it: what they did is to be understood from the recording.
            in_team = pose.robot in self._ledger.participations
            if self._ledger.direct and in_team and pose.tick <= self._table.tick:
                self._note(pose, "pose", packet, arrival_us)
                self._ledger.packet(pose, arrival_us)
            raise
        self._answers.take_pose(pose, packet, self._table.tick)
        self._note(pose, "pose", packet, arrival_us)
        self._ledger.packet(pose, arrival_us)

    def take_command(self, command: Command, payload: bytes, arrival_us: int) -> None:
        """A command has come at a time; ``OutOfTurn`` if it cannot be from its robot now."""
        self._check_turn(command)
        self._answers.take_command(command, payload, self._table.tick)
        self._note(command, "command", payload, arrival_us)
        self._ledger.answered(command, arrival_us)

    def _check_turn(self, message: Pose | Command) -> None:
        robot, tick, table = message.robot, message.tick, self._table
        channel = type(message).__name__.lower()
        participations = self._ledger.participations.get(robot)
        if participations is None:
            team = ", ".join(self._ledger.robots)
            raise OutOfTurn(f"robot {robot!r} is not in this team ({team})")
        if robot in table.in_phase(Phase.LEFT, Phase.ABSENT):
            raise OutOfTurn(f"{channel} of {robot} at tick {table.tick}: it is not there")
        if tick > table.tick or not participations or tick < participations[-1].first_tick:
            raise OutOfTurn(f"{channel} of {robot} is for tick {tick}, this is {table.tick}")

    def _note(self, message: Pose | Command, channel: str, payload: bytes, arrival_us: int) -> None:
        key = robot_key(self._run, message.robot, channel)
        if self.record is not None and not self.record.note(message.tick, key, payload, arrival_us):
            self._answers.counts[message.robot][UNRECORDED] += 1
