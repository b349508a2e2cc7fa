"""A study under way: missing runs are executed, finished ones are kept, and the table is read.

``encircle.study("loss").table()`` runs what is missing and returns the table as a pandas frame.
"""

import os
import warnings
from collections.abc import Callable, Generator, Iterator
from contextlib import closing, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from encircle.progress import notebook_progress
from encircle.protocol.process.interrupts import signals_held
from encircle.protocol.process.tracebacks import TRACEBACK_IN
from encircle.runner.links import LINKS
from encircle.studies.plan import Plan
from encircle.studies.sources import code
from encircle.studies.study_directory import directory_of
from encircle.studies.study_table import StudyTable
from encircle.studies.tasks import FAILED, TRACEBACK, Row, Task
from encircle.studies.workers import in_processes, on_cluster
from encircle.world.loading.remarks import ScenarioRemark

if TYPE_CHECKING:
    import pandas as pd

TASK_RUNS = 8
TRACEBACKS_MAX = 100
"""How many tracebacks of failed runs are stored; few of them differ from each other."""
Progress = Callable[[int, int], None]


class Study:
    """A plan and the directory of its table.

    ``directory``: ``runs/study-NAME`` by default. Nothing is written before ``run`` or
    ``table`` is called.
    """

    def __init__(self, plan: Plan, directory: str | Path | None = None) -> None:
        self.plan = plan
        self.directory = directory_of(plan.name, directory)

    def run(
        self,
        *,
        link: str = "memory",
        workers: int | None = None,
        cluster: str | None = None,
        progress: Progress | None = None,
    ) -> int:
        """Execute the runs that are missing or have failed; returns how many these were.

        ``link``: ``memory`` or ``zenoh``. In memory the runs are executed by ``workers`` processes
        of this machine (one per core by default), or by the dask cluster at ``cluster``. Over Zenoh
        they are executed one after the other, by robot processes that stay for all runs.
        ``progress`` is called with the numbers of finished runs and of all runs; in a notebook a
        bar is shown without it. A run that fails is entered in the table as failed, its traceback
        is written to a file under ``failed``, and the other runs go on. Raises ``StudyError`` if
        the directory belongs to another study, ``StudyFailed`` if not everything could be run, and
        ``Interrupted`` after Ctrl-C; the same call then goes on where it stopped. Warns with
        ``ScenarioRemark`` of cells that may not be what the user meant.
        """
        if link not in LINKS:
            raise ValueError(f"link {link!r}: must be one of {', '.join(LINKS)}")
        for remark in self.plan.remarks():
            warnings.warn(remark, ScenarioRemark, stacklevel=2)
        bar = nullcontext(progress) if progress else notebook_progress(self.plan.name, "runs")
        with signals_held(), bar as tell, closing(self.open()) as table:
            missing = int((~table.done).sum())
            done = self.plan.runs - missing
            tell(done, self.plan.runs)
            if missing:
                todo = missing_tasks(self.plan, table.done)
                sources = table.owner["code"]
                with closing(self._rows(todo, sources, link, workers, cluster)) as finished:
                    for rows in finished:
                        table.append([self._with_traceback_saved(row) for row in rows])
                        done += len(rows)
                        tell(done, self.plan.runs)
            table.merge()
        return missing

    def table(self) -> "pd.DataFrame":
        """The whole table, one row per run, by cell and seed; missing runs are executed first.

        In the row of a failed run the column ``failed`` gives the reason and nothing is
        measured. A warning counts such runs.
        """
        self.run()
        with closing(self.open()) as table:
            frame: pd.DataFrame = table.read().to_pandas()
            if failed := int(table.failed.sum()):
                message = f"{failed} of {self.plan.runs} runs failed: see the column {FAILED!r}"
                warnings.warn(message, RuntimeWarning, stacklevel=2)
        return frame

    def _repr_html_(self) -> str:
        # Imported late: only a notebook asks for it.
        from encircle.studies.notebook.study_view import study_html

        return study_html(self.plan, self.directory)

    def open(self) -> StudyTable:
        """The table, locked for this process until it is closed."""
        return StudyTable(self.directory, self.plan, {"code": code(self.plan.plugins)})

    def _with_traceback_saved(self, row: Row) -> Row:
        """A row as it goes into the table; the traceback of a failed run goes into a file."""
        trace = row.pop(TRACEBACK, "")
        if not trace:
            return row
        folder = self.directory / FAILED
        path = folder / f"cell-{row['cell']}-seed-{row['seed']}.txt"
        folder.mkdir(exist_ok=True)
        if sum(1 for _ in folder.iterdir()) < TRACEBACKS_MAX or path.exists():
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


def missing_tasks(plan: Plan, done: NDArray[np.bool_]) -> Iterator[Task]:
    """The tasks that are missing, a few seeds of one cell each.

    ``done``: (C, S) whether the run of a cell with a seed is in the table.
    """
    missing = [np.flatnonzero(~row) for row in done]
    for cell, seed_indices in enumerate(missing):
        if seed_indices.size == 0:
            continue
        scenario = plan.scenario_of(cell).model_dump_json(exclude_unset=True)
        for first in range(0, seed_indices.size, TASK_RUNS):
            seeds = tuple(plan.seed_list[k] for k in seed_indices[first : first + TASK_RUNS])
            yield Task(cell, plan.levels(cell), scenario, seeds, plan.measure_names, plan.plugins)
