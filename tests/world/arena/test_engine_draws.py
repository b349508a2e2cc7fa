"""What is drawn in the arena, noise and starts, and that nothing else decides a step."""

import random
from math import dist

import numpy as np
import pytest
from helpers_world import arena, frozen, small
from scipy import stats

from encircle.world.arena import engine
from encircle.world.scenario.errors import ScenarioError

ALPHA = 1e-3
LIVELY = (
    "target.behaviour=flee",
    "sensing.noise_m_std=0.2",
    "team.motion=unicycle",
    "channel.order=kept",
    "channel.delay={model='gamma', mean_s=0.3, std_s=0.3}",
    "channel.loss={model='gilbert-elliott', good_to_bad=0.2, bad_to_good=0.4}",
)
STEPS = np.random.default_rng(3).normal(0.0, 0.3, (40, 4, 2))


def detections(hunted, ticks):
    """(T, N, 2) errors of what the robots take the target's position to be."""
    state, found = engine.initial(hunted), []
    for _ in range(ticks):
        found.append([o.target for o in engine.observe(hunted, state)])
        state, _ = engine.advance(hunted, state, np.zeros((len(hunted.ids), 2)), [b""] * 4)
    return np.array(found) - state.positions[len(hunted.ids)]


@pytest.mark.parametrize("std", [0.05, 0.8])
def test_detection_noise_is_normal_and_independent_by_axis_robot_and_tick(std):
    errors = detections(arena(f"sensing.noise_m_std={std}"), 1500)
    assert stats.kstest(errors.ravel(), stats.norm(0, std).cdf).pvalue > ALPHA
    series = errors.reshape(1500, 8).T
    assert all(stats.kstest(s, stats.norm(0, std).cdf).pvalue > ALPHA / 8 for s in series)
    bound = stats.norm.isf(ALPHA / 2 / 36) / 1500**0.5
    assert abs(np.corrcoef(series)[np.triu_indices(8, 1)]).max() < bound
    assert max(abs(np.corrcoef(s[1:], s[:-1])[0, 1]) for s in series) < bound
    spread = (errors.ravel() / std) ** 2
    assert ALPHA < stats.chi2.sf(spread.sum(), len(spread)) < 1 - ALPHA


def test_without_noise_detections_are_exact():
    assert (detections(arena(), 5) == 0.0).all()


def test_more_noise_is_the_same_noise_larger_and_another_robot_changes_nobodys():
    small_noise, large = (detections(arena(f"sensing.noise_m_std={s}"), 20) for s in (0.1, 0.4))
    np.testing.assert_allclose(large, 4 * small_noise, atol=1e-5)
    few, many = (
        engine.observe(hunted, engine.initial(hunted))
        for hunted in (
            arena("sensing.noise_m_std=0.1", team={"positions": [[4.0, 0.0], [0.0, 4.0]]}),
            arena("sensing.noise_m_std=0.1"),
        )
    )
    assert [o.target for o in many[:2]] == [o.target for o in few]


def run(seed=1, changes=LIVELY):
    hunted = engine.build(small(*changes), seed)
    states = [engine.initial(hunted)]
    fates = []
    for tick in range(40):
        state, fate = engine.advance(
            hunted, states[-1], STEPS[tick], [bytes([tick, k]) for k in range(4)]
        )
        states.append(state)
        fates.append(fate)
    seen = [engine.observe(hunted, state) for state in states]
    return [frozen(state) for state in states], frozen(fates), seen


def test_a_run_depends_on_nothing_but_its_arguments():
    random.seed(1)
    np.random.seed(1)
    globals_before = (random.getstate(), np.random.get_state()[1].tobytes())
    first = run()
    assert (random.getstate(), np.random.get_state()[1].tobytes()) == globals_before
    random.seed(2)
    np.random.seed(2)
    run(seed=2)
    assert run() == first
    assert run(seed=2) != first


def test_a_step_and_an_observation_leave_state_arena_and_commands_as_they_were():
    hunted = arena(*LIVELY, obstacles=[{"position": [2.0, 2.0], "radius_m": 0.5}])
    state = engine.initial(hunted)
    for tick in range(30):
        arrays = (hunted.radii, hunted.ranges, hunted.step_m_max, STEPS[tick], *hunted.channel)
        before = (frozen(state), frozen(arrays))
        engine.observe(hunted, state)
        engine.truth(hunted, state)
        after, _ = engine.advance(hunted, state, STEPS[tick], [b"a", b"b", b"c", b"d"])
        again, _ = engine.advance(hunted, state, STEPS[tick], [b"a", b"b", b"c", b"d"])
        assert (frozen(state), frozen(arrays)) == before
        assert frozen(after) == frozen(again)
        state = after


def starts(seed=1, robots=5, **changes):
    scenario = small(team={"robots": robots, **changes}, target={"position": [3.0, -2.0]})
    return engine.initial(engine.build(scenario, seed)).positions[:robots].tolist()


def test_random_starts_lie_in_the_annulus_and_apart():
    ring = {"placement": {"distance_m_min": 3.0, "distance_m_max": 4.0}}
    for seed in range(1, 30):
        places = starts(seed, **ring)
        assert all(2.999 <= dist(p, (3.0, -2.0)) <= 4.001 for p in places)
        assert all(dist(p, q) > 1.0 for p in places for q in places if p is not q)


def test_random_starts_are_uniform_over_the_annulus():
    ring = {"placement": {"distance_m_min": 2.0, "distance_m_max": 10.0}}
    places = np.array([starts(seed, 1, **ring)[0] for seed in range(600)]) - [3.0, -2.0]
    # Uniform by area: the square of the distance is uniform.
    squared = (np.hypot(*places.T) ** 2 - 4.0) / 96.0
    bearing = np.arctan2(places[:, 1], places[:, 0]) / (2 * np.pi) + 0.5
    assert stats.kstest(squared, "uniform").pvalue > ALPHA
    assert stats.kstest(bearing, "uniform").pvalue > ALPHA


def test_a_larger_team_starts_with_the_smaller_ones_places_and_another_seed_elsewhere():
    assert starts(1, 8)[:5] == starts(1, 5)
    assert starts(2, 5) != starts(1, 5)


def test_a_team_for_which_there_is_no_room_is_refused():
    ring = {"placement": {"distance_m_min": 2.0, "distance_m_max": 2.5}}
    with pytest.raises(ScenarioError, match="no room for r"):
        starts(1, 40, **ring)
