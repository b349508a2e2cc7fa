"""What a study's directory holds so far, for who only looks: no lock is taken, nothing is written.

Another process may be at work there. If files are merged away meanwhile, all are read again, a few
times. A file that is damaged is passed over: ``Study.run`` says so.
"""

import json
from pathlib import Path
from typing import NamedTuple

import pyarrow as pa
import pyarrow.parquet as pq

from encircle.studies.plan import Plan
from encircle.studies.study_directory import OWNER_FILE, PARTS_DIRECTORY, TABLE_FILE
from encircle.studies.study_table import KEY_COLUMNS
from encircle.studies.summary import CAPTURED, TICKS

TRIES_MAX = 5


class CellSoFar(NamedTuple):
    """The runs of one cell that are there: captured and last tick of each, and how many failed."""

    captured: tuple[bool, ...]
    ticks: tuple[float, ...]
    failed: int


class SoFar(NamedTuple):
    """What is there of a study, cell by cell. ``problem``: why nothing can be told, else empty."""

    cells: tuple[CellSoFar, ...]
    problem: str = ""

    @property
    def runs(self) -> int:
        """How many runs are there that did not fail."""
        return sum(len(cell.captured) for cell in self.cells)

    @property
    def failed(self) -> int:
        """How many runs have failed."""
        return sum(cell.failed for cell in self.cells)


def runs_so_far(directory: Path, plan: Plan) -> SoFar:
    """The runs of a plan's cells and seeds in a directory; none if it is not there yet."""
    nothing = SoFar((CellSoFar((), (), 0),) * len(plan.cells))
    if not directory.exists():
        return nothing
    try:
        owner = json.loads((directory / OWNER_FILE).read_text(encoding="utf-8"))
        is_own = owner["fingerprint"] == plan.fingerprint
    except (OSError, ValueError, TypeError, KeyError):
        return nothing._replace(problem=f"{directory} is not a study's")
    if not is_own:
        return nothing._replace(problem=f"{directory} holds runs of another configuration")
    seeds, columns = set(plan.seed_list), [*KEY_COLUMNS, CAPTURED, TICKS]
    done: dict[tuple[int, int], tuple[bool, float]] = {}
    failed: set[tuple[int, int]] = set()
    for rows in _files(directory, columns):
        for cell, seed, failure, captured, ticks in zip(
            *(rows[name].to_pylist() for name in columns), strict=True
        ):
            if seed not in seeds or not 0 <= cell < len(plan.cells):
                continue
            if failure:
                failed.add((cell, seed))
            else:
                done[cell, seed] = (captured > 0.5, float(ticks))
    return SoFar(tuple(_cell(index, done, failed) for index in range(len(plan.cells))))


def _files(directory: Path, columns: list[str]) -> list[pa.Table]:
    """All files' rows, of one moment."""
    tables: list[pa.Table] = []
    for _ in range(TRIES_MAX):
        whole = directory / TABLE_FILE
        paths = [*([whole] if whole.exists() else [])]
        paths += sorted((directory / PARTS_DIRECTORY).glob("*.parquet"))
        tables = []
        try:
            for path in paths:
                try:
                    tables.append(pq.read_table(path, columns=columns))
                except (pa.ArrowException, KeyError):
                    continue
        except FileNotFoundError:
            continue
        return tables
    return tables


def _cell(
    index: int,
    done: dict[tuple[int, int], tuple[bool, float]],
    failed: set[tuple[int, int]],
) -> CellSoFar:
    keys = sorted(key for key in done if key[0] == index)
    captured, ticks = ([done[key][k] for key in keys] for k in (0, 1))
    left = sum(1 for key in failed if key[0] == index and key not in done)
    return CellSoFar(tuple(map(bool, captured)), tuple(map(float, ticks)), left)
