"""What is wrong with a study whose keys each have a value of the right kind, cells included."""

from collections.abc import Collection, Iterator
from math import prod

from encircle.measures.registry import MEASURES, REGISTRY
from encircle.protocol.suggestions import did_you_mean
from encircle.studies.plan import CELLS_MAX, RESERVED, Plan
from encircle.world.scenario.errors import ScenarioError

GIVE = "give either"
"""What a scenario without robots is told, to which a study may add them on an axis."""
CLOCK = "clock = 'wall': a study pairs runs that can be repeated; use 'lockstep'"


def problems_of(plan: Plan, left_out: Collection[str] = ()) -> list[str]:
    """Every problem, a line each; empty if there is none.

    ``left_out``: keys of the study that are wrong in themselves and so are left out of the plan,
    whole or in part. What follows from their absence is no problem of its own.
    """
    problems = [*_of_names(plan, left_out), *_of_size(plan)]
    if cells_of(plan) <= CELLS_MAX and not {"scenario", "set"} & set(left_out):
        problems += [line for line in _of_cells(plan) if "axes" not in left_out or GIVE not in line]
    return problems


def cells_of(plan: Plan) -> int:
    """How many cells there are, without making them."""
    return prod(len(axis.levels) for axis in plan.all_axes)


def _of_cells(plan: Plan) -> Iterator[str]:
    """What is wrong with the scenarios of cells, each line once, with where it is first."""
    seen: dict[str, str] = {}
    for cell in range(len(plan.cells)):
        try:
            clock = plan.scenario_of(cell).clock
            lines = [CLOCK] if clock == "wall" else []
        except ScenarioError as error:
            lines = lines_of(error)
        for line in lines:
            where = ", ".join(f"{k} = {v}" for k, v in plan.levels(cell).items())
            seen.setdefault(line, where)
    for line, where in seen.items():
        yield f"{line} (at {where or 'the base'})"


def lines_of(error: ScenarioError) -> list[str]:
    """The problems of a scenario, without the head that counts them."""
    lines = str(error).splitlines()
    return [line.strip() for line in lines[1:] or lines]


def _of_names(plan: Plan, left_out: Collection[str]) -> list[str]:
    problems = []
    names = [axis.name for axis in plan.all_axes]
    taken = {*RESERVED, *MEASURES, *plan.measures}
    problems += [f"axes: {n!r} stands twice" for n in sorted(set(names)) if names.count(n) > 1]
    problems += [
        f"axes.{k}.name = {n!r}: is a column of the table"
        for k, n in enumerate(names)
        if n in taken
    ]
    problems += [
        f"measures: {name!r}: {problem}"
        for name in plan.measures
        if (problem := REGISTRY.problem_with(name))
    ]
    if {"axes", "strategies"} & set(left_out):
        # Whether there is such an axis or level is to be seen once those are right.
        return problems
    if plan.compare is not None and plan.compare not in names:
        problems.append(
            f"compare = {plan.compare!r}: must be one of the axes {', '.join(names) or '(none)'}"
            f"{did_you_mean(plan.compare, names)}"
        )
    if plan.baseline is not None:
        axis = plan.compared
        if axis is None or plan.baseline not in map(str, axis.levels):
            known = ", ".join(map(str, axis.levels)) if axis else "none, as nothing is compared"
            near = did_you_mean(plan.baseline, map(str, axis.levels)) if axis else ""
            problems.append(
                f"baseline = {plan.baseline!r}: must be one of the levels ({known}){near}"
            )
    return problems


def _of_size(plan: Plan) -> list[str]:
    problems = []
    if any(axis.key == "seed" for axis in plan.axes) or "seed" in plan.set:
        problems.append("key 'seed': every cell is run with the study's seeds, give those")
    if (cells := cells_of(plan)) > CELLS_MAX:
        problems.append(f"axes: {cells} cells, at most {CELLS_MAX} are allowed")
    return problems
