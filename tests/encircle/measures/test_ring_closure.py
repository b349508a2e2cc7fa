"""Closure of the ring against targets that are simulated to run straight ahead, and by hand."""

from math import asin, pi

import numpy as np
import pytest
from helpers_measures import RING_M, polygon, scenario, standing

from encircle.measures import ring_closure
from encircle.measures.registry import measure

NAMES = ["closed_share", "slack_rad_mean", "slack_rad_final"]


def faster(ratio, robots=4, stop_m=1.3):
    """A scenario whose target is so many times as fast as the robots."""
    return scenario(
        robots,
        target={"step_m_max": 0.3 * ratio},
        capture={"stop_distance_m": stop_m},
    )


def met_on_every_heading(robots, ratio, stop_m):
    """Whether somebody comes within reach of a target at the origin, whatever heading it keeps.

    The target runs at 1 m/s; a robot can be wherever its speed has let it come by then.
    """
    times = np.arange(0.0, 200.0, 0.02)
    for heading in np.radians(np.arange(0.0, 360.0, 0.5)):
        target = np.exp(1j * heading) * times
        away = abs((robots @ [1.0, 1j])[:, None] - target)
        if not (away <= times / ratio + stop_m + 1e-6).any():
            return False
    return True


def random_ring(seed):
    """Robots about a faster target, none near enough to capture it; and the log of that."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(3, 7))
    ratio, stop_m = rng.uniform(1.05, 2.0), rng.uniform(1.0, 1.5)
    places = polygon(count) * rng.uniform(0.5, 1.5, (count, 1)) + rng.normal(0.0, 1.0, (count, 2))
    distances_m = np.hypot(*places.T)
    places *= (np.maximum(distances_m, 1.01 * stop_m) / distances_m)[:, None]
    positions = np.vstack([places, [0.0, 0.0]])
    log = standing(1, count, positions=positions, scenario=faster(ratio, count, stop_m))
    return places, ratio, stop_m, measure(log, NAMES)


@pytest.mark.parametrize("seed", range(40))
def test_a_ring_is_closed_if_the_target_is_met_on_every_heading(seed):
    places, ratio, stop_m, found = random_ring(seed)
    if abs(found["slack_rad_mean"]) > np.radians(1.0):  # headings are tried in steps of half of it
        assert found["closed_share"] == met_on_every_heading(places, ratio, stop_m)


def test_the_seeds_above_try_open_and_closed_rings():
    assert 8 <= sum(random_ring(seed)[-1]["closed_share"] for seed in range(40)) <= 32


def test_the_slack_of_an_even_ring_is_a_closed_form():
    log = standing(3, scenario=faster(1.3))
    slack = 2.0 * (asin(1 / 1.3) + asin(1.3 / RING_M)) - pi / 2
    assert measure(log, NAMES) == pytest.approx(dict(zip(NAMES, (1.0, slack, slack), strict=True)))


def test_slack_is_of_ticks_and_a_negative_one_is_open():
    positions = standing(3).positions
    positions[2:, :2] *= 50.0  # two of four far away
    log = standing(3, positions=positions, scenario=faster(1.5))
    found, slacks = measure(log, NAMES), ring_closure.slacks_rad(log)
    assert (slacks >= 0.0).tolist() == [True, True, False, False]
    assert found["closed_share"] == 0.5
    assert found["slack_rad_mean"] == pytest.approx(slacks.mean())
    # Between the two far ones: both halves less a right angle.
    far = 2.0 * (asin(1 / 1.5) + asin(1.3 / (50.0 * RING_M))) - pi / 2
    assert found["slack_rad_final"] == pytest.approx(far)


def test_a_ring_about_a_slower_target_is_always_closed_and_a_target_that_cannot_move_is_slow():
    alone = np.array([[90.0, 0.0], [0.0, 0.0]])
    for step_m in (0.2, 0.0001):
        slow = scenario(1, target={"step_m_max": step_m})
        log = standing(2, 1, positions=alone, scenario=slow)
        assert measure(log, NAMES) == dict(zip(NAMES, (1.0, 0.0, 0.0), strict=True))
    log = standing(2, 1, positions=alone, scenario=faster(1.3, 1))
    assert ring_closure.closed_share(log) == 0.0


def test_a_robot_that_is_lost_occupies_nothing():
    there = np.full((4, 4), True)
    there[2:, 1] = False
    found = measure(standing(4, there=there, scenario=faster(1.5)), NAMES)
    assert found["closed_share"] == pytest.approx(2 / 5)  # ticks 0 and 1 of 0 to 4
    nobody = standing(4, there=np.full((4, 4), False), scenario=faster(1.5))
    assert measure(nobody, NAMES) == pytest.approx(
        dict(zip(NAMES, (0.0, -2 * pi, -2 * pi), strict=True))
    )


def test_in_a_mixed_team_each_robot_occupies_by_its_own_step():
    weak = {"count": 4, "r1": {"step_m_max": 0.1}}
    mixed = scenario(4, team={"robots": weak}, target={"step_m_max": 0.4})
    log = standing(1, scenario=mixed)
    assert ring_closure.speed_ratios(log.scenario) == pytest.approx([0.25, 0.75, 0.75, 0.75])
    weakest = asin(0.25) + asin(0.75) + 2.0 * asin(1.3 / RING_M) - pi / 2
    assert ring_closure.slack_rad_final(log) == pytest.approx(weakest)


@pytest.mark.parametrize("seed", range(40))
def test_all_ticks_at_once_are_as_one_at_a_time_to_the_bit(seed):
    rng = np.random.default_rng(seed)
    count, ticks, capture_m = int(rng.integers(1, 7)), 30, float(rng.choice([0.0, 1.0]))
    bearings = rng.uniform(-4.0, 4.0, (ticks, count))
    bearings[::3] = np.round(bearings[::3])  # some stand one behind the other
    distances_m = rng.uniform(0.1, 5.0, (ticks, count))
    ratios = rng.choice(
        [0.0, 0.4, 0.9, 1.0, 1.2, np.inf], count, p=[0.1, 0.3, 0.3, 0.2, 0.05, 0.05]
    )
    singly = [
        ring_closure.least_slack_rad(bearing, distance_m, ratios.tolist(), capture_m)
        for bearing, distance_m in zip(bearings.tolist(), distances_m.tolist(), strict=True)
    ]
    at_once = ring_closure.least_slacks_rad(bearings, distances_m, ratios.tolist(), capture_m)
    assert at_once.tolist() == singly
