"""Reading a run's recording back, whole or cut off anywhere.

A world that was killed leaves a file without its end. What reached the disk as a whole chunk is
there, and everything before it; the rest is not. Nor is what comes after damage, which the
checksums of the chunks show. Messages of an earlier version of the wire are read as messages of
this one (``encircle.protocol.wire.earlier_versions``).
"""

import json
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from mcap.exceptions import McapError
from mcap.records import Channel, Message, Metadata
from mcap.stream_reader import StreamReader

from encircle.protocol.codec import M, decode
from encircle.protocol.errors import ProtocolError, UnknownKey
from encircle.protocol.keys import check_name, parse_key
from encircle.protocol.wire.earlier_versions import upgraded
from encircle.world.loading.interventions import as_played
from encircle.world.loading.load import load
from encircle.world.recording.run_directory import RECORDING, RunDirectoryError
from encircle.world.scenario.errors import ScenarioError
from encircle.world.scenario.model import Scenario

INTERVENTION = "world/intervention"
UNREADABLE = (
    *(McapError, EOFError, ValueError, KeyError, struct.error),
    # A length that is not one.
    *(OverflowError, MemoryError),
)


class RecordingError(RunDirectoryError):
    """A recording that cannot be read; the message says which and why."""


@dataclass(frozen=True, slots=True)
class Recording:
    """A recording in memory. ``messages``: (tick, topic, payload) in the order of the file.

    ``scenario``: as played, with the events that were given while the run went on;
    ``written``: as the run began, the same if left out.
    ``complete``: whether the file was finished; a killed run's is not, but reads up to its last
    chunk. ``versions``: of the programs that made it, by name. ``logged_us``: each message's log
    time in us, which in real time is when the world sent it or got it (Unix time).
    """

    path: Path
    scenario: Scenario
    seed: int
    run: str
    messages: tuple[tuple[int, str, bytes], ...]
    complete: bool
    versions: Mapping[str, str] = field(default_factory=dict)
    logged_us: tuple[int, ...] = ()
    written: Scenario | None = None

    @property
    def scenario_as_written(self) -> Scenario:
        """The scenario as the run began."""
        return self.scenario if self.written is None else self.written

    def of_channel(self, channel: str) -> Iterator[tuple[int, str, bytes]]:
        """The messages of one channel: (tick, robot or ``world``, payload)."""
        for tick, topic, payload in self.messages:
            parts = topic.split("/")
            if parts[-1] == channel:
                yield tick, parts[-2], payload


def decoded(kind: type[M], recording: Recording, tick: int, payload: bytes) -> M:
    """A message of a recording; ``RecordingError`` if it is none of that kind."""
    try:
        return decode(kind, payload, recording.run)
    except ProtocolError as error:
        raise RecordingError(f"{recording.path}: tick {tick}: {error}") from None


def recording_of(path: str | Path) -> Path:
    """The recording file of a run directory, or the file itself."""
    location = Path(path)
    return location / RECORDING if location.is_dir() else location


def read_metadata(metadata: Mapping[str, str]) -> tuple[Scenario, int, str]:
    """Scenario, seed and run name from a recording's metadata."""
    tree = json.loads(metadata["scenario"])
    return load(tree), int(metadata["seed"]), check_name("run", metadata["run"])


def read_recording(path: str | Path) -> Recording:
    """Read a run directory's recording, finished or not; ``RecordingError`` if it is none."""
    file_path = recording_of(path)
    channels: dict[int, str] = {}
    metadata: dict[str, str] = {}
    messages: list[tuple[int, str, bytes]] = []
    logged_us: list[int] = []
    complete = True
    try:
        with open(file_path, "rb") as file:
            try:
                for record in StreamReader(file, validate_crcs=True).records:
                    if isinstance(record, Message):
                        topic, payload = channels[record.channel_id], upgraded(record.data)
                        messages.append((record.sequence, topic, payload))
                        logged_us.append(record.log_time // 1000)
                    elif isinstance(record, Channel):
                        channels[record.id] = record.topic
                    elif isinstance(record, Metadata) and record.name == "encircle":
                        metadata = record.metadata
            except UNREADABLE:
                complete = False
    except OSError as error:
        raise RecordingError(f"{file_path} cannot be read: {error.strerror}") from None
    try:
        scenario, seed, run = read_metadata(metadata)
        versions = json.loads(metadata.get("versions", "{}"))
        for topic in channels.values():
            parse_key(f"encircle/{run}/{topic}")
        written = scenario
        for _, topic, payload in messages:
            if topic == INTERVENTION:
                scenario = as_played(scenario, payload, run)
    except UnknownKey as error:
        raise RecordingError(f"{file_path}: {error}") from None
    except ProtocolError as error:
        raise RecordingError(f"{file_path}: {error}") from None
    except ScenarioError as error:
        # As of a policy or target behaviour that is not installed here.
        raise RecordingError(f"{file_path} cannot be understood here: {error}") from None
    except (KeyError, ValueError):
        raise RecordingError(
            f"{file_path} is not a recording of this program, or its head is damaged"
        ) from None
    heard, times = tuple(messages), tuple(logged_us)
    return Recording(file_path, scenario, seed, run, heard, complete, versions, times, written)
