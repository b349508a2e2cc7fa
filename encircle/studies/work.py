"""The work of a study: from a task to rows of its table.

What is done in a worker process, on this machine or another. A task is complete in itself, scenario
included, and nothing is remembered from one to the next.
"""

import json
import time
from collections.abc import Mapping
from functools import lru_cache
from typing import Any, NamedTuple

from encircle.measures import measure
from encircle.memory import run_in_memory
from encircle.runlog import Collector, RunLog
from encircle.studies import sources
from encircle.studies.sources import Names
from protocol.log import bounded_log
from world.engine import build
from world.scenario import load

RUN = "study"
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
    rows = []
    for seed in task.seeds:
        begun = time.perf_counter()
        collector = Collector()
        result = run_in_memory(build(scenario, seed), RUN, bounded_log(), watch=collector)
        rows.append(row(task, collector.log(), result.digest, begun, code))
    return code[0], rows


def row(task: Task, log: RunLog, digest: str, begun_s: float, code: tuple[str, str]) -> Row:
    """A run's row: axes, seed, digest, outcome, measures, versions.

    ``begun_s``: ``perf_counter`` when the run began; ``code``: as from ``own_code``.
    """
    return {
        "cell": task.cell,
        **task.levels,
        "seed": log.seed,
        "digest": digest,
        "captured": float(log.captured),
        "ticks": log.ticks,
        **{name: float(value) for name, value in measure(log, task.columns).items()},
        "wall_s": time.perf_counter() - begun_s,
        "code": code[0],
        "versions": code[1],
    }
