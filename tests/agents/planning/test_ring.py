"""Eq. 1 against its printed form and closed forms."""

from math import atan2, cos, hypot, pi, sin

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from encircle.agents.planning import ring as ring_module
from encircle.agents.planning.ring import encirclement_points

CHEAP = settings(max_examples=100, deadline=None, derandomize=True)
coordinates = st.floats(-50.0, 50.0)
places = st.tuples(coordinates, coordinates)
teams = st.lists(places, min_size=1, max_size=9)
RHO = 4.0


def printed(team, target, centre, rho, turning=1.0):
    """Eq. 1 as printed, with a 2 x 2 matrix; ``turning = -1`` turns clockwise, as the text says.

    Of robots equally far in whole microns the first counts as the farthest.
    """
    distances = [hypot(x - target[0], y - target[1]) for x, y in team]
    microns = [round(distance * 2**20) for distance in distances]
    first = microns.index(max(microns))
    ray = (np.array(team[first]) - target) / distances[first]
    points = []
    for q in range(1, len(team) + 1):
        angle = turning * (q - 1) * 2 * pi / len(team)
        matrix = np.array([[cos(angle), -sin(angle)], [sin(angle), cos(angle)]])
        points.append(np.array(centre) + rho * matrix @ ray)
    return np.array(points)


def away_from_target(team, target):
    return max(hypot(x - target[0], y - target[1]) for x, y in team) > 1e-3


@CHEAP
@given(teams, places, st.lists(places, min_size=1, max_size=4), st.floats(0.1, 10.0))
def test_points_are_those_of_equation_1(team, target, predictions, rho):
    assume(away_from_target(team, target))
    points = encirclement_points(team, target, np.array(predictions), rho)
    assert points.shape == (len(predictions), len(team), 2)
    for ring, centre in zip(points, predictions, strict=True):
        np.testing.assert_allclose(ring, printed(team, target, centre, rho), atol=1e-9)


@CHEAP
@given(teams, places, places)
def test_the_set_of_points_is_the_same_whichever_way_it_turns(team, target, centre):
    assume(away_from_target(team, target))
    points = encirclement_points(team, target, np.array([centre]), RHO)[0]
    clockwise = printed(team, target, centre, RHO, turning=-1.0)
    apart = np.linalg.norm(points[:, None] - clockwise[None], axis=2)
    assert apart.min(axis=0).max() < 1e-9
    assert apart.min(axis=1).max() < 1e-9


@CHEAP
@given(teams, places, places)
def test_points_lie_on_the_circle_at_equal_angles(team, target, centre):
    points = encirclement_points(team, target, np.array([centre]), RHO)[0] - centre
    np.testing.assert_allclose(np.hypot(*points.T), RHO, atol=1e-9)
    turns = np.diff(np.arctan2(points[:, 1], points[:, 0])) % (2 * pi)
    np.testing.assert_allclose(turns, 2 * pi / len(team), atol=1e-9)


def test_the_first_point_lies_towards_the_farthest_robot_seen_from_the_current_target():
    team, target, predicted = [(1.0, 0.0), (3.0, 4.0), (0.0, -2.0)], (0.0, 0.0), (10.0, 10.0)
    first = encirclement_points(team, target, np.array([predicted]), 5.0)[0, 0]
    assert first == pytest.approx((13.0, 14.0))


@pytest.mark.parametrize("order", [(0, 1, 2), (1, 0, 2), (2, 1, 0)])
def test_of_robots_equally_far_the_first_in_robot_order_gives_the_direction(order):
    equally_far = [(3.0, 4.0), (-5.0, 0.0), (4.0, -3.0)]
    team = [equally_far[k] for k in order]
    first = encirclement_points(team, (0.0, 0.0), np.zeros((1, 2)), 5.0)[0, 0]
    assert first == pytest.approx(team[0])


@pytest.mark.parametrize("noise_m", [-4e-16, -1e-9, 0.0, 1e-9, 4e-16])
@pytest.mark.parametrize("noisy", [0, 1, 2])
def test_robots_are_equally_far_in_whole_microns_so_that_rounding_noise_does_not_decide(
    noisy, noise_m
):
    target, team = (1.0, 2.0), [(4.0, 6.0), (-4.0, 2.0), (1.0, -3.0)]
    x, y = team[noisy]
    grown = 1.0 + noise_m / 5.0
    team[noisy] = (target[0] + grown * (x - target[0]), target[1] + grown * (y - target[1]))
    first = encirclement_points(team, target, np.zeros((1, 2)), 5.0)[0, 0]
    np.testing.assert_allclose(first, (3.0, 4.0), atol=1e-8)


def test_a_micron_farther_is_farther_and_the_ring_has_its_radius():
    team = [(3.0, 4.0), (-5.0 - 2.0**-20, 0.0), (-5.0 - 1.4 * 2.0**-20, 0.0)]
    points = encirclement_points(team, (0.0, 0.0), np.zeros((1, 2)), 5.0)[0]
    np.testing.assert_allclose(points[0], (-5.0, 0.0), atol=1e-12)
    np.testing.assert_allclose(np.hypot(*points.T), 5.0, atol=1e-12)


def test_robots_less_than_half_a_micron_from_the_target_give_no_direction():
    for team in ([(1e-9, -2e-9), (0.0, 0.0)], [(0.0, 0.0), (-1e-9, 0.0)]):
        points = encirclement_points(team, (0.0, 0.0), np.zeros((1, 2)), 5.0)[0]
        np.testing.assert_allclose(points, [(5.0, 0.0), (-5.0, 0.0)], atol=1e-9)


@CHEAP
@given(teams, places)
def test_all_rings_have_the_same_shape_and_follow_their_centres(team, target):
    centres = np.array([[0.0, 0.0], [7.0, -3.0], [100.0, 100.0]])
    rings = encirclement_points(team, target, centres, RHO) - centres[:, None]
    np.testing.assert_allclose(rings, np.broadcast_to(rings[0], rings.shape), atol=1e-9)


@pytest.mark.parametrize("count", [1, 2, 5])
def test_robots_that_all_stand_on_the_target_still_get_a_ring(count):
    points = encirclement_points([(1.0, 2.0)] * count, (1.0, 2.0), np.array([[1.0, 2.0]]), RHO)[0]
    np.testing.assert_allclose(np.hypot(*(points - (1.0, 2.0)).T), RHO)
    bearings = sorted(atan2(y - 2.0, x - 1.0) % (2 * pi) for x, y in points)
    np.testing.assert_allclose(np.diff(bearings), 2 * pi / count, atol=1e-9)


def test_inputs_stay_as_they_are():
    centres = np.array([[1.0, 2.0], [3.0, 4.0]])
    encirclement_points([(0.0, 0.0), (5.0, 5.0)], (1.0, 1.0), centres, RHO)
    np.testing.assert_array_equal(centres, [[1.0, 2.0], [3.0, 4.0]])


@CHEAP
@given(team=st.lists(places, min_size=1, max_size=40), target=places)
def test_many_robots_in_arrays_give_the_farthest_that_few_in_floats_give_bit_for_bit(team, target):
    # The last of them again, so that there are equals.
    for robots in (team, [*team, team[-1]], [target] * len(team)):
        assert repr(ring_module._farthest_of_many(robots, target)) == repr(
            ring_module._farthest(robots, target)
        )
