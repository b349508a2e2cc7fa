"""A study's table as CSV text, from which the same numbers are read again, bit for bit.

A float stands as its shortest text that gives it back, an undefined one as ``nan``. The columns are
those of the study's plan, in the order of its table; nothing else is read.
"""

import csv
import io
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from encircle.bundles.bundle_file import TABLE, BundleError
from encircle.studies.plan import Plan
from encircle.studies.tasks import FAILED

ROWS_MAX = 200_000
INTEGERS, TEXTS = ("cell", "seed", "ticks"), ("digest", FAILED, "code", "versions")
UNREPEATABLE = "wall_s"
"""How long a run took: the one column that is another each time."""
FIELD_CHARACTERS_MAX = 100_000
_INTEGER = re.compile(r"[0-9]{1,19}")
_FLOAT = re.compile(r"-?(?:[0-9]{1,20}(?:\.[0-9]{1,20})?(?:e[+-]?[0-9]{1,3})?|inf)|nan")

Row = dict[str, Any]


def columns_of(plan: Plan) -> dict[str, type]:
    """The columns of a study's table, in order, and what they hold."""
    axes = {axis.name: float if axis.numeric else str for axis in plan.all_axes}
    names = [
        *("cell", *axes, "seed", "digest", "captured", "ticks", FAILED),
        *plan.measure_names,
        *(UNREPEATABLE, "code", "versions"),
    ]
    kinds: dict[str, type] = {**dict.fromkeys(INTEGERS, int), **dict.fromkeys(TEXTS, str), **axes}
    return {name: kinds.get(name, float) for name in dict.fromkeys(names)}


def table_text(plan: Plan, rows: Iterable[Mapping[str, Any]]) -> str:
    """The table as CSV."""
    columns = columns_of(plan)
    text = io.StringIO()
    # Its line ends are both characters, so that a text with one of them is put in quotes.
    writer = csv.writer(text)
    writer.writerow(columns)
    for row in rows:
        writer.writerow([_cell_text(kind, row[name]) for name, kind in columns.items()])
    return text.getvalue()


def read_table(plan: Plan, content: bytes) -> list[Row]:
    """The rows of a table; ``BundleError`` names the line and column that cannot be one's."""
    columns = columns_of(plan)
    try:
        csv.field_size_limit(FIELD_CHARACTERS_MAX)
        lines = csv.reader(io.StringIO(content.decode("utf-8"), newline=""), strict=True)
        header = next(lines, [])
        if header != list(columns):
            raise BundleError(_header_problem(header, list(columns)))
        rows: list[Row] = []
        for number, line in enumerate(lines, start=2):
            if len(rows) == ROWS_MAX:
                raise BundleError(f"{TABLE}: more than {ROWS_MAX} rows")
            rows.append(_row(number, line, columns))
    except (csv.Error, UnicodeDecodeError) as error:
        raise BundleError(f"{TABLE} cannot be read: {error}") from None
    return rows


def equal(one: Any, other: Any) -> bool:
    """Whether two values of a table are the same, to the last bit; undefined numbers are."""
    if isinstance(one, float) and isinstance(other, float):
        if math.isnan(one) or math.isnan(other):
            return math.isnan(one) and math.isnan(other)
        return one == other and math.copysign(1.0, one) == math.copysign(1.0, other)
    return bool(one == other)


def _header_problem(header: Sequence[str], expected: Sequence[str]) -> str:
    missing = [name for name in expected if name not in header]
    foreign = [name for name in header if name not in expected]
    what = [f"no column {', '.join(missing)}"] if missing else []
    what += [f"a column {', '.join(foreign)} that is not of the plan"] if foreign else []
    return f"{TABLE}: {' and '.join(what) or 'the columns are in another order than the plan has'}"


def _cell_text(kind: type, value: Any) -> str:
    return repr(float(value)) if kind is float else str(value)


def _row(number: int, line: Sequence[str], columns: Mapping[str, type]) -> Row:
    if len(line) != len(columns):
        raise BundleError(f"{TABLE}, line {number}: {len(line)} values under {len(columns)} names")
    return {
        name: _value(number, name, kind, text)
        for (name, kind), text in zip(columns.items(), line, strict=True)
    }


def _value(number: int, name: str, kind: type, text: str) -> Any:
    if kind is str:
        return text
    pattern, what = (_INTEGER, "whole number") if kind is int else (_FLOAT, "number")
    if pattern.fullmatch(text) is None:
        raise BundleError(f"{TABLE}, line {number}, {name} = {text[:40]!r}: must be a {what}")
    return kind(text)
