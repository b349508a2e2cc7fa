"""The stories of the paper's five simulations, asserted from the truth at every tick.

What is asserted is computed here from positions alone: who is in range, which way the target runs,
when and by how much it turns, that no bodies overlap, and that it ends captured.
"""

from itertools import combinations
from math import atan2, degrees, dist, hypot, pi
from typing import NamedTuple

import pytest

import encircle
from encircle.runner.memory import run_in_memory
from encircle.world.arena import engine
from encircle.world.loading.load import load

RANGE_M = 6.0
STORIES = ("sim1", "sim2", "sim3", "sim4", "sim5")


class Story(NamedTuple):
    """Positions of robots and target at every tick, contacts, and the scenario."""

    robots: list[list[tuple[float, float]]]
    target: list[tuple[float, float]]
    contacts: list[tuple[str, str]]
    scenario: encircle.Scenario
    captured_at: int | None

    def in_range(self, robot: int, tick: int) -> bool:
        return dist(self.robots[tick][robot], self.target[tick]) <= RANGE_M

    def heading_deg(self, tick: int) -> float:
        """Direction of the target's step from ``tick`` to the next one."""
        (x, y), (u, v) = self.target[tick], self.target[tick + 1]
        return degrees(atan2(v - y, u - x))


@pytest.fixture(scope="module")
def stories() -> dict[str, Story]:
    return {name: told(name) for name in STORIES}


def told(name: str, overrides: tuple[str, ...] = ()) -> Story:
    scenario = load(name, overrides)
    arena = engine.build(scenario, scenario.seed)
    first = engine.truth(arena, engine.initial(arena))
    states = [first]

    def note(_tick: int, key: str, payload: bytes) -> None:
        if key.endswith("world/state"):
            states.append(encircle_state(payload))

    states.clear()
    result = run_in_memory(arena, "story", print, note)
    return Story(
        [list(state.robots) for state in states],
        [state.target for state in states],
        [pair for state in states for pair in state.contacts],
        scenario,
        result.capture_tick,
    )


def encircle_state(payload: bytes):
    from encircle.protocol.codec import decode
    from encircle.protocol.messages import State

    return decode(State, payload, "story")


def first_in_range(story: Story, robot: int) -> int:
    return next(t for t in range(len(story.target)) if story.in_range(robot, t))


def turn_deg(story: Story, before: int, after: int) -> float:
    return (story.heading_deg(after) - story.heading_deg(before) + 180) % 360 - 180


@pytest.mark.parametrize("name", STORIES)
def test_the_target_is_captured_and_surrounded(stories, name):
    story = stories[name]
    assert story.captured_at == len(story.target) - 1
    x, y = story.target[-1]
    rays = [(rx - x, ry - y) for rx, ry in story.robots[-1]]
    assert all(hypot(*ray) <= 1.3 for ray in rays)
    bearings = sorted(atan2(ry, rx) for rx, ry in rays)
    gaps = [b - a for a, b in zip(bearings, [*bearings[1:], bearings[0] + 2 * pi], strict=True)]
    assert max(gaps) < pi


@pytest.mark.parametrize("name", STORIES)
def test_bodies_never_overlap(stories, name):
    story = stories[name]
    fixed = [(o.position, o.radius_m) for o in story.scenario.obstacles]
    for robots, target in zip(story.robots, story.target, strict=True):
        bodies = [*robots, target]
        assert all(dist(a, b) >= 1.0 for a, b in combinations(bodies, 2))
        assert all(dist(a, place) >= 0.5 + radius for a in bodies for place, radius in fixed)


@pytest.mark.parametrize("name", STORIES)
def test_nobody_moves_farther_than_its_step_unless_by_hand(stories, name):
    story = stories[name]
    moved_by_hand = {event.tick for event in story.scenario.events if event.kind == "move-target"}
    for tick in range(1, len(story.target)):
        for before, after in zip(story.robots[tick - 1], story.robots[tick], strict=True):
            assert dist(before, after) <= 0.3 + 1e-5
        if tick not in moved_by_hand:
            step_m = dist(story.target[tick - 1], story.target[tick])
            assert step_m <= story.scenario.target.step_m_max + 1e-5


@pytest.mark.parametrize("name", ["sim1", "sim3", "sim4", "sim5"])
def test_at_the_start_only_r1_detects_the_target(stories, name):
    assert [stories[name].in_range(robot, 0) for robot in range(4)] == [True, False, False, False]


