"""Scenarios by name, from a file or from a mapping, checked as a whole.

Unknown keys, values out of range and contradictions are refused, all of them at once, each with its
key and its value.
"""

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from encircle.protocol.parameters import SET_BY_ROBOT_KEYS
from encircle.world.loading.bare_words import quoted_change
from encircle.world.loading.channel_consistency import unknown_robots_of_events
from encircle.world.loading.consistency import problems_of
from encircle.world.loading.files import copied, override, read
from encircle.world.loading.profiles import expanded
from encircle.world.loading.robots import unknown_robots
from encircle.world.loading.trace_files import inlined
from encircle.world.scenario.errors import ScenarioError
from encircle.world.scenario.model import Scenario
from encircle.world.scenario.validation import Path as KeyPath
from encircle.world.scenario.validation import problems_in

PROBLEMS_SHOWN_MAX = 100
START = "team: "
"""What begins the problem that there are neither robots nor positions."""
ROBOT_KEYS = tuple(f"robot.{name}" for name in SET_BY_ROBOT_KEYS)
"""Keys that the model does not know of: it takes the robots' parameters as they are."""


def load(source: str | Path | Mapping[str, Any], overrides: Sequence[str] = ()) -> Scenario:
    """A scenario from a shipped name, a TOML file or a mapping, with ``key=value`` overrides.

    Keys are dotted (``channel.loss.rate``), list items by number (``obstacles.0.radius_m``), robots
    by id (``team.robots.r3.step_m_max``); values are TOML, or plain text if they are not. Files of
    traces are read here and their rows put in their place, as are the tables of
    ``channel.profile``; a relative file lies beside the scenario's file, or below the working
    directory if a mapping or an override names it. Raises ``ScenarioError`` listing every problem.
    """
    name, tree = read(source)
    problems = []
    for change in overrides:
        try:
            override(tree, change)
        except ScenarioError as error:
            problems.append(str(error))
    problems += unknown_robots(tree)
    problems += expanded(tree)
    problems += inlined(tree)
    try:
        scenario = Scenario.model_validate(tree)
    except ValidationError as error:
        refused = problems_in(error, Scenario, tree, ROBOT_KEYS)
        hints = {change.partition("=")[0]: _hint(change) for change in overrides}
        problems += [line + hints.get(".".join(map(str, at)), "") for at, line in refused.items()]
        problems += _further_problems(tree, list(refused))
        raise ScenarioError(_listed(name, problems)) from None
    if problems := problems + problems_of(scenario):
        raise ScenarioError(_listed(name, problems))
    return scenario


def _further_problems(tree: Mapping[str, Any], refused: Collection[KeyPath]) -> list[str]:
    """Contradictions elsewhere in a scenario some of whose values are refused already.

    The refused values are left out; where they cannot be, with the tables that they are in.
    """
    values = [_without_numbers_last(path) for path in refused]
    for paths in (values, [path[:2] for path in values]):
        try:
            scenario = Scenario.model_validate(_without(tree, paths))
            problems = problems_of(scenario)
        except ValidationError:
            continue
        # What is wrong now with the same table may follow from what was left out.
        tables = [".".join(map(str, path[: max(2, len(path) - 1)])) for path in paths]
        touched = re.compile("|".join(rf"(?<![\w.]){re.escape(t)}(?!\w)" for t in tables))
        lines = [line for line in problems if not (touched.search(line) or line.startswith(START))]
        unknown = unknown_robots_of_events(tree.get("events"), scenario.ids, refused)
        return lines + [line for line in unknown if line not in lines]
    return []


def _without_numbers_last(path: KeyPath) -> KeyPath:
    """The path of the list that a path's item is in; other paths are returned as they are."""
    while path and isinstance(path[-1], int):
        path = path[:-1]
    return path


def _without(tree: Mapping[str, Any], paths: Iterable[KeyPath]) -> dict[str, Any]:
    """A copy of a tree without the values at some paths, or without the lists that they are in."""
    rest: dict[str, Any] = copied(tree)
    for path in map(_without_numbers_last, paths):
        table: Any = rest
        for key in path[:-1]:
            is_list = isinstance(table, list) and isinstance(key, int) and key < len(table)
            table = table[key] if is_list or (isinstance(table, dict) and key in table) else None
        if path and isinstance(table, dict):
            table.pop(path[-1], None)
    return rest


def _hint(change: str) -> str:
    """What was perhaps meant by a change whose value is refused; empty if nothing is known."""
    quoted = quoted_change(change)
    return f" (did you mean {quoted}? texts in it need quotes)" if quoted else ""


def _listed(name: str, lines: Sequence[str]) -> str:
    many = "one problem" if len(lines) == 1 else f"{len(lines)} problems"
    more = len(lines) - PROBLEMS_SHOWN_MAX
    listed = [*lines[:PROBLEMS_SHOWN_MAX], *([f"and {more} more"] if more > 0 else [])]
    return "\n".join([f"scenario {name!r} has {many}:", *(f"  {line}" for line in listed)])
