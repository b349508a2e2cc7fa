"""Traces: what a real network did in a recorded run, as a file that the channel can replay.

A trace has one row per packet and link, in the order of sending, with the columns that
``encircle.world.loading.trace_files`` reads. The run must be one in real time. The trace holds the
loss and delay of the real network only, without those that the channel model injected. If robots
did not receive each other's packets directly but through the world, a packet's delay is the sum of
two: the way to the world, and the way of the next observation. The wait for the tick in between is
left out.
"""

import csv
import io
from pathlib import Path
from statistics import median
from typing import NamedTuple

from encircle.network.recorded_ledger import ledger_of
from encircle.protocol.process.interrupts import check, signals_held
from encircle.world.loading.channel_consistency import TRACE_ROWS_MAX
from encircle.world.network.transits import offsets_of, transits_of
from encircle.world.network.transport import delay_refusal, unsteady
from encircle.world.recording.recording import Recording
from encircle.world.recording.run_directory import RunDirectoryError

COLUMNS = ("sender", "receiver", "lost", "delay_s")
SUFFIXES = (".csv", ".parquet")
DELAY_DIGITS = 6


class TraceFileError(RunDirectoryError):
    """The trace cannot be written; the message names the file and the reason."""


class TraceRow(NamedTuple):
    """One packet of a trace; ``delay_s`` is None if it was lost or is not known.

    ``sender`` and ``receiver`` are empty in a trace for all links.
    """

    sender: str
    receiver: str
    lost: int
    delay_s: float | None


class NetworkTrace(NamedTuple):
    """The packets of a run, or of a public trace set.

    ``delays_refused``: why delays are left out, None if they are given. ``left_out``: how many
    packets at the end do not fit into a trace.
    """

    rows: list[TraceRow]
    delays_refused: str | None
    left_out: int


def trace_of(recording: Recording) -> NetworkTrace:
    """The trace of a recorded run; raises ``RecordingError`` if it was not in real time."""
    ledger = ledger_of(recording)
    offsets = {robot: offsets_of(ledger, robot) for robot in ledger.robots}
    pairs = [(s, r) for s in ledger.robots for r in ledger.robots if s != r]
    rows_per_link_max = TRACE_ROWS_MAX // max(1, len(pairs))
    rows: list[TraceRow] = []
    refused, left_out = None, 0
    for sender, receiver in pairs:
        transits = transits_of(ledger, sender, receiver, offsets)
        known = [transit for transit in transits if transit.delay_us is not None]
        if any(not transit.lost for transit in transits) and refused is None:
            error_us = median([transit.error_us for transit in known]) if known else None
            refused = delay_refusal(error_us, ledger.tick_s)
            refused = refused or unsteady(sender, offsets) or unsteady(receiver, offsets)
            refused = refused and f"{sender} to {receiver}: {refused}"
        # The time of sending is known only if the packet reached the world too.
        usual_us = median([transit.delay_us or 0.0 for transit in known]) if known else 0.0
        left_out += max(0, len(transits) - rows_per_link_max)
        for _, lost, delay_us, _ in transits[:rows_per_link_max]:
            # With an inexact clock offset an arrival may seem earlier than the sending.
            delay_s = max(0.0, usual_us if delay_us is None else delay_us) / 1e6
            rows.append(
                TraceRow(
                    sender, receiver, int(lost), None if lost else round(delay_s, DELAY_DIGITS)
                )
            )
    return NetworkTrace(rows, refused, left_out)


def check_trace_path(path: Path) -> None:
    """Raise ``TraceFileError`` if no trace can be written to a path.

    To be called before a run is read.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise TraceFileError(f"{path}: a trace's name must end in {' or '.join(SUFFIXES)}")
    if path.exists():
        raise TraceFileError(f"{path} exists: choose another --out, nothing was changed")


def write_trace(trace: NetworkTrace, path: Path) -> None:
    """Write a trace to a new file; raises ``TraceFileError`` if that is not possible."""
    check_trace_path(path)
    if not trace.rows:
        raise TraceFileError(f"{path}: the run has no packet that could have been heard")
    first = 0 if trace.rows[0].sender else COLUMNS.index("lost")
    names = COLUMNS[first:] if trace.delays_refused is None else COLUMNS[first:-1]
    made = (
        _as_csv(trace, names) if path.suffix.lower() == ".csv" else _as_parquet(trace, names, path)
    )
    try:
        with signals_held(), open(path, "xb") as file:
            try:
                file.write(made)
                file.flush()
                check()
            except BaseException:
                # Half a file would make the next attempt fail, as the path exists.
                path.unlink()
                raise
    except OSError as error:
        raise TraceFileError(f"{path} cannot be written: {error.strerror}") from None


def _as_csv(trace: NetworkTrace, names: tuple[str, ...]) -> bytes:
    text = io.StringIO(newline="")
    writer = csv.writer(text)
    writer.writerow(names)
    first = COLUMNS.index(names[0])
    writer.writerows(row[first : first + len(names)] for row in trace.rows)
    return text.getvalue().encode()


def _as_parquet(trace: NetworkTrace, names: tuple[str, ...], path: Path) -> bytes:
    try:
        from pyarrow import parquet, table
    except ImportError:
        raise TraceFileError(
            f"{path}: writing Parquet needs pyarrow (pip install 'encircle[studies]'), CSV does not"
        ) from None
    columns = dict(zip(COLUMNS, map(list, zip(*trace.rows, strict=True)), strict=True))
    made = io.BytesIO()
    parquet.write_table(table({name: columns[name] for name in names}), made)
    return made.getvalue()
