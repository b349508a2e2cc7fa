"""Starts: the given ones moved about by seed, never onto each other; random ones elsewhere."""

from itertools import combinations

import numpy as np
import pytest
from helpers_world import SQUARE, overlapping, small
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from encircle.world.arena import engine
from encircle.world.arena.placement import starts
from encircle.world.loading.load import load
from encircle.world.scenario.errors import ScenarioError

ALPHA = 1e-6


def moved(jitter_m, seed, positions=SQUARE):
    scenario = small(f"team.jitter_m={jitter_m}", team={"positions": positions})
    return np.array(starts(scenario, seed)) - np.array(positions)


def test_starts_are_uniform_within_their_jitter_and_independent_along_both_axes():
    scenario = small("team.jitter_m=0.5")
    drawn = np.array([np.subtract(starts(scenario, seed), SQUARE).ravel() for seed in range(2000)])
    law = stats.uniform(-0.5, 1.0)
    assert min(stats.kstest(column, law.cdf).pvalue for column in drawn.T) > ALPHA / 8
    assert stats.kstest(drawn.ravel(), law.cdf).pvalue > ALPHA
    assert 0.499 < abs(drawn).max() <= 0.5
    bound = stats.norm.isf(ALPHA / 2 / 28) / 2000**0.5
    assert abs(np.corrcoef(drawn.T)[np.triu_indices(8, 1)]).max() < bound


def test_without_jitter_starts_are_those_given_whatever_the_seed():
    for seed in (1, 2):
        assert (moved(0.0, seed) == 0.0).all()
        arena = engine.build(small(), seed)
        assert engine.initial(arena).positions[:4].tolist() == [list(p) for p in SQUARE]


def test_a_robots_start_does_not_depend_on_the_rest_of_the_team():
    assert (moved(0.3, 5)[:2] == moved(0.3, 5, SQUARE[:2])).all()
    np.testing.assert_allclose(moved(0.6, 5), 2 * moved(0.3, 5), atol=1e-12)
    assert (moved(0.3, 5) != moved(0.3, 6)).all()


def test_the_arena_begins_at_the_moved_starts_in_whole_quanta():
    scenario = small("team.jitter_m=0.3")
    state = engine.initial(engine.build(scenario, 9))
    np.testing.assert_allclose(state.positions[:4], starts(scenario, 9), atol=2.0**-20)
    assert (state.positions * 2**20 == np.rint(state.positions * 2**20)).all()


PLACES = st.tuples(st.floats(-4.0, 4.0), st.floats(-4.0, 4.0))


@settings(deadline=None, derandomize=True, max_examples=80)
@given(positions=st.lists(PLACES, min_size=1, max_size=3), jitter_m=st.floats(0.01, 0.6))
def test_starts_that_could_overlap_are_refused_and_others_never_do(positions, jitter_m):
    disc = [{"position": [-3.0, 0.0], "radius_m": 0.7}]
    tree = {"team": {"positions": positions}, "obstacles": disc}
    # By the corners: two squares of side 2 jitter around the places are this near at the nearest.
    bodies = [(p, 0.5, jitter_m) for p in positions]
    fixed = [((0.0, 0.0), 0.5, 0.0), ((-3.0, 0.0), 0.7, 0.0)]
    pairs = [*combinations(bodies, 2), *((b, f) for b in bodies for f in fixed)]
    nearest = []
    for ((x, y), radius, mine), ((ox, oy), other, theirs) in pairs:
        grid = np.linspace(-(mine + theirs), mine + theirs, 41)
        away = np.hypot(x - ox + grid[:, None], y - oy + grid)
        nearest.append(away.min() - radius - other)
    try:
        scenario = load(tree, [f"team.jitter_m={jitter_m!r}"])
    except ScenarioError as error:
        # The grid of displacements is within a fortieth of the reach of the nearest one.
        assert min(nearest) < 1.2 * jitter_m / 10 + 2e-4
        assert "overlap" in str(error)  # noqa: PT017
        return
    assert min(nearest) > 0.0
    for seed in range(5):
        arena = engine.build(scenario, seed)
        state = engine.initial(arena)
        assert overlapping(state.positions, arena.radii, len(positions) + 1) == []


def test_two_robots_can_come_nearer_by_twice_their_jitter():
    tree = {"team": {"positions": [[3.0, 0.0], [5.0, 0.0]]}}
    assert load(tree, ["team.jitter_m=0.49"]).ids
    with pytest.raises(ScenarioError, match=r"team\.positions\.1 .* team\.positions\.0"):
        load(tree, ["team.jitter_m=0.5"])


def test_the_refusal_names_jitter_and_both_places():
    tree = {"team": {"positions": [[1.5, 0.0]]}}
    assert load(tree, ["team.jitter_m=0.49"]).ids
    with pytest.raises(ScenarioError) as caught:
        load(tree, ["team.jitter_m=0.5"])
    said = str(caught.value)
    parts = ("team.jitter_m = 0.5", "team.positions.0 = (1.5, 0.0)", "target.position = (0.0, 0.0)")
    assert all(part in said for part in parts)
    assert "one problem" in said
