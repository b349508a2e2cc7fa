"""The benchmark's runs, from a study's directory or the rows of a table.

Only runs of exactly the benchmark's tasks are taken. A seed counts if every cell has a run of it,
failed or not: a failed run is a hunt without capture. A directory is read without a lock, and
nothing is written into it.
"""

import json
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from encircle.benchmark.outcomes import Outcomes
from encircle.benchmark.tasks import STUDY, TASK_AXIS, VERSION, tasks_digest
from encircle.studies.plan import STRATEGY_AXIS, Plan, StudyError
from encircle.studies.study_directory import OWNER_FILE, PARTS_DIRECTORY, TABLE_FILE
from encircle.studies.summary import CAPTURED, TICKS
from encircle.studies.tasks import FAILED

COLUMNS = ("cell", "seed", FAILED, CAPTURED, TICKS, "digest")
OWN_PARAMETERS = "team.policy_parameters."


class BenchmarkRuns(NamedTuple):
    """The runs of a table.

    ``digests``: (P, T, S) the digest of each run, empty of a failed one. ``code``: digest of the
    code that ran. ``failed``: how many runs failed.
    """

    plan: Plan
    outcomes: Outcomes
    digests: NDArray[np.str_]
    code: str
    failed: int


def read_runs(directory: Path) -> BenchmarkRuns:
    """The benchmark's runs in a study's directory.

    Raises ``StudyError`` if it holds another study, other tasks, or no seed that is complete.
    """
    try:
        owner = json.loads((directory / OWNER_FILE).read_text(encoding="utf-8"))
        plan, code = Plan.model_validate(owner["plan"]), str(owner["code"])
    except (OSError, ValueError, KeyError, TypeError):
        raise StudyError(f"{directory} is not a study's directory, or is damaged") from None
    rows = _rows(directory)
    # The plan is that of the first call, and later ones may have added seeds.
    seeds = tuple(sorted({row["seed"] for row in rows})) or plan.seed_list
    return runs_of(_with_seeds(plan, seeds), rows, code, str(directory))


def runs_of(plan: Plan, rows: Iterable[Mapping[str, Any]], code: str, where: str) -> BenchmarkRuns:
    """The benchmark's runs among the rows of a plan's table, which may be incomplete.

    ``rows``: with ``COLUMNS`` at least; if a run stands twice, the one that did not fail counts.
    ``where``: what the table is called in messages. Raises ``StudyError`` as ``read_runs`` does,
    and for a row that no hunt can have.
    """
    _check_tasks(plan, where)
    wanted, runs = set(plan.seed_list), dict[tuple[int, int], Mapping[str, Any]]()
    for row in rows:
        key = row["cell"], row["seed"]
        if row["seed"] in wanted and (key not in runs or not row[FAILED]):
            runs[key] = row
    counts = Counter(seed for _, seed in runs)
    seeds = [seed for seed in plan.seed_list if counts[seed] == len(plan.cells)]
    if not seeds:
        raise StudyError(f"{where} has no seed that is done in all {len(plan.cells)} cells yet")
    tasks, policies = (axis.levels for axis in plan.all_axes)
    limits = limit_ticks(plan)
    ticks = np.zeros((len(policies), len(tasks), len(seeds)), np.int64)
    digests = np.zeros(ticks.shape, "U64")
    failed = 0
    for cell, (task, policy) in enumerate(plan.cells):
        for k, seed in enumerate(seeds):
            row = runs[cell, seed]
            failed += bool(row[FAILED])
            ticks[policy, task, k] = _capture_tick(row, int(limits[task]), where)
            digests[policy, task, k] = row["digest"]
    outcomes = Outcomes(tuple(policies), tuple(tasks), tuple(seeds), ticks, limits)
    return BenchmarkRuns(plan, outcomes, digests, code, failed)


def limit_ticks(plan: Plan) -> NDArray[np.int64]:
    """(T,) how long a run of each task lasts without capture."""
    # The scenarios themselves need the policy, whose file may not be here.
    tasks = plan.axes[0].arms or ()
    return np.array([task.set["ticks_max"] for task in tasks], np.int64)


def _capture_tick(row: Mapping[str, Any], limit: int, where: str) -> int:
    """The tick of a run's capture, 0 without one; ``StudyError`` for what no hunt can come to."""
    if row[FAILED]:
        return 0
    captured, ticks = row[CAPTURED], row[TICKS]
    run = f"{where}: cell {row['cell']}, seed {row['seed']}"
    if captured not in (0, 1):
        raise StudyError(f"{run}, {CAPTURED} = {captured}: must be 0 or 1")
    if not 1 <= ticks <= limit:
        raise StudyError(f"{run}, {TICKS} = {ticks}: must be 1 to {limit}, the task's limit")
    return int(ticks) if captured else 0


def _with_seeds(plan: Plan, seeds: tuple[int, ...]) -> Plan:
    # A copy would keep the cached seeds.
    return Plan.model_validate({**plan.model_dump(), "seeds": seeds})


def _check_tasks(plan: Plan, where: str) -> None:
    named = [axis.name for axis in plan.all_axes] == [TASK_AXIS, STRATEGY_AXIS]
    own = all(line.startswith(OWN_PARAMETERS) for line in plan.changes)
    if not (named and own and tasks_digest(plan.model_dump(mode="json")) == tasks_digest()):
        raise StudyError(
            f"{where} holds runs of other tasks than benchmark {VERSION}: make one with"
            f" encircle study {STUDY}, or with encircle benchmark"
        )


def _rows(directory: Path) -> list[dict[str, Any]]:
    # Imported late: the published table alone needs none of it.
    import pyarrow.dataset as ds

    whole = directory / TABLE_FILE
    files = [*([whole] if whole.exists() else []), *(directory / PARTS_DIRECTORY).glob("*.parquet")]
    if not files:
        return []
    source = ds.dataset([str(path) for path in files], format="parquet")
    rows: list[dict[str, Any]] = source.to_table(columns=list(COLUMNS)).to_pylist()
    return rows
