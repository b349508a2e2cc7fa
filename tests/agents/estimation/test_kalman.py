"""The track against filterpy's KalmanFilter, run on the full state with everything in order.

The oracle keeps x, y and both velocities in one 4-state filter and updates once per detection; the
track keeps one 2 x 2 covariance, folds a tick's detections into one, and gets them late, shuffled
and more than once.
"""

from dataclasses import replace
from math import nan

import numpy as np
import pytest
from filterpy.common import Q_discrete_white_noise
from filterpy.kalman import KalmanFilter, predict, update
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import block_diag

from encircle.agents.estimation.kalman import (
    EMPTY_TRACK,
    coast_to,
    covariance_step,
    incorporate,
    next_estimate,
)
from encircle.protocol.parameters import Parameters

CHEAP = settings(max_examples=40, deadline=None, derandomize=True)
TICK_S = 0.1
P = Parameters()
coordinates = st.floats(-50.0, 50.0).map(lambda x: round(x, 6))


def reference(detections, last_tick, parameters=P):
    """Mean (x, vx, y, vy) and 4 x 4 covariance at ``last_tick`` by the textbook filter."""
    by_tick = {}
    for detection in sorted(set(detections)):
        by_tick.setdefault(detection[0], []).append(detection)
    start = min(by_tick)
    kf = KalmanFilter(dim_x=4, dim_z=2)
    axis = np.array([[1.0, TICK_S], [0.0, 1.0]])
    kf.F = block_diag(axis, axis)
    noise = Q_discrete_white_noise(2, TICK_S, parameters.acceleration_mps2_std**2)
    kf.Q = block_diag(noise, noise)
    kf.H = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]])
    variance = parameters.measurement_m_std**2
    kf.R = variance * np.eye(2)
    _, _, x, y = by_tick[start].pop(0)
    kf.x = np.array([x, 0.0, y, 0.0])
    kf.P = np.diag([variance, parameters.velocity_mps_std**2] * 2)
    for tick in range(start, last_tick + 1):
        if tick > start:
            kf.predict()
        for _, _, x, y in by_tick.get(tick, ()):
            kf.update(np.array([x, y]))
    return kf.x, kf.P


def assert_same(estimate, expected):
    mean, covariance = expected
    assert (estimate.x, estimate.vx, estimate.y, estimate.vy) == pytest.approx(
        mean, rel=1e-6, abs=1e-6
    )
    p00, p01, p11 = estimate.covariance
    axis = np.array([[p00, p01], [p01, p11]])
    np.testing.assert_allclose(block_diag(axis, axis), covariance, rtol=1e-6, atol=1e-8)


def folded(arrivals, last_tick, parameters=P):
    """The track after folding ``(arrival tick, detection)`` tick by tick, in the order given."""
    track = EMPTY_TRACK
    for tick in range(last_tick + 1):
        now = [detection for arrival, detection in arrivals if arrival == tick]
        track = incorporate(track, now, tick, TICK_S, parameters)
    return track


@st.composite
def hunts(draw, last_tick, late_max):
    """Detections and their arrivals: late, shuffled, some twice. Nobody is silent for long."""
    places = st.tuples(coordinates, coordinates)
    seen = {(tick, 0): draw(places) for tick in range(draw(st.integers(0, 9)), last_tick, 10)}
    others = st.tuples(st.integers(0, last_tick), st.integers(0, 3))
    for key in draw(st.lists(others, max_size=25)):
        seen.setdefault(key, draw(places))
    detections = [(*key, *place) for key, place in seen.items()]
    arrivals = []
    for detection in detections:
        delays = st.integers(0, min(late_max, last_tick - detection[0]))
        arrivals += [
            (detection[0] + d, detection) for d in draw(st.lists(delays, min_size=1, max_size=3))
        ]
    return detections, draw(st.permutations(arrivals))


@CHEAP
@given(hunts(25, 0))
def test_detections_in_order_give_what_filterpys_filter_gives(hunt):
    detections, arrivals = hunt
    assert_same(folded(arrivals, 25).estimate, reference(detections, 25))


