"""A study's starts as an omniscient planner plays them: its capture rate in every cell.

Cells that differ in radio, sensors' noise or policy alone are one to the planner, who knows the
truth. So a study of policies over loss has one row here for each of its other settings, to be read
beside all rows of the study with that setting.
"""

from collections.abc import Callable
from contextlib import closing
from typing import Any, NamedTuple

from encircle.planner.omniscient import reach
from encircle.protocol.process.interrupts import check, signals_held
from encircle.runner.process_pool import in_processes
from encircle.statistics.intervals import Interval, capture_rate
from encircle.studies.plan import Plan
from encircle.world.scenario.model import Scenario

_NOT_THE_PLANNERS = ("channel", "sensing", "robot")


class Row(NamedTuple):
    """One setting: its levels by axis, and how often the planner captures, with 95 % interval."""

    levels: dict[str, Any]
    rate: Interval
    seeds: int


def rows(plan: Plan, candidates: int, workers: int, tell: Callable[[int], None]) -> list[Row]:
    """A row for each setting of a study that makes a difference to the planner, in its order.

    ``candidates``: plans tried per start; ``tell`` gets the number of starts done, now and then.
    Raises ``Interrupted`` after Ctrl-C.
    """
    settings: dict[str, tuple[dict[str, Any], Scenario]] = {}
    same_at = _indifferent_axes(plan)
    for cell in range(len(plan.cells)):
        levels = {k: v for k, v in plan.levels(cell).items() if k not in same_at}
        settings.setdefault(repr(levels), (levels, plan.scenario_of(cell)))
    tasks = [
        (number, scenario, seed, candidates)
        for number, (_, scenario) in enumerate(settings.values())
        for seed in plan.seed_list
    ]
    captures: list[list[bool]] = [[] for _ in settings]
    with signals_held(), closing(in_processes(_reaches, tasks, workers)) as answers:
        for done, (number, captured) in enumerate(answers, 1):
            captures[number].append(captured)
            tell(done)
            check()
    return [
        Row(levels, capture_rate(captured), len(captured))
        for (levels, _), captured in zip(settings.values(), captures, strict=True)
    ]


def _indifferent_axes(plan: Plan) -> set[str]:
    """Axes all of whose levels are one to the planner."""
    names = set()
    for axis in plan.all_axes:
        keys = {key for index in range(len(axis.levels)) for key in axis.changes(index)}
        if all(key == "team.strategy" or key.split(".")[0] in _NOT_THE_PLANNERS for key in keys):
            names.add(axis.name)
    return names


def _reaches(task: tuple[int, Scenario, int, int]) -> tuple[int, bool]:
    number, scenario, seed, candidates = task
    return number, reach(scenario, seed, candidates).capture_tick is not None
