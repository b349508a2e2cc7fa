"""Checks of a study whose keys each have a valid value: names, size, and every cell's scenario.

What is wrong with a single value is found earlier, by ``encircle.studies.plan``.
"""

import re
from collections.abc import Collection, Iterator
from math import prod

from encircle.measures.registry import MEASURES, problem_with, split_name
from encircle.protocol.errors import did_you_mean
from encircle.studies.plan import CELLS_MAX, RESERVED_COLUMNS, Plan
from encircle.world.scenario.errors import ScenarioError

NO_ROBOTS_PREFIX = "give either"
"""How the problem of a scenario without robots begins; an axis of a study may add the robots."""
CLOCK_PROBLEM = "clock = 'wall': a study pairs runs that can be repeated; use 'lockstep'"

_OF_KEY = re.compile(
    r"(override '[^=]*=|\S+ = ).*?(: (?:unknown key|has no meaning|there is no such key).*)"
)
"""A problem that is the key's, whatever its value: what is before the value, what is after it."""


def plan_problems(plan: Plan, left_out: Collection[str] = ()) -> list[str]:
    """Every problem of a study, a line each; an empty list if there is none.

    ``left_out``: keys of the study that are invalid and therefore missing in the plan, in whole
    or in part. Consequences of their absence are not reported.
    """
    problems = [*_name_problems(plan, left_out), *_size_problems(plan)]
    if cell_count(plan) <= CELLS_MAX and not {"scenario", "set"} & set(left_out):
        problems += [
            line
            for line in _cell_problems(plan)
            if "axes" not in left_out or NO_ROBOTS_PREFIX not in line
        ]
        if not problems:
            problems += _problems_with_robots(plan)
    return problems


def cell_count(plan: Plan) -> int:
    """The number of cells, computed without making them."""
    return prod(len(axis.levels) for axis in plan.all_axes)


def _cell_problems(plan: Plan) -> Iterator[str]:
    """Problems of the cells' scenarios, each line once, with the first cell that has it.

    A key that is wrong itself is one problem, whatever value each cell gives it.
    """
    seen: dict[str, tuple[str, str]] = {}
    for cell in range(len(plan.cells)):
        try:
            clock = plan.scenario_of(cell).clock
            lines = [CLOCK_PROBLEM] if clock == "wall" else []
        except ScenarioError as error:
            lines = problem_lines(error)
        for line in lines:
            where = ", ".join(f"{k} = {v}" for k, v in plan.levels(cell).items())
            seen.setdefault(_without_value(line), (line, where))
    for line, where in seen.values():
        yield f"{line} (at {where or 'the base'})"


def _without_value(line: str) -> str:
    """A problem of a key itself without the value that it was given; others as they are."""
    of_key = _OF_KEY.fullmatch(line)
    return of_key[1] + of_key[2] if of_key else line


def _problems_with_robots(plan: Plan) -> list[str]:
    """Robots whose measures a study names, and that no cell has."""
    named = {name: robot for name in plan.measures if (robot := split_name(name)[1])}
    for cell in range(len(plan.cells) if named else 0):
        team = plan.scenario_of(cell).ids
        named = {name: robot for name, robot in named.items() if robot not in team}
    return [f"measures: {name!r}: no cell has a robot {robot}" for name, robot in named.items()]


def problem_lines(error: ScenarioError) -> list[str]:
    """The problems of a scenario, without the first line, which counts them."""
    lines = str(error).splitlines()
    return [line.strip() for line in lines[1:] or lines]


def _name_problems(plan: Plan, left_out: Collection[str]) -> list[str]:
    problems = []
    names = [axis.name for axis in plan.all_axes]
    table_columns = {*RESERVED_COLUMNS, *MEASURES, *plan.measures}
    problems += [f"axes: {n!r} stands twice" for n in sorted(set(names)) if names.count(n) > 1]
    problems += [
        f"axes.{k}.name = {n!r}: is a column of the table"
        for k, n in enumerate(names)
        if n in table_columns
    ]
    problems += [
        f"measures: {name!r}: {problem}"
        for name in plan.measures
        if (problem := problem_with(name))
    ]
    if {"axes", "strategies"} & set(left_out):
        # Names of axes and levels can be checked only once the axes are valid.
        return problems
    if plan.compare is not None and plan.compare not in names:
        problems.append(
            f"compare = {plan.compare!r}: must be one of the axes {', '.join(names) or '(none)'}"
            f"{did_you_mean(plan.compare, names)}"
        )
    if plan.baseline is not None:
        axis = plan.compared_axis
        if axis is None or plan.baseline not in map(str, axis.levels):
            known = ", ".join(map(str, axis.levels)) if axis else "none, as nothing is compared"
            near = did_you_mean(plan.baseline, map(str, axis.levels)) if axis else ""
            problems.append(
                f"baseline = {plan.baseline!r}: must be one of the levels ({known}){near}"
            )
    return problems


def _size_problems(plan: Plan) -> list[str]:
    problems = []
    if any(axis.key == "seed" for axis in plan.axes) or "seed" in plan.set:
        problems.append("key 'seed': every cell is run with the study's seeds, give those")
    if (cells := cell_count(plan)) > CELLS_MAX:
        problems.append(f"axes: {cells} cells, at most {CELLS_MAX} are allowed")
    return problems
