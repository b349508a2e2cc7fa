"""Measures of belief against closed forms, full matrices, scipy's chi-square and filter theory."""

from math import isnan, sqrt

import numpy as np
import pytest
from helpers_measures import SQUARE, scenario, standing
from scipy.stats import chi2

from encircle.agents.estimation import kalman
from encircle.measures import belief
from encircle.protocol.parameters import Parameters

TICK_S = 0.1
NOBODY = (np.nan, np.nan)


def test_who_knows_the_truth_is_never_wrong():
    log = standing(6)
    assert belief.peer_error_m_mean(log) == belief.peer_error_m_rms(log) == 0.0
    assert belief.peer_error_m_p95(log) == belief.target_error_m_rms(log) == 0.0
    assert belief.peer_missing_share(log) == belief.estimate_missing_share(log) == 0.0


def test_errors_of_peers_are_over_robots_peers_and_ticks_but_not_of_oneself():
    believed = standing(5).believed
    believed[:, 0, 2] += (3.0, 4.0)
    believed[:, 1, 1] += (100.0, 0.0)
    log = standing(5, believed=believed)
    assert belief.peer_errors_m(log).shape == (5 * 12,)
    assert belief.peer_error_m_mean(log) == pytest.approx(5.0 / 12)
    assert belief.peer_error_m_rms(log) == pytest.approx(5.0 / sqrt(12))
    assert belief.peer_error_m_p95(log) == pytest.approx(5.0)


def test_peers_left_out_of_a_team_are_missing_not_wrong():
    believed = standing(4).believed
    believed[:, 0, 1:] += (0.0, 2.0)
    believed[:2, 0, 2] = NOBODY
    log = standing(4, believed=believed)
    assert belief.peer_missing_share(log) == pytest.approx(2 / 48)
    assert belief.peer_error_m_mean(log) == pytest.approx(2.0 * 10 / 46)


def test_peers_are_compared_with_where_they_are_at_the_tick_of_the_decision():
    places = np.tile(np.array([*SQUARE, (0.0, 0.0)]), (3, 1, 1))
    places[:, 0, 0] += [0.0, 0.25, 0.5]
    log = standing(2, positions=places)
    # The others take the first robot to stand still: wrong by 0 at tick 0 and 0.25 at tick 1.
    assert belief.peer_error_m_mean(log) == pytest.approx(3 * 0.25 / 24)


def test_one_robot_has_no_peers():
    log = standing(3, 1)
    assert isnan(belief.peer_error_m_mean(log))
    assert isnan(belief.peer_error_m_p95(log))
    assert isnan(belief.peer_error_m_rms(log))
    assert isnan(belief.peer_missing_share(log))


def test_the_error_of_the_estimate_is_over_those_who_have_one():
    estimates = standing(8).estimates
    estimates[:, :2, :2] = (3.0, 4.0)
    estimates[:4, 3] = np.nan
    log = standing(8, estimates=estimates)
    assert belief.estimate_missing_share(log) == pytest.approx(4 / 32)
    assert belief.target_error_m_rms(log) == pytest.approx(5.0 * sqrt(16 / 28))


def test_without_any_estimate_there_is_no_error():
    log = standing(3, estimates=np.nan)
    assert isnan(belief.target_error_m_rms(log))
    assert isnan(belief.nees_mean(log))
    assert isnan(belief.nees_in_band_share(log))
    assert belief.estimate_missing_share(log) == 1.0


def test_the_velocity_is_the_displacement_since_the_tick_before():
    moved = scenario(4, events=[{"kind": "move-target", "tick": 2, "position": [50.0, 0.0]}])
    positions = standing(4).positions
    positions[:, 4] = [(0.0, 0.0), (0.3, 0.0), (50.0, 0.0), (50.0, -0.2), (50.0, -0.2)]
    found = belief.target_velocity_mps(standing(4, positions=positions, scenario=moved))
    expected = [NOBODY, (3.0, 0.0), NOBODY, (0.0, -2.0)]
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_the_band_is_that_of_chi_square_with_four_degrees_of_freedom():
    assert chi2(4).ppf([0.025, 0.975]) == pytest.approx(belief.NEES_BAND, rel=1e-12)


