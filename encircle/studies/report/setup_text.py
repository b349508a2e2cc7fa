"""A study's set-up as text: the scenario of its first cell, what is varied, which seeds.

It describes the first cell and not the base scenario, because the base need not be complete without
the levels of the axes. The texts on channel and events are made from the fields of their models
that differ from the defaults, so that a new loss model needs no change here.
"""

import re
from collections.abc import Sequence

from encircle.scene.field_text import ITEMS_MAX, items_text, value_text
from encircle.studies.charts.layout import axis_label, level_text
from encircle.studies.plan import Axis, Plan
from encircle.world.scenario.model import Scenario

_ROBOT = re.compile(r"^team\.robots\.r\d+\.")
"""A key of one robot says the same of it as one of ``team`` says of all."""


def setup_rows(plan: Plan) -> list[tuple[str, str]]:
    """The scenario of the first cell in rows (name, text), with a note on what is varied."""
    scenario = plan.scenario_of(0)
    team, target, sensing = scenario.team, scenario.target, scenario.sensing
    hz = 1.0 / scenario.tick_s
    turning = f", turning by at most {team.turn_rad_max:.3g} rad per tick"
    motion = team.motion + (turning if team.motion == "unicycle" else "")
    behaviour = target.behaviour + (
        f" ({items_text(target.parameters)})" if target.parameters else ""
    )
    noise = f", detection noise {sensing.noise_m_std:g} m" if sensing.noise_m_std else ""
    noise += _localisation(scenario)
    limit = f"{scenario.ticks_max} ticks ({scenario.ticks_max * scenario.tick_s:g} s)"
    rows = [
        (
            "Robots",
            f"{len(scenario.ids)}; {_starts(scenario)}",
            ("team.robots", "team.positions", "team.placement", "team.jitter"),
        ),
        ("Strategy", team.strategy + _exceptions(scenario, "strategy"), ("team.strategy",)),
        (
            "Robots' bodies",
            f"radius {team.radius_m:g} m; {_speed(team.step_m_max, hz)}"
            f"{_exceptions(scenario, 'step_m_max', ' m')}; {motion}",
            ("team.radius", "team.step", "team.motion", "team.turn"),
        ),
        (
            "Robots' sensors",
            f"range {team.sensing_range_m:g} m{_exceptions(scenario, 'sensing_range_m', ' m')},"
            f" {sensing.rays} rays{noise}",
            ("team.sensing", "sensing"),
        ),
        (
            "Target",
            f"behaviour {behaviour}; radius {target.radius_m:g} m;"
            f" {_speed(target.step_m_max, hz)}; sees {target.sensing_range_m:g} m far",
            ("target",),
        ),
        ("Obstacles", str(len(scenario.obstacles)) if scenario.obstacles else "none", ("obst",)),
        (
            "Radio",
            f"{_radio(scenario)}{_robot_radios(scenario)}",
            ("channel", "team.radio_range", "team.loss_rate"),
        ),
        ("Events", "; ".join(map(value_text, scenario.events)) or "none", ("events",)),
        (
            "Capture",
            f"{scenario.capture_count} robots within {scenario.capture.stop_distance_m:g} m of the"
            " target, no angle between neighbours of half a turn or more",
            ("capture",),
        ),
        ("Time", f"ticks of {scenario.tick_s:g} s, at most {limit}", ("tick",)),
    ]
    if texts := _policy_parameters(scenario):
        rows.append(("Policies' parameters", texts, ("team.policy_parameters",)))
    if scenario.robot:
        rows.append(("Robots' parameters", items_text(scenario.robot), ("robot.",)))
    text_rows = [(name, text + _varied(plan, keys)) for name, text, keys in rows]
    return [*text_rows, ("Seeds", f"{seeds_text(plan.seed_list)}, the same in every cell")]


def seeds_text(seeds: Sequence[int]) -> str:
    """``40, from 1 to 40``; the single seeds if they are not consecutive."""
    if len(seeds) > 2 and list(seeds) == list(range(seeds[0], seeds[0] + len(seeds))):
        return f"{len(seeds)}, from {seeds[0]} to {seeds[-1]}"
    few = ", ".join(map(str, seeds[:ITEMS_MAX])) + (", ..." if len(seeds) > ITEMS_MAX else "")
    return f"{len(seeds)}: {few}"


