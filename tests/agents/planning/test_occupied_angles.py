"""Occupied angles: against simulated chases, a minimiser, and headings tried one by one.

The simulation knows no formula: a target runs along each heading, a robot along each of its own,
tick by tick, and what counts is whether they ever come within the capture distance.
"""

from math import acos, asin, cos, inf, pi, radians, sin

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize_scalar

from encircle.agents.planning.occupied_angles import half_angle, is_closed, least_slack, slacks

CHEAP = settings(max_examples=200, deadline=None, derandomize=True)
ROUNDING_RAD = 1e-12
ratios = st.floats(0.05, 0.97)
captures = st.floats(0.0, 2.0)


def meets(heading, speed_ratio, capture_m, distance_m):
    """Whether a robot on some straight course comes within reach; the target runs at 1 m/s."""
    courses = np.radians(np.arange(0.0, 360.0, 0.25))
    times = np.arange(0.0, 60.0, 0.02)
    target = np.exp(1j * heading) * times
    robot = distance_m + speed_ratio * np.exp(1j * courses)[:, None] * times
    return bool((abs(robot - target) <= capture_m + 0.005).any())


@pytest.mark.parametrize(
    ("speed_ratio", "capture_m", "distance_m"),
    [(0.5, 0.0, 2.0), (0.5, 1.3, 4.0), (0.77, 1.3, 4.0), (0.8, 0.3, 1.0), (0.3, 1.0, 1.1)],
)
def test_a_simulated_robot_meets_the_headings_within_the_angle_and_no_others(
    speed_ratio, capture_m, distance_m
):
    """Courses in steps of 0.25 degrees, ticks of 0.02 s: the edge is known to a degree or two."""
    half = half_angle(speed_ratio, capture_m, distance_m)
    off = [radians(degrees) for degrees in (-60, -20, -5, -2)]
    for heading in [0.0, *(half + by for by in off), *(-half - by for by in off)]:
        assert meets(heading, speed_ratio, capture_m, distance_m), heading
    for by in (2, 5, 20, 60):
        for heading in (half + radians(by), -half - radians(by)):
            assert not meets(heading, speed_ratio, capture_m, distance_m), heading


def nearest_miss(heading, speed_ratio, capture_m, distance_m):
    """The least of the target's distance from the robot's start less what the robot can cover."""

    def missing_m(way_m):
        x, y = way_m * cos(heading) - distance_m, way_m * sin(heading)
        return np.hypot(x, y) - speed_ratio * way_m - capture_m

    # Convex: a norm less a line.
    bounds = (0.0, 100.0 * distance_m / (1.0 - speed_ratio))
    way = minimize_scalar(missing_m, bounds=bounds, method="bounded", options={"xatol": 1e-9}).x
    return min(missing_m(way), missing_m(0.0))


@CHEAP
@given(ratios, captures, st.floats(0.1, 20.0))
def test_at_the_edge_of_the_angle_the_nearest_miss_changes_its_sign(ratio, capture_m, beyond_m):
    distance_m = capture_m + beyond_m
    half = half_angle(ratio, capture_m, distance_m)
    assume(0.01 < half < pi - 0.01)
    assert nearest_miss(half - 0.01, ratio, capture_m, distance_m) < 0.0
    assert nearest_miss(half + 0.01, ratio, capture_m, distance_m) > 0.0


def test_the_angle_at_its_limits():
    assert half_angle(0.5, 0.0, 3.0) == pytest.approx(pi / 6)
    assert half_angle(0.0, 1.0, 2.0) == pytest.approx(pi / 6)  # one that stands is in the way
    assert half_angle(1.0, 0.0, 3.0) == pytest.approx(pi / 2)
    assert half_angle(1.01, 0.0, 3.0) == half_angle(inf, 0.0, 3.0) == pi
    assert half_angle(0.5, 1.0, 1.0) == half_angle(0.5, 1.0, 0.0) == pi
    # Far away only speed counts, and a robot about to capture occupies beyond a right angle.
    assert half_angle(0.5, 1.3, 1e9) == pytest.approx(pi / 6)
    assert half_angle(0.5, 1.3, 1.3 + 1e-12) == pytest.approx(pi / 6 + pi / 2, abs=1e-5)


@CHEAP
@given(ratios, captures, st.floats(0.1, 20.0), st.floats(0.01, 1.0))
def test_nearer_faster_and_with_more_reach_occupies_more(ratio, capture_m, beyond_m, more):
    distance_m = capture_m + beyond_m
    half = half_angle(ratio, capture_m, distance_m)
    assert half_angle(ratio, capture_m, distance_m + more) <= half
    assert half_angle(min(0.99, ratio + more), capture_m, distance_m) >= half
    assert half_angle(ratio, capture_m + more * beyond_m, distance_m) >= half


