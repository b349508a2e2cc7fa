"""What a capture is and who can make one: brute force over placements, and known packings."""

from math import cos, hypot, pi, sin

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from encircle.world.arena.capture import ROBOTS_MIN, is_captured, robots_within_max

MICRON = 2.0**-20


def on_microns(rays):
    return np.rint(np.asarray(rays) / MICRON) * MICRON


def surrounded(rays):
    """No half-plane holds them all: each has another less than half a turn on from it."""
    return all(any(ax * by - ay * bx > 0.0 for bx, by in rays) for ax, ay in rays)


@settings(deadline=None, derandomize=True, max_examples=400)
@given(
    polar=st.lists(st.tuples(st.floats(-pi, pi), st.floats(1.0, 1.7)), min_size=1, max_size=7),
    count=st.integers(2, 5),
)
def test_captured_means_enough_robots_close_that_no_half_plane_holds(polar, count):
    rays = [(d * cos(b), d * sin(b)) for b, d in polar]
    close = [ray for ray in rays if hypot(*ray) <= 1.3]
    crosses = [a[0] * b[1] - a[1] * b[0] for a in close for b in close if a is not b]
    assume(all(abs(cross) > 1e-9 for cross in crosses))
    assume(all(abs(hypot(*ray) - 1.3) > 1e-9 for ray in rays))
    captured = is_captured(np.array(rays), 1.3, count)
    assert captured == (len(close) >= count and surrounded(close))


def test_a_robot_exactly_at_the_stop_distance_counts_and_opposite_ones_do_not_enclose():
    ring = np.array([[1.25, 0.0], [0.0, 1.25], [-1.25, 0.0], [0.0, -1.25]])
    assert is_captured(ring, 1.25, 4)
    assert not is_captured(ring * 1.0000001, 1.25, 4)
    assert not is_captured(ring[[0, 2]], 1.25, 2)
    assert not is_captured(ring[[0, 1, 2]], 1.25, 3)


@pytest.mark.parametrize("count", [1, 2])
def test_one_or_two_robots_never_capture_wherever_they_stand(count):
    draws = np.random.default_rng(count)
    for _ in range(5000):
        assert not is_captured(on_microns(draws.uniform(-1.0, 1.0, (count, 2))), 2.0, count)


def test_two_robots_on_opposite_sides_of_the_target_leave_a_gap_of_pi_and_never_capture():
    draws = np.random.default_rng(3)
    for ray in draws.integers(-400_000, 400_000, (5000, 2)):
        for times in (1, 2, 3):
            assert not is_captured(np.array([ray, -times * ray]) * MICRON, 2.0, 2)


@pytest.mark.parametrize("robots", [3, 4])
def test_a_gap_of_exactly_pi_is_no_capture_on_whichever_bearing(robots):
    """Two on opposite sides, the others on one side of the line through them, in whole microns."""
    draws = np.random.default_rng(robots)
    for _ in range(5000):
        ray, *others = draws.integers(-400_000, 400_000, (robots - 1, 2)).tolist()
        side = [ray[0] * y - ray[1] * x for x, y in others]
        others = [o if s > 0 else [-o[0], -o[1]] for o, s in zip(others, side, strict=True) if s]
        times = int(draws.integers(1, 4))
        opposite = [-times * part for part in ray]
        assert not is_captured(np.array([ray, opposite, *others]) * MICRON, 2.0, 2)


def test_three_robots_can_capture():
    ring = [(cos(2 * pi * k / ROBOTS_MIN), sin(2 * pi * k / ROBOTS_MIN)) for k in range(ROBOTS_MIN)]
    assert is_captured(on_microns(ring), 1.0 + MICRON, ROBOTS_MIN)


@pytest.mark.parametrize(
    ("stop_m", "radius_m", "target_m", "most"),
    [
        # Equal coins around a coin: six. Seven around a disc of radius r (1 / sin(pi / 7) - 1).
        (1.0, 0.5, 0.5, 6),
        (0.5 / sin(pi / 7), 0.5, 0.5 / sin(pi / 7) - 0.5, 7),
        (0.5 / sin(pi / 7) - 1e-6, 0.5, 0.5 / sin(pi / 7) - 0.5 - 1e-6, 6),
        (1.3, 0.5, 0.5, 7),
        # Large bodies around a small target: three touch each other at 2 / sqrt(3) radii.
        (1.1, 1.0, 0.1, 2),
        (2.0 / 3.0**0.5 + 1e-9, 1.0, 0.1, 3),
    ],
)
def test_as_many_have_room_as_in_known_packings(stop_m, radius_m, target_m, most):
    assert robots_within_max(stop_m, radius_m, target_m) == most


@pytest.mark.parametrize("target_m", [0.2, 0.5, 1.0])
@pytest.mark.parametrize("room_m", [0.0, 0.05, 0.3, 0.6, 1.0, 1.5, 2.5, 4.0])
def test_no_placement_has_more_robots_than_the_bound(room_m, target_m):
    """Greedy packings at random and rings, close to the densest and never beyond it."""
    radius_m, found = 0.5, 0
    draws = np.random.default_rng(int(room_m * 100 + target_m * 10))
    nearest_m = radius_m + target_m
    stop_m = nearest_m + room_m
    for _ in range(20):
        placed = np.empty((0, 2))
        for _ in range(400):
            # Rings are dense: distances at either end as often as between.
            distance_m = draws.choice([nearest_m, stop_m, draws.uniform(nearest_m, stop_m)])
            bearing = draws.uniform(-pi, pi)
            place = distance_m * np.array([cos(bearing), sin(bearing)])
            if (np.hypot(*(placed - place).T) >= 2 * radius_m).all():
                placed = np.vstack([placed, place])
        found = max(found, len(placed))
    rings = sum(
        int(pi / np.arcsin(radius_m / d_m) + 1e-9)
        for d_m in np.arange(stop_m, nearest_m - 1e-9, -2 * radius_m)
        if d_m >= radius_m
    )
    assert max(found, rings) <= robots_within_max(stop_m, radius_m, target_m)
