"""A run robot by robot: the policy, the modes, and all that is measured of each robot."""

from collections import Counter
from math import isnan
from typing import Any

from encircle.measures.registry import ROBOT_MEASURES, measure_named
from encircle.runlog.runlog import RunLog

NOT_DEFINED = "-"


def breakdown(log: RunLog) -> list[dict[str, Any]]:
    """Of each robot, in robot order: its id, policy, modes, and every measure of each robot.

    ``modes``: the share of the run's ticks in each mode, the most frequent first. What is not
    defined is None. The whole can be written as JSON.
    """
    robots: list[dict[str, Any]] = []
    for index, robot in enumerate(log.scenario.ids):
        modes = Counter(log.modes[:, index].tolist()).most_common()
        measured = {name: measure_named(f"{name}/{robot}").function(log) for name in ROBOT_MEASURES}
        robots.append(
            {
                "robot": robot,
                "policy": log.scenario.strategy_of(robot),
                "modes": {mode: ticks / log.ticks for mode, ticks in modes},
                **{name: None if isnan(value) else value for name, value in measured.items()},
            }
        )
    return robots


def breakdown_rows(robots: list[dict[str, Any]]) -> list[tuple[str, ...]]:
    """A breakdown as rows of a table: name, unit, and a text for each robot."""
    modes = dict.fromkeys(mode for robot in robots for mode in robot["modes"])
    rows = [("policy", "", *(robot["policy"] for robot in robots))]
    rows += [
        (f"ticks in {mode}", "1", *(_text(robot["modes"].get(mode, 0.0)) for robot in robots))
        for mode in modes
    ]
    listed = {f"{mode}_share" for mode in ("search", "encircle", "shrink", "pursue", "lost")}
    return rows + [
        (name, measure_named(f"{name}/r1").unit, *(_text(robot[name]) for robot in robots))
        for name in ROBOT_MEASURES
        if name not in listed
    ]


def _text(value: float | None) -> str:
    return NOT_DEFINED if value is None else f"{value:.4g}"
