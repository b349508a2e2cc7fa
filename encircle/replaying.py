"""Replay: read a recording back, and check that fresh brains decide the same on it.

The check feeds each robot's recorded setup and observations, byte for byte, to a new robot core and
compares the poses and commands it sends with those recorded. It needs no world and no link, so what
is found different was decided differently.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from mcap.exceptions import McapError
from mcap.records import Channel, Message, Metadata
from mcap.stream_reader import StreamReader

from agents.core import RobotCore
from encircle.hunts import read_metadata, recording_of
from protocol.codec import decode
from protocol.messages import Command
from world.run_directory import RunDirectoryError
from world.scenario import Scenario


class RecordingError(RunDirectoryError):
    """A recording that cannot be read; the message says which and why."""


@dataclass(frozen=True, slots=True)
class Recording:
    """A recording in memory. ``messages``: (tick, topic, payload) in the order of the file.

    ``complete``: whether the file was finished; a killed run's is not, but reads up to its last
    chunk.
    """

    path: Path
    scenario: Scenario
    seed: int
    run: str
    messages: tuple[tuple[int, str, bytes], ...]
    complete: bool

    def of_channel(self, channel: str) -> Iterator[tuple[int, str, bytes]]:
        """The messages of one channel: (tick, robot or ``world``, payload)."""
        for tick, topic, payload in self.messages:
            parts = topic.split("/")
            if parts[-1] == channel:
                yield tick, parts[-2], payload


@dataclass(frozen=True, slots=True)
class ReplayCheck:
    """What a replay found. ``differences``: (tick, robot, channel) that came out differently."""

    ticks: int
    robots: int
    compared: int
    differences: tuple[tuple[int, str, str], ...]
    complete: bool

    @property
    def same(self) -> bool:
        """Whether every decision was compared equal, and there was at least one."""
        return self.compared > 0 and not self.differences


def read_recording(path: str | Path) -> Recording:
    """Read a run directory's recording, finished or not; ``RecordingError`` if it is none."""
    file_path = recording_of(path)
    channels: dict[int, str] = {}
    metadata: dict[str, str] = {}
    messages: list[tuple[int, str, bytes]] = []
    complete = True
    try:
        with open(file_path, "rb") as file:
            try:
                for record in StreamReader(file).records:
                    if isinstance(record, Message):
                        messages.append((record.sequence, channels[record.channel_id], record.data))
                    elif isinstance(record, Channel):
                        channels[record.id] = record.topic
                    elif isinstance(record, Metadata) and record.name == "encircle":
                        metadata = record.metadata
            except (McapError, EOFError, ValueError, KeyError, struct.error):
                complete = False
    except OSError as error:
        raise RecordingError(f"{file_path} cannot be read: {error.strerror}") from None
    try:
        scenario, seed, run = read_metadata(metadata)
    except (KeyError, ValueError):  # a scenario that does not load is a ValueError too
        raise RecordingError(
            f"{file_path} is not a recording of this program, or its head is damaged"
        ) from None
    return Recording(file_path, scenario, seed, run, tuple(messages), complete)


def replay(path: str | Path) -> ReplayCheck:
    """Feed a recording's observations to fresh brains and compare what they decide."""
    recording = read_recording(path)
    run = recording.run
    cores = {robot: RobotCore(robot, run) for robot in recording.scenario.ids}
    decided: dict[tuple[int, str, str], bytes] = {}
    differences: list[tuple[int, str, str]] = []
    compared = 0
    for tick, topic, payload in recording.messages:
        *_, robot, channel = topic.split("/")
        if channel in ("setup", "observation", "pose", "command") and robot not in cores:
            differences.append((tick, robot, channel))
        elif channel in ("setup", "observation"):
            for key, answer in cores[robot].receive(f"encircle/{run}/{topic}", payload):
                decided[tick, robot, key.rsplit("/", 1)[1]] = answer
        elif channel in ("pose", "command"):
            compared += 1
            if not _same(decided.pop((tick, robot, channel), None), payload, channel, run):
                differences.append((tick, robot, channel))
    # What was decided but not recorded was left out, unless the recording ends before it: answers
    # are recorded when a round is complete, and a cut may go through the last round.
    last = max((tick for tick, _, _ in recording.messages), default=0)
    answered = max((tick for tick, _, _ in recording.of_channel("command")), default=-1)
    whole = answered if recording.complete else answered - 1
    differences += [left for left in decided if left[0] <= whole]
    return ReplayCheck(
        last,
        len(cores),
        compared,
        tuple(differences),
        recording.complete,
    )


def _same(decided: bytes | None, recorded: bytes, channel: str, run: str) -> bool:
    """Whether a decision is the recorded one; how many messages a robot refused is no decision."""
    if decided is None or decided == recorded or channel != "command":
        return decided == recorded
    mine, theirs = decode(Command, decided, run), decode(Command, recorded, run)
    return replace(mine, refused={}) == replace(theirs, refused={})
