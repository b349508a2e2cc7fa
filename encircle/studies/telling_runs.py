"""Runs of a study that tell most to who looks at them: of a cell the median one and the worst.

Runs are ranked by the time to capture, the outcome that every study has; one without a capture is
later than any with one, and of equal ones the first seed counts. Of two in the middle the earlier
one is the median. Of a cell the first run without a capture is shown as well, and of the study the
first that failed.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

from encircle.studies.plan import Plan
from encircle.studies.study_table import StudyTable
from encircle.studies.summary import CAPTURED, TICKS, Summary
from encircle.studies.tasks import FAILED

COLUMNS = ("seed", "digest", CAPTURED, TICKS, "wall_s", FAILED)
MEDIAN, WORST = "the median run", "the worst run"
UNCAPTURED, FIRST_FAILED = "the first without a capture", "the first that failed"


class TellingRun(NamedTuple):
    """A run of the table, and why it tells something.

    ``digest``: empty of a run that failed, ``failure``: why it did; ``wall_s``: how long it took.
    """

    cell: int
    seed: int
    reasons: tuple[str, ...]
    captured: bool
    ticks: int
    digest: str
    wall_s: float
    failure: str = ""

    @property
    def name(self) -> str:
        """A name for files."""
        return f"cell-{self.cell}-seed-{self.seed}"


class Replay(NamedTuple):
    """A telling run and the page that shows it, relative to the study's directory.

    ``page`` is empty if there is none; ``problem`` then says why.
    """

    run: TellingRun
    page: str
    problem: str = ""


def telling_runs(
    plan: Plan, table: StudyTable, summary: Summary | None, every_cell: bool
) -> list[TellingRun]:
    """The telling runs of every cell, or of the two cells that differ most, and the first failed.

    ``summary``: of the table, None if no seed is complete.
    """
    cells = () if summary is None else range(len(plan.cells)) if every_cell else extremes(summary)
    runs = [run for cell in cells for run in _of_cell(table, cell)]
    failures = table.failures(1)
    if failures:
        cell, seed = failures[0]["cell"], failures[0]["seed"]
        wall_s = next(row["wall_s"] for row in _rows(table, cell) if row["seed"] == seed)
        failure = failures[0][FAILED]
        runs.append(TellingRun(cell, seed, (FIRST_FAILED,), False, 0, "", wall_s, failure))
    return runs


def extremes(summary: Summary) -> tuple[int, ...]:
    """The cells with the lowest and the highest capture rate, the first ones of several.

    If all rates are equal, those with the longest and the shortest mean time; one if both are one.
    """
    rates = [cell.rate.value for cell in summary.cells]
    times_s = [-cell.time_s.value for cell in summary.cells]
    ranks = rates if min(rates) < max(rates) else times_s
    return tuple(dict.fromkeys((ranks.index(min(ranks)), ranks.index(max(ranks)))))


def _of_cell(table: StudyTable, cell: int) -> Iterator[TellingRun]:
    rows = [row for row in _rows(table, cell) if not row[FAILED]]
    if not rows:
        return
    order = sorted(range(len(rows)), key=lambda k: (not rows[k][CAPTURED], rows[k][TICKS], k))
    worst = rows[order[-1]]
    latest = next(k for k in order if _equal(rows[k], worst))
    reasons: dict[int, list[str]] = {}
    reasons.setdefault(order[(len(order) - 1) // 2], []).append(MEDIAN)
    reasons.setdefault(latest, []).append(WORST)
    if not worst[CAPTURED]:
        first = next(k for k, row in enumerate(rows) if not row[CAPTURED])
        reasons.setdefault(first, []).append(UNCAPTURED)
    for k, why in reasons.items():
        row = rows[k]
        outcome = bool(row[CAPTURED]), int(row[TICKS]), row["digest"], row["wall_s"]
        yield TellingRun(cell, row["seed"], tuple(why), *outcome)


def _equal(one: dict[str, Any], other: dict[str, Any]) -> bool:
    return bool(one[CAPTURED] == other[CAPTURED] and one[TICKS] == other[TICKS])


def _rows(table: StudyTable, cell: int) -> list[dict[str, Any]]:
    """The runs of a cell in the order of their seeds, failed ones included."""
    rows: list[dict[str, Any]] = table.read(COLUMNS, slice(cell, cell + 1)).to_pylist()
    return rows
