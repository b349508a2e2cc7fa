"""The recording of a run: one MCAP file with every wire message as it was.

One channel per key, without the run's prefix; message encoding ``msgpack``, with a JSON schema.
Times are simulated time, tick times tick length; in real time the log time is the world's clock.
Chunks of 64 KiB go to the file as they fill, so a
killed run stays readable up to its last chunk. Configuration, seed and versions are metadata. When
the disk is full the recording stops at its last whole record.
"""

import json
import os
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import IO, Any, cast

from mcap.writer import CompressionType, Writer

from encircle.world.recording.schemas import json_schema

CHUNK_BYTES = 64 * 1024
LIBRARY = "encircle"


class RecordingStopped(Exception):
    """The recording cannot go on; the message says which and why. What is there is readable."""


class Recorder:
    """Writes one recording. The file must not exist yet; ``OSError`` if it cannot be made.

    ``held``: what is to be let go of when it is closed.
    """

    def __init__(self, path: Path, tick_s: float, metadata: Mapping[str, str]) -> None:
        self._file = _WholeRecords(path)
        self._stopped: RecordingStopped | None = None
        self.held = ExitStack()
        # The writer only writes, and asks where it is.
        output = cast(IO[Any], self._file)
        self._writer = Writer(output, chunk_size=CHUNK_BYTES, compression=CompressionType.NONE)
        self._writer.start(profile="", library=LIBRARY)
        self._writer.add_metadata("encircle", dict(metadata))
        self._tick_ns = round(tick_s * 1e9)
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}

    def record(self, tick: int, key: str, payload: bytes, at_us: int | None = None) -> None:
        """Append one message of a tick; raises ``RecordingStopped`` once, then does nothing.

        ``at_us``: when the world sent it or got it (Unix time in us), in real time.
        """
        if self._stopped is not None:
            return
        try:
            channel = self._channels.get(key)
            if channel is None:
                channel = self._channels[key] = self._register(key)
            time_ns = tick * self._tick_ns
            logged_ns = time_ns if at_us is None else at_us * 1000
            self._writer.add_message(channel, logged_ns, payload, time_ns, tick)
        except RecordingStopped as error:
            self._stopped = error
            raise

    def close(self) -> None:
        """Finish the file; raises ``RecordingStopped`` if it was stopped, or is now."""
        try:
            if self._stopped is not None:
                raise self._stopped
            self._writer.finish()  # type: ignore[no-untyped-call]
        finally:
            self._file.close()
            self.held.close()

    def _register(self, key: str) -> int:
        topic = key.split("/", 2)[2]
        name = topic.rsplit("/", 1)[1]
        if name not in self._schemas:
            schema = json.dumps(json_schema(name)).encode()
            self._schemas[name] = self._writer.register_schema(name, "jsonschema", schema)
        return self._writer.register_channel(topic, "msgpack", self._schemas[name])


class _WholeRecords:
    """A new file to which each write goes at once and whole, or not at all."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file = open(path, "xb", buffering=0)  # noqa: SIM115  # closed by close()
        self._bytes = 0

    def write(self, data: bytes) -> int:
        left = memoryview(data)
        try:
            while left:
                left = left[os.write(self._file.fileno(), left) :]
        except OSError as error:
            os.ftruncate(self._file.fileno(), self._bytes)
            reason = f"cannot record to {self._path}: {error.strerror}"
            raise RecordingStopped(reason) from None
        self._bytes += len(data)
        return len(data)

    def tell(self) -> int:
        return self._bytes

    def flush(self) -> None:
        """Nothing is held back."""

    def close(self) -> None:
        self._file.close()
