"""Replay of runs by the clock: what each robot had received when it decided, reconstructed.

New robots receive the same as the real ones (``encircle.replay.receipts``), by the tick and not by
the clock, and must decide the same.

What cannot be reconstructed is not guessed. If a robot has received a packet that the world has
not, it is not checked from there on until it joins again, and the result says so. Nor are its last
commands checked, if no recorded command has the receipts of their observations. The command to
stand still that a robot gives when no observation arrives depends on the clock, and is not checked.
"""

from collections import defaultdict
from dataclasses import dataclass, field, replace

from encircle.protocol.codec import decode
from encircle.protocol.keys import channel_of
from encircle.protocol.messages import Command, CommandMode, Pose
from encircle.protocol.real_time import Receipt
from encircle.replay.receipts import NotRecorded, RobotByReceipts
from encircle.replay.replay_check import ReplayCheck, raise_failure, steered_text
from encircle.world.recording.recording import Recording, decoded

Packets = dict[tuple[str, int], bytes]


@dataclass(slots=True)
class _RobotRecording:
    """One robot's part of a recording, by tick."""

    setups: dict[int, bytes] = field(default_factory=dict)
    observations: dict[int, bytes] = field(default_factory=dict)
    commands: dict[int, Command] = field(default_factory=dict)
    poses: dict[int, Pose] = field(default_factory=dict)


def replay_real_time(recording: Recording) -> ReplayCheck:
    """As ``encircle.replay.replaying.replay``, for a run by the clock."""
    parts, packets, foreign = _parts_of(recording)
    differences, unchecked, compared = foreign, [], 0
    for robot, part in parts.items():
        check = _RobotCheck(robot, part, recording.run, packets)
        check.run_all()
        differences += check.differences
        unchecked += check.unchecked
        compared += check.compared
    last = max((tick for tick, _, _ in recording.messages), default=0)
    return ReplayCheck(
        last,
        len(parts),
        compared,
        tuple(sorted(differences)),
        recording.complete,
        tuple(unchecked),
    )


def _parts_of(
    recording: Recording,
) -> tuple[dict[str, _RobotRecording], Packets, list[tuple[int, str, str]]]:
    """Each robot's part, all packets, and the messages of robots that are not of the team."""
    parts = {robot: _RobotRecording() for robot in recording.scenario.ids}
    packets: Packets = {}
    foreign = []
    for tick, topic, payload in recording.messages:
        robot, channel = topic.split("/")[-2:]
        if channel not in ("setup", "observation", "pose", "command"):
            continue
        if robot not in parts:
            foreign.append((tick, robot, channel))
        elif channel == "setup":
            parts[robot].setups[tick] = payload
        elif channel == "observation":
            parts[robot].observations[tick] = payload
        elif channel == "pose":
            pose = decoded(Pose, recording, tick, payload)
            parts[robot].poses[tick] = pose
            packets[robot, pose.sequence] = payload
        else:
            command = decoded(Command, recording, tick, payload)
            if command.mode != CommandMode.STOP:
                parts[robot].commands[tick] = command
    return parts, packets, foreign


class _RobotCheck:
    """The check of one robot, which receives again what it received."""

    def __init__(self, robot: str, part: _RobotRecording, run: str, packets: Packets) -> None:
        self.differences: list[tuple[int, str, str]] = []
        self.unchecked: list[str] = []
        self.compared = 0
        self._robot, self._part, self._run, self._packets = robot, part, run, packets
        self._steered = {t for t, c in part.commands.items() if c.mode == CommandMode.STEERED}
        if self._steered:
            self.unchecked.append(steered_text(robot, len(self._steered)))

    def run_all(self) -> None:
        """Check every participation of the robot in the run."""
        part = self._part
        begins = sorted(part.setups)
        by_participation: dict[int, list[int]] = defaultdict(list)
        for tick in sorted(part.commands):
            begun = max((first for first in begins if first <= tick), default=None)
            if begun is None:
                self.differences.append((tick, self._robot, "command"))
            else:
                by_participation[begun].append(tick)
        for first, ticks in by_participation.items():
            try:
                self._check_participation(first, ticks)
            except NotRecorded as reason:
                self.unchecked.append(f"{self._robot}: {reason}; not checked from there")

    def _check_participation(self, first: int, ticks: list[int]) -> None:
        robot = RobotByReceipts(self._robot, self._run, self._part.setups[first])
        if robot.core.setup is None:
            self.differences.append((first, self._robot, "setup"))
            return
        for receipt in self._receipts(ticks):
            if robot.receive(receipt, self._part.observations, self._packets):
                self._decide(robot, receipt.number)
                ticks = [tick for tick in ticks if tick != receipt.number]
        if ticks:
            raise NotRecorded(f"what it had at tick {ticks[0]} is not recorded")

    def _receipts(self, ticks: list[int]) -> list[Receipt]:
        """What the robot has received, in that order, by its commands of these ticks."""
        receipts: dict[tuple[str, int], Receipt] = {}
        for tick in ticks:
            timing = self._part.commands[tick].timing
            for receipt in timing.receipts if timing else ():
                receipts.setdefault((receipt.source, receipt.number), receipt)
        return list(receipts.values())

    def _decide(self, robot: RobotByReceipts, tick: int) -> None:
        answer = robot.decide()
        raise_failure(robot.core)
        if answer is None:
            self.differences.append((tick, self._robot, "command"))
            return
        if tick in self._steered:
            return
        messages = {channel_of(key): payload for key, payload in answer[1]}
        mine, theirs = (
            decode(Command, messages["command"], self._run),
            self._part.commands.get(tick),
        )
        # One that is not recorded was lost on its way to the world.
        if theirs is not None:
            self.compared += 1
            if _without_clock(mine) != _without_clock(theirs):
                self.differences.append((tick, self._robot, "command"))
        recorded = self._part.poses.get(tick)
        if recorded is not None:
            self.compared += 1
            pose = decode(Pose, messages["pose"], self._run) if "pose" in messages else None
            if pose is None or replace(pose, sent_us=None) != replace(recorded, sent_us=None):
                self.differences.append((tick, self._robot, "pose"))


def _without_clock(command: Command) -> Command:
    return replace(command, refused={}, timing=None)
