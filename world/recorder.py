"""The recording of a run: one MCAP file with every wire message as it was.

One channel per key, without the run's prefix; message encoding ``msgpack``, with a JSON schema.
Times are simulated time, tick times tick length. Chunks of 64 KiB go to the file as they fill, so a
killed run stays readable up to its last chunk. Configuration, seed and versions are metadata.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import BinaryIO

from mcap.writer import CompressionType, Writer

from world.schemas import json_schema

CHUNK_BYTES = 64 * 1024
LIBRARY = "encircle"


class Recorder:
    """Writes one recording. The file must not exist yet."""

    def __init__(self, path: Path, tick_s: float, metadata: Mapping[str, str]) -> None:
        self._file: BinaryIO = open(path, "xb")  # noqa: SIM115  # closed by close()
        self._writer = Writer(self._file, chunk_size=CHUNK_BYTES, compression=CompressionType.NONE)
        self._writer.start(profile="", library=LIBRARY)
        self._writer.add_metadata("encircle", dict(metadata))
        self._file.flush()
        self._tick_ns = round(tick_s * 1e9)
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}

    def record(self, tick: int, key: str, payload: bytes) -> None:
        """Append one message of a tick."""
        channel = self._channels.get(key)
        if channel is None:
            channel = self._channels[key] = self._register(key)
        time_ns = tick * self._tick_ns
        self._writer.add_message(channel, time_ns, payload, time_ns, tick)

    def close(self) -> None:
        """Finish the file."""
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._file.close()

    def _register(self, key: str) -> int:
        topic = key.split("/", 2)[2]
        name = topic.rsplit("/", 1)[1]
        if name not in self._schemas:
            schema = json.dumps(json_schema(name)).encode()
            self._schemas[name] = self._writer.register_schema(name, "jsonschema", schema)
        return self._writer.register_channel(topic, "msgpack", self._schemas[name])
