"""Errors of robots' own positions: their law against theory, and what they leave as it is."""

import numpy as np
import pytest
from helpers_world import arena, frozen, small
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from encircle.protocol.messages import QUANTUM_M
from encircle.world.arena import engine

ALPHA = 1e-3
STILL = np.zeros((4, 2))
NOISE, DRIFT = "sensing.localisation_noise_m_std", "sensing.localisation_drift_m_per_sqrt_s"
PACKETS = [b"a", b"b", b"c", b"d"]


def seen(hunted, ticks, steps=STILL):
    """The observations of some ticks, T times N, and the states."""
    states, observations = [engine.initial(hunted)], []
    for _ in range(ticks):
        observations.append(engine.observe(hunted, states[-1]))
        states.append(engine.advance(hunted, states[-1], steps, PACKETS)[0])
    return observations, states[:-1]


def own_errors(hunted, ticks):
    """(T, N, 2) told less true positions of the robots."""
    observations, states = seen(hunted, ticks)
    count = len(hunted.ids)
    told = np.array([[o.position for o in row] for row in observations])
    return told - np.array([state.positions[:count] for state in states])


def increments(*overrides, ticks=1500, seed=1):
    """(T - 1, N, 2) what the errors change by from tick to tick."""
    hunted = engine.build(small(*overrides), seed)
    errors = own_errors(hunted, ticks)
    assert (errors[0] == 0.0).all()
    return np.diff(errors, axis=0)


def check_white(errors, std):
    """Errors (T, N, 2) are normal, and independent by axis, robot and tick."""
    count = len(errors)
    series = errors.reshape(count, -1).T
    assert stats.kstest(errors.ravel(), stats.norm(0, std).cdf).pvalue > ALPHA
    spread = (errors.ravel() / std) ** 2
    assert ALPHA < stats.chi2.sf(spread.sum(), len(spread)) < 1 - ALPHA
    pairs = np.triu_indices(len(series), 1)
    bound = stats.norm.isf(ALPHA / 2 / (len(pairs[0]) + len(series))) / count**0.5
    assert abs(np.corrcoef(series)[pairs]).max() < bound
    assert max(abs(np.corrcoef(s[1:], s[:-1])[0, 1]) for s in series) < bound


@pytest.mark.parametrize("std", [0.05, 0.8])
def test_noise_is_normal_and_independent_by_axis_robot_and_tick(std):
    check_white(own_errors(arena(f"{NOISE}={std}"), 1500), std)


@pytest.mark.parametrize(("drift", "tick_s"), [(0.1, 0.1), (0.5, 2.0)])
def test_drift_is_a_random_walk_with_independent_normal_steps(drift, tick_s):
    check_white(increments(f"{DRIFT}={drift}", f"tick_s={tick_s}"), drift * tick_s**0.5)


def test_drift_grows_with_the_square_root_of_time_whatever_a_tick_is():
    """Many walks: at time t each axis has the variance drift^2 t (a Wiener process)."""
    drift, count = 0.2, 60
    for tick_s, ticks in ((0.1, 41), (0.4, 11)):
        walks = [
            own_errors(engine.build(small(f"{DRIFT}={drift}", f"tick_s={tick_s}"), seed), ticks)
            for seed in range(count)
        ]
        for share in (0.25, 1.0):
            tick = round(share * (ticks - 1))
            ends = np.array([walk[tick] for walk in walks]).ravel() / (
                drift * (tick * tick_s) ** 0.5
            )
            assert stats.kstest(ends, "norm").pvalue > ALPHA
            assert ALPHA < stats.chi2.sf((ends**2).sum(), len(ends)) < 1 - ALPHA


def test_both_together_are_the_sum_of_each_alone():
    noise, drift, both = (
        own_errors(arena(*changes), 50)
        for changes in (
            [f"{NOISE}=0.3"],
            [f"{DRIFT}=0.4"],
            [f"{NOISE}=0.3", f"{DRIFT}=0.4"],
        )
    )
    np.testing.assert_allclose(noise + drift, both, rtol=0.0, atol=2 * QUANTUM_M)


