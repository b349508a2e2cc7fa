"""The numbers of one tick, in closed form and by brute force."""

from itertools import combinations
from math import asin, dist, pi, sqrt

import numpy as np
import pytest

from encircle.protocol.messages import Command, State
from encircle.scene.radio_watch import age_mean
from encircle.scene.values import TruthValues, conflicts
from encircle.world.loading.load import load

SQUARE = ((4.0, 0.0), (0.0, 4.0), (-4.0, 0.0), (0.0, -4.0))


def state(robots, target=(0.0, 0.0)):
    return State(3, tuple(robots), (0.0,) * len(robots), target, False, ())


def command(robot, goal, point=0):
    return Command(robot, 3, (0.0, 0.0), "encircle", 0.0, point, goal, None, None, ())


def truth(ratio=0.75):
    return TruthValues(
        load({"team": {"robots": 4, "step_m_max": 0.3}, "target": {"step_m_max": 0.3 / ratio}})
    )


def test_a_square_has_quarters_of_a_turn_between_its_corners():
    values, everybody = truth(), (True,) * 4
    moved = [(x + 2.0, y - 1.0) for x, y in SQUARE]
    seen = state(moved, (2.0, -1.0))
    assert values.distances_m(seen) == pytest.approx((4.0,) * 4)
    assert values.gap_rad(seen, everybody) == pytest.approx(pi / 2)
    half = asin(0.75) + asin(1.3 / 4.0)
    assert values.slack_rad(seen, everybody) == pytest.approx(2.0 * half - pi / 2)


@pytest.mark.parametrize(
    ("there", "gap_rad"),
    [
        ((True, True, False, True), pi),
        ((True, True, False, False), 1.5 * pi),
        ((False, True, False, False), 2.0 * pi),
        ((False,) * 4, 2.0 * pi),
    ],
)
def test_who_is_lost_closes_no_gap(there, gap_rad):
    values = truth()
    assert values.gap_rad(state(SQUARE), there) == pytest.approx(gap_rad)
    slack = values.slack_rad(state(SQUARE), there)
    assert (slack is None) == (not any(there))


def test_two_that_hold_one_point_are_a_conflict():
    same = {robot: command(robot, (1.0, 1.0)) for robot in ("r1", "r2")}
    assert conflicts(same, 0.5) == 1
    assert conflicts({**same, "r2": command("r2", (1.0, 1.0), point=None)}, 0.5) == 0
    assert conflicts({**same, "r2": command("r2", None)}, 0.5) == 0
    # A body's diameter apart both could stand.
    assert conflicts({**same, "r2": command("r2", (1.0 + 0.999, 1.0))}, 0.5) == 1
    assert conflicts({**same, "r2": command("r2", (1.0 + 1.001, 1.0))}, 0.5) == 0
    assert conflicts({}, 0.5) == 0


def test_conflicts_are_those_of_all_pairs():
    draws = np.random.default_rng(3)
    for _ in range(50):
        goals = draws.uniform(0.0, sqrt(8.0), (6, 2)).tolist()
        commands = {f"r{k}": command(f"r{k}", tuple(goal)) for k, goal in enumerate(goals)}
        expected = sum(dist(a, b) < 1.0 for a, b in combinations(goals, 2))
        assert conflicts(commands, 0.5) == expected


def test_the_mean_age_is_of_the_links_whose_ends_are_there():
    ages = ((0, 2, -1), (4, 0, 6), (1, 1, 0))
    everybody = (True, True, True)
    assert age_mean(ages, everybody, 9, True) == pytest.approx((2 + 10 + 4 + 6 + 1 + 1) / 6)
    # Of who came later it is not known whether something had arrived before.
    assert age_mean(ages, everybody, 9, False) == pytest.approx((2 + 4 + 6 + 1 + 1) / 5)
    assert age_mean(ages, (True, True, False), 9, True) == pytest.approx(3.0)
    assert age_mean(ages, (True, False, False), 9, True) is None
