"""Made runs for the tests of the benchmark, without any hunts."""

import json
from contextlib import closing

import numpy as np

from encircle.benchmark.outcomes import Outcomes
from encircle.studies.study_table import StudyTable

CODE = {"code": "c0de"}


def made_outcomes(rates, seeds=20, *, tasks=6, seed=0, names=None):
    """Runs of policies that capture at given rates, by chance; limits are 100 ticks and more."""
    rng = np.random.default_rng(seed)
    shape = (len(rates), tasks, seeds)
    captured = rng.random(shape) < np.reshape(rates, (-1, 1, 1))
    ticks = rng.integers(1, 101, shape)
    return Outcomes(
        tuple(names or (f"p{k}" for k in range(len(rates)))),
        tuple(f"scene{k % 3}-{3 + k}-perfect" for k in range(tasks)),
        tuple(range(140_001, 140_001 + seeds)),
        np.where(captured, ticks, 0),
        100 + 10 * np.arange(tasks),
    )


def filled_study(directory, plan, capture_tick, failed=()):
    """A complete table of a plan's runs; ``capture_tick(cell, seed)`` is 0 without capture.

    ``failed``: the (cell, seed) of runs that failed.
    """
    rows = [
        _row(plan, cell, seed, capture_tick(cell, seed), (cell, seed) in failed)
        for cell in range(len(plan.cells))
        for seed in plan.seed_list
    ]
    with closing(StudyTable(directory, plan, CODE)) as table:
        table.append(rows)
        table.merge()


def _row(plan, cell, seed, tick, failed):
    ticks = tick or plan.scenario_of(cell).ticks_max
    outcome = {
        "digest": f"{cell}-{seed}",
        "captured": float(tick > 0),
        "ticks": ticks,
        "failed": "",
    }
    if failed:
        outcome = {"digest": "", "captured": np.nan, "ticks": 0, "failed": "it broke"}
    measured = {name: 1.0 for name in plan.measure_names if name != "captured"}
    common = {"wall_s": 0.01, "code": CODE["code"], "versions": json.dumps({})}
    return {"cell": cell, **plan.levels(cell), "seed": seed, **outcome, **measured, **common}
