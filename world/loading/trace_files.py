"""Recorded traces of loss and delay: files read, checked and put into the scenario.

A trace is a table with a row per packet, in the order of sending: ``lost`` (0 or 1, false or true)
for loss, ``delay_s`` (seconds, empty where the packet was lost) for delay, and, if each directed
link has rows of its own, ``sender`` and ``receiver``. Rows in which those two are empty are for
all links that have none of their own; other columns are passed over. The rows replace
the file's name as the scenario is loaded, so that a resolved scenario, its digest and its
recording depend on no path.
"""

import csv
import re
from collections.abc import Iterator, Mapping, Sequence
from math import isnan
from pathlib import Path
from typing import Any, NamedTuple

from encircle.world.loading.channel_consistency import TRACE_ROWS_MAX
from encircle.world.scenario.fields import DELAY_S_MAX, shown

COLUMNS = ("lost", "delay_s", "sender", "receiver")
ROBOT = re.compile(r"r[1-9][0-9]*", re.ASCII)
CELL_BYTES_MAX, PARQUET_BYTES_MAX = 64, 2**28
"""How long a text in a Parquet file may be, and the columns that are read, as the file says."""
BITS = {"0": 0, "1": 1, "false": 0, "true": 1, "0.0": 0, "1.0": 1}


class TraceError(ValueError):
    """A trace that cannot be used; the message names file, row, column and value."""


class Trace(NamedTuple):
    """The columns of a trace by name, all equally long; cells as they stand in the file.

    ``names``: of all columns, also of those that are not read.
    """

    path: Path
    names: Sequence[str]
    columns: Mapping[str, Sequence[Any]]
    rows: int

    def refused(self, row: int, column: str, must: str) -> TraceError:
        """What is wrong with a cell; rows count from 1, without the header."""
        value = shown(self.columns[column][row])
        return TraceError(f"{self.path}, row {row + 1}, {column} = {value}: must be {must}")


def anchored(tree: Any, folder: Path) -> Any:
    """A scenario's tree with its traces' relative file names taken to lie in ``folder``."""
    for _, table in trace_tables(tree):
        if isinstance(table.get("file"), str):
            table["file"] = str(folder / table["file"])
    return tree


def inlined(tree: Any) -> list[str]:
    """Replace the file of every trace by its rows; returns what is wrong with them."""
    problems: list[str] = []
    read: dict[str, Trace] = {}
    for key, table in trace_tables(tree):
        if "file" not in table:
            continue
        file = table.pop("file")
        if not isinstance(file, str):
            problems.append(f"{key}.file = {shown(file)}: must be the name of a file")
        elif table.get("model") != "trace":
            problems.append(f"{key}.file = {file!r}: has a meaning for model 'trace' only")
        elif table.get("values") or table.get("links"):
            problems.append(f"{key}.file = {file!r}: give either file or rows in values and links")
        else:
            try:
                if file not in read:
                    read[file] = read_trace(Path(file))
                table.update(rows_of(read[file], key.rsplit(".", 1)[-1]))
                continue
            except TraceError as error:
                problems.append(f"{key}.file: {error}")
        if table.get("model") == "trace":
            # So that the rest of the scenario is checked as well.
            table.setdefault("values", [0])
    return problems


def read_trace(path: Path) -> Trace:
    """Read a trace from a CSV or Parquet file; ``TraceError`` if it cannot be read."""
    readers = {".csv": _from_csv, ".parquet": _from_parquet}
    suffix = path.suffix.lower()
    if suffix not in readers:
        raise TraceError(f"{path}: a trace's name must end in .csv or .parquet")
    try:
        trace = readers[suffix](path)
    except FileNotFoundError:
        raise TraceError(f"{path}: there is no such file") from None
    except TraceError:
        raise
    except (OSError, ValueError, csv.Error) as error:  # wrong UTF-8 and pyarrow's are ValueErrors
        raise TraceError(f"{path} cannot be read: {error}") from None
    if trace.rows == 0:
        raise TraceError(f"{path}: has no rows")
    return trace


def rows_of(trace: Trace, sort: str) -> dict[str, Any]:
    """A trace's rows as a scenario's ``values`` and ``links``; ``sort`` is loss or delay."""
    values: list[int] | list[float | None] = _losses(trace) if sort == "loss" else _delays(trace)
    if "sender" not in trace.columns and "receiver" not in trace.columns:
        return {"values": values}
    ends = [_column(trace, end) for end in ("sender", "receiver")]
    by_link: dict[tuple[str, str], list[Any]] = {}
    for row, value in enumerate(values):
        sender, receiver = ("" if cell[row] is None else str(cell[row]).strip() for cell in ends)
        if not sender and not receiver:
            pass
        elif not ROBOT.fullmatch(sender):
            raise trace.refused(row, "sender", "a robot, as in r1, or empty if receiver is")
        elif not ROBOT.fullmatch(receiver) or receiver == sender:
            raise trace.refused(row, "receiver", "another robot, as in r2, or empty if sender is")
        by_link.setdefault((sender, receiver), []).append(value)
    table: dict[str, Any] = {}
    if ("", "") in by_link:
        table["values"] = by_link.pop(("", ""))
    if by_link:
        table["links"] = [
            {"sender": s, "receiver": r, "values": own} for (s, r), own in by_link.items()
        ]
    return table


