"""Sensing against plain geometry: rays that meet discs, and points along a line of sight."""

from math import cos, dist, hypot, inf, pi, sin, sqrt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.world.arena import sensing
from encircle.world.arena.sensing import geometry, in_sight, ray_directions, scan

SETTINGS = settings(deadline=None, derandomize=True, max_examples=80)


@st.composite
def fields(draw):
    """Discs apart from each other: moving ones first, how many move, and the ranges of those."""
    centre = st.tuples(st.floats(-6.0, 6.0), st.floats(-6.0, 6.0))
    discs = draw(st.lists(st.tuples(centre, st.floats(0.1, 1.5)), min_size=1, max_size=9))
    kept = []
    for place, radius in discs:
        if all(dist(place, p) > radius + r for p, r in kept):
            kept.append((place, radius))
    moving = draw(st.integers(1, len(kept)))
    ranges = draw(st.lists(st.floats(0.5, 10.0), min_size=moving, max_size=moving))
    positions, radii = zip(*kept, strict=True)
    return np.array(positions), np.array(radii), moving, np.array(ranges)


def first_hit(start, bearing, centre, radius):
    """Distance along a ray to a disc that does not hold its start, and how clear a hit or miss.

    Solves |start + t u - centre| = radius for the smaller t.
    """
    ux, uy = cos(bearing), sin(bearing)
    px, py = start[0] - centre[0], start[1] - centre[1]
    half = px * ux + py * uy
    under = half * half - (px * px + py * py - radius * radius)
    if under < 0.0 or half > 0.0:
        return inf, abs(under)
    return -half - sqrt(under), abs(under)


@SETTINGS
@given(field=fields(), rays=st.integers(8, 40))
def test_each_ray_reports_the_nearest_surface_within_range(field, rays):
    positions, radii, moving, ranges = field
    found = scan(geometry(positions, radii, moving), ranges, radii, rays)
    assert found.shape == (moving, rays)
    for body in range(moving):
        for ray in range(rays):
            hits = [
                first_hit(positions[body], 2 * pi * ray / rays, positions[k], radii[k])
                for k in range(len(radii))
                if k != body
            ]
            if all(clear > 1e-9 for _, clear in hits):
                nearest = min([distance for distance, _ in hits], default=inf)
                assert found[body, ray] == pytest.approx(min(nearest, ranges[body]), abs=1e-8)


@SETTINGS
@given(field=fields(), rays=st.sampled_from([8, 24, 25]))
def test_few_pairs_are_scanned_as_many_are_bit_for_bit(field, rays):
    positions, radii, moving, ranges = field
    sensed = geometry(positions, radii, moving)
    scans = set()
    for few_max in (0, 10**6):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(sensing, "FEW_PAIRS_MAX", few_max)
            scans.add(scan(sensed, ranges, radii, rays).tobytes())
    assert len(scans) == 1


@SETTINGS
@given(field=fields())
def test_sight_is_what_points_along_the_line_between_two_centres_say(field):
    positions, radii, moving, ranges = field
    seen = in_sight(geometry(positions, radii, moving), ranges, radii)
    along = np.linspace(0.0, 1.0, 4001)[:, None]
    for row in range(moving):
        assert not seen[row, row]
        for column in range(moving):
            if row == column:
                continue
            line = positions[row] + along * (positions[column] - positions[row])
            far = dist(positions[row], positions[column]) > ranges[row]
            depths = [
                radii[k] - np.hypot(*(line - positions[k]).T).min()
                for k in range(moving, len(radii))
            ]
            if all(abs(depth) > 1e-4 for depth in depths):
                assert seen[row, column] == (not far and all(depth < 0 for depth in depths))


