"""Measures of choice against cases worked out by hand, and enumeration of all assignments."""

from itertools import permutations
from math import isnan, pi, sin, sqrt

import numpy as np
import pytest
from helpers_measures import RING_M, SQUARE, scenario, standing
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.agents.planning.ring import encirclement_points
from encircle.measures import choice

CHEAP = settings(max_examples=60, deadline=None, derandomize=True)
NOWHERE = (np.nan, np.nan)


def turned(goals, angle_rad):
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.asarray(goals) @ np.array([[c, s], [-s, c]])


def test_four_robots_at_their_own_points_have_no_quarrel():
    log = standing(5)
    found = [choice.conflict_share, choice.conflict_pairs_mean, choice.switches]
    found += [choice.switch_share, choice.xi_disagreement_share, choice.xi_spread_ticks_mean]
    assert [measure(log) for measure in found] == [0.0] * 6
    assert choice.regret_m_mean(log) == pytest.approx(0.0, abs=1e-12)
    assert choice.regret_defined_share(log) == 1.0


def test_goals_nearer_than_a_body_are_one_point():
    goals = standing(4).goals
    goals[1, 0] = goals[1, 1] + (0.99, 0.0)
    goals[2, :3] = goals[2, 3]  # three pairs of three robots, and three more with the fourth
    goals[3, 0] = goals[3, 1] + (1.0, 0.0)
    log = standing(4, goals=goals)
    assert choice.conflicts(log).tolist() == [0, 1, 6, 0]
    assert choice.conflict_share(log) == 0.5
    assert choice.conflict_pairs_mean(log) == pytest.approx(7 / 4)
    assert choice.conflict_ticks(log) == 2.0


def test_numbers_of_points_are_no_places():
    log = standing(3, points=2)
    assert choice.conflict_share(log) == 0.0


def test_a_robot_that_does_not_encircle_holds_no_point():
    points, goals = standing(4).points, np.broadcast_to(SQUARE[0], (4, 4, 2)).copy()
    points[0, 1:] = -1  # one encircles: nothing to compare
    points[1, 2:] = -1  # two do
    goals[2, 1:] = NOWHERE  # a point without a place
    log = standing(4, points=points, goals=goals)
    assert choice.encircling(log).sum(axis=1).tolist() == [1, 2, 1, 4]
    assert choice.conflicts(log).tolist() == [1, 6]
    assert choice.conflict_share(log) == 1.0
    none = standing(4, points=-1)
    assert isnan(choice.conflict_share(none))
    assert isnan(choice.conflict_pairs_mean(none))
    assert isnan(choice.conflict_ticks(none))
    assert isnan(choice.xi_disagreement_share(none))
    assert isnan(choice.switch_share(none))
    assert choice.switches(none) == 0.0
    assert isnan(choice.regret_m_mean(none))
    assert choice.regret_defined_share(none) == 0.0


def test_two_robots_that_exchange_their_points_have_both_switched():
    goals = standing(6).goals
    goals[3:, [0, 1]] = goals[3:, [1, 0]]
    log = standing(6, goals=goals)
    assert choice.switches(log) == 2.0
    assert choice.switch_share(log) == pytest.approx(2 / (5 * 4))


@pytest.mark.parametrize(("share", "switched"), [(0.49, 0.0), (0.51, 1.0)])
def test_a_switch_is_a_jump_of_more_than_half_the_way_to_the_next_point(share, switched):
    jump_m = share * 2 * RING_M * sin(pi / 4)
    goals = standing(2).goals
    goals[1, 3, 0] += jump_m
    assert choice.switches(standing(2, goals=goals)) == switched
    # In a team of two the next point is across the ring, 2 rho away.
    believed = standing(2).believed
    believed[:, 3, 1:3] = NOWHERE
    goals[1, 3, 0] += share * 2 * RING_M - jump_m
    assert choice.switches(standing(2, goals=goals, believed=believed)) == switched
    believed[0] = standing(1).believed  # the team that counts is that of the later tick
    assert choice.switches(standing(2, goals=goals, believed=believed)) == switched


def test_a_new_number_a_turned_ring_or_a_moved_target_is_no_switch():
    still = standing(12)
    goals = np.array([turned(SQUARE, 0.2 * tick) for tick in range(12)])
    estimates = still.estimates
    estimates[6:, :, :2] = (70.0, -30.0)
    goals[6:] += (70.0, -30.0)
    points = (still.points + np.arange(12)[:, None]) % 4
    log = standing(12, goals=goals, estimates=estimates, points=points)
    assert choice.switches(log) == 0.0
    assert choice.switch_chances(log).sum() == 11 * 4


def test_what_happens_while_a_robot_does_not_encircle_is_no_switch():
    goals, points = standing(5).goals, standing(5).points
    goals[3:, 0] = SQUARE[2]
    points[2, 0] = -1
    log = standing(5, goals=goals, points=points)
    assert choice.switches(log) == 0.0
    assert choice.switch_chances(log).sum() == 3 * 4 + 2
    alone = standing(5, 1, goals=[[[0.0, 4.0]]] * 2 + [[[9.0, 0.0]]] * 3)
    assert choice.switches(alone) == 0.0