@pytest.mark.parametrize("name", ["sim1", "sim3", "sim5"])
def test_the_target_runs_to_the_right_until_it_detects_r3(stories, name):
    story = stories[name]
    seen = first_in_range(story, 2)
    assert seen > 5
    assert story.target[seen][0] > 1.0
    assert all(abs(story.heading_deg(tick)) < 30 for tick in range(seen))


@pytest.mark.parametrize("name", ["sim1", "sim5"])
def test_having_detected_r3_the_target_turns(stories, name):
    story = stories[name]
    seen = first_in_range(story, 2)
    assert abs(turn_deg(story, seen - 1, seen + 5)) > 45
    # Without r3 in its way it would not have turned then.
    alone = told(name, ("team.positions.2=[60.0, 0.0]", f"ticks_max={seen + 6}"))
    assert abs(turn_deg(alone, seen - 1, seen + 5)) < abs(turn_deg(story, seen - 1, seen + 5)) - 10


def test_in_simulation_1_all_others_learn_of_the_target_from_r1s_first_packet(stories):
    modes = decided("sim1")
    assert modes[0] == ["encircle", "search", "search", "search"]
    assert modes[1] == ["encircle"] * 4


def decided(name: str) -> list[list[str]]:
    from encircle.protocol.codec import decode
    from encircle.protocol.messages import Command

    scenario = load(name)
    modes: list[list[str]] = []

    def note(tick: int, key: str, payload: bytes) -> None:
        if key.endswith("command"):
            if tick == len(modes):
                modes.append([])
            modes[tick].append(decode(Command, payload, "story").mode)

    run_in_memory(engine.build(scenario, scenario.seed), "story", print, note)
    return modes


def test_in_simulation_2_robots_touch_neither_each_other_nor_obstacles(stories):
    touching = stories["sim2"].contacts
    assert all("target" in pair for pair in touching)
    assert len(stories["sim2"].scenario.obstacles) >= 3


def test_in_simulation_2_the_direct_way_is_blocked_for_somebody(stories):
    story = stories["sim2"]
    blocked = [
        any(
            segment_distance(start, story.target[0], o.position) < o.radius_m + 0.5
            for o in story.scenario.obstacles
        )
        for start in story.robots[0]
    ]
    assert any(blocked)


def segment_distance(a, b, point) -> float:
    length = dist(a, b)
    along = sum((p - q) * (s - q) for p, q, s in zip(point, a, b, strict=True)) / length**2
    nearest = [q + max(0.0, min(1.0, along)) * (s - q) for q, s in zip(a, b, strict=True)]
    return dist(nearest, point)


def test_simulation_3_is_simulation_1_until_the_target_is_moved(stories):
    one, three = stories["sim1"], stories["sim3"]
    (event,) = three.scenario.events
    assert three.robots[: event.tick] == one.robots[: event.tick]
    assert three.target[: event.tick] == one.target[: event.tick]
    assert three.target[event.tick] == pytest.approx(event.position, abs=1e-5)
    assert dist(three.target[event.tick - 1], three.target[event.tick]) > 3.0
    assert one.captured_at is not None
    assert event.tick < one.captured_at < three.captured_at


def test_in_simulation_3_the_robots_turn_after_the_moved_target(stories):
    story = stories["sim3"]
    (event,) = story.scenario.events
    later = event.tick + 15
    for robot in range(4):
        before, after = story.robots[event.tick][robot], story.robots[later][robot]
        assert dist(after, event.position) < dist(before, event.position)


def test_in_simulation_4_the_target_is_faster_than_the_robots(stories):
    story = stories["sim4"]
    assert story.scenario.target.step_m_max == pytest.approx(1.3 * story.scenario.team.step_m_max)
    fastest = max(dist(a, b) for a, b in zip(story.target, story.target[1:], strict=False))
    assert fastest == pytest.approx(0.39, abs=1e-5)


@pytest.mark.parametrize("strategy", ["xi-0", "xi-1", "xi-3", "xi-star"])
@pytest.mark.parametrize("x", [8.0, 11.0, 14.0])
def test_in_simulation_5_all_four_policies_fulfil_the_task(strategy, x):
    hunt = encircle.run(
        "sim5",
        link="memory",
        overrides=[f"team.positions.2.0={x}", f"team.strategy={strategy}"],
    )
    assert hunt.captured