def test_more_is_the_same_larger_and_a_larger_team_changes_nobodys():
    for key in (NOISE, DRIFT):
        few, large = (own_errors(arena(f"{key}={size}"), 20) for size in (0.1, 0.4))
        np.testing.assert_allclose(large, 4 * few, rtol=0.0, atol=8 * QUANTUM_M)
        pair = arena(f"{key}=0.1", team={"positions": [[4.0, 0.0], [0.0, 4.0]]})
        states = [engine.initial(pair)]
        for _ in range(4):
            states.append(engine.advance(pair, states[-1], STILL[:2], PACKETS[:2])[0])
        told = np.array([[o.position for o in engine.observe(pair, s)] for s in states])
        np.testing.assert_array_equal(told - states[0].positions[:2], few[:5, :2])


def test_errors_go_on_while_a_robot_is_lost():
    """They are of a robot and a tick, not of what it has been asked."""
    hunted = arena(f"{DRIFT}=0.3", f"{NOISE}=0.1")
    lost = np.array([False, True, False, False])
    states = [engine.initial(hunted), engine.initial(hunted)]
    for _ in range(6):
        states = [
            engine.advance(hunted, states[0], STILL, PACKETS)[0],
            engine.advance(hunted, states[1], STILL, [b"a", None, b"c", b"d"], lost=lost)[0],
        ]
    always, back = (engine.observe(hunted, state) for state in states)
    assert [o.position for o in always] == [o.position for o in back]


@given(
    st.floats(0.0, 2.0),
    st.floats(0.0, 2.0),
    st.integers(0, 2**32),
    st.integers(1, 8),
)
def test_what_lies_between_things_is_told_as_it_is(noise, drift, seed, ticks):
    """Own position, detection and sightings are shifted by one error, to the last bit."""
    changes = ["sensing.noise_m_std=0.1", "target.behaviour=flee", "team.sensing_range_m=9"]
    exact, off = (
        seen(engine.build(small(*changes, *own), seed), ticks, np.full((4, 2), 0.1))[0][-1]
        for own in ([], [f"{NOISE}={noise}", f"{DRIFT}={drift}"])
    )
    for true, told in zip(exact, off, strict=True):
        assert len(told.seen) == len(true.seen) == 3
        shift = np.subtract(told.position, true.position)
        assert np.subtract(told.target, true.target).tolist() == shift.tolist()
        for (robot, *place), (other, *where) in zip(told.seen, true.seen, strict=True):
            assert robot == other
            assert np.subtract(place, where).tolist() == shift.tolist()
        assert (told.scan, told.heading_rad) == (true.scan, true.heading_rad)
        assert (shift / QUANTUM_M).tolist() == np.rint(shift / QUANTUM_M).tolist()


def test_without_errors_observations_are_those_of_before_to_the_last_bit():
    changes = ("sensing.noise_m_std=0.2", "target.behaviour=flee")
    zero = (f"{NOISE}=0.0", f"{DRIFT}=0.0")
    plain, none = (seen(arena(*changes, *own), 10) for own in ((), zero))
    assert plain[0] == none[0]
    assert [frozen(state) for state in plain[1]] == [frozen(state) for state in none[1]]


def test_truth_detection_noise_and_packets_are_what_they_were():
    changes = (
        *("sensing.noise_m_std=0.2", "target.behaviour=flee", "channel.order=kept"),
        "channel.loss={model='distance', midpoint_m=5, width_m=1}",
        "channel.delay={model='gamma', mean_s=0.3, std_s=0.3}",
    )
    fates, errors = [], []
    for own in ((), (f"{NOISE}=0.5", f"{DRIFT}=0.5")):
        hunted = arena(*changes, *own)
        state, rows = engine.initial(hunted), []
        for _ in range(30):
            observations = engine.observe(hunted, state)
            # Relative to where a robot believes to be, it measures as ever.
            errors.append([np.subtract(o.target, o.position).tolist() for o in observations])
            state, fate = engine.advance(hunted, state, STILL + 0.05, PACKETS)
            rows.append((frozen(fate), frozen(state.positions), frozen(state.channel_state)))
        fates.append(rows)
    assert fates[0] == fates[1]
    assert errors[:30] == errors[30:]
