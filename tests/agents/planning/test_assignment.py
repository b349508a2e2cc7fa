"""``assign`` against full enumeration and the literal Algorithm 1, ties above all.

The oracle enumerates all permutations of distances in whole microns and takes the smallest sum,
then the lexicographically smallest permutation: what Algorithm 1 finds for the first robot.
"""

from itertools import permutations
from math import cos, hypot, pi, sin

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment

from encircle.agents.planning.assignment import (
    algorithm_1,
    assign,
    assign_by_enumeration,
    assign_with_hysteresis,
    whole_quanta,
)
from encircle.protocol.messages import QUANTUM_M

CHEAP = settings(max_examples=60, deadline=None, derandomize=True)


def ring(count, radius=4.0, turn=0.0, centre=(0.0, 0.0)):
    bearings = [turn + 2 * pi * k / count for k in range(count)]
    return [(centre[0] + radius * cos(b), centre[1] + radius * sin(b)) for b in bearings]


def microns(team, points):
    """Whole numbers of quanta, one row per robot."""
    return [[round(hypot(x - px, y - py) / QUANTUM_M) for px, py in points] for x, y in team]


def enumerated(costs):
    """Smallest sum and the first permutation, in lexicographic order, that has it."""
    ways = permutations(range(len(costs)))
    return min((sum(row[q] for row, q in zip(costs, way, strict=True)), way) for way in ways)


def assert_as_enumerated(team, points):
    choice, distances = assign(np.array(team), np.array([points]))
    total, way = enumerated(microns(team, points))
    assert tuple(choice[0].tolist()) == way
    goals = [points[q] for q in way]
    expected = [hypot(x - u, y - v) for (x, y), (u, v) in zip(team, goals, strict=True)]
    np.testing.assert_allclose(distances[0], expected, atol=1e-12)
    assert sum(expected) == pytest.approx(total * QUANTUM_M, abs=1e-5)


@st.composite
def formations(draw, coordinate, count_max=6):
    count = draw(st.integers(1, count_max))
    places = st.lists(st.tuples(coordinate, coordinate), min_size=count, max_size=count)
    return draw(places), draw(places)


@CHEAP
@given(formations(st.floats(-20.0, 20.0)))
def test_the_shortest_assignment_is_found(formation):
    assert_as_enumerated(*formation)


@CHEAP
@given(formations(st.integers(-2, 2).map(float)))
def test_on_a_grid_where_ties_abound_the_first_of_the_shortest_is_found(formation):
    assert_as_enumerated(*formation)


@CHEAP
@given(formations(st.integers(-2, 2).map(float), count_max=5))
def test_it_is_what_algorithm_1_finds_for_the_first_robot(formation):
    team, points = formation
    costs = np.array(microns(team, points), float)
    choice, _ = assign(np.array(team), np.array([points]))
    point, minimum = algorithm_1(costs, 0)
    assert choice[0, 0] == point
    assert costs[np.arange(len(team)), choice[0]].sum() == minimum
    assert assign_by_enumeration(costs) == (tuple(choice[0].tolist()), minimum)


@CHEAP
@given(formations(st.floats(-20.0, 20.0), count_max=5), st.data())
def test_algorithm_1_finds_the_minimum_for_every_robot(formation, data):
    team, points = formation
    costs = np.array(microns(team, points), float)
    own = data.draw(st.integers(0, len(team) - 1))
    point, minimum = algorithm_1(costs, own)
    assert minimum == enumerated(costs.tolist())[0]
    fixed = [way for way in permutations(range(len(team))) if way[own] == point]
    assert minimum in [sum(costs[n, q] for n, q in enumerate(way)) for way in fixed]


@pytest.mark.parametrize("count", range(1, 7))
@pytest.mark.parametrize(
    "planning_team",
    [
        lambda n: [(0.0, 0.0)] * n,  # every distance the same
        lambda n: [(float(k), 0.0) for k in range(n)],  # collinear, in order
        lambda n: [(3.0 * (n - k), 0.0) for k in range(n)],  # collinear, reversed
        lambda n: [(5.0, 5.0)] * n,  # all in one place
        lambda n: ring(n, 8.0),  # one robot behind each point
        lambda n: ring(n, 8.0, pi / n),  # each between two points
        lambda n: ring(n, 8.0, pi),  # each opposite its point
        lambda n: ring(n, 8.0)[::-1],
    ],
)
def test_symmetric_formations_are_assigned_as_by_enumeration(count, planning_team):
    for turn in (0.0, pi / 2, 0.3):
        assert_as_enumerated(planning_team(count), ring(count, 4.0, turn))


def test_robots_that_follow_algorithm_1_each_for_itself_can_claim_one_point():
    # Three robots, each as far as can be from its own point and equally far from the two others:
    # both rotations are shortest. Robots 2 and 3 both start their enumeration with point 1.
    costs = np.array([[8.0, 4.0, 4.0], [4.0, 8.0, 4.0], [4.0, 4.0, 8.0]])
    claims = [algorithm_1(costs, own)[0] for own in range(3)]
    assert claims == [1, 0, 0]
    team, points = ring(3, 2.0, pi), ring(3, 2.0)
    np.testing.assert_allclose(
        whole_quanta(np.array([[hypot(x - u, y - v) for u, v in points] for x, y in team])),
        np.rint(np.where(np.eye(3) > 0, 4.0, 2.0) * 2**20),
    )
    assert sorted(assign(np.array(team), np.array([points]))[0][0].tolist()) == [0, 1, 2]


