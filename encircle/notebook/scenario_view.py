"""A scenario in a notebook: what it is, and the arena at the start."""

from collections import Counter
from collections.abc import Iterator

import numpy as np

from encircle.notebook.html import facts, framed
from encircle.notebook.sketch import GREY, Sketch, draw_bodies
from encircle.scene.channel_text import channel_sentences
from encircle.scene.counts import counted
from encircle.scene.field_text import value_text
from encircle.world.arena.engine import build, initial, truth
from encircle.world.scenario.errors import ScenarioError
from encircle.world.scenario.model import Scenario

EVENTS_MAX = 8
START_NOTE = (
    "The arena at the start, to scale: robots, and the filled target in the circle of the stop"
    " distance; broken circles are how far robots detect the target."
)


def scenario_html(scenario: Scenario) -> str:
    """A scenario as HTML: a table, and a drawing of the arena at the start."""
    drawing = start_svg(scenario)
    title = scenario.title or "Scenario"
    return framed(title, [facts(_facts(scenario)), drawing], START_NOTE if drawing else "")


def start_svg(scenario: Scenario) -> str:
    """A drawing of the arena at the start; empty if the bodies cannot be placed."""
    try:
        arena = build(scenario, scenario.seed)
        state = truth(arena, initial(arena))
    except ScenarioError:
        return ""
    robots, target = np.array(state.robots), np.array(state.target)
    radius_m, stop_m = scenario.team.radius_m, scenario.capture.stop_distance_m
    ranges_m = [scenario.parameters_of(robot)["sensing_range_m"] for robot in scenario.ids]
    discs = [(*place, radius_m) for place in robots.tolist()]
    discs += [(*target.tolist(), max(stop_m, scenario.target.radius_m))]
    discs += [(*o.position, o.radius_m) for o in scenario.obstacles]
    corners = np.array([(x + s * r, y + s * r) for x, y, r in discs for s in (-1.0, 1.0)])
    sketch = Sketch(corners.min(axis=0), corners.max(axis=0), "The arena at the start")
    for obstacle in scenario.obstacles:
        sketch.circle(obstacle.position, obstacle.radius_m, GREY, GREY)
    for place, range_m in zip(robots.tolist(), ranges_m, strict=True):
        sketch.circle(place, range_m, GREY, "none", 'stroke-dasharray="5 4"')
    sketch.circle(target.tolist(), stop_m, "currentColor")
    draw_bodies(sketch, robots, target, radius_m, scenario.target.radius_m)
    return sketch.svg()


def _facts(scenario: Scenario) -> Iterator[tuple[str, str]]:
    if scenario.description.strip():
        yield "about", " ".join(scenario.description.split())
    policies = Counter(map(scenario.strategy_of, scenario.ids))
    named = ", ".join(policies) if len(policies) == 1 else _counted(policies)
    yield "team", f"{counted(len(scenario.ids), 'robot')}, {named}"
    yield "radio", "; ".join(channel_sentences(scenario))
    yield "target", f"{scenario.target.behaviour}, at most {scenario.target.step_m_max:g} m a tick"
    stop_m = scenario.capture.stop_distance_m
    yield "captured", f"when {_captors(scenario.capture_count)} within {stop_m:g} m around it"
    limit_s = scenario.ticks_max * scenario.tick_s
    yield "time", f"at most {scenario.ticks_max} ticks of {scenario.tick_s:g} s ({limit_s:g} s)"
    if scenario.clock == "wall":
        yield "clock", "real time"
    if scenario.sensing.noise_m_std:
        yield "noise", f"{scenario.sensing.noise_m_std:g} m per axis of a detection"
    for event in scenario.events[:EVENTS_MAX]:
        yield f"tick {event.tick}", value_text(event)
    if len(scenario.events) > EVENTS_MAX:
        yield "", f"and {len(scenario.events) - EVENTS_MAX} more events"
    yield "seed", f"{scenario.seed}"


def _captors(count: int) -> str:
    return "one robot is" if count == 1 else f"{count} robots are"


def _counted(policies: Counter[str]) -> str:
    return ", ".join(f"{count} {policy}" for policy, count in policies.items())
