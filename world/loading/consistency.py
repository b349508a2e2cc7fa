"""What contradicts itself in a scenario although each value is in range; with key and value."""

from collections.abc import Mapping, Sequence
from math import hypot
from typing import Any

import msgpack

from encircle.protocol.parameters import Parameters, Problems
from encircle.protocol.plugins import SHIPPED_POLICIES, STRATEGIES, PluginLoadError, Registry
from encircle.protocol.wire.checks import parameters as parameters_received
from encircle.protocol.wire.limits import NUMBER_MAX
from encircle.world.loading.channel_consistency import problems_of_radio
from encircle.world.scenario.fields import ROBOTS_MAX, shown
from encircle.world.scenario.model import Scenario
from encircle.world.scenario.plugin_parameters import check_parameters
from encircle.world.targets.behaviours import REGISTRY as BEHAVIOURS

STARTING_GAP_M = 1e-4
POLICIES = Registry(STRATEGIES, SHIPPED_POLICIES)
"""The functions themselves are the robots'."""


def problems_of(scenario: Scenario) -> list[str]:
    """Every contradiction in a scenario; empty if there are none."""
    return [
        *_team(scenario),
        *_times(scenario),
        *_names(scenario),
        *problems_of_radio(scenario.channel, scenario.events, scenario.ids),
        *_overlaps(scenario),
    ]


def _team(scenario: Scenario) -> list[str]:
    problems = []
    team, placement = scenario.team, scenario.team.placement
    if team.positions is None and team.count is None:
        problems.append("team: give either robots (a number) or positions")
    if team.positions is not None and team.count not in (None, len(team.positions)):
        key = "team.robots.count" if team.overrides else "team.robots"
        problems.append(
            f"{key} = {team.count}: but {len(team.positions)} positions are given; give"
            f" {team.count}, or leave team.positions out to have robots placed at random"
            " (team.placement)"
        )
    if team.positions is not None and not 1 <= len(team.positions) <= ROBOTS_MAX:
        problems.append(f"team.positions: {len(team.positions)} given, must be 1 to {ROBOTS_MAX}")
    if team.positions is None and team.jitter_m > 0.0:
        problems.append(
            f"team.jitter_m = {team.jitter_m}: has no meaning without positions;"
            " random starts are another for every seed as it is"
        )
    if placement.distance_m_min > placement.distance_m_max:
        problems.append(
            f"team.placement.distance_m_min = {placement.distance_m_min}:"
            f" must be at most distance_m_max = {placement.distance_m_max}"
        )
    touching = team.radius_m + scenario.target.radius_m
    if scenario.capture.stop_distance_m < touching:
        problems.append(
            f"capture.stop_distance_m = {scenario.capture.stop_distance_m}: bodies of radius"
            f" {team.radius_m} and {scenario.target.radius_m} cannot come closer than {touching}"
        )
    if scenario.capture.count is not None and scenario.capture.count > len(scenario.ids):
        problems.append(
            f"capture.count = {scenario.capture.count}: the team has {len(scenario.ids)} robots"
        )
    return problems


def _times(scenario: Scenario) -> list[str]:
    if scenario.is_direct and scenario.clock != "wall":
        return [
            f"radio = 'direct': needs clock = 'wall', not {scenario.clock!r}; robots that send to"
            " each other directly receive at any time, not at the end of a round"
        ]
    return []


def _names(scenario: Scenario) -> list[str]:
    team, target = scenario.team, scenario.target
    # The robots would find out, but later, and each by itself.
    problems = _policy("team", team.strategy, team.policy_parameters)
    is_sound = not problems
    for robot, own in team.overrides.items():
        # What is wrong with the team's policy is not said again for each robot that has it.
        if own.strategy is not None or (own.policy_parameters is not None and is_sound):
            problems += _policy(
                f"team.robots.{robot}",
                scenario.strategy_of(robot),
                scenario.policy_parameters_of(robot),
            )
    problems += _plugin(
        BEHAVIOURS, "target.behaviour", target.behaviour, "target.parameters", target.parameters
    )
    problems += [
        f"robot.{name} = {scenario.robot[name]!r}: belongs under team, target or capture"
        for name in sorted(set(scenario.robot) & set(scenario.bodies))
    ]
    of_team = _problems_of_parameters(scenario.parameters)
    problems += [f"robot.{problem}" for problem in of_team]
    for robot in scenario.team.overrides:
        of_robot = _problems_of_parameters(scenario.parameters_of(robot))
        problems += [f"team.robots.{robot}.{line}" for line in of_robot if line not in of_team]
    return problems


def _problems_of_parameters(parameters: Mapping[str, Any]) -> Sequence[str]:
    try:
        Parameters.from_mapping(parameters)
    except Problems as error:
        return error.lines
    return ()


def _policy(table: str, name: str, parameters: Mapping[str, Any]) -> list[str]:
    if name in SHIPPED_POLICIES and not parameters:
        # It needs none; and a world need not import what only robots use.
        return []
    key = f"{table}.policy_parameters"
    problems = _plugin(POLICIES, f"{table}.strategy", name, key, parameters)
    if problems:
        return problems
    try:
        # As robots receive them, who would refuse the whole setup.
        parameters_received(msgpack.unpackb(msgpack.packb(parameters), use_list=False))
    except OverflowError:
        must = f"made of numbers between {-NUMBER_MAX:g} and {NUMBER_MAX:g}"
    except ValueError as error:
        must = str(error)
    else:
        return []
    return [f"{key} = {shown(parameters)}: must be {must}, to be sent to robots"]


def _plugin(
    registry: Registry, key: str, name: str, parameters_key: str, parameters: Mapping[str, Any]
) -> list[str]:
    """What is wrong with a plug-in's name, or with its own parameters."""
    try:
        check_parameters(registry.named(name), parameters)
    except Problems as error:
        return [f"{parameters_key}.{problem} ({key} = {name!r})" for problem in error.lines]
    except (ValueError, PluginLoadError) as error:
        return [f"{key} = {name!r}: {error}"]
    return []


def _overlaps(scenario: Scenario) -> list[str]:
    """Starts that overlap, or could once they are moved about by ``team.jitter_m``."""
    team = scenario.team
    bodies = [("target.position", scenario.target.position, scenario.target.radius_m, 0.0)]
    bodies += [
        (f"team.positions.{k}", position, team.radius_m, team.jitter_m)
        for k, position in enumerate(team.positions or ())
    ]
    fixed = [
        (f"obstacles.{k}.position", o.position, o.radius_m, 0.0)
        for k, o in enumerate(scenario.obstacles)
    ]
    problems = []
    for k, (name, (x, y), radius, jitter) in enumerate(bodies):
        for other, (ox, oy), other_radius, other_jitter in [*bodies[:k], *fixed]:
            apart, reach = radius + other_radius + STARTING_GAP_M, jitter + other_jitter
            if hypot(x - ox, y - oy) < apart:
                problems.append(f"{name} = {(x, y)}: overlaps {other} = {(ox, oy)}")
            # The least distance of two positions, each moved by its jitter along each axis.
            elif hypot(max(0.0, abs(x - ox) - reach), max(0.0, abs(y - oy) - reach)) < apart:
                problems.append(
                    f"team.jitter_m = {team.jitter_m}: moved by that much,"
                    f" {name} = {(x, y)} could overlap {other} = {(ox, oy)}"
                )
    return problems