@CHEAP
@given(formations(st.floats(-20.0, 20.0)), st.lists(st.floats(-5, 5), min_size=1, max_size=7))
def test_each_ring_is_assigned_for_itself(formation, shifts):
    team, points = formation
    rings = np.array([[(x + shift, y) for x, y in points] for shift in shifts])
    choice, distances = assign(np.array(team), rings)
    assert choice.shape == distances.shape == (len(shifts), len(team))
    for row, far, one in zip(choice, distances, rings, strict=True):
        alone, far_alone = assign(np.array(team), one[None])
        np.testing.assert_array_equal(row, alone[0])
        np.testing.assert_array_equal(far, far_alone[0])


@pytest.mark.parametrize("count", [7, 8, 12, 20])
def test_large_teams_get_a_shortest_permutation_that_does_not_depend_on_rounding(count):
    rng = np.random.default_rng(count)
    for scale in (1.0, 300.0):
        team = rng.integers(-3, 4, (count, 2)) * scale
        points = np.array(ring(count)) * scale
        choice, distances = assign(team, points[None])
        assert sorted(choice[0].tolist()) == list(range(count))
        costs = np.array(microns(team.tolist(), points.tolist()))
        best = costs[linear_sum_assignment(costs)].sum()
        assert costs[np.arange(count), choice[0]].sum() == best
        assert distances.sum() == pytest.approx(best * QUANTUM_M, abs=1e-5 * count)


def test_ties_go_to_the_first_robots_up_to_seven_of_them():
    # Everyone in the middle: all of 7! permutations are equally short.
    choice, _ = assign(np.zeros((7, 2)), np.array([ring(7)]))
    assert choice[0].tolist() == list(range(7))


def test_sums_that_differ_by_rounding_noise_only_are_a_tie():
    team, points = [(0.0, 0.0), (0.0, 0.0)], [(4.0, 0.0), (0.0, 4.0)]
    for noise in (-1e-12, 1e-12):
        shaken = np.array(team) + np.array([[noise, 0.0], [0.0, noise]])
        assert assign(shaken, np.array([points]))[0][0].tolist() == [0, 1]


def totals(team, points, own, kept):
    """Smallest sums over all permutations, and over those in which ``own`` goes to ``kept``."""
    costs = microns(team, points)
    ways = list(permutations(range(len(team))))
    sums = [sum(row[q] for row, q in zip(costs, way, strict=True)) for way in ways]
    return min(sums), min(s for s, way in zip(sums, ways, strict=True) if way[own] == kept)


def decided(team, points, own, previous, gain_m):
    """The point ``own`` has been assigned, and the one it goes to."""
    points = np.array(points)
    assigned = assign(np.array(team), points[None])[0][0]
    way = assign_with_hysteresis(np.array(team), points, assigned, own, previous, gain_m)
    return int(assigned[own]), way


@settings(CHEAP, max_examples=200)
@given(
    formations(st.floats(-20.0, 20.0)),
    st.tuples(st.floats(-20.0, 20.0), st.floats(-20.0, 20.0)),
    st.floats(0.0, 10.0),
    st.data(),
)
def test_a_point_is_kept_unless_changing_it_gains_enough(formation, previous, gain_m, data):
    team, points = formation
    own = data.draw(st.integers(0, len(team) - 1))
    away = sorted((hypot(x - previous[0], y - previous[1]), q) for q, (x, y) in enumerate(points))
    assume(len(away) == 1 or away[1][0] - away[0][0] > 1e-6)
    nearest = away[0][1]
    best, keeping = totals(team, points, own, nearest)
    assume(abs(keeping - best - gain_m / QUANTUM_M) > 2 * len(team))  # beyond rounding
    assigned, way = decided(team, points, own, previous, gain_m)
    assert way == (nearest if keeping - best <= gain_m / QUANTUM_M else assigned)


@pytest.mark.parametrize(("gain_m", "way"), [(1.9, 1), (2.0, 0), (2.1, 0)])
def test_a_gain_of_exactly_the_threshold_is_not_enough(gain_m, way):
    # In order 2 m in all, crosswise 4 m: the robots stand a metre nearer to their own points.
    team, points = [(1.0, 0.0), (2.0, 0.0)], [(3.0, 0.0), (0.0, 0.0)]
    assert totals(team, points, 0, 0) == (2 * 2**20, 4 * 2**20)
    assert decided(team, points, 0, (3.0, 0.0), gain_m) == (1, way)


def test_of_two_points_equally_near_to_the_old_one_the_first_is_kept():
    team, points = [(0.0, 3.0), (0.0, -3.0)], [(0.0, -4.0), (0.0, 4.0)]
    assert decided(team, points, 0, (9.0, 0.0), 100.0) == (1, 0)
    assert decided(team, points[::-1], 0, (9.0, 0.0), 100.0) == (0, 0)
    # As near in whole microns: rounding noise does not decide.
    assert decided(team, points, 0, (9.0, 1e-9), 100.0) == (1, 0)


def test_one_robot_alone_has_one_point():
    assert decided([(5.0, 5.0)], [(0.0, 1.0)], 0, (3.0, 3.0), 0.5) == (0, 0)
