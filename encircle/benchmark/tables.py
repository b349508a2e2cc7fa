"""The benchmark's runs in a study's directory, read without a lock and without writing anything.

Only runs of exactly the benchmark's tasks are taken. A seed counts if every cell has a run of it,
failed or not: a failed run is no capture.
"""

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from encircle.benchmark.outcomes import Outcomes
from encircle.benchmark.tasks import STUDY, TASK_AXIS, VERSION, tasks_digest
from encircle.studies.plan import STRATEGY_AXIS, Plan, StudyError
from encircle.studies.study_table import OWNER_FILE, PARTS_DIRECTORY, TABLE_FILE
from encircle.studies.summary import CAPTURED, TICKS
from encircle.studies.tasks import FAILED

COLUMNS = ("cell", "seed", FAILED, CAPTURED, TICKS, "digest")


class BenchmarkRuns(NamedTuple):
    """The runs in a directory.

    ``digests``: (P, T, S) the digest of each run, empty of a failed one. ``code``: digest of the
    code that ran. ``failed``: how many runs failed.
    """

    plan: Plan
    outcomes: Outcomes
    digests: "np.ndarray[Any, np.dtype[np.str_]]"
    code: str
    failed: int


def read_runs(directory: Path) -> BenchmarkRuns:
    """The benchmark's runs in a study's directory.

    Raises ``StudyError`` if it holds another study, other tasks, or no seed that is complete.
    """
    plan, code = _plan_of(directory)
    rows = _rows(directory, plan)
    seeds = _complete(rows, plan)
    if not seeds:
        raise StudyError(f"{directory} has no seed that is done in all {len(plan.cells)} cells yet")
    rows = rows.filter(pc.is_in(rows["seed"], pa.array(seeds)))
    task_axis, policy_axis = plan.all_axes
    shape = (len(task_axis.levels), len(policy_axis.levels), len(seeds))
    place = {seed: k for k, seed in enumerate(seeds)}
    ticks = np.zeros(shape, np.int64)
    digests = np.zeros(shape, "U64")
    failed = 0
    for cell, seed, failure, captured, tick, digest in zip(
        *(rows[name].to_pylist() for name in COLUMNS), strict=True
    ):
        at = (*plan.cells[cell], place[seed])
        failed += bool(failure)
        ticks[at] = tick if not failure and captured > 0.5 else 0
        digests[at] = digest
    outcomes = Outcomes(
        tuple(policy_axis.levels),
        tuple(task_axis.levels),
        tuple(seeds),
        ticks.transpose(1, 0, 2),
        limit_ticks(plan),
    )
    return BenchmarkRuns(plan, outcomes, digests.transpose(1, 0, 2), code, failed)


def limit_ticks(plan: Plan) -> "np.ndarray[Any, np.dtype[np.int64]]":
    """(T,) how long a run of each task lasts without capture."""
    policies = len(plan.strategies)
    cells = range(0, len(plan.cells), policies)
    return np.array([plan.scenario_of(cell).ticks_max for cell in cells], np.int64)


def _plan_of(directory: Path) -> tuple[Plan, str]:
    """The plan that a directory's runs are of, and the digest of its code."""
    try:
        owner = json.loads((directory / OWNER_FILE).read_text(encoding="utf-8"))
        plan, code = Plan.model_validate(owner["plan"]), str(owner["code"])
        names = [axis.name for axis in plan.all_axes]
        theirs = tasks_digest(owner["plan"]) if names == [TASK_AXIS, STRATEGY_AXIS] else ""
    except (OSError, ValueError, KeyError, TypeError):
        raise StudyError(f"{directory} is not a study's directory, or is damaged") from None
    own = all(line.startswith("team.policy_parameters.") for line in plan.changes)
    if theirs != tasks_digest() or not own:
        raise StudyError(
            f"{directory} holds runs of other tasks than benchmark {VERSION}: make one with"
            f" encircle study {STUDY}, or with encircle benchmark"
        )
    return plan, code


def _rows(directory: Path, plan: Plan) -> pa.Table:
    import pyarrow.dataset as ds

    whole = directory / TABLE_FILE
    files = [*([whole] if whole.exists() else []), *(directory / PARTS_DIRECTORY).glob("*.parquet")]
    if not files:
        raise StudyError(f"{directory} has no runs yet")
    source = ds.dataset([str(path) for path in files], format="parquet")
    rows = source.to_table(columns=list(COLUMNS)).sort_by(
        [(name, "ascending") for name in ("cell", "seed", FAILED)]
    )
    rows = rows.filter(pc.is_in(rows["seed"], pa.array(plan.seed_list)))
    # Of a run that failed and was repeated, the row without a failure comes first.
    cells, seeds = rows["cell"].to_numpy(), rows["seed"].to_numpy()
    first = np.ones(len(cells), bool)
    first[1:] = (cells[1:] != cells[:-1]) | (seeds[1:] != seeds[:-1])
    return rows.filter(pa.array(first))


def _complete(rows: pa.Table, plan: Plan) -> list[int]:
    """The seeds of which every cell has a run, in the order of the plan."""
    seeds, counts = np.unique(rows["seed"].to_numpy(), return_counts=True)
    complete = set(seeds[counts == len(plan.cells)].tolist())
    return [seed for seed in plan.seed_list if seed in complete]
