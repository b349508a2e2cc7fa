"""Eq. 2 against numpy's variance, Eq. 3 against a search over the grid."""

from math import exp

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from encircle.agents.planning.prediction_step import best_step, deviation_weights, variances

CHEAP = settings(max_examples=100, deadline=None, derandomize=True)
GRID = (0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
distances_of = arrays(
    float, st.tuples(st.integers(1, 7), st.integers(1, 9)), elements=st.floats(0.0, 50.0)
)


@CHEAP
@given(distances_of)
def test_v_is_the_variance_of_the_distances(distances):
    np.testing.assert_allclose(variances(distances), np.var(distances, axis=1), atol=1e-12)


@CHEAP
@given(distances_of, st.floats(0.0, 1.0))
def test_xi_star_minimises_the_weighted_variance(distances, weight):
    grid = GRID[: len(distances)]
    weighted = [
        exp(weight * xi) * float(np.var(row)) for xi, row in zip(grid, distances, strict=True)
    ]
    assert weighted[best_step(distances, grid, weight)] == pytest.approx(min(weighted), abs=1e-12)


def test_weights_are_the_papers():
    expected = [1.0, 1.051271, 1.105171, 1.161834, 1.221403, 1.284025, 1.349859]
    np.testing.assert_allclose(deviation_weights(GRID, 0.05), expected, atol=1e-6)


def test_of_equal_steps_the_smallest_is_taken():
    even = np.full((7, 4), 3.0)
    assert best_step(even, GRID, 0.05) == 0
    uneven = np.tile([1.0, 2.0, 3.0, 5.0], (7, 1))
    assert best_step(uneven, GRID, 0.0) == 0
    assert best_step(uneven[:3], (2.0, 4.0, 6.0), 0.0) == 0
    assert best_step(np.vstack([uneven[:2], even[:2]]), GRID[:4], 0.05) == 2


@pytest.mark.parametrize("noise_m", [-1e-13, 1e-13])
@pytest.mark.parametrize("noisy", range(7))
def test_steps_whose_variances_differ_by_rounding_noise_are_equal(noisy, noise_m):
    for row in ([1.0, 2.0, 3.0, 5.0], [3.0, 3.0, 3.0, 3.0], [30.0, 1.0, 2.0, 25.0]):
        distances = np.tile(row, (7, 1))
        distances[noisy, 1] += noise_m
        assert best_step(distances, GRID, 0.0) == 0
        # The same distances of robots in another order.
        distances[noisy] = np.roll(distances[noisy], 1 + noisy % 3)
        assert best_step(distances, GRID, 0.0) == 0


def test_a_smaller_variance_six_steps_ahead_counts_only_if_it_outweighs_the_uncertainty():
    # Variances 1 and 0.64: exp(0.05 * 6) is 1.35 and exp(0.1 * 6) is 1.82.
    near, far = [1.0, 3.0], [1.2, 2.8]
    distances = np.array([near, near, near, near, near, near, far])
    assert best_step(distances, GRID, 0.05) == 6
    assert best_step(distances, GRID, 0.1) == 0


def test_the_distances_stay_as_they_are():
    distances = np.array([[1.0, 2.0], [3.0, 7.0]])
    best_step(distances, (0.0, 1.0), 0.05)
    np.testing.assert_array_equal(distances, [[1.0, 2.0], [3.0, 7.0]])


def test_a_robot_alone_has_no_variance_and_does_not_look_ahead():
    assert best_step(np.array([[5.0], [4.0], [3.0]]), (0.0, 1.0, 2.0), 0.05) == 0
