"""Plans and filled tables for the tests of what studies report, without any hunts.

Times to capture are exponential, so that the truth is known: with mean m and limit T the rate of
capture is 1 - exp(-T / m), the mean time up to the limit m times that. The runs of one seed are
correlated across cells, as common seeds make them.
"""

import json
from collections.abc import Callable, Mapping
from math import ceil, inf, sqrt
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.special import ndtr

from encircle.studies.plan import Plan
from encircle.studies.plan_files import load_plan
from encircle.studies.study_table import StudyTable

CODE = {"code": "c0de"}
VERSIONS = {"python": "3.11.0", "encircle": "0.1.0"}
MEASURED = ("age_ticks_mean", "path_m_mean", "capture_s")
COMMON = 0.5
"""Correlation of the times of one seed in two cells, before they are made exponential."""

LOSS = {
    "name": "loss",
    "label": "packet loss",
    "unit": "%",
    "scale": 100,
    "key": "channel.loss.rate",
    "values": [0.0, 0.2, 0.4, 0.6, 0.8],
}
DELAY = {
    "name": "delay",
    "label": "mean delay",
    "unit": "ms",
    "scale": 1000,
    "key": "channel.delay.mean_s",
    "values": [0.0, 0.1, 0.2, 0.4, 0.6, 0.8, 1.0],
}
ARMS = {
    "name": "radio",
    "arms": [
        {"name": "independent losses", "set": {"ticks_max": 300}},
        {"name": "bursts of twenty packets, at the same mean rate", "set": {"ticks_max": 300}},
        {"name": "short", "set": {"ticks_max": 300}},
    ],
}


class Truth(NamedTuple):
    """The distribution of a cell: mean time to capture in s, infinite for never.

    Mean age in ticks.
    """

    mean_s: float
    age_ticks: float = 1.0


def study_plan(**changes: Any) -> Plan:
    """A plan over simulation 1 with one cell and few measures, changed by the arguments."""
    tree = {"scenario": "sim1", "set": {"channel.loss.model": "bernoulli"}, "measures": MEASURED}
    return load_plan({**tree, **changes})


def loss_only(levels: Mapping[str, Any]) -> Truth:
    """Capture is slower the more packets are lost, and slower for all strategies but the first."""
    slower = 1.0 if levels.get("strategy", "xi-star") == "xi-star" else 1.6
    loss = float(levels.get("loss", 0.0)) + 0.5 * float(levels.get("delay", 0.0))
    return Truth(slower * 8.0 / max(1.0 - loss, 0.05), 1.0 + 20.0 * loss)


def never(_levels: Mapping[str, Any]) -> Truth:
    """No run captures."""
    return Truth(inf)


def filled(
    plan: Plan, directory: Path, truth: Callable[[Mapping[str, Any]], Truth] = loss_only
) -> StudyTable:
    """A complete table of simulated runs. The caller closes it."""
    table = StudyTable(directory, plan, CODE)
    table.append([row for cell in range(len(plan.cells)) for row in _rows(plan, cell, truth)])
    table.merge()
    return table


def _rows(
    plan: Plan, cell: int, truth: Callable[[Mapping[str, Any]], Truth]
) -> list[dict[str, Any]]:
    levels, scenario = plan.levels(cell), plan.scenario_of(cell)
    known = truth(levels)
    rows = []
    for seed in plan.seed_list:
        common, own = np.random.default_rng([seed, 0]), np.random.default_rng([seed, 1, cell])
        normal = sqrt(COMMON) * common.normal() + sqrt(1.0 - COMMON) * own.normal()
        time_s = -known.mean_s * np.log1p(-ndtr(normal))
        captured = bool(time_s <= scenario.ticks_max * scenario.tick_s)
        ticks = ceil(time_s / scenario.tick_s) if captured else scenario.ticks_max
        measured = {
            "age_ticks_mean": known.age_ticks * own.uniform(0.8, 1.2),
            "capture_s": ticks * scenario.tick_s if captured else np.nan,
            "delay_s_mean": scenario.tick_s / 2.0
            + scenario.channel.delay.mean_s * own.uniform(1, 1.1),
        }
        numbers = {name: measured.get(name, own.gamma(4.0, 2.0)) for name in plan.measure_names}
        rows.append(
            {"cell": cell, **levels, "seed": seed, "digest": f"{cell}-{seed}"}
            | {"captured": float(captured), "ticks": ticks, "failed": ""}
            | {name: float(value) for name, value in numbers.items()}
            | {"wall_s": 0.01, "code": CODE["code"], "versions": json.dumps(VERSIONS)}
        )
    return rows
