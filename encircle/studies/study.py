"""A study at work: what is missing is run, what is there is kept, the table is read.

``encircle.study("loss").table()`` runs what is missing and returns the table as a pandas frame.
"""

import os
import warnings
from collections.abc import Callable, Generator, Iterator
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from encircle.protocol.process.interrupts import signals_held
from encircle.protocol.process.tracebacks import TRACEBACK_IN
from encircle.runner.links import LINKS
from encircle.studies.plan import Plan
from encircle.studies.sources import code
from encircle.studies.table import StudyTable
from encircle.studies.tasks import FAILED, TRACE, Row, Task
from encircle.studies.workers import in_processes, on_cluster
from encircle.world.loading.remarks import ScenarioRemark

if TYPE_CHECKING:
    import pandas as pd

TASK_RUNS = 8
TRACES_MAX = 100
"""Tracebacks that are kept of runs that failed; they are seldom more than a few different ones."""
Progress = Callable[[int, int], None]


class Study:
    """A plan and the directory of its table. ``directory``: ``runs/study-NAME`` by default.

    Nothing is written before ``run`` or ``table`` is called.
    """

    def __init__(self, plan: Plan, directory: str | Path | None = None) -> None:
        self.plan = plan
        self.directory = Path(directory or Path("runs") / f"study-{plan.name}")

    def run(
        self,
        *,
        link: str = "memory",
        workers: int | None = None,
        cluster: str | None = None,
        progress: Progress | None = None,
    ) -> int:
        """Run what is missing, and again what failed; returns how many runs that were.

        ``link``: ``memory``, on ``workers`` processes of this machine (one per core by default) or
        on the dask cluster at ``cluster``; or ``zenoh``, one run after the other through robot
        processes that are kept. ``progress`` is called with the numbers of runs that are done and
        that there are. A run that fails stands as failed in the table, its traceback in a file
        under ``failed``, and the others go on. Raises ``StudyError`` for a directory that is
        another study's and ``StudyFailed`` if not everything could be run, ``Interrupted`` after
        Ctrl-C; the same call then goes on. Warns with ``ScenarioRemark`` of cells that may not be
        what was meant.
        """
        if link not in LINKS:
            raise ValueError(f"link {link!r}: must be one of {', '.join(LINKS)}")
        for remark in self.plan.remarks():
            warnings.warn(remark, ScenarioRemark, stacklevel=2)
        tell = progress or (lambda _done, _all: None)
        with signals_held(), closing(self.open()) as table:
            missing = int((~table.done).sum())
            done = self.plan.runs - missing
            tell(done, self.plan.runs)
            if missing:
                todo = tasks(self.plan, table.done)
                sources = table.owner["code"]
                with closing(self._rows(todo, sources, link, workers, cluster)) as finished:
                    for rows in finished:
                        table.append([self._without_trace(row) for row in rows])
                        done += len(rows)
                        tell(done, self.plan.runs)
            table.merge()
        return missing

    def table(self) -> "pd.DataFrame":
        """The whole table, one row per run by cell and seed; what is missing is run first.

        Of a run that failed, ``failed`` says how and nothing is measured; a warning counts them.
        """
        self.run()
        with closing(self.open()) as table:
            frame: pd.DataFrame = table.read().to_pandas()
            if failed := int(table.failed.sum()):
                message = f"{failed} of {self.plan.runs} runs failed: see the column {FAILED!r}"
                warnings.warn(message, RuntimeWarning, stacklevel=2)
        return frame

    def open(self) -> StudyTable:
        """The table, locked until it is closed."""
        return StudyTable(self.directory, self.plan, {"code": code(self.plan.plugins)})

    def _without_trace(self, row: Row) -> Row:
        """A row as it goes into the table; the traceback of a run that failed goes into a file."""
        trace = row.pop(TRACE, "")
        if not trace:
            return row
        folder = self.directory / FAILED
        path = folder / f"cell-{row['cell']}-seed-{row['seed']}.txt"
        folder.mkdir(exist_ok=True)
        if sum(1 for _ in folder.iterdir()) < TRACES_MAX or path.exists():
            path.write_bytes(f"{row[FAILED]}\n\n{trace}".encode(errors="backslashreplace"))
            row[FAILED] += f"{TRACEBACK_IN}{path}"
        return row

    def _rows(
        self, todo: Iterator[Task], code: str, link: str, workers: int | None, cluster: str | None
    ) -> Generator[list[Row]]:
        if link == "zenoh":
            from encircle.studies.session import over_zenoh

            return over_zenoh(self.plan, todo, code)
        if cluster is not None:
            return on_cluster(todo, code, cluster)
        return in_processes(todo, code, workers or os.cpu_count() or 1)


def tasks(plan: Plan, done: NDArray[np.bool_]) -> Iterator[Task]:
    """What is to do, a few seeds of one cell at a time. ``done``: (C, S) cells and seeds."""
    missing = [np.flatnonzero(~row) for row in done]
    for cell, places in enumerate(missing):
        if places.size == 0:
            continue
        scenario = plan.scenario_of(cell).model_dump_json(exclude_unset=True)
        for first in range(0, places.size, TASK_RUNS):
            seeds = tuple(plan.seed_list[k] for k in places[first : first + TASK_RUNS])
            yield Task(cell, plan.levels(cell), scenario, seeds, plan.columns, plan.plugins)