@SETTINGS
@given(field=fields())
def test_geometry_is_differences_distances_and_gaps_between_surfaces(field):
    positions, radii, moving, _ = field
    geo = geometry(positions, radii, moving)
    for row in range(moving):
        for column in range(len(radii)):
            x, y = positions[column] - positions[row]
            assert (geo.x[row, column], geo.y[row, column]) == (x, y)
            assert geo.distances[row, column] == pytest.approx(hypot(x, y))
            gap = inf if row == column else hypot(x, y) - radii[row] - radii[column]
            assert geo.gaps[row, column] == pytest.approx(gap, abs=1e-12)


def two_bodies_and(*obstacles):
    positions = np.array([[0.0, 0.0], [4.0, 0.0], *(place for place, _ in obstacles)])
    radii = np.array([0.5, 0.5, *(radius for _, radius in obstacles)])
    return geometry(positions, radii, 2), radii


def test_something_exactly_at_the_range_is_sensed_and_something_beyond_is_not():
    geo, radii = two_bodies_and()
    seen = in_sight(geo, np.array([4.0, 3.999]), radii)
    assert seen.tolist() == [[False, True], [False, False]]


@pytest.mark.parametrize(
    ("obstacle", "hides"),
    [
        (((2.0, 0.9), 1.0), True),
        (((2.0, 1.1), 1.0), False),
        (((5.5, 0.0), 0.9), False),
        (((-1.5, 0.0), 0.9), False),
    ],
)
def test_an_obstacle_hides_only_what_is_behind_it(obstacle, hides):
    geo, radii = two_bodies_and(obstacle)
    seen = in_sight(geo, np.array([6.0, 6.0]), radii)
    assert seen[0, 1] == seen[1, 0] == (not hides)


def test_a_moving_body_hides_nothing():
    positions = np.array([[0.0, 0.0], [4.0, 0.0], [2.0, 0.0]])
    geo = geometry(positions, np.full(3, 0.5), 3)
    assert in_sight(geo, np.full(3, 6.0), np.full(3, 0.5)).sum() == 6


def test_a_scan_of_an_empty_field_is_the_range_all_round():
    geo = geometry(np.array([[1.0, 2.0]]), np.array([0.5]), 1)
    assert (scan(geo, np.array([6.0]), np.array([0.5]), 24) == 6.0).all()


def test_the_first_ray_points_along_x_and_the_next_ones_counter_clockwise():
    cosines, sines = ray_directions(8)
    np.testing.assert_allclose(cosines[[0, 2, 4, 6]], [1, 0, -1, 0], atol=1e-15)
    np.testing.assert_allclose(sines[[0, 2, 4, 6]], [0, 1, 0, -1], atol=1e-15)
    geo = geometry(np.array([[0.0, 0.0], [0.0, 3.0]]), np.array([0.5, 1.0]), 1)
    assert scan(geo, np.array([6.0]), np.array([0.5, 1.0]), 4).tolist() == [[6.0, 2.0, 6.0, 6.0]]


@pytest.mark.parametrize("seed", range(12))
def test_bodies_that_one_ray_at_most_can_meet_cost_one_ray_and_give_the_same_bits(
    seed, monkeypatch
):
    draw = np.random.default_rng(seed)
    moving, side_m = int(draw.integers(2, 60)), float(draw.choice([3.0, 20.0, 100.0]))
    positions = draw.uniform(-side_m, side_m, (moving + 3, 2))
    if seed % 3 == 0:
        positions = np.round(positions)  # many lie exactly on rays, or midway between two
    radii = np.append(np.full(moving, 0.2), draw.uniform(0.2, 3.0, 3))
    ranges = np.full(moving, float(draw.choice([5.0, 30.0, 200.0])))
    relative = geometry(positions, radii, moving)
    for rays in (1, 2, 3, 8, 36, 90):
        monkeypatch.setattr(sensing, "FEW_PAIRS_MAX", moving * len(radii))
        every_ray = scan(relative, ranges, radii, rays)
        monkeypatch.setattr(sensing, "FEW_PAIRS_MAX", 0)
        assert scan(relative, ranges, radii, rays).tobytes() == every_ray.tobytes()