def test_nees_is_the_quadratic_form_of_the_whole_inverse_covariance():
    rng = np.random.default_rng(11)
    ticks = 30
    target = rng.uniform(-1.0, 1.0, (ticks + 1, 2)).cumsum(axis=0)
    estimates = rng.uniform(-2.0, 2.0, (ticks, 4, 4))
    roots = np.tril(rng.uniform(0.2, 1.5, (ticks, 4, 2, 2)))
    blocks = roots @ roots.swapaxes(-1, -2)
    positions = standing(ticks).positions
    positions[:, 4] = target
    covariances = blocks[..., [0, 0, 1], [0, 1, 1]]
    log = standing(ticks, positions=positions, estimates=estimates, covariances=covariances)
    expected = []
    for tick in range(1, ticks):
        truth = np.array([*target[tick], *(target[tick] - target[tick - 1]) / TICK_S])
        for robot in range(4):
            whole = np.kron(blocks[tick, robot], np.eye(2))  # x, y, vx, vy
            off = estimates[tick, robot] - truth
            expected.append(off @ np.linalg.solve(whole, off))
    np.testing.assert_allclose(belief.nees(log), expected, rtol=1e-9)
    assert belief.nees_mean(log) == pytest.approx(np.mean(expected))


@pytest.mark.parametrize("honesty", [1.0, 2.0])
def test_errors_drawn_from_the_claimed_covariance_give_four_and_those_twice_as_large_sixteen(
    honesty,
):
    # The mean of n chi-square values with 4 degrees of freedom has a standard error of sqrt(8 / n);
    # six of them, and of the share's, are a false alarm in 10^8 seeds.
    ticks, rng = 2000, np.random.default_rng(7)
    positions = standing(ticks).positions
    positions[:, 4] = np.arange(ticks + 1)[:, None] * (0.125, -0.25)
    root = np.array([[0.2, 0.0], [0.5, 0.9]])
    claimed = root @ root.T
    off = honesty * np.einsum("ij,tnaj->tnia", root, rng.standard_normal((ticks, 4, 2, 2)))
    truth = np.concatenate([positions[:-1, 4], np.tile((1.25, -2.5), (ticks, 1))], axis=1)
    log = standing(
        ticks,
        positions=positions,
        estimates=truth[:, None] + off.reshape(ticks, 4, 4),
        covariances=claimed[[0, 0, 1], [0, 1, 1]],
    )
    count = 4 * (ticks - 1)
    error = 6 * honesty**2 * sqrt(8 / count)
    assert belief.nees_mean(log) == pytest.approx(4.0 * honesty**2, abs=error)
    low, high = chi2(4).ppf([0.025, 0.975]) / honesty**2
    share = chi2(4).cdf(high) - chi2(4).cdf(low)
    error = 6 * sqrt(share * (1 - share) / count)
    assert belief.nees_in_band_share(log) == pytest.approx(share, abs=error)


@pytest.mark.parametrize("claimed", [1.0, 0.25])
def test_the_robots_filter_is_consistent_if_told_the_true_noise_and_not_if_told_a_quarter(claimed):
    # Values at successive ticks are correlated over some ten of them: 300 or more independent ones,
    # a standard error of at most sqrt(8 / 300), six of which are a false alarm in 10^8 seeds. The
    # displacement differs from the velocity by half an acceleration times a tick, a sixth of the
    # filter's own velocity error: 0.1 is ample for that.
    ticks, noise_m, rng = 3000, 0.05, np.random.default_rng(2)
    told = Parameters(measurement_m_std=claimed * noise_m, acceleration_mps2_std=0.5)
    velocity = rng.normal(0.0, told.velocity_mps_std, 2)
    place, track = np.zeros(2), kalman.EMPTY_TRACK
    target, rows = [], []
    for tick in range(ticks + 1):
        target.append(place)
        seen = place + rng.normal(0.0, noise_m, 2)
        track = kalman.incorporate(track, [(tick, 0, *seen.tolist())], tick, TICK_S, told)
        rows.append((*track.estimate[:4], *track.estimate.covariance))
        acceleration = rng.normal(0.0, 0.5, 2)
        place = place + TICK_S * velocity + TICK_S**2 / 2 * acceleration
        velocity = velocity + TICK_S * acceleration
    positions = standing(ticks, 1).positions
    positions[:, 1] = target
    rows = np.array(rows[:-1])[:, None]
    log = standing(
        ticks, 1, positions=positions, estimates=rows[..., :4], covariances=rows[..., 4:]
    )
    if claimed == 1.0:
        assert belief.nees_mean(log) == pytest.approx(4.0, abs=6 * sqrt(8 / 300) + 0.1)
        assert belief.nees_in_band_share(log) == pytest.approx(0.95, abs=0.05)
    else:
        assert belief.nees_mean(log) > 10.0
        assert belief.nees_in_band_share(log) < 0.7
