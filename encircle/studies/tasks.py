"""The work of a study: from a task to rows of its table.

What is done in a worker process, on this machine or another. A task is complete in itself, scenario
included, and nothing is remembered from one to the next.
"""

import json
import time
import traceback
from collections.abc import Mapping
from functools import lru_cache
from math import nan
from typing import Any, NamedTuple

from encircle.measures.registry import measure
from encircle.protocol.plugins import PluginFailed, error_line
from encircle.protocol.process.log import bounded_log
from encircle.runlog.runlog import RunLog, RunLogCollector
from encircle.runner.memory import RunEndedByPlugin, run_in_memory
from encircle.studies import sources
from encircle.studies.sources import Names
from encircle.world.arena.engine import build
from encircle.world.loading.load import load
from encircle.world.scenario.model import Scenario

RUN = "study"
FAILED, TRACE = "failed", "trace"
"""In a row, how a run failed, empty if it did not; and its traceback, which goes into a file."""
Row = dict[str, Any]


class Task(NamedTuple):
    """Some seeds of one cell. ``scenario``: the cell's, as JSON; ``columns``: measures to take.

    ``plugins``: those that the study uses, in whatever cell.
    """

    cell: int
    levels: Mapping[str, Any]
    scenario: str
    seeds: tuple[int, ...]
    columns: tuple[str, ...]
    plugins: Names = ()


@lru_cache(maxsize=64)
def own_code(plugins: Names) -> tuple[str, str]:
    """``sources.code`` and, as JSON, ``sources.versions`` of this process, as first asked for.

    What a process has imported stays as it was then, whatever becomes of the files.
    """
    return sources.code(plugins), json.dumps(sources.versions(plugins))


def run_task(task: Task) -> tuple[str, list[Row]]:
    """Run a task in memory; returns the digest of this process's code and a row per seed."""
    # Before the plug-ins are imported.
    code = own_code(task.plugins)
    scenario = load(json.loads(task.scenario))
    return code[0], [run_seed(task, scenario, seed, code) for seed in task.seeds]


def run_seed(task: Task, scenario: Scenario, seed: int, code: tuple[str, str]) -> Row:
    """One run in memory: its row, which says so if the run failed, whatever the reason."""
    begun_s = time.perf_counter()
    collector = RunLogCollector()
    try:
        result = run_in_memory(build(scenario, seed), RUN, bounded_log(), observer=collector)
        return row(task, collector.log(), result.digest, begun_s, code)
    except RunEndedByPlugin as error:
        return failed_row(task, seed, str(error), error.failed.trace, begun_s, code)
    except PluginFailed as error:
        return failed_row(task, seed, str(error), error.trace, begun_s, code)
    except Exception as error:
        # It is this run's, and no reason to lose the others.
        trace = "".join(traceback.format_exception(error))
        return failed_row(task, seed, error_line(error), trace, begun_s, code)


def row(task: Task, log: RunLog, digest: str, begun_s: float, code: tuple[str, str]) -> Row:
    """A run's row: axes, seed, digest, outcome, measures, versions.

    ``begun_s``: ``perf_counter`` when the run began; ``code``: as from ``own_code``.
    """
    measured = {name: float(value) for name, value in measure(log, task.columns).items()}
    outcome = (digest, float(log.captured), log.ticks, "")
    return _row(task, log.seed, outcome, measured, begun_s, code)


def failed_row(
    task: Task, seed: int, failure: str, trace: str, begun_s: float, code: tuple[str, str]
) -> Row:
    """The row of a run that failed: nothing was measured. ``trace`` goes with it to its file."""
    nothing = dict.fromkeys(task.columns, nan)
    base_row = _row(task, seed, ("", nan, 0, failure), nothing, begun_s, code)
    return {**base_row, TRACE: trace}


def _row(
    task: Task,
    seed: int,
    outcome: tuple[str, float, int, str],
    measured: Mapping[str, float],
    begun_s: float,
    code: tuple[str, str],
) -> Row:
    return {
        "cell": task.cell,
        **task.levels,
        "seed": seed,
        **dict(zip(("digest", "captured", "ticks", FAILED), outcome, strict=True)),
        **measured,
        "wall_s": time.perf_counter() - begun_s,
        "code": code[0],
        "versions": code[1],
    }