@pytest.mark.parametrize(
    ("faster", "needed"),
    [(1.1, 3), (1.2, 4), (1.4, 4), (1.5, 5), (1.75, 6), (2.0, 6), (2.5, 8), (3.0, 10)],
)
def test_an_even_ring_is_closed_by_the_known_numbers_of_robots(faster, needed):
    for count in (needed - 1, needed):
        bearings = [2.0 * pi * robot / count for robot in range(count)]
        halves = [half_angle(1.0 / faster, 0.0, 4.0) + 1e-12] * count
        assert is_closed(bearings, halves) == (count >= needed)
        assert least_slack(bearings, halves) == pytest.approx(
            2.0 * asin(1.0 / faster) - 2.0 * pi / count, abs=1e-9
        )


def uncovered(bearings, halves, heading, by_rad=0.0):
    """Whether a heading is off every robot's angle by more, by the angle between unit vectors."""
    return all(
        acos(max(-1.0, min(1.0, cos(heading - bearing)))) > half + by_rad
        for bearing, half in zip(bearings, halves, strict=True)
    )


robots = st.lists(st.tuples(st.floats(-10.0, 10.0), st.floats(0.0, pi)), min_size=1, max_size=7)


@CHEAP
@given(robots)
def test_a_negative_slack_is_the_width_of_a_range_of_free_headings(team):
    bearings, halves = zip(*team, strict=True)
    gaps = slacks(bearings, halves)
    headings = [radians(0.5 * step) for step in range(720)]
    free = [heading for heading in headings if uncovered(bearings, halves, heading)]
    width_rad = sum(max(0.0, -gap.slack_rad) for gap in gaps)
    assert len(free) * radians(0.5) == pytest.approx(width_rad, abs=radians(1.1) * len(team))
    if any(uncovered(bearings, halves, heading, ROUNDING_RAD) for heading in free):
        assert not is_closed(bearings, halves)
    for gap in gaps:
        if gap.slack_rad < -radians(1.1):
            # In the middle of the free range nobody meets the target.
            behind = max(_reach(bearings, halves, bearings[gap.after]))
            assert uncovered(bearings, halves, bearings[gap.after] + behind - gap.slack_rad / 2)


def _reach(bearings, halves, bearing):
    for other, half in zip(bearings, halves, strict=True):
        # A bearing that is less by rounding alone is the same, and not a turn behind.
        yield half - ((bearing - other + ROUNDING_RAD) % (2.0 * pi) - ROUNDING_RAD)


@CHEAP
@given(st.lists(st.integers(-180, 180), min_size=2, max_size=7, unique=True), st.floats(0.0, pi))
def test_of_equal_angles_a_slack_is_both_halves_less_the_difference_of_bearings(degrees, half):
    bearings = [radians(2.0 * bearing) + 0.001 * bearing for bearing in degrees]
    gaps = slacks(bearings, [half] * len(bearings))
    for gap in gaps:
        turn = (bearings[gap.before] - bearings[gap.after]) % (2.0 * pi)
        assert gap.slack_rad == pytest.approx(2.0 * half - turn, abs=1e-9)
    assert sum(gap.slack_rad for gap in gaps) == pytest.approx(
        2.0 * half * len(bearings) - 2.0 * pi, abs=1e-9
    )


@CHEAP
@given(robots)
def test_the_gaps_lead_once_around_and_name_each_robot_once_at_each_end(team):
    bearings, halves = zip(*team, strict=True)
    gaps = slacks(bearings, halves)
    assert sorted(gap.after for gap in gaps) == list(range(len(team)))
    assert [gap.before for gap in gaps] == [gap.after for gap in (*gaps[1:], gaps[0])]


@CHEAP
@given(robots, st.floats(-7.0, 7.0), st.randoms(use_true_random=False))
def test_neither_a_turn_nor_another_order_of_the_robots_changes_the_least_slack(team, by, random):
    shuffled = random.sample(team, len(team))
    turned = [bearing + by for bearing, _ in shuffled]
    assert least_slack(turned, [half for _, half in shuffled]) == pytest.approx(
        least_slack(*zip(*team, strict=True)), abs=1e-9
    )


def test_a_far_robot_behind_a_near_one_opens_no_gap():
    near = [radians(100.0)] * 2
    assert is_closed([0.0, pi], near)
    # Its own 10 degrees and its neighbour's 100 do not span 180; the one's behind it does.
    assert is_closed([0.0, pi, 0.001], [*near, radians(10.0)])
    assert least_slack([0.0, pi, 0.001], [*near, radians(10.0)]) == pytest.approx(radians(20.0))


def test_one_robot_and_none():
    assert slacks([1.0], [pi / 3]) == ((0, 0, pytest.approx(2 * pi / 3 - 2 * pi)),)
    assert is_closed([1.0], [pi])
    assert slacks([], []) == ()
    assert least_slack([], []) == -2.0 * pi
