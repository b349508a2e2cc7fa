"""Who can capture at all: brute force over placements, and packings that are known."""

from math import cos, pi, sin

import numpy as np
import pytest

from world.capture_bounds import ROBOTS_MIN, most_within
from world.engine import is_captured

MICRON = 2.0**-20


def on_microns(rays):
    return np.rint(np.asarray(rays) / MICRON) * MICRON


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
    assert most_within(stop_m, radius_m, target_m) == most


@pytest.mark.parametrize("stop_m", [1.05, 1.3, 1.6, 2.0, 2.5, 3.5, 5.0])
@pytest.mark.parametrize("target_m", [0.2, 0.5, 1.0])
def test_no_placement_has_more_robots_than_the_bound(stop_m, target_m):
    """Greedy packings at random, which can come close to the densest and never beyond it."""
    radius_m, found = 0.5, 0
    draws = np.random.default_rng(int(stop_m * 100 + target_m * 10))
    nearest_m = radius_m + target_m
    if nearest_m > stop_m:
        pytest.skip("the bodies cannot come so near")
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
    assert max(found, rings) <= most_within(stop_m, radius_m, target_m)
