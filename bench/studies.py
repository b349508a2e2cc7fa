"""Speed of studies: hunts per second, scaling over cores, and what measuring costs.

``python bench/studies.py`` prints the figures as JSON. The hunts are those of the shipped study
``loss-delay``, spread evenly over its cells.

``python bench/studies.py --runs 10000`` prints instead what a run costs beside its hunt, with two
processes of this machine and with two workers of a dask cluster on it. The hunts are of few ticks,
so that what is around them shows.
"""

import argparse
import json
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from statistics import median
from typing import Any

from encircle.measures.registry import measure
from encircle.progress import Progress, Tell, no_progress
from encircle.runlog.runlog import RunLogCollector
from encircle.runner.memory import run_in_memory
from encircle.studies.plan_files import load_plan
from encircle.studies.study import Study
from encircle.world.arena.engine import build

TURNS = 5
WORKERS = 2
SHORT = {
    "name": "short",
    "scenario": "sim1",
    "set": {"ticks_max": 5, "channel.loss.model": "bernoulli"},
    "axes": [{"name": "loss", "key": "channel.loss.rate", "values": [0.0, 0.3, 0.6, 0.9]}],
}
"""A study of hunts so short that what is around them shows."""


def scaling(seeds: int, tell: Tell = no_progress) -> dict[str, Any]:
    """Hunts per second with one worker process and with two, worker start-up left out."""
    plan = load_plan("loss-delay", seeds=seeds)
    speeds: dict[int, list[float]] = {1: [], 2: []}
    for turn in range(2):
        for workers in (1, 2):
            tell(2 * turn + workers - 1, 4)
            marks: list[tuple[float, int]] = []
            with tempfile.TemporaryDirectory() as scratch:
                Study(plan, Path(scratch) / "study").run(
                    workers=workers,
                    progress=lambda done, _all, to=marks: to.append((time.perf_counter(), done)),
                )
            # The first mark is before the workers start, the second when they have done a batch.
            (begun, before), (ended, after) = marks[2], marks[-1]
            speeds[workers].append((after - before) / (ended - begun))
    one, two = median(speeds[1]), median(speeds[2])
    return {
        "hunts": plan.runs,
        "hunts_per_s_one_worker": one,
        "hunts_per_s_two_workers": two,
        "hunts_per_s_per_core": two / 2,
        "scaling_one_to_two": two / one,
    }


def overhead(tell: Tell = no_progress) -> dict[str, Any]:
    """Time of measured and logged hunts over that of the same hunts bare, in one process."""
    plan = load_plan("loss-delay")
    arenas = [build(plan.scenario_of(cell), 1) for cell in range(0, len(plan.cells), 4)]
    ratios, bare_us, logged = [], [], []
    for turn in range(TURNS):
        tell(turn, TURNS)
        bare_s = logged_s = measured_s = 0.0
        ticks = 0
        for arena in arenas:
            begun = time.perf_counter()
            ticks += run_in_memory(arena, "bench", print).ticks
            bare_s += time.perf_counter() - begun
            begun = time.perf_counter()
            collector = RunLogCollector()
            run_in_memory(arena, "bench", print, observer=collector)
            log = collector.log()
            logged_s += time.perf_counter() - begun
            measure(log)
            measured_s += time.perf_counter() - begun
        ratios.append(measured_s / bare_s)
        logged.append(logged_s / bare_s)
        bare_us.append(bare_s / ticks * 1e6)
    return {
        "bare_us_per_tick": median(bare_us),
        "logged_over_bare": median(logged),
        "logged_and_measured_over_bare": median(ratios),
    }


def around_short_hunts(runs: int, tell: Tell = no_progress) -> dict[str, Any]:
    """What a run costs beside its hunt, with processes of this machine and on a local cluster.

    ``wall_ms_per_run``: of the study but its first batch; ``run_ms``: of a run, in its worker, the
    median;
    ``parent_cpu_ms_per_run``: of this process, in which the cluster's scheduler is as well.
    """
    from distributed import LocalCluster

    seeds = max(1, runs // len(SHORT["axes"][0]["values"]))
    plan = load_plan(SHORT, seeds=seeds)
    found: dict[str, Any] = {"runs": plan.runs, "workers": WORKERS}
    with ExitStack() as stack:
        cluster = stack.enter_context(
            LocalCluster(
                n_workers=WORKERS, threads_per_worker=1, dashboard_address=None, host="127.0.0.1"
            )
        )
        where = {
            "processes": {"workers": WORKERS},
            "cluster": {"cluster": cluster.scheduler_address},
        }
        for done, (name, options) in enumerate(where.items()):
            tell(done, len(where))
            found[name] = _around(
                Study(plan, Path(stack.enter_context(_scratch())) / name), options
            )
    return found


def _scratch() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory()


def _around(study: Study, options: dict[str, Any]) -> dict[str, float]:
    marks: list[tuple[float, float, int]] = []
    study.run(
        progress=lambda done, _all: marks.append((time.perf_counter(), time.process_time(), done)),
        **options,
    )
    (begun, cpu, before), (ended, cpu_ended, after) = marks[2], marks[-1]
    runs, wall_ms = after - before, 1e3 * (ended - begun)
    run_ms = 1e3 * float(study.table()["wall_s"].median())
    return {
        "wall_ms_per_run": wall_ms / runs,
        "run_ms": run_ms,
        "wall_ms_per_run_beside": wall_ms / runs - run_ms / WORKERS,
        "parent_cpu_ms_per_run": 1e3 * (cpu_ended - cpu) / runs,
    }


def measure_studies(seeds: int = 8) -> dict[str, Any]:
    """Everything this file measures."""
    with Progress("(e) studies, scaling", "turns") as tell:
        found = scaling(seeds, tell)
    with Progress("(e) studies, measuring", "turns") as tell:
        return found | overhead(tell)


def _main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--runs", type=int, help="of short hunts, here and on a local cluster")
    runs = options.parse_args().runs
    print(json.dumps(around_short_hunts(runs) if runs else measure_studies(), indent=2))


if __name__ == "__main__":
    _main()
