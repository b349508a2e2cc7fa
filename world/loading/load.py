"""Scenarios by name, from a file or from a mapping, checked as a whole.

Unknown keys, values out of range and contradictions are refused, all of them at once, each with its
key and its value.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from encircle.protocol.parameters import Parameters
from encircle.world.loading.consistency import problems_of
from encircle.world.loading.files import override, read
from encircle.world.loading.trace_files import inlined
from encircle.world.scenario.errors import ScenarioError
from encircle.world.scenario.model import Scenario
from encircle.world.scenario.validation import problems_in

PROBLEMS_SHOWN_MAX = 100
BODIES = ("radius_m", "target_radius_m", "step_m_max", "sensing_range_m", "stop_distance_m")
ROBOT_KEYS = tuple(f"robot.{n}" for n in Parameters.__dataclass_fields__ if n not in BODIES)
"""Keys that the model does not know of: it takes the robots' parameters as they are."""


def load(source: str | Path | Mapping[str, Any], overrides: Sequence[str] = ()) -> Scenario:
    """A scenario from a shipped name, a TOML file or a mapping, with ``key=value`` overrides.

    Keys are dotted (``channel.loss.rate``), list items by number (``obstacles.0.radius_m``); values
    are TOML, or plain text if they are not. Files of traces are read here and their rows put in
    their place; a relative one lies beside the scenario's file, or below the working directory if
    a mapping or an override names it. Raises ``ScenarioError`` listing every problem.
    """
    name, tree = read(source)
    problems = []
    for change in overrides:
        try:
            override(tree, change)
        except ScenarioError as error:
            problems.append(str(error))
    problems += inlined(tree)
    try:
        scenario = Scenario.model_validate(tree)
    except ValidationError as error:
        found = problems_in(error, Scenario, tree, ROBOT_KEYS)
        problems += found.values()
        problems += _further_problems(tree, [list(map(str, path)) for path in found])
        raise ScenarioError(_listed(name, problems)) from None
    if problems := problems + problems_of(scenario):
        raise ScenarioError(_listed(name, problems))
    return scenario


def _further_problems(tree: dict[str, Any], refused: list[list[str]]) -> list[str]:
    """Contradictions elsewhere in a scenario some of whose values are refused already."""
    rest = {key: value for key, value in tree.items() if [key] not in refused}
    for path in refused:
        table = rest.get(path[0])
        if len(path) > 1 and isinstance(table, dict):
            rest[path[0]] = {key: value for key, value in table.items() if key != path[1]}
        else:
            rest.pop(path[0], None)
    try:
        problems = problems_of(Scenario.model_validate(rest))
    except ValidationError:
        return []
    touched = {".".join(path[:2]) for path in refused}
    return [
        line
        for line in problems
        # A value that was taken out may itself be what is missing now.
        if "give either" not in line and not any(key in line for key in touched)
    ]


def _listed(name: str, lines: Sequence[str]) -> str:
    many = "one problem" if len(lines) == 1 else f"{len(lines)} problems"
    more = len(lines) - PROBLEMS_SHOWN_MAX
    listed = [*lines[:PROBLEMS_SHOWN_MAX], *([f"and {more} more"] if more > 0 else [])]
    return "\n".join([f"scenario {name!r} has {many}:", *(f"  {line}" for line in listed)])