@CHEAP
@given(
    counts=st.lists(st.integers(0, 8), min_size=1, max_size=40),
    tick_s=st.sampled_from([0.02, 0.1, 1.0]),
    acceleration_mps2_std=st.sampled_from([0.1, 4.0, 30.0]),
    measurement_m_std=st.sampled_from([0.02, 0.3]),
)
def test_covariance_and_gain_are_those_of_filterpys_predict_and_update(
    counts, tick_s, acceleration_mps2_std, measurement_m_std
):
    """The gain is read off filterpy's update as its answer to a unit innovation from zero."""
    transition, position_of = np.array([[1.0, tick_s], [0.0, 1.0]]), np.array([[1.0, 0.0]])
    noise = Q_discrete_white_noise(2, tick_s, acceleration_mps2_std**2)
    mean, covariance = np.zeros(2), (measurement_m_std**2, 0.0, 4.0)
    for count in counts:
        p00, p01, p11 = covariance
        _, expected = predict(mean, np.array([[p00, p01], [p01, p11]]), transition, noise)
        gain = mean
        if count:
            variance = np.array([[measurement_m_std**2 / count]])
            gain, expected = update(mean, expected, 1.0, variance, position_of)
        covariance, *gains = covariance_step(
            covariance, count, tick_s, acceleration_mps2_std, measurement_m_std
        )
        assert gains == pytest.approx(list(gain), rel=1e-11, abs=1e-14)
        found = [[covariance[0], covariance[1]], [covariance[1], covariance[2]]]
        np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-12)


@CHEAP
@given(hunts(28, 28))
def test_detections_late_shuffled_and_repeated_give_the_same_as_in_order(hunt):
    detections, arrivals = hunt
    assert_same(folded(arrivals, 28).estimate, reference(detections, 28))


@CHEAP
@given(hunts(90, 20))
def test_the_same_holds_when_the_window_has_moved_on(hunt):
    detections, arrivals = hunt
    track = folded(arrivals, 90)
    assert len(track.entries) == P.window_ticks
    assert track.dropped == 0
    assert_same(track.estimate, reference(detections, 90))


@CHEAP
@given(hunts(28, 28))
def test_the_track_is_the_same_to_the_last_bit_whatever_the_order_of_arrival(hunt):
    detections, arrivals = hunt
    in_order = [(detection[0], detection) for detection in sorted(detections)]
    assert folded(arrivals, 28) == folded(in_order, 28)
    assert folded(arrivals[::-1], 28) == folded(in_order, 28)


@pytest.mark.parametrize("count", [1, 2, 5])
def test_first_detections_give_their_mean_and_the_prior_velocity(count):
    arrivals = [(0, (0, origin, float(origin), 2.0)) for origin in range(count)]
    estimate = folded(arrivals, 0).estimate
    assert (estimate.x, estimate.y) == pytest.approx(((count - 1) / 2, 2.0))
    assert (estimate.vx, estimate.vy) == (0.0, 0.0)
    assert estimate.covariance == pytest.approx((0.05**2 / count, 0.0, 9.0))


def test_a_target_at_constant_velocity_is_found_to_move_so():
    arrivals = [(t, (t, 0, 1.0 + 0.2 * t, 2.0 - 0.1 * t)) for t in range(25)]
    estimate = folded(arrivals, 29).estimate
    assert (estimate.vx, estimate.vy) == pytest.approx((2.0, -1.0), abs=1e-3)
    assert (estimate.x, estimate.y) == pytest.approx((1.0 + 0.2 * 29, 2.0 - 0.1 * 29), abs=1e-2)


@pytest.mark.parametrize(("late", "kept"), [(P.window_ticks - 1, True), (P.window_ticks, False)])
def test_a_detection_too_late_for_the_window_is_dropped_and_counted(late, kept):
    regular = [(t, (t, 0, 0.0, 0.0)) for t in range(61)]
    late_one = (60, (60 - late, 1, 5.0, 5.0))
    with_it, without_it = folded([*regular, late_one], 60), folded(regular, 60)
    assert with_it.dropped == (0 if kept else 1)
    assert (with_it.estimate != without_it.estimate) == kept


def test_a_detection_at_the_windows_first_tick_builds_on_all_that_was_before():
    regular = [(t, (t, 0, 0.1 * t, 1.0)) for t in range(20, 32)]
    first_tick = 60 - P.window_ticks + 1
    late = (60, (first_tick, 1, 3.0, 1.5))
    track = folded([*regular, late], 60)
    assert track.dropped == 0
    assert_same(track.estimate, reference([d for _, d in [*regular, late]], 60))


def test_of_two_detections_by_one_robot_at_one_tick_the_first_known_stays():
    first = (3, (3, 1, 1.0, 1.0))
    other, third = (3, 1, 9.0, 9.0), (3, 2, 2.0, 2.0)
    assert folded([first, (5, other)], 6) == folded([first], 6)
    assert folded([first, (5, other), (5, third)], 6) == folded([first, (5, third)], 6)


