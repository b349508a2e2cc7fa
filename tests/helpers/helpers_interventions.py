"""Interventions drawn at random, and hunts in memory to which they are given."""

import random
from collections.abc import Mapping, Sequence
from typing import Any

from helpers_world import RUN

from encircle.runner.memory import run_in_memory
from encircle.world.arena.engine import build
from encircle.world.coordinator.result import Result
from encircle.world.coordinator.world_core import WorldCore
from encircle.world.loading.interventions import InterventionRefused
from encircle.world.recording.resuming import Resumed
from encircle.world.scenario.model import Scenario

Messages = list[tuple[int, str, bytes]]
Plan = Mapping[int, Sequence[Mapping[str, Any]]]
"""What is given at which tick."""


def drawn_plan(seed: int, ids: Sequence[str], ticks: int, count: int = 6) -> Plan:
    """Events of every kind at random ticks, some of a later tick than the next."""
    draws = random.Random(f"plan {seed}")
    plan: dict[int, list[Mapping[str, Any]]] = {}
    for _ in range(count):
        at = draws.randint(0, ticks - 1)
        event = drawn_event(draws, ids)
        if draws.random() < 0.3:
            event["tick"] = at + draws.randint(1, 10)
        if event["kind"] not in ("move-target", "heal") and draws.random() < 0.5:
            event["ticks"] = draws.randint(1, 15)
        plan.setdefault(at, []).append(event)
    return plan


def drawn_event(draws: random.Random, ids: Sequence[str]) -> dict[str, Any]:
    """An event of some kind, of the next tick and without an end."""
    cut = draws.randint(1, len(ids) - 1)
    robot, other = draws.sample(ids, 2)
    place = [draws.uniform(-6.0, 6.0), draws.uniform(-6.0, 6.0)]
    return draws.choice(
        [
            {"kind": "loss", "rate": draws.random()},
            {"kind": "loss"},
            {"kind": "delay", "delay_s": draws.uniform(0.0, 1.0)},
            {"kind": "range", "range_m": draws.uniform(2.0, 12.0)},
            {"kind": "range"},
            {"kind": "partition", "groups": [list(ids[:cut]), list(ids[cut:])]},
            {"kind": "silence", "robot": robot},
            {"kind": "outage", "sender": robot, "receiver": other},
            {"kind": "heal"},
            {"kind": "move-target", "position": place},
            {"kind": "crash", "robot": robot},
        ]
    )


def hunted_with(
    scenario: Scenario, plan: Plan, resumed: Resumed | None = None
) -> tuple[Result, Messages]:
    """A hunt in memory to which a plan is given; what was refused is left out."""
    messages: Messages = [] if resumed is None else list(resumed.messages)

    def give(world: WorldCore) -> None:
        for event in plan.get(world.state.tick, ()):
            try:
                world.intervene(event)
            except InterventionRefused:
                # Such as a crash of a robot that is away already.
                continue

    result = run_in_memory(
        build(scenario, scenario.seed),
        RUN,
        lambda _line: None,
        lambda *message: messages.append(message),
        progress=give,
        resumed=resumed,
    )
    return result, messages


def given(messages: Messages) -> Messages:
    """The messages about interventions."""
    return [message for message in messages if message[1].endswith("/intervention")]


def rounds(messages: Messages) -> Messages:
    """All other messages."""
    return [message for message in messages if not message[1].endswith("/intervention")]
