"""The runs of a task in memory, and their rows for the table.

Nothing is remembered from one task to the next.
"""

import json
import time
import traceback
from collections.abc import Mapping
from math import nan

from encircle.measures.registry import measure
from encircle.protocol.plugins import PluginFailed, error_line
from encircle.protocol.process.log import bounded_log
from encircle.runlog.runlog import RunLog, RunLogCollector
from encircle.runner.memory import RunEndedByPlugin, rare_garbage_collection, run_in_memory
from encircle.studies.tasks import FAILED, TRACEBACK, Row, Task, code_and_versions
from encircle.world.arena.engine import build
from encircle.world.loading.load import load
from encircle.world.scenario.model import Scenario

RUN = "study"


def run_task(task: Task) -> tuple[str, list[Row]]:
    """Run a task in memory; returns the digest of this process's code and a row per seed."""
    # The digest must be taken before the plug-ins are imported.
    code = code_and_versions(task.plugins)
    scenario = load(json.loads(task.scenario))
    # Around all seeds: whenever it is left, all that a run has made is looked through.
    with rare_garbage_collection():
        return code[0], [run_seed(task, scenario, seed, code) for seed in task.seeds]


def run_seed(task: Task, scenario: Scenario, seed: int, code: tuple[str, str]) -> Row:
    """Run one seed in memory; returns its row, also if the run failed, for whatever reason."""
    begun_s = time.perf_counter()
    collector = RunLogCollector()
    try:
        result = run_in_memory(build(scenario, seed), RUN, bounded_log(), observer=collector)
        return result_row(task, collector.log(), result.digest, begun_s, code)
    except RunEndedByPlugin as error:
        return failed_row(task, seed, str(error), error.failed.trace, begun_s, code)
    except PluginFailed as error:
        return failed_row(task, seed, str(error), error.trace, begun_s, code)
    except (Exception, KeyboardInterrupt) as error:
        # An error in one run must not end the other runs. No signal raises one here: a policy has.
        trace = "".join(traceback.format_exception(error))
        return failed_row(task, seed, error_line(error), trace, begun_s, code)


def result_row(task: Task, log: RunLog, digest: str, begun_s: float, code: tuple[str, str]) -> Row:
    """The row of a finished run: axes, seed, digest, outcome, measures, versions.

    ``begun_s``: ``perf_counter`` when the run began; ``code``: as from ``code_and_versions``.
    """
    measured = {name: float(value) for name, value in measure(log, task.measure_names).items()}
    outcome = (digest, float(log.captured), log.ticks, "")
    return _common_row(task, log.seed, outcome, measured, begun_s, code)


def failed_row(
    task: Task, seed: int, failure: str, trace: str, begun_s: float, code: tuple[str, str]
) -> Row:
    """The row of a failed run, without measures; ``trace`` is its traceback."""
    nothing = dict.fromkeys(task.measure_names, nan)
    base_row = _common_row(task, seed, ("", nan, 0, failure), nothing, begun_s, code)
    return {**base_row, TRACEBACK: trace}


def _common_row(
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