def test_nothing_is_known_before_the_first_detection():
    track = folded([(3, (3, 0, 1.0, 2.0))], 2)
    assert track.estimate is None
    assert track.detected_tick == -1


def test_a_detection_older_than_the_first_known_starts_the_filter_earlier():
    arrivals = [(5, (5, 0, 1.0, 0.0)), (6, (2, 1, 0.0, 0.0))]
    detections = [detection for _, detection in arrivals]
    assert_same(folded(arrivals, 8).estimate, reference(detections, 8))


def test_a_target_unseen_for_longer_than_the_limit_is_lost_and_not_before():
    parameters = replace(P, track_age_ticks_max=12)
    arrivals = [(4, (4, 0, 1.0, 2.0))]
    assert folded(arrivals, 16, parameters).estimate is not None
    assert folded(arrivals, 17, parameters).estimate is None


@pytest.mark.parametrize(("age_max", "tick"), [(5, 100), (30, 100), (60, 100), (5, 12), (5, 8)])
def test_a_lost_target_seen_again_starts_a_new_track_without_memory_of_the_old(age_max, tick):
    parameters = replace(P, track_age_ticks_max=age_max)
    before = [(t, (t, 0, 1.0, 2.0)) for t in range(2)]
    again = [(t, (t, 0, 7.0, 0.1 * t)) for t in range(tick, tick + 3)]
    track = folded([*before, *again], tick + 4, parameters)
    assert track.estimate is not None
    assert_same(track.estimate, reference([detection for _, detection in again], tick + 4))
    assert track.detected_tick == tick + 2


def test_a_late_detection_after_the_track_was_given_up_starts_it_anew():
    parameters = replace(P, track_age_ticks_max=5)
    seen = [(t, (t, 0, 1.0, 2.0)) for t in range(2)]
    late = (4, 1, 1.5, 2.0)
    assert folded(seen, 7, parameters).estimate is None
    assert_same(folded([*seen, (8, late)], 8, parameters).estimate, reference([late], 8))


@pytest.mark.parametrize(("age_max", "window"), [(5, 30), (29, 30), (30, 30), (5, 8), (60, 30)])
@pytest.mark.parametrize("copy_tick", [0, 2, 4])
def test_a_copy_of_what_a_given_up_track_was_fed_with_does_not_feed_the_next(
    age_max, window, copy_tick
):
    parameters = replace(
        P, track_age_ticks_max=age_max, window_ticks=window, spline_spacing_ticks=1
    )
    before = [(t, (t, 0, 1.0, 2.0)) for t in range(5)]
    tick = 4 + age_max + 2  # the tick after the one at which the track is given up
    again = [(t, (t, 0, 7.0, 0.1 * t)) for t in range(tick, tick + 3)]
    copy = (copy_tick, 0, 1.0, 2.0)
    for arrival in range(tick - 1, tick + 3):
        copied = folded([*before, *again, (arrival, copy)], tick + 3, parameters)
        clean = folded([*before, *again], tick + 3, parameters)
        assert copied._replace(dropped=0) == clean
        assert_same(copied.estimate, reference([d for _, d in again], tick + 3, parameters))


IGNORE = replace(P, late_detections="ignore")


@CHEAP
@given(hunts(28, 28))
def test_where_late_detections_are_ignored_the_rest_is_filtered_as_without_them(hunt):
    _, arrivals = hunt
    timely = [arrival for arrival in arrivals if arrival[0] - arrival[1][0] <= 1]
    track, clean = folded(arrivals, 28, IGNORE), folded(timely, 28)
    assert track._replace(dropped=0) == clean
    # Counted is what is not known, at each tick at which it arrives.
    known = {detection for _, detection in timely}
    assert track.dropped == len({late for late in arrivals if late[1] not in known})


@pytest.mark.parametrize(("late", "used"), [(0, True), (1, True), (2, False), (29, False)])
def test_late_is_what_an_undelayed_link_would_have_brought_earlier(late, used):
    regular = [(t, (t, 0, 0.0, 0.0)) for t in range(61)]
    late_one = (60, (60 - late, 1, 5.0, 5.0))
    track = folded([*regular, late_one], 60, IGNORE)
    assert track.dropped == (0 if used else 1)
    assert (track.estimate != folded(regular, 60).estimate) == used


