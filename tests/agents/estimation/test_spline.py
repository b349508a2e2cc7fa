"""Extrapolation against scipy's CubicSpline fitted directly, and the published noise gains."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from encircle.agents.estimation.kalman import EMPTY_TRACK, incorporate
from encircle.agents.estimation.spline import extrapolate, extrapolation_matrix
from encircle.protocol.parameters import Parameters

CHEAP = settings(max_examples=60, deadline=None, derandomize=True)
TICK_S = 0.1
P = Parameters()
ENDS = ("natural", "not-a-knot")
XI = (0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
PUBLISHED_GAINS = {
    "not-a-knot": (10, 36, 86, 164, 280, 440),
    "natural": (2, 3, 16, 43, 90, 161),
}

grids = st.lists(st.floats(0.0, 12.0), min_size=1, max_size=8, unique=True).map(sorted).map(tuple)


@CHEAP
@given(st.integers(2, 12), st.integers(1, 5), st.sampled_from(ENDS), grids, st.randoms())
def test_the_matrix_does_what_a_spline_fitted_to_the_samples_does(count, spacing, ends, xi, random):
    samples = np.array([[random.uniform(-20, 20), random.uniform(-20, 20)] for _ in range(count)])
    times = np.arange(count) * spacing
    spline = CubicSpline(times, samples, bc_type=ends)
    expected = spline(times[-1] + np.array(xi))
    matrix = extrapolation_matrix(count, spacing, ends, xi)
    np.testing.assert_allclose(matrix @ samples, expected, rtol=1e-9, atol=1e-6)


@pytest.mark.parametrize("ends", ENDS)
def test_noise_gains_are_the_published_ones(ends):
    # The gain is the norm of a row: the standard deviation of a prediction from K = 6 samples, one
    # tick apart, with independent noise of unit standard deviation. The source gives them rounded.
    gains = np.linalg.norm(extrapolation_matrix(6, 1, ends, XI[1:]), axis=1)
    np.testing.assert_allclose(gains, PUBLISHED_GAINS[ends], atol=0.6)


@pytest.mark.parametrize("ends", ENDS)
@pytest.mark.parametrize("count", range(2, 10))
def test_a_straight_line_is_prolonged_exactly(ends, count):
    matrix = extrapolation_matrix(count, 3, ends, XI)
    line = 2.0 + 0.5 * np.arange(1 - count, 1) * 3
    np.testing.assert_allclose(matrix @ line, 2.0 + 0.5 * np.array(XI), atol=1e-9)


@pytest.mark.parametrize("count", range(4, 10))
def test_a_cubic_is_prolonged_exactly_without_a_knot_at_the_ends(count):
    times = np.arange(1 - count, 1.0)
    values = 0.1 * times**3 - times**2 + 2.0
    xi = np.array(XI)
    matrix = extrapolation_matrix(count, 1, "not-a-knot", XI)
    np.testing.assert_allclose(matrix @ values, 0.1 * xi**3 - xi**2 + 2.0, atol=1e-8)


def test_at_xi_zero_the_prediction_is_the_newest_sample():
    np.testing.assert_allclose(
        extrapolation_matrix(4, 3, "natural", (0.0,)), [[0.0, 0.0, 0.0, 1.0]], atol=1e-12
    )


def test_the_matrix_is_shared_and_therefore_cannot_be_written():
    matrix = extrapolation_matrix(4, 3, "natural", XI)
    with pytest.raises(ValueError, match="read-only"):
        matrix[0, 0] = 1.0


def track_of(path, seen, parameters=P):
    """A track of a target that was at ``path(tick)`` at the ticks in ``seen``."""
    track = EMPTY_TRACK
    for tick in range(max(seen) + 1):
        here = [(tick, 0, *path(tick))] if tick in seen else []
        track = incorporate(track, here, tick, TICK_S, parameters)
    return track


def curve(tick):
    return 0.2 * tick, 3.0 - 0.01 * tick**2


@pytest.mark.parametrize("ends", ENDS)
@pytest.mark.parametrize(("count", "spacing"), [(4, 3), (2, 1), (5, 2), (7, 4)])
def test_a_prediction_is_the_spline_through_the_latest_filtered_positions(ends, count, spacing):
    p = replace(P, spline_samples=count, spline_spacing_ticks=spacing, spline_ends=ends)
    track = track_of(curve, set(range(45)), p)
    filtered = [(entry.estimate.x, entry.estimate.y) for entry in track.entries]
    samples = np.array(filtered[::-1][::spacing][:count][::-1])
    times = np.arange(count) * spacing
    expected = CubicSpline(times, samples, bc_type=ends)(times[-1] + np.array(XI))
    predicted, how = extrapolate(track, TICK_S, p, XI)
    assert how == "spline"
    np.testing.assert_allclose(predicted, expected, atol=1e-7)


@pytest.mark.parametrize(("last", "how"), [(8, "velocity"), (9, "spline")])
def test_the_spline_is_used_as_soon_as_it_has_its_samples(last, how):
    # Four samples, three ticks apart, reach back nine ticks.
    assert extrapolate(track_of(curve, set(range(last + 1))), TICK_S, P, XI)[1] == how


@pytest.mark.parametrize("seen", [{0, 4}, {3, 4}, set(range(5))])
def test_before_that_the_filters_velocity_is_used(seen):
    track = track_of(curve, seen)
    estimate = track.estimate
    predicted, how = extrapolate(track, TICK_S, P, XI)
    expected = [
        (estimate.x + xi * TICK_S * estimate.vx, estimate.y + xi * TICK_S * estimate.vy)
        for xi in XI
    ]
    assert how == "velocity"
    np.testing.assert_allclose(predicted, expected, atol=1e-12)


def test_after_a_single_detection_the_position_is_held():
    predicted, how = extrapolate(track_of(curve, {3}), TICK_S, P, XI)
    assert how == "hold"
    np.testing.assert_array_equal(predicted, [curve(3)] * len(XI))


def test_a_steady_target_is_predicted_where_it_will_be():
    track = track_of(lambda tick: (1.0 + 0.2 * tick, -0.1 * tick), set(range(40)))
    predicted, _ = extrapolate(track, TICK_S, P, XI)
    expected = [(1.0 + 0.2 * (39 + xi), -0.1 * (39 + xi)) for xi in XI]
    np.testing.assert_allclose(predicted, expected, atol=1e-3)
