"""Voronoi pursuit: the shared edge against scipy's diagram and a brute force; the law it obeys.

The law: straight towards the middle of the shared edge is where the target's cell shrinks fastest,
by L |m - p| / |p - e| of area for each m. The area comes from clipping a square, bisector by
bisector, which knows nothing of edges between two.
"""

from math import hypot

import numpy as np
import pytest
from helpers_agents import view_of
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial import Voronoi

from encircle.agents.policies.interface import Decision
from encircle.agents.policies.voronoi import shared_edge, voronoi
from encircle.protocol.parameters import Parameters

P = Parameters()
CHEAP = settings(max_examples=80, deadline=None, derandomize=True)
coordinates = st.floats(-9.0, 9.0)
places = st.tuples(coordinates, coordinates)
BOUND_M = 20.0


def apart(points, by=0.3):
    return all(
        hypot(a[0] - b[0], a[1] - b[1]) > by for i, a in enumerate(points) for b in points[:i]
    )


def decided(positions, own, target, **parameters):
    seen = view_of(positions, own, target, lambda grid: pytest.fail("nothing is to be predicted"))
    return voronoi(None, seen, **parameters)[1]


@CHEAP
@given(robots=st.lists(places, min_size=3, max_size=7), target=places)
def test_an_edge_is_that_of_scipy_where_it_is_bounded(robots, target):
    assume(apart([*robots, target]))
    spread = np.array([*robots, target]) - np.array(target)
    assume(np.linalg.svd(spread, compute_uv=False)[1] > 0.1)  # not all on one line
    diagram = Voronoi(np.array([*robots, target]))
    ridges = {
        min(pair): corners
        for pair, corners in zip(diagram.ridge_points.tolist(), diagram.ridge_vertices, strict=True)
        if max(pair) == len(robots)
    }
    for robot, place in enumerate(robots):
        others = [p for k, p in enumerate(robots) if k != robot]
        edge = shared_edge(place, target, others, 1e4)
        corners = ridges.get(robot)
        if corners is None:
            assert edge is None or hypot(*np.subtract(*edge)) < 1e-6
        elif -1 not in corners and np.abs(diagram.vertices[corners]).max() < 1e3:
            assert edge is not None
            wanted = diagram.vertices[corners]
            there = min(np.abs(wanted - edge).max(), np.abs(wanted[::-1] - edge).max())
            assert there < 1e-5


@CHEAP
@given(robots=st.lists(places, min_size=1, max_size=6), target=places)
def test_an_edge_is_what_a_walk_along_the_bisector_finds(robots, target):
    assume(apart([*robots, target]))
    own, *others = robots
    edge = shared_edge(own, target, others, BOUND_M)
    middle = np.add(own, target) / 2.0
    across = np.array([target[1] - own[1], own[0] - target[0]])
    across /= np.hypot(*across)
    walk = middle + np.linspace(-BOUND_M, BOUND_M, 4001)[:, None] * across
    away = np.hypot(*(walk - target).T)
    free = away <= BOUND_M
    for other in others:
        free &= away <= np.hypot(*(walk - other).T)
    if edge is None:
        assert free.sum() <= 1
        return
    for point in edge:
        assert abs(hypot(*np.subtract(point, target)) - hypot(*np.subtract(point, own))) < 1e-9
    if free.any():
        ends = walk[free][[0, -1]]
        off = min(np.hypot(*(ends - edge).T).max(), np.hypot(*(ends[::-1] - edge).T).max())
        assert off <= 0.0101


def cell_area(robots, target, half_m=40.0):
    """The area of the target's cell within a square about it."""
    corners = [np.array(p) * half_m + target for p in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    for robot in robots:
        normal, middle = np.subtract(robot, target), np.add(robot, target) / 2.0
        kept = []
        for a, b in zip(corners, [*corners[1:], corners[0]], strict=True):
            sa, sb = (a - middle) @ normal, (b - middle) @ normal
            if sa <= 0.0:
                kept.append(a)
            if sa * sb < 0.0:
                kept.append(a + (b - a) * sa / (sa - sb))
        corners = kept
    x, y = np.array(corners).T
    return abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2.0


@pytest.mark.parametrize("seed", range(6))
def test_the_way_to_the_middle_shrinks_the_target_s_cell_fastest(seed):
    draws = np.random.default_rng(seed)
    bearings = np.arange(5) * 2.0 * np.pi / 5.0 + draws.uniform(-0.3, 0.3, 5)
    distances = draws.uniform(3.0, 5.0, 5)
    robots = np.stack([distances * np.cos(bearings), distances * np.sin(bearings)], axis=1)
    target = np.zeros(2)
    edge = shared_edge(tuple(robots[0]), (0.0, 0.0), [tuple(p) for p in robots[1:]], BOUND_M)
    ends = np.array(edge)
    length, middle = np.hypot(*(ends[1] - ends[0])), ends.mean(axis=0)
    gradient = []
    for axis in (0, 1):
        moved = [robots.copy(), robots.copy()]
        moved[0][0, axis] += 1e-4
        moved[1][0, axis] -= 1e-4
        gradient.append((cell_area(moved[0], target) - cell_area(moved[1], target)) / 2e-4)
    law = -length / np.hypot(*robots[0]) * (middle - robots[0])
    # More area for the target where the robot goes away from the edge's middle.
    assert np.allclose(gradient, law, rtol=1e-3, atol=1e-3)
    places = [tuple(p) for p in robots.tolist()]
    step = np.array(decided(places, 0, (0.0, 0.0)).step)
    assert np.allclose(step / 0.3, -np.array(gradient) / np.hypot(*gradient), atol=1e-3)


def test_a_robot_behind_others_heads_straight_for_the_target():
    decision = decided([(8.0, 0.0), (2.0, 0.0), (-2.0, 0.5)], 0, (0.0, 0.0))
    assert decision.goal == (0.0, 0.0)
    assert decision.step == pytest.approx((-0.3, 0.0))


def test_alone_it_heads_straight_and_stops_at_the_stop_distance():
    assert decided([(5.0, 0.0)], 0, (0.0, 0.0)).step == pytest.approx((-0.3, 0.0))
    assert decided([(1.2, 0.0)], 0, (0.0, 0.0)).step == pytest.approx((0.0, 0.0))


def test_without_an_estimate_it_searches():
    search = Decision("search", (0.1, 0.0), (3.0, 0.0))
    seen = view_of(
        [(0.0, 0.0)], 0, None, lambda grid: pytest.fail("there is none"), P, search=search
    )
    assert voronoi(None, seen) == (None, search)
