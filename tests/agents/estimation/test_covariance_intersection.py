"""Covariance intersection against a grid over w, full matrices, its theorem, and Stone Soup."""

from importlib.util import find_spec

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.agents.estimation.covariance_intersection import (
    intersection,
    product,
    weight_of_first,
)
from encircle.agents.estimation.kalman import Estimate

CHEAP = settings(max_examples=200, deadline=None, derandomize=True)
GRID = np.linspace(0.0, 1.0, 20_001)
IDENTITY = np.eye(2)


@st.composite
def covariances(draw):
    """Positive definite: standard deviations of 1 mm to 100 m (or m/s), correlation up to 0.99."""
    a, b = draw(st.floats(-3.0, 2.0)), draw(st.floats(-3.0, 2.0))
    r = draw(st.floats(-0.99, 0.99))
    return 10.0 ** (2 * a), r * 10.0 ** (a + b), 10.0 ** (2 * b)


numbers = st.floats(-20.0, 20.0)
estimates = st.builds(Estimate, numbers, numbers, numbers, numbers, covariances())


def matrix(covariance):
    p00, p01, p11 = covariance
    return np.array([[p00, p01], [p01, p11]])


def vector(estimate):
    return np.array([[estimate.x, estimate.y], [estimate.vx, estimate.vy]])


def by_formula(first, second, w1, w2):
    """Mean and covariance for given weights, by numpy on matrices."""
    a, b = (np.linalg.inv(matrix(e.covariance)) for e in (first, second))
    covariance = np.linalg.inv(w1 * a + w2 * b)
    return covariance @ (w1 * a @ vector(first) + w2 * b @ vector(second)), covariance


def determinants(first, second, weights):
    a, b = np.linalg.inv(matrix(first)), np.linalg.inv(matrix(second))
    mixed = weights[:, None, None] * a + (1.0 - weights)[:, None, None] * b
    return 1.0 / np.linalg.det(mixed)


def assert_close(estimate, mean, covariance, rtol=1e-6):
    scale = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(
        matrix(estimate.covariance) / np.outer(scale, scale),
        covariance / np.outer(scale, scale),
        atol=rtol,
    )
    np.testing.assert_allclose(vector(estimate), mean, atol=1e-5, rtol=1e-5)


@CHEAP
@given(covariances(), covariances())
def test_no_weight_on_a_grid_gives_a_smaller_determinant(first, second):
    weight = weight_of_first(first, second)
    assert 0.0 <= weight <= 1.0
    least = determinants(first, second, np.array([weight]))[0]
    assert least <= determinants(first, second, GRID).min() * (1.0 + 1e-7)


@CHEAP
@given(estimates, estimates)
def test_the_result_is_that_of_the_formula_on_matrices(first, second):
    weight = weight_of_first(first.covariance, second.covariance)
    assert_close(intersection(first, second), *by_formula(first, second, weight, 1.0 - weight))
    assert_close(product(first, second), *by_formula(first, second, 1.0, 1.0))


@CHEAP
@given(estimates, estimates)
def test_the_order_of_the_two_does_not_matter(first, second):
    there, back = intersection(first, second), intersection(second, first)
    assert_close(there, vector(back), matrix(back.covariance))


@CHEAP
@given(covariances(), covariances(), st.floats(-2.0, 2.0))
def test_the_weight_does_not_depend_on_the_unit_of_the_velocity(first, second, exponent):
    unit = 10.0**exponent
    first_in, second_in = ((p, c * unit, v * unit**2) for p, c, v in (first, second))
    weights = np.array([weight_of_first(first, second), weight_of_first(first_in, second_in)])
    one, other = determinants(first, second, weights)
    assert one == pytest.approx(other, rel=1e-7)


@CHEAP
@given(st.lists(st.floats(-3.0, 3.0), min_size=16, max_size=16))
def test_the_error_is_never_larger_than_claimed_whatever_is_correlated(entries):
    # Any joint covariance of two errors is L L'. Both estimates claim exactly their own part.
    root = np.array(entries).reshape(4, 4) + 0.01 * np.eye(4)
    joint = root @ root.T
    first, second = joint[:2, :2], joint[2:, 2:]
    if min(np.linalg.eigvalsh(first)[0], np.linalg.eigvalsh(second)[0]) < 1e-3:
        return
    covariances = [(p[0, 0], p[0, 1], p[1, 1]) for p in (first, second)]
    # Errors (1, 0) and (0, 1) of the first along x and y, and of the second, show the gains.
    gains, zero = [], Estimate(0.0, 0.0, 0.0, 0.0, covariances[0])
    for position, velocity in IDENTITY:
        fused = intersection(
            zero._replace(x=position, vx=velocity),
            Estimate(0.0, position, 0.0, velocity, covariances[1]),
        )
        gains.append([(fused.x, fused.vx), (fused.y, fused.vy)])
    gain = np.hstack(np.array(gains).transpose(1, 2, 0))
    claimed = matrix(fused.covariance)
    excess = np.linalg.eigvalsh(claimed - gain @ joint @ gain.T)[0]
    assert excess >= -1e-7 * np.trace(claimed)


