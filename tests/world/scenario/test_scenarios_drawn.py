"""The scenarios that tests draw at random leave out no kind that a scenario can name.

What there is to draw is read off the models, the parameters and the entry points: a loss, a delay,
an event, a key or a strategy that is added there and not drawn fails here.
"""

from collections import defaultdict
from dataclasses import fields
from functools import cache
from importlib.metadata import entry_points
from typing import Any, Literal, get_args, get_origin, get_type_hints

from helpers_scenarios import PARAMETERS, ROBOTS, scenario_of
from pydantic import BaseModel

from encircle.protocol.parameters import Parameters, declared
from encircle.world.scenario.model import Scenario

SEEDS = range(300)
CANNOT_BE_REPEATED = {"Scenario.clock", "Scenario.radio"}
OF_ONE_POLICY = {"Team.policy_parameters", "RobotOverride.policy_parameters"}
"""What can be given depends on the policy; tests of policies give it."""


@cache
def drawn():
    return [scenario_of(seed) for seed in SEEDS]


def parts_of(annotation):
    """An annotation and all that it is made of: of unions, tuples and annotated types."""
    yield annotation
    for inner in get_args(annotation) if get_origin(annotation) is not Literal else ():
        yield from parts_of(inner)


def models(kind: type[BaseModel]) -> set[type[BaseModel]]:
    """A model and all that it can hold."""
    found, new = set(), {kind}
    while new:
        found |= new
        new = {
            part
            for model in new
            for hint in get_type_hints(model, include_extras=True).values()
            for part in parts_of(hint)
            if isinstance(part, type) and issubclass(part, BaseModel)
        } - found
    return found


def keys():
    """All keys of all models, and those among them that name one of several kinds, with these."""
    every, kinds = {}, {}
    for model in models(Scenario):
        hints = get_type_hints(model, include_extras=True)
        for name, field in model.model_fields.items():
            key = f"{model.__name__}.{name}"
            every[key] = field
            literals = [p for p in parts_of(hints[name]) if get_origin(p) is Literal]
            if literals:
                kinds[key] = {value for literal in literals for value in get_args(literal)}
    return every, kinds


def values(part: Any, found: dict[str, list[Any]]) -> dict[str, list[Any]]:
    """What a scenario holds, by key."""
    if isinstance(part, BaseModel):
        for name in type(part).model_fields:
            value = getattr(part, name)
            found[f"{type(part).__name__}.{name}"].append(value)
            values(value, found)
        for single in (part.model_extra or {}).values():
            values(single, found)
    elif isinstance(part, tuple):
        for one in part:
            values(one, found)
    return found


@cache
def found():
    every = defaultdict(list)
    for scenario in drawn():
        values(scenario, every)
    return every


def test_the_models_are_all_looked_at():
    every, kinds = keys()
    assert {"BernoulliLoss.rate", "Crash.robot", "LinkOverride.delay", "Obstacle.radius_m"} <= set(
        every
    )
    assert {"BurstLoss.model", "TraceDelay.mode", "Outage.kind", "Team.motion"} <= set(kinds)


def test_every_kind_of_every_stage_is_drawn():
    missing = {
        key: kinds - set(found()[key])
        for key, kinds in keys()[1].items()
        if key not in CANNOT_BE_REPEATED
    }
    assert not any(missing.values()), missing


def test_every_key_is_drawn_with_more_than_its_default():
    undrawn = [
        key
        for key, field in keys()[0].items()
        if key not in CANNOT_BE_REPEATED | OF_ONE_POLICY
        and len(keys()[1].get(key, "")) != 1
        and all(value == field.get_default(call_default_factory=True) for value in found()[key])
    ]
    assert undrawn == []


def test_every_strategy_behaviour_and_size_of_team_is_drawn():
    for group, key in (("strategies", "Team.strategy"), ("targets", "Target.behaviour")):
        known = {entry.name for entry in entry_points(group=f"encircle.{group}")}
        assert known == set(found()[key])
    assert {len(scenario.ids) for scenario in drawn()} == set(ROBOTS) == set(range(2, 9))


def test_every_parameter_of_robots_and_each_of_its_choices_is_drawn():
    bodies = set(drawn()[0].bodies)
    assert set(PARAMETERS) == {field.name for field in fields(Parameters)} - bodies
    chosen = defaultdict(set)
    for scenario in drawn():
        for name, value in scenario.robot.items():
            chosen[name].add(value if isinstance(value, str | int | float) else tuple(value))
    choices = {name: set(one.choices) for name, one in declared().items() if one.choices}
    assert choices == {name: chosen[name] for name in choices}
    assert {name for name, seen in chosen.items() if len(seen) > 1} == set(PARAMETERS)


def test_a_seed_is_a_scenario():
    assert scenario_of(7) == scenario_of(7) != scenario_of(8)