def axis_rows(plan: Plan, shown: Plan) -> list[tuple[str, str, str]]:
    """What is varied: axis, key, levels; of arms, which keys each sets to what.

    ``shown``: the plan with delays as they were delivered.
    """
    pairs = zip(plan.all_axes, shown.all_axes, strict=True)
    return [
        (axis.title, _keys(axis), _levels(axis) + _delivered(delivered))
        for axis, delivered in pairs
    ]


def _delivered(axis: Axis) -> str:
    return f"; delivered: {_levels(axis)}" if axis.show == "delivered" else ""


def _keys(axis: Axis) -> str:
    if axis.key is not None:
        return axis.key
    return ", ".join(dict.fromkeys(key for arm in axis.arms or () for key in arm.set))


def _levels(axis: Axis) -> str:
    if axis.arms is None:
        return ", ".join(level_text(axis, index) for index in range(len(axis.levels)))
    return "; ".join(f"{arm.name}: {items_text(arm.set) or 'nothing set'}" for arm in axis.arms)


def _varied(plan: Plan, beginnings: tuple[str, ...]) -> str:
    names = [
        axis_label(axis)
        for axis in plan.all_axes
        if len(axis.levels) > 1
        and any(
            _ROBOT.sub("team.", key).startswith(beginnings)
            for index in range(len(axis.levels))
            for key in axis.changes(index)
        )
    ]
    return f" [varied: {', '.join(names)}]" if names else ""


def _starts(scenario: Scenario) -> str:
    team = scenario.team
    if team.positions is None:
        near, far = team.placement.distance_m_min, team.placement.distance_m_max
        return f"starts by seed, {near:g} to {far:g} m from the target"
    jitter = f", moved by up to {team.jitter_m:g} m along each axis by seed"
    return "given starts" + (jitter if team.jitter_m else "")


def _exceptions(scenario: Scenario, key: str, unit: str = "") -> str:
    """Of which robots a value is another than the team's: ``, but 0.15 m for r3``."""
    values = {robot: getattr(own, key) for robot, own in scenario.team.overrides.items()}
    texts = [f"{value_text(values[r])}{unit} for {r}" for r in scenario.ids if values.get(r)]
    return f", but {_few(texts)}" if texts else ""


def _policy_parameters(scenario: Scenario) -> str:
    of_team = scenario.team.policy_parameters
    singles = {robot: scenario.policy_parameters_of(robot) for robot in scenario.ids}
    texts = [items_text(of_team)] if of_team else []
    texts += [
        f"of {robot}: {items_text(own) or 'by default'}"
        for robot, own in singles.items()
        if own != of_team
    ]
    return "; ".join(texts)


def _robot_radios(scenario: Scenario) -> str:
    texts = []
    for robot in scenario.ids:
        own = scenario.override_of(robot)
        if own.radio_range_m is not None:
            texts.append(f"range {own.radio_range_m:g} m for {robot}")
        if own.loss_rate:
            texts.append(f"loss of {own.loss_rate:g} by {robot}'s radio")
    return f"; {_few(texts)}" if texts else ""


def _few(texts: Sequence[str]) -> str:
    return ", ".join(texts[:ITEMS_MAX]) + (", ..." if len(texts) > ITEMS_MAX else "")


def _localisation(scenario: Scenario) -> str:
    sensing = scenario.sensing
    noise = sensing.localisation_noise_m_std
    drift = sensing.localisation_drift_m_per_sqrt_s
    texts = [f"noise {noise:g} m"] * (noise > 0.0) + [f"drift {drift:g} m/sqrt(s)"] * (drift > 0.0)
    return f", own position with {' and '.join(texts)}" if texts else ""


def _speed(step_m: float, hz: float) -> str:
    return f"at most {step_m:g} m per tick ({step_m * hz:.3g} m/s)"


def _radio(scenario: Scenario) -> str:
    channel = scenario.channel
    perfect = type(channel)()
    parts = []
    for name in type(channel).model_fields:
        value = getattr(channel, name)
        if value != getattr(perfect, name):
            parts.append(f"{name.replace('_', ' ')} {value_text(value)}")
        elif name in ("loss", "delay"):
            parts.append(f"no {name}")
    return "; ".join(parts)
