"""A recording as a directory of Parquet files, one per table of ``encircle.exports.table_rows``.

Each file's metadata say of which run it is. Rows are written as they are made, so that a long run
takes no more memory than its recording.
"""

import json
from contextlib import ExitStack
from pathlib import Path

import pyarrow as pa
from pyarrow import parquet

from encircle.exports.table_rows import TABLES, Row, rows_of
from encircle.protocol.process.interrupts import check
from encircle.scene.builder import frames_of_recording
from encircle.scene.stage import stage_of
from encircle.world.recording.recording import Recording

FORMAT_VERSION = 1
ROWS_AT_ONCE = 100_000
KEY = "encircle"
TYPES = {
    "int": pa.int64(),
    "float": pa.float64(),
    "bool": pa.bool_(),
    "name": pa.string(),
    "text": pa.string(),
    "names": pa.list_(pa.string()),
}


def export(recording: Recording, out: Path, *, beliefs: bool = True) -> None:
    """Write a recording's tables into a new directory.

    ``beliefs``: whether to work out what robots believed, which takes the longest. Raises
    ``RecordingError`` for a message that cannot be read.
    """
    stage = stage_of(recording.scenario, recording.seed, recording.run)
    states = [tick for tick, topic, _ in recording.messages if topic == "world/state"]
    last_tick = max(states, default=0)
    about = json.dumps(about_run(recording, last_tick))
    out.mkdir()
    with ExitStack() as files:
        writers = {}
        for name, columns in TABLES.items():
            schema = pa.schema(
                [(column, TYPES[kind]) for column, kind in columns], metadata={KEY: about}
            )
            writer = parquet.ParquetWriter(out / f"{name}.parquet", schema, compression="zstd")
            writers[name] = files.enter_context(writer)
        waiting: dict[str, list[Row]] = {name: [] for name in TABLES}
        for frame in frames_of_recording(recording, beliefs):
            check()
            for name, row in rows_of(stage, frame, last_tick):
                waiting[name].append(row)
            for name in [name for name, rows in waiting.items() if len(rows) >= ROWS_AT_ONCE]:
                _write(writers[name], waiting[name])
        for name, rows in waiting.items():
            _write(writers[name], rows)


def about_run(recording: Recording, last_tick: int) -> dict[str, object]:
    """What every file's metadata say of the run, under the key ``encircle``."""
    scenario = recording.scenario
    return {
        "format": FORMAT_VERSION,
        "run": recording.run,
        "seed": recording.seed,
        "title": scenario.title,
        "tick_s": scenario.tick_s,
        "last_tick": last_tick,
        "clock": scenario.clock,
        "complete": recording.complete,
        "versions": dict(recording.versions),
        "scenario": scenario.model_dump(mode="json", exclude_defaults=True),
    }


def _write(writer: parquet.ParquetWriter, rows: list[Row]) -> None:
    """Write rows as a row group, and forget them."""
    if not rows:
        return
    schema = writer.schema
    columns = [
        pa.array(column, field.type)
        for column, field in zip(zip(*rows, strict=True), schema, strict=True)
    ]
    writer.write_table(pa.Table.from_arrays(columns, schema=schema))
    rows.clear()