def test_disagreement_about_xi_is_among_those_who_encircle():
    xi, points = np.zeros((5, 4)), standing(5).points
    xi[1] = [2.0, 2.0, 2.0, 2.0]
    xi[2] = [0.0, 6.0, 1.0, 0.0]
    xi[3] = [0.0, 5.0, 0.0, 0.0]
    points[3, 1] = -1
    xi[4], points[4, :3] = [0.0, 1.0, 2.0, 3.0], -1
    log = standing(5, xi=xi, points=points)
    assert choice.xi_spreads(log).tolist() == [0.0, 0.0, 6.0, 0.0]
    assert choice.xi_disagreement_share(log) == pytest.approx(1 / 4)
    assert choice.xi_spread_ticks_mean(log) == pytest.approx(6 / 4)
    assert isnan(choice.xi_spread_ticks_mean(standing(5, xi=np.nan)))


def test_two_robots_that_go_for_each_others_points_walk_across_the_ring_for_nothing():
    goals = standing(4).goals
    goals[:2, [0, 2]] = goals[:2, [2, 0]]
    log = standing(4, goals=goals)
    assert choice.regrets_m(log).tolist() == pytest.approx([4 * RING_M] * 2 + [0.0] * 2)
    assert choice.regret_m_mean(log) == pytest.approx(2 * RING_M)


def test_a_ring_in_which_everyone_goes_one_further_costs_four_sides_of_the_square():
    log = standing(3, goals=np.roll(SQUARE, 1, axis=0))
    assert choice.regret_m_mean(log) == pytest.approx(4 * RING_M * sqrt(2))


def test_a_contested_point_costs_nothing_if_yielding_leads_to_the_best():
    goals = standing(3).goals
    goals[0, 1] = SQUARE[0]  # r1 and r2 for the first point; r2 yields and finds its own free
    goals[1, :] = SQUARE[3]
    goals[2, 2], goals[2, 3] = SQUARE[1], SQUARE[2]  # r2, r3 for the second; the fourth is free
    found = choice.regrets_m(standing(3, goals=goals)).tolist()
    assert found[:2] == pytest.approx([0.0, 0.0])
    # r3 yields to r2 and takes the fourth point while r4 walks to the third.
    assert found[2] == pytest.approx(2 * RING_M * sqrt(2))


def test_goals_off_the_true_ring_stand_for_its_nearest_points():
    log = standing(3, goals=turned(SQUARE, 0.7) * 0.5 + (0.3, -0.2))
    assert choice.regret_m_mean(log) == pytest.approx(0.0)
    assert choice.regret_m_mean(standing(3, goals=turned(SQUARE, 0.9))) > 1.0


def test_regret_is_defined_where_everyone_encircles():
    points = standing(8).points
    points[5:, 2] = -1
    log = standing(8, points=points)
    assert choice.regrets_m(log).shape == (5,)
    assert choice.regret_defined_share(log) == pytest.approx(5 / 8)


@pytest.mark.parametrize("robots", [1, 3, 4, 6])
def test_the_true_ring_is_that_of_the_robots_code(robots):
    rng = np.random.default_rng(robots)
    positions = rng.uniform(-9.0, 9.0, (21, robots + 1, 2))
    wide = scenario(robots, robot={"ring_radius_m": 2.5})
    if robots > 1:
        # Two that are equally far, on opposite sides, but for rounding noise.
        first, target = positions[:10, 0], positions[:10, robots]
        positions[:10, robots - 1] = target + (1.0 + 1e-12) * (target - first)
    rings = choice.true_rings(standing(20, robots, positions=positions, scenario=wide))
    for ring, row in zip(rings, positions[:-1].tolist(), strict=True):
        *team, target = map(tuple, row)
        expected = encirclement_points(team, target, np.array([target]), 2.5)[0]
        np.testing.assert_allclose(ring, expected, atol=1e-12)


@CHEAP
@given(st.integers(1, 5), st.integers(0, 2**32 - 1))
def test_regret_is_that_of_the_best_of_all_allowed_assignments(robots, seed):
    rng = np.random.default_rng(seed)
    positions = rng.uniform(-9.0, 9.0, (7, robots + 1, 2))
    goals = rng.uniform(-6.0, 6.0, (6, robots, 2)) + positions[:-1, -1:]
    log = standing(6, robots, positions=positions, goals=goals)
    found = choice.regrets_m(log)
    for tick in range(6):
        ring = choice.true_rings(log)[tick]
        costs = np.linalg.norm(positions[tick, :-1, None] - ring, axis=2)
        claims = np.linalg.norm(goals[tick, :, None] - ring, axis=2).argmin(axis=1).tolist()
        totals = {
            p: sum(costs[n, p[n]] for n in range(robots)) for p in permutations(range(robots))
        }
        allowed = [
            total
            for chosen, total in totals.items()
            if all(q in [chosen[n] for n in range(robots) if claims[n] == q] for q in set(claims))
        ]
        assert found[tick] == pytest.approx(min(allowed) - min(totals.values()), abs=1e-9)
    assert (found >= 0.0).all()