def test_the_product_claims_half_of_an_error_that_both_share_and_the_intersection_all_of_it():
    shared = Estimate(1.0, 2.0, 3.0, 4.0, (0.04, 0.01, 0.5))
    assert_close(intersection(shared, shared), vector(shared), matrix(shared.covariance), 1e-12)
    halved = product(shared, shared).covariance
    assert halved == pytest.approx([value / 2 for value in shared.covariance], rel=1e-12)


def test_what_is_better_in_every_direction_is_taken_alone():
    good, bad = (0.01, 0.002, 0.5), (0.02, 0.002, 0.6)
    assert weight_of_first(good, bad) == 1.0
    assert weight_of_first(bad, good) == 0.0


def test_mirror_images_are_weighed_alike_and_the_weight_is_that_of_the_closed_form():
    # P = diag(1, s), diag(s, 1): det of the inverse's mixture is (w + (1-w)/s)(w/s + 1-w).
    assert weight_of_first((1.0, 0.0, 9.0), (9.0, 0.0, 1.0)) == pytest.approx(0.5, abs=1e-12)
    # P = diag(1, 4), diag(2, 1): (w + (1-w)/2)(w/4 + 1-w) is largest at w = 1/6.
    assert weight_of_first((1.0, 0.0, 4.0), (2.0, 0.0, 1.0)) == pytest.approx(1 / 6, abs=1e-12)


@CHEAP
@given(covariances(), st.floats(-1e-9, 1e-9), st.floats(-1e-9, 1e-9))
def test_last_bits_of_equal_covariances_do_not_decide_the_weight(covariance, more, less):
    p00, p01, p11 = covariance
    if p01 * p01 > 0.5 * p00 * p11:
        return
    assert weight_of_first(covariance, (p00 * (1.0 + more), p01, p11 * (1.0 + less))) == 0.5


def test_two_steps_apart_in_position_meet_between_by_weight():
    # Scalar closed form: equal covariances, so w = 1/2, and the mean is the middle.
    first = Estimate(0.0, 0.0, 0.0, 0.0, (0.5, 0.0, 2.0))
    second = Estimate(2.0, -4.0, 1.0, 0.0, (0.5, 0.0, 2.0))
    assert intersection(first, second)[:4] == pytest.approx((1.0, -2.0, 0.5, 0.0), abs=1e-12)


@pytest.mark.skipif(
    find_spec("stonesoup") is None,
    reason="Stone Soup, an oracle from outside, is no dependency and not installed",
)
@settings(max_examples=60, deadline=None, derandomize=True)
@given(estimates, estimates)
def test_stone_soup_fuses_the_same(first, second):
    from stonesoup.models.measurement.linear import LinearGaussian
    from stonesoup.types.detection import GaussianDetection
    from stonesoup.types.hypothesis import SingleHypothesis
    from stonesoup.types.prediction import GaussianStatePrediction
    from stonesoup.updater.chernoff import ChernoffUpdater

    weight = weight_of_first(first.covariance, second.covariance)
    if not 0.001 < weight < 0.999:
        return
    whole = [np.kron(matrix(e.covariance), IDENTITY) for e in (first, second)]
    # One scale for all: Stone Soup inverts by the pseudoinverse, which cuts off small eigenvalues.
    scale = np.diag(1.0 / np.sqrt(np.diag(whole[0])))
    means = [scale @ vector(e).reshape(4, 1) for e in (first, second)]
    whole = [scale @ covariance @ scale for covariance in whole]
    model = LinearGaussian(ndim_state=4, mapping=(0, 1, 2, 3), noise_covar=whole[0])
    heard = GaussianDetection(means[0], covar=whole[0], measurement_model=model)
    updater = ChernoffUpdater(measurement_model=model, omega=weight)
    update = updater.update(SingleHypothesis(GaussianStatePrediction(means[1], whole[1]), heard))
    fused = intersection(first, second)
    mine = scale @ np.kron(matrix(fused.covariance), IDENTITY) @ scale
    np.testing.assert_allclose(mine, update.covar, atol=1e-6 * np.trace(mine))
    spread = 1.0 + max(float(np.abs(mean).max()) for mean in means)
    np.testing.assert_allclose(
        scale @ vector(fused).reshape(4, 1), update.state_vector, atol=1e-6 * spread
    )
