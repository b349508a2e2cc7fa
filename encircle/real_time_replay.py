"""Replay of runs by the clock: what each robot had when it decided, put together again.

Lock-step needs the observations alone. Here a robot answers the newest one that it has, and hears
its peers itself; but its commands say which packets it has heard since the last one, how many
observations it has passed over and how many never came, and the world has recorded observations
and packets. Fresh robots are given the same, by the tick and not by the clock, and must decide the
same.

What cannot be put together is not guessed. If a command was lost on its way to the world, if some
observations between two commands never came and others did, or if a robot has heard a packet that
the world has not, then that robot is not checked from there on until it joins again, and the check
says so. The order to stand still that a robot gives when no observation comes is a matter of the
clock, and not checked.
"""

from collections import defaultdict
from dataclasses import dataclass, field, replace

from agents.core import RobotCore
from agents.real_time_core import RealTimeCore
from encircle.replaying import ReplayCheck
from protocol.codec import decode
from protocol.keys import robot_key
from protocol.messages import Command, Pose
from protocol.real_time import MISSED, PASSED_OVER, STOPPED
from world.recording import Recording

Packets = dict[tuple[str, int], bytes]


@dataclass(slots=True)
class _Part:
    """One robot's part of a recording, by tick."""

    setups: dict[int, bytes] = field(default_factory=dict)
    observations: dict[int, bytes] = field(default_factory=dict)
    commands: dict[int, Command] = field(default_factory=dict)
    poses: dict[int, Pose] = field(default_factory=dict)


class _Unknown(Exception):
    """What a robot had cannot be put together; the message says why."""


def replay_by_clock(recording: Recording) -> ReplayCheck:
    """As ``encircle.replaying.replay``, for a run by the clock."""
    parts, packets, foreign = _parts_of(recording)
    differences, unchecked, compared = foreign, [], 0
    for robot, part in parts.items():
        check = _Check(robot, part, recording.run, packets)
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
) -> tuple[dict[str, _Part], Packets, list[tuple[int, str, str]]]:
    """Each robot's part, all packets, and what is from nobody of the team."""
    parts = {robot: _Part() for robot in recording.scenario.ids}
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
            pose = decode(Pose, payload, recording.run)
            parts[robot].poses[tick] = pose
            packets[robot, pose.sequence] = payload
        else:
            command = decode(Command, payload, recording.run)
            if command.mode != STOPPED:
                parts[robot].commands[tick] = command
    return parts, packets, foreign


class _Check:
    """One robot, told again what it was told."""

    def __init__(self, robot: str, part: _Part, run: str, packets: Packets) -> None:
        self.differences: list[tuple[int, str, str]] = []
        self.unchecked: list[str] = []
        self.compared = 0
        self._robot, self._part, self._run, self._packets = robot, part, run, packets

    def run_all(self) -> None:
        """Check every stay of the robot in the run."""
        part = self._part
        begins = sorted(part.setups)
        by_stay: dict[int, list[int]] = defaultdict(list)
        for tick in sorted(part.commands):
            begun = max((first for first in begins if first <= tick), default=None)
            if begun is None:
                self.differences.append((tick, self._robot, "command"))
            else:
                by_stay[begun].append(tick)
        for first, ticks in by_stay.items():
            try:
                self._stay(first, ticks)
            except _Unknown as reason:
                self.unchecked.append(f"{self._robot}: {reason}")

    def _stay(self, first: int, ticks: list[int]) -> None:
        core = RobotCore(self._robot, self._run)
        core.receive(robot_key(self._run, self._robot, "setup"), self._part.setups[first])
        if core.setup is None:
            self.differences.append((first, self._robot, "setup"))
            return
        robot, before = RealTimeCore(core), first - 1
        counted = {MISSED: 0, PASSED_OVER: 0}
        for tick in ticks:
            command = self._part.commands[tick]
            now = {name: command.refused.get(name, 0) for name in counted}
            since = {name: now[name] - counted[name] for name in counted}
            self._tell(robot, range(before + 1, tick), since, tick)
            self._hear(robot, command, tick)
            self._observe(robot, tick)
            self._compare(robot, tick)
            before, counted = tick, now

    def _tell(self, robot: RealTimeCore, between: range, since: dict[str, int], tick: int) -> None:
        """The observations that were passed over since the last command."""
        if since[MISSED] + since[PASSED_OVER] != len(between):
            raise _Unknown(f"a command before tick {tick} is not recorded; not checked from there")
        if since[MISSED] and since[PASSED_OVER]:
            raise _Unknown(
                f"which observations came before tick {tick} is not known; not checked from there"
            )
        for passed in between if since[PASSED_OVER] else ():
            self._observe(robot, passed)

    def _observe(self, robot: RealTimeCore, tick: int) -> None:
        observation = self._part.observations.get(tick)
        if observation is None:
            raise _Unknown(f"the observation of tick {tick} is not recorded")
        robot.take(0, robot_key(self._run, self._robot, "observation"), observation)

    def _hear(self, robot: RealTimeCore, command: Command, tick: int) -> None:
        for sender, sequence, came_us in command.timing[2] if command.timing else ():
            packet = self._packets.get((sender, sequence))
            if packet is None:
                raise _Unknown(
                    f"packet {sequence} of {sender}, heard by tick {tick}, did not reach the world;"
                    " not checked from there"
                )
            robot.take(came_us, robot_key(self._run, sender, "pose"), packet)

    def _compare(self, robot: RealTimeCore, tick: int) -> None:
        action = robot.decide()
        if action is None:
            self.differences.append((tick, self._robot, "command"))
            return
        said = {key.rsplit("/", 1)[1]: payload for key, payload in robot.said(action, 0)}
        mine, theirs = decode(Command, said["command"], self._run), self._part.commands[tick]
        self.compared += 1
        if _without_clock(mine) != _without_clock(theirs):
            self.differences.append((tick, self._robot, "command"))
        recorded = self._part.poses.get(tick)
        # One that is not recorded was lost on its way to the world.
        if recorded is not None:
            self.compared += 1
            pose = decode(Pose, said["pose"], self._run) if "pose" in said else None
            if pose is None or replace(pose, sent_us=None) != replace(recorded, sent_us=None):
                self.differences.append((tick, self._robot, "pose"))


def _without_clock(command: Command) -> Command:
    return replace(command, refused={}, timing=None)
