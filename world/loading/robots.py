"""Single robots' tables under ``team.robots``, before a scenario is checked.

``team.robots`` may be a number although an override names one of the robots: the number is then the
table's ``count``. And a number that is set where a table is becomes its ``count``, so that a study
can vary how many robots there are and what is different about one of them.
"""

import re
from collections.abc import Mapping
from typing import Any

from encircle.protocol.errors import did_you_mean
from encircle.world.scenario.fields import ROBOTS_MAX, shown

KEY = ("team", "robots")
COUNT = "count"
_ROBOT = re.compile(r"r[1-9][0-9]{0,8}")


def as_table(robots: Any) -> Any:
    """``team.robots`` for a key below it to be set: a number is the table's count."""
    return {COUNT: robots} if _is_number(robots) else robots


def set_robots(robots: Any, value: Any) -> Any:
    """``team.robots`` after it has been set to ``value``: a number is the count of a table."""
    return {**robots, COUNT: value} if isinstance(robots, dict) and _is_number(value) else value


def unknown_robots(tree: Mapping[str, Any]) -> list[str]:
    """A line for each table of a robot that the team does not have; it is taken out of the tree."""
    team = tree.get(KEY[0])
    table = team.get(KEY[1]) if isinstance(team, Mapping) else None
    if not isinstance(team, Mapping) or not isinstance(table, dict):
        return []
    positions, given = team.get("positions"), table.get(COUNT)
    count = len(positions) if isinstance(positions, list | tuple) else given
    is_known = isinstance(count, int) and not isinstance(count, bool) and 1 <= count <= ROBOTS_MAX
    ids = [f"r{k + 1}" for k in range(count)] if isinstance(count, int) and is_known else []
    lines = []
    for key in [key for key in table if key != COUNT]:
        if key in ids or (not is_known and _ROBOT.fullmatch(str(key))):
            continue
        near = did_you_mean(key, [COUNT, *ids])
        robots = "r1, r2, ..." if not ids else ids[0] if len(ids) == 1 else f"r1 to {ids[-1]}"
        lines.append(f"team.robots.{key} = {shown(table.pop(key))}: robots are {robots}{near}")
    return lines


def _is_number(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)