def trace_tables(tree: Any) -> Iterator[tuple[str, dict[str, Any]]]:
    """The tables of loss and delay in a scenario's tree, which may be malformed, by key."""
    channel = tree.get("channel") if isinstance(tree, dict) else None
    if not isinstance(channel, dict):
        return
    links = channel.get("links")
    parents = [("channel", channel)]
    parents += [
        (f"channel.links.{k}", x) for k, x in enumerate(links if isinstance(links, list) else ())
    ]
    for key, parent in parents:
        for sort in ("loss", "delay"):
            if isinstance(parent, dict) and isinstance(parent.get(sort), dict):
                yield f"{key}.{sort}", parent[sort]


def _from_csv(path: Path) -> Trace:
    with open(path, encoding="utf-8-sig", newline="") as file:
        lines = (line for line in csv.reader(file, strict=True) if line)
        header = [name.strip() for name in next(lines, [])]
        rows: list[list[str]] = []
        for line in lines:
            if len(line) != len(header):
                raise TraceError(
                    f"{path}, row {len(rows) + 1}: has {len(line)} values under {len(header)} names"
                )
            if len(rows) == TRACE_ROWS_MAX:
                raise _too_long(path, f"more than {TRACE_ROWS_MAX}")
            rows.append(line)
    _check_names(path, header)
    columns = {name: [row[index] for row in rows] for index, name in enumerate(header)}
    return Trace(path, header, columns, len(rows))


def _from_parquet(path: Path) -> Trace:
    try:
        from pyarrow import ArrowException, parquet
    except ImportError:
        raise TraceError(
            f"{path}: reading Parquet needs pyarrow (pip install 'encircle[studies]'), CSV does not"
        ) from None
    try:
        with parquet.ParquetFile(path) as file:
            head, schema = file.metadata, file.schema_arrow
        if head.num_rows > TRACE_ROWS_MAX:
            raise _too_long(path, str(head.num_rows))
        _check_names(path, schema.names)
        read = [name for name in schema.names if name in COLUMNS]
        for name in read:
            _check_type(path, schema.field(name))
        texts = [name for name in read if _is_text(schema.field(name).type)]
        # A few long texts, many times, are a small file and a huge table: each is had once.
        with parquet.ParquetFile(path, read_dictionary=texts) as file:
            _check_size(path, head, read)
            table = file.read(columns=read)
        for name in texts:
            _check_texts(path, name, table[name])
        return Trace(path, schema.names, table.to_pydict(), head.num_rows)
    except ArrowException as error:
        raise TraceError(f"{path} cannot be read: {error}") from None


def _check_type(path: Path, field: Any) -> None:
    from pyarrow import types

    plain = (types.is_boolean, types.is_integer, types.is_floating, types.is_null, _is_text)
    if not any(is_plain(field.type) for is_plain in plain):
        raise TraceError(
            f"{path}, {field.name}: is of {field.type}, must be truth values, numbers or texts"
        )


def _is_text(kind: Any) -> bool:
    from pyarrow import types

    kind = kind.value_type if types.is_dictionary(kind) else kind
    return bool(types.is_string(kind) or types.is_large_string(kind))


def _check_size(path: Path, head: Any, read: Sequence[str]) -> None:
    groups = [head.row_group(k) for k in range(head.num_row_groups)]
    columns = [group.column(k) for group in groups for k in range(group.num_columns)]
    size = sum(c.total_uncompressed_size for c in columns if c.path_in_schema in read)
    if size > PARQUET_BYTES_MAX:
        raise TraceError(f"{path}: has {size} bytes to be read, at most {PARQUET_BYTES_MAX} may be")


def _check_texts(path: Path, name: str, column: Any) -> None:
    from pyarrow import compute

    for chunk in column.chunks:
        longest = compute.max(compute.binary_length(chunk.dictionary)).as_py() or 0
        if longest > CELL_BYTES_MAX:
            raise TraceError(
                f"{path}, {name}: has a text of {longest} bytes, at most {CELL_BYTES_MAX} may be"
            )


def _check_names(path: Path, names: Sequence[str]) -> None:
    if len(set(names)) < len(names):
        raise TraceError(f"{path}: two columns have one name: {', '.join(names)}")


def _too_long(path: Path, rows: str) -> TraceError:
    return TraceError(f"{path}: has {rows} rows, a scenario's traces can have {TRACE_ROWS_MAX}")


def _column(trace: Trace, name: str) -> Sequence[Any]:
    if name not in trace.columns:
        raise TraceError(
            f"{trace.path}: has no column {name!r}; its columns are {', '.join(trace.names)}"
        )
    return trace.columns[name]


def _losses(trace: Trace) -> list[int]:
    losses = []
    for row, cell in enumerate(_column(trace, "lost")):
        bit = BITS.get(str(cell).strip().lower())
        if bit is None:
            raise trace.refused(row, "lost", "0 or 1, false or true")
        losses.append(bit)
    return losses


def _delays(trace: Trace) -> list[float | None]:
    """Delays in s, None for lost packets, whose cells are not read."""
    cells = _column(trace, "delay_s")
    lost = _losses(trace) if "lost" in trace.columns else None
    delays_s: list[float | None] = []
    for row, cell in enumerate(cells):
        empty = cell is None or str(cell).strip().lower() in ("", "nan")
        if (lost is None and empty) or (lost is not None and lost[row]):
            delays_s.append(None)
            continue
        try:
            delay_s = float(cell)
        except (TypeError, ValueError):
            delay_s = float("nan")
        if isnan(delay_s) or not 0.0 <= delay_s <= DELAY_S_MAX:
            empty_if = "" if lost is not None else ", or empty if the packet was lost"
            raise trace.refused(row, "delay_s", f"from 0 to {DELAY_S_MAX:g} s{empty_if}")
        delays_s.append(delay_s)
    return delays_s
