"""Scenarios that name code which is not run: checked all the same, with shipped names in its place.

A policy or target behaviour that is *away* is in a file that must not be imported, or is not
installed. While a scenario's tables are checked, a shipped name stands in for it, without own
parameters; in the checked scenario the written names and parameters stand again.
"""

from collections.abc import Callable, Mapping
from typing import Any, cast

from encircle.protocol.plugins import STRATEGIES, TARGETS
from encircle.world.loading.load import load
from encircle.world.scenario.model import Scenario
from encircle.world.scenario.robots_table import RobotOverride, RobotsTable

POLICY, BEHAVIOUR = "xi-star", "flee"
IsAway = Callable[[str, str], bool]
"""Whether what has a name in a group of plug-ins is not to be had."""


def load_with_stand_ins(tree: dict[str, Any], is_away: IsAway) -> Scenario:
    """A scenario from its tables, which are changed; ``ScenarioError`` as ``load``."""
    team, target = _table(tree, "team"), _table(tree, "target")
    of_target = _taken(target, "behaviour", "parameters", BEHAVIOUR, TARGETS, is_away)
    of_team = _taken(team, "strategy", "policy_parameters", POLICY, STRATEGIES, is_away)
    robots = team.get("robots")
    of_robots = {
        robot: _taken_of_robot(own, bool(of_team), is_away)
        for robot, own in (robots.items() if isinstance(robots, dict) else ())
        if isinstance(own, dict)
    }
    scenario = load(tree)
    return _restored(scenario, of_team, of_target, {k: v for k, v in of_robots.items() if v})


def _table(tree: Mapping[str, Any], key: str) -> dict[str, Any]:
    table = tree.get(key)
    return table if isinstance(table, dict) else {}


def _taken(
    table: dict[str, Any], key: str, parameters: str, stand_in: str, group: str, is_away: IsAway
) -> dict[str, Any]:
    """Put a stand-in into a table, if its name is away; returns what stood there."""
    name = table.get(key)
    if not isinstance(name, str) or not is_away(group, name):
        return {}
    table[key] = stand_in
    return {key: name, parameters: table.pop(parameters, None) or {}}


def _taken_of_robot(own: dict[str, Any], of_team: bool, is_away: IsAway) -> dict[str, Any]:
    """As ``_taken`` for one robot, which has the team's policy unless it names another."""
    name = own.get("strategy")
    is_named_away = isinstance(name, str) and is_away(STRATEGIES, name)
    if not is_named_away and not (name is None and of_team and own.get("policy_parameters")):
        return {}
    own["strategy"] = POLICY if is_named_away else None
    return {"strategy": name, "policy_parameters": own.pop("policy_parameters", None)}


def _restored(
    scenario: Scenario,
    of_team: Mapping[str, Any],
    of_target: Mapping[str, Any],
    of_robots: Mapping[str, Mapping[str, Any]],
) -> Scenario:
    """The scenario with the names that were taken out of its tables."""
    team = scenario.team
    if of_robots:
        overrides = dict(team.overrides)
        for robot, names in of_robots.items():
            given = {key: value for key, value in names.items() if value is not None}
            own = overrides.get(robot, RobotOverride())
            overrides[robot] = own.model_copy(update=given)
        robots = RobotsTable(count=team.count, **cast(dict[str, Any], overrides))
        team = team.model_copy(update={"robots": robots})
    return scenario.model_copy(
        update={
            "team": team.model_copy(update=dict(of_team)),
            "target": scenario.target.model_copy(update=dict(of_target)),
        }
    )