def test_a_late_copy_of_what_is_known_is_not_counted_as_ignored():
    arrivals = [(3, (2, 1, 5.0, 5.0)), (6, (2, 1, 5.0, 5.0)), (6, (2, 2, 5.0, 5.0))]
    track = folded(arrivals, 8, IGNORE)
    assert track.dropped == 1
    assert_same(track.estimate, reference([(2, 1, 5.0, 5.0)], 8))


def test_the_mean_of_detections_is_the_same_with_every_python():
    """Python's own ``sum`` gives 1.0 for these from 3.12 on, and 0.9999999999999999 before."""
    detections = tuple((0, robot, 0.1, -0.1) for robot in range(10))
    total = 0.1 + 0.1 + 0.1 + 0.1 + 0.1 + 0.1 + 0.1 + 0.1 + 0.1 + 0.1
    estimate = next_estimate(None, detections, TICK_S, P)
    assert estimate.position == (total / 10, -total / 10)


@CHEAP
@given(hunts(25, 0))
def test_in_order_the_filter_needs_no_window(hunt):
    detections, arrivals = hunt
    estimate = None
    for tick in range(26):
        now = tuple(sorted(detection for detection in detections if detection[0] == tick))
        estimate = next_estimate(estimate, now, TICK_S, P)
    assert estimate == folded(arrivals, 25).estimate


@pytest.mark.parametrize("silent_ticks", [0, 10, 29, 30, 31, 100])
@pytest.mark.parametrize("late", [0, 1, 3])
def test_a_target_first_seen_after_any_silence_is_tracked_at_once(silent_ticks, late):
    detection = (silent_ticks, 2, 7.0, 8.0)
    track = folded([(silent_ticks + late, detection)], silent_ticks + late)
    assert track.estimate is not None
    assert_same(track.estimate, reference([detection], silent_ticks + late))
    assert track.dropped == 0


def test_folding_changes_neither_the_track_nor_the_detections():
    track = folded([(0, (0, 0, 1.0, 2.0))], 3)
    copy, detections = track._replace(), [(2, 1, 5.0, 5.0), (4, 0, 1.0, 1.0)]
    incorporate(track, detections, 4, TICK_S, P)
    assert track == copy
    assert detections == [(2, 1, 5.0, 5.0), (4, 0, 1.0, 1.0)]


def test_without_detections_a_covariance_step_is_pure_prediction():
    (p00, p01, p11), gain_x, gain_v = covariance_step((1.0, 0.2, 0.5), 0, TICK_S, 10.0, nan)
    noise = Q_discrete_white_noise(2, TICK_S, 100.0)
    assert p00 == pytest.approx(1.0 + 2 * TICK_S * 0.2 + TICK_S**2 * 0.5 + noise[0, 0])
    assert p01 == pytest.approx(0.2 + TICK_S * 0.5 + noise[0, 1])
    assert p11 == pytest.approx(0.5 + noise[1, 1])
    assert (gain_x, gain_v) == (0.0, 0.0)


def test_the_covariance_comes_to_rest():
    covariance = (0.0025, 0.0, 9.0)
    for _ in range(300):
        before = covariance
        covariance, _, _ = covariance_step(before, 1, TICK_S, 10.0, 0.05)
    assert covariance == before


@pytest.mark.parametrize("missed", [0, 1, 7, 25, 30])
def test_ticks_left_out_are_as_ticks_in_which_nothing_was_heard(missed):
    known = folded([(k, (k, 0, 0.3 * k, 1.0)) for k in range(8)], 7)
    tick = 8 + missed
    caught_up = incorporate(coast_to(known, tick, TICK_S, P), (), tick, TICK_S, P)
    one_by_one = known
    for passed in range(8, tick + 1):
        one_by_one = incorporate(one_by_one, (), passed, TICK_S, P)
    assert caught_up == one_by_one


def test_a_track_left_alone_for_longer_than_targets_are_remembered_starts_anew():
    known = folded([(k, (k, 0, 0.3 * k, 1.0)) for k in range(8)], 7)
    tick = 9 + P.track_age_ticks_max
    known = known._replace(dropped=2, told_ticks=((1, 7),))
    track = incorporate(coast_to(known, tick, TICK_S, P), (), tick, TICK_S, P)
    assert track.estimate is None
    # What has come already would not be new if it came once more.
    assert (track.dropped, track.told_ticks) == (2, ((1, 7),))
    assert track.detected_tick == -1
    seen = incorporate(track, [(tick + 1, 2, 5.0, 6.0)], tick + 1, TICK_S, P)
    assert (seen.estimate.x, seen.estimate.y) == (5.0, 6.0)
