"""Cyclic assignment, held against brute force over all permutations, and against the shortest."""

from itertools import permutations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from encircle.agents.planning.assignment import assign
from encircle.agents.planning.cyclic_assignment import assign_in_cyclic_order
from encircle.agents.planning.ring import encirclement_points

SETTINGS = settings(max_examples=80, deadline=None)
RADIUS_M = 3.0
BEARINGS = st.lists(st.floats(0.0, 6.28), min_size=1, max_size=6, unique=True)


def at(bearings, distances_m):
    """Positions about the origin."""
    return np.array(distances_m)[:, None] * np.column_stack((np.cos(bearings), np.sin(bearings)))


def rings_about(team, centres):
    """Rings about ``centres`` (G, 2), the first point in the farthest robot's direction."""
    farthest = [tuple(p) for p in team.tolist()]
    return encirclement_points(farthest, tuple(centres[0].tolist()), centres, RADIUS_M)


def squared_arcs(team, ring, centre, assigned):
    """Sum of the squared angles between robots and their points, each at most half a turn."""
    (rx, ry), (px, py) = (team - centre).T, (ring[list(assigned)] - centre).T
    return float(np.sum(np.arctan2(rx * py - ry * px, rx * px + ry * py) ** 2))


@SETTINGS
@given(BEARINGS, st.data())
def test_no_permutation_has_smaller_squared_angles(bearings, data):
    assume(all(abs(a - b) > 1e-6 for a in bearings for b in bearings if a is not b))
    count = len(bearings)
    distances = data.draw(st.lists(st.floats(0.5, 30.0), min_size=count, max_size=count))
    team, centre = at(bearings, distances), np.zeros((1, 2))
    rings = rings_about(team, centre)
    chosen, _ = assign_in_cyclic_order(team, rings, centre)
    assert sorted(chosen[0].tolist()) == list(range(count))
    best = min(
        squared_arcs(team, rings[0], centre[0], every) for every in permutations(range(count))
    )
    assert squared_arcs(team, rings[0], centre[0], chosen[0]) == pytest.approx(best, abs=1e-6)


@SETTINGS
@given(st.integers(1, 40), st.integers(0, 10**6))
def test_it_is_an_assignment_with_its_distances_and_never_shorter_than_the_shortest(count, seed):
    draw = np.random.default_rng(seed)
    team = draw.uniform(-20.0, 20.0, (count, 2))
    centres = draw.uniform(-5.0, 5.0, (4, 2))
    rings = rings_about(team, centres)
    chosen, distances = assign_in_cyclic_order(team, rings, centres)
    for ring, of_ring, away in zip(rings, chosen, distances, strict=True):
        assert sorted(of_ring.tolist()) == list(range(count))
        assert away == pytest.approx(np.hypot(*(ring[of_ring] - team).T))
    shortest = assign(team, rings)[1].sum(axis=1)
    assert (distances.sum(axis=1) >= shortest - 1e-4).all()


def test_robots_around_the_ring_far_outside_go_almost_the_shortest_way():
    draw = np.random.default_rng(7)
    bearings, distances = draw.uniform(0.0, 2.0 * np.pi, 64), draw.uniform(20.0, 40.0, 64)
    team, centre = at(bearings, distances), np.zeros((1, 2))
    rings = rings_about(team, centre)
    excess = assign_in_cyclic_order(team, rings, centre)[1].sum() / assign(team, rings)[1].sum()
    assert 1.0 <= excess < 1.01


def test_robots_in_one_direction_are_taken_in_robot_order_and_one_at_the_centre_counts_as_east():
    team, centre = np.array([(2.0, 0.0), (0.0, 0.0), (4.0, 0.0)]), np.zeros((1, 2))
    rings = rings_about(team, centre)
    chosen = assign_in_cyclic_order(team, rings, centre)[0][0].tolist()
    start = chosen[0]
    assert chosen == [start, (start + 1) % 3, (start + 2) % 3]


def test_all_robots_of_equal_views_agree_whatever_the_last_bit_of_a_bearing_is():
    bearings = 2.0 * np.pi * np.arange(12) / 12
    team, centre = at(bearings, np.full(12, 9.0)), np.zeros((1, 2))
    rings = rings_about(team, centre)
    chosen = assign_in_cyclic_order(team, rings, centre)[0]
    nudged = assign_in_cyclic_order(np.nextafter(team, 99.0), rings, centre)[0]
    assert np.array_equal(chosen, nudged)
