"""Bodies never overlap: whole hunts, adversarial commands, long contacts and slow creeping."""

from math import cos, hypot, pi, sin

import numpy as np
import pytest
from helpers_world import arena, overlapping, small, walked
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.runner.memory import run_in_memory
from encircle.world.arena import engine
from encircle.world.loading.files import shipped
from encircle.world.loading.load import load
from encircle.world.scenario.errors import ScenarioError

HUNTS = [
    *((name, []) for name in shipped()),
    *((name, ["team.motion=unicycle"]) for name in ("sim1", "sim2")),
    ("sim2", ["channel.loss={model='bernoulli', rate=0.5}", "sensing.noise_m_std=0.3"]),
    ("sim2", ["channel.delay={model='gamma', mean_s=0.5, std_s=0.4}", "team.strategy=pursuit"]),
    ("sim4", ["target.behaviour=gap", "robot.clearance_m=0.0"]),
    ("sim1", ["team.strategy=pursuit", "robot.clearance_m=0.0"]),
]


def hunted_without_overlap(scenario, seed):
    hunted = engine.build(scenario, seed)
    count = len(hunted.ids) + 1

    def check(core):
        assert overlapping(core.state.positions, hunted.radii, count) == [], core.state.tick

    return run_in_memory(hunted, "tested", print, progress=check)


@pytest.mark.parametrize(("name", "changes"), HUNTS)
def test_bodies_never_overlap_in_a_hunt(name, changes):
    scenario = load(name, [*changes, "ticks_max=120"])
    hunted_without_overlap(scenario, scenario.seed)


@pytest.mark.parametrize("motion", ["holonomic", "unicycle"])
@pytest.mark.parametrize("seed", range(1, 7))
def test_bodies_never_overlap_in_a_random_hunt(motion, seed):
    scenario = small(
        "ticks_max=60",
        f"team.motion={motion}",
        "target.behaviour=flee",
        "sensing.noise_m_std=0.1",
        "channel.loss={model='bernoulli', rate=0.3}",
        team={"robots": 3 + seed, "placement": {"distance_m_min": 2.0, "distance_m_max": 6.0}},
    )
    hunted_without_overlap(scenario, seed)


@pytest.mark.parametrize(
    ("seed", "robots", "changes"),
    [
        (5, 8, ["team.strategy=pursuit"]),
        (34, 7, ["target.behaviour=gap"]),
        (64, 7, ["robot.clearance_m=0.0"]),
    ],
)
def test_bodies_never_overlap_in_hunts_in_which_they_once_did(seed, robots, changes):
    scenario = small("target.behaviour=flee", "ticks_max=200", *changes, team={"robots": robots})
    hunted_without_overlap(scenario, seed)


@settings(deadline=None, derandomize=True, max_examples=15)
@given(seed=st.integers(1, 10_000), press=st.sampled_from([0.05, 0.3]))
def test_bodies_never_overlap_whatever_is_commanded(seed, press):
    hunted = engine.build(small("target.behaviour=flee", team={"robots": 7}), seed)
    draws = np.random.default_rng(seed).normal(0.0, 0.2, (7, 2))
    state = engine.initial(hunted)
    for _ in range(60):
        wanted = draws + press * (state.positions[7] - state.positions[:7])
        state, _ = engine.advance(hunted, state, wanted, [b""] * 7)
        assert overlapping(state.positions, hunted.radii, 8) == []


@pytest.mark.parametrize("heading", [-3.0, -2.07, -0.78, 0.5, 2.0])
def test_a_robot_that_pushes_after_the_target_for_long_never_overlaps_it(heading):
    hunted = arena(
        "target.behaviour=straight",
        f"target.heading_rad={heading}",
        team={"positions": [[-1.01 * cos(heading), -1.01 * sin(heading)]]},
    )
    push = np.array([[0.3 * cos(heading + 1e-5), 0.3 * sin(heading + 1e-5)]])
    for state in walked(hunted, 300, lambda _tick: push):
        assert overlapping(state.positions, hunted.radii, 2) == [], state.tick


@pytest.mark.parametrize("bearing", [0.105, 0.525, 2.0, 4.2])
@pytest.mark.parametrize("aside", [1e-6, 1e-5])
def test_a_robot_that_slides_slowly_round_the_target_for_long_never_overlaps_it(bearing, aside):
    start = [1.01 * cos(bearing), 1.01 * sin(bearing)]
    hunted = arena(team={"positions": [start]})
    inward, along = np.array([-cos(bearing), -sin(bearing)]), [-sin(bearing), cos(bearing)]
    press = np.array([0.05 * inward + aside * np.array(along)])
    for state in walked(hunted, 150, lambda _tick: press):
        assert overlapping(state.positions, hunted.radii, 2) == [], state.tick


@pytest.mark.parametrize("apart", [1e-7, 3e-7, 1e-6])
def test_robots_that_may_start_close_together_do_not_overlap_at_tick_0(apart):
    for bearing in np.linspace(0.0, pi / 2, 60):
        place = [(1 + apart) * cos(bearing), (1 + apart) * sin(bearing)]
        try:
            scenario = small(team={"positions": [place]})
        except ScenarioError:
            continue
        state = engine.initial(engine.build(scenario, 1))
        assert overlapping(state.positions, np.array([0.5, 0.5]), 2) == []


def test_robots_that_creep_up_by_less_than_a_quantum_a_tick_do_not_overlap():
    # Both are within the skin but not down to half of it, close in by less than the quantum that
    # is let pass, and are rounded towards each other: 1.505 - 0.495 becomes 2 quanta, not 1.
    quantum = 2.0**-20
    start = np.array([937_139, 470_660])
    hunted = arena(
        team={"positions": [[0.0, 0.0], (start * quantum).tolist()]},
        target={"position": [50.0, 0.0], "behaviour": "still"},
    )
    creep = [[98, 49], [1, 0], [0, 1], [1, 0]]
    commands = [[step, [0, 0]] for step in creep] + [[[1.505, 0.505], [0.495, 0.495]]]
    states = walked(hunted, 5, lambda tick: quantum * np.array(commands[tick]))
    before = states[4].positions
    assert 1.0 < hypot(*(before[1] - before[0])) < 1.0 + 3 * quantum
    assert overlapping(states[5].positions, hunted.radii, 3) == []
