"""Strategies: the paper's choice rebuilt from its parts, the fixed steps, pursuit, and the drift.

The main oracle enumerates: for each xi the ring of Eq. 1, the shortest permutation, the variance of
Eq. 2 weighted as in Eq. 3.
"""

import tomllib
from dataclasses import replace
from itertools import permutations
from math import atan2, cos, exp, hypot, pi, sin

import numpy as np
import pytest
from helpers_agents import view_of
from helpers_paths import ROOT
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from encircle.agents.policies.interface import View
from encircle.agents.policies.paper import pursue, xi_0, xi_1, xi_3, xi_star
from encircle.agents.policies.registry import policy_named
from encircle.protocol.parameters import Parameters
from encircle.protocol.plugins import SHIPPED_POLICIES, STRATEGIES

CHEAP = settings(max_examples=60, deadline=None, derandomize=True)
P = Parameters()
coordinates = st.floats(-15.0, 15.0)
places = st.tuples(coordinates, coordinates)
teams = st.lists(places, min_size=1, max_size=5)
DRIFT = (0.2, -0.1)


def view(positions, own=0, target=(0.0, 0.0), drift=DRIFT, parameters=P, goal=None):
    """A view in which the target is predicted to move on by ``drift`` per step."""

    def predict(grid):
        steps = np.array(grid)[:, None]
        return np.array(target) + steps * np.array(drift), "velocity"

    return view_of(positions, own, target, predict, parameters, goal)


def decided(seen, policy=xi_star):
    memory, decision = policy(None, seen)
    assert memory is None
    return decision


def planned(positions, target, grid):
    """For each xi: weighted variance and each robot's point, by enumeration."""
    count = len(positions)
    distances = [hypot(x - target[0], y - target[1]) for x, y in positions]
    far = positions[distances.index(max(distances))]
    bearing = atan2(far[1] - target[1], far[0] - target[0])
    plans = []
    for xi in grid:
        cx, cy = target[0] + xi * DRIFT[0], target[1] + xi * DRIFT[1]
        angles = [bearing + 2 * pi * q / count for q in range(count)]
        ring = [(cx + 4 * cos(a), cy + 4 * sin(a)) for a in angles]
        ways = []
        for way in permutations(range(count)):
            legs = [
                hypot(x - ring[q][0], y - ring[q][1])
                for (x, y), q in zip(positions, way, strict=True)
            ]
            ways.append((sum(legs), way, legs))
        ways.sort()
        clear = len(ways) == 1 or ways[1][0] - ways[0][0] > 1e-4
        plans.append((exp(0.05 * xi) * float(np.var(ways[0][2])), ways[0][1], ring, clear))
    return plans


@CHEAP
@given(teams, places, st.data())
def test_a_robot_heads_for_its_point_of_the_ring_at_xi_star(positions, target, data):
    farthest = max(hypot(x - target[0], y - target[1]) for x, y in positions)
    assume(farthest > 6.01)  # beyond k1 rho of someone: nobody shrinks
    plans = planned(positions, target, P.xi_grid)
    weighted = sorted(plan[0] for plan in plans)
    assume(all(plan[3] for plan in plans) and weighted[1] - weighted[0] > 1e-6)
    xi = min(range(7), key=lambda k: plans[k][0])
    own = data.draw(st.integers(0, len(positions) - 1))
    choice = decided(view(positions, own, target))
    point = plans[xi][1][own]
    assert (choice.mode, choice.xi, choice.point) == ("encircle", float(xi), point)
    assert choice.goal == pytest.approx(plans[xi][2][point])
    x, y = positions[own]
    assert choice.step == pytest.approx((choice.goal[0] - x, choice.goal[1] - y))
    assert choice.predictor == "velocity"


@CHEAP
@given(st.lists(places, min_size=2, max_size=6), places)
def test_robots_with_the_same_view_go_to_different_points(positions, target):
    assume(max(hypot(x - target[0], y - target[1]) for x, y in positions) > 6.01)
    choices = [decided(view(positions, own, target)) for own in range(len(positions))]
    assert sorted(choice.point for choice in choices) == list(range(len(positions)))
    assert len({choice.xi for choice in choices}) == 1


@pytest.mark.parametrize(("strategy", "xi"), [(xi_0, 0.0), (xi_1, 1.0), (xi_3, 3.0)])
def test_fixed_steps_look_exactly_that_far_ahead(strategy, xi):
    positions = [(10.0, 0.0), (0.0, 9.0)]
    choice = decided(view(positions), strategy)
    _, way, ring, _ = planned(positions, (0.0, 0.0), (xi,))[0]
    assert (choice.xi, choice.point) == (xi, way[0])
    assert choice.goal == pytest.approx(ring[way[0]])


@CHEAP
@given(teams, places, places, st.data())
def test_a_point_once_chosen_is_kept_unless_another_gains_the_team_enough(
    positions, target, goal, data
):
    assume(max(hypot(x - target[0], y - target[1]) for x, y in positions) > 6.01)
    own = data.draw(st.integers(0, len(positions) - 1))
    free = decided(view(positions, own, target))
    # xi* is chosen as ever, and the ring is the one at xi*.
    _, way, ring, clear = planned(positions, target, (free.xi,))[0]
    assume(clear and way[own] == free.point)
    away = sorted((hypot(x - goal[0], y - goal[1]), q) for q, (x, y) in enumerate(ring))
    assume(len(away) == 1 or away[1][0] - away[0][0] > 1e-6)
    nearest = away[0][1]

    def total(way):
        return sum(
            hypot(x - ring[q][0], y - ring[q][1]) for (x, y), q in zip(positions, way, strict=True)
        )

    ways = list(permutations(range(len(positions))))
    loss = min(total(w) for w in ways if w[own] == nearest) - min(map(total, ways))
    for gain_m in (0.1, 1.0, 30.0):
        assume(abs(loss - gain_m) > 1e-4)
        parameters = replace(P, switch_gain_m=gain_m)
        choice = decided(view(positions, own, target, parameters=parameters, goal=goal))
        assert choice.point == (nearest if loss < gain_m else free.point)
        assert choice.xi == free.xi
        assert choice.goal == pytest.approx(ring[choice.point])
        x, y = positions[own]
        assert choice.step == pytest.approx((choice.goal[0] - x, choice.goal[1] - y))


@CHEAP
@given(teams, places, places)
def test_by_default_and_without_a_point_to_keep_the_choice_is_free(positions, target, goal):
    free = decided(view(positions, 0, target))
    assert decided(view(positions, 0, target, goal=goal)) == free
    keeping = replace(P, switch_gain_m=100.0)
    assert decided(view(positions, 0, target, parameters=keeping)) == free


def test_by_default_a_tie_is_broken_as_ever_whatever_was_chosen_before():
    robots = [(10.0, 0.0), (10.0, 0.0)]
    assert decided(view(robots, 0, drift=(0.0, 0.0))).point == 0
    assert decided(view(robots, 0, drift=(0.0, 0.0), goal=(-4.0, 0.0))).point == 0
    keeping = replace(P, switch_gain_m=1e-6)
    kept = decided(view(robots, 0, (0.0, 0.0), (0.0, 0.0), keeping, (-4.0, 0.0)))
    assert kept.point == 1


def test_a_robot_between_two_points_does_not_turn_back_and_forth():
    # Two robots beside the middle between the two points of the ring that a third one, far off,
    # holds in place. Which of the two is nearer to which point changes with every tick of noise.
    def goals(gain_m):
        goal, found = None, []
        for tick in range(8):
            noise = 0.05 if tick % 2 else -0.05
            robots = [(-1.0, noise), (-1.0, -noise), (10.0, 0.0)]
            parameters = replace(P, switch_gain_m=gain_m, xi_grid=(0.0,))
            goal = decided(view(robots, 0, parameters=parameters, goal=goal)).goal
            found.append(goal[1] > 0.0)
        return found

    assert goals(0.0) == [False, True] * 4
    assert goals(0.01) == [False, True] * 4
    assert goals(0.5) == [False] * 8


def square(radius, count=4):
    return [
        (radius * cos(2 * pi * k / count), radius * sin(2 * pi * k / count)) for k in range(count)
    ]


@pytest.mark.parametrize(("radius", "mode"), [(5.99, "shrink"), (6.01, "encircle")])
def test_robots_shrink_once_all_are_within_k1_rho(radius, mode):
    positions = [(radius, 0.0), *square(4.0)[1:]]
    for own in range(4):
        assert decided(view(positions, own)).mode == mode


def test_robots_near_but_all_on_one_side_do_not_shrink():
    positions = [(4 * cos(angle), 4 * sin(angle)) for angle in (0.0, 0.5, 1.0, 1.5)]
    assert {decided(view(positions, own)).mode for own in range(4)} == {"encircle"}


@pytest.mark.parametrize("count", [3, 4, 5, 8])
def test_in_an_even_ring_everyone_goes_straight_in_by_a_full_step(count):
    positions = square(4.0, count)
    for own, (x, y) in enumerate(positions):
        choice = decided(view(positions, own))
        assert choice.mode == "shrink"
        assert choice.step == pytest.approx((-0.3 * x / 4, -0.3 * y / 4))
        assert choice.goal == (0.0, 0.0)


@pytest.mark.parametrize("strategy", [pursue, xi_star])
def test_at_the_stop_distance_nobody_goes_further_in(strategy):
    for radius in (1.1, 1.3):
        assert hypot(*decided(view(square(radius)), strategy).step) == pytest.approx(0.0, abs=1e-9)
    assert hypot(*decided(view(square(1.31)), strategy).step) > 0.2


def test_the_last_step_stops_short_of_the_target():
    parameters = replace(P, step_m_max=2.0)
    step = decided(view([(3.0, 0.0)], parameters=parameters), pursue).step
    touching = P.radius_m + P.target_radius_m + P.clearance_m
    assert 3.0 + step[0] == pytest.approx(touching)


@CHEAP
@given(places, places)
def test_pursuit_goes_straight_for_the_target_whatever_the_others_do(own, other):
    assume(hypot(*own) > 1.5)
    choice = decided(view([own, other]), pursue)
    scale = 0.3 / hypot(*own)
    assert choice.mode == "pursue"
    assert choice.step == pytest.approx((-own[0] * scale, -own[1] * scale))


def test_a_robot_on_the_target_stays():
    assert decided(view([(0.0, 0.0)]), pursue).step == (0.0, 0.0)


def wrapped(angle):
    return (angle + pi) % (2 * pi) - pi


@settings(CHEAP, max_examples=200)
@given(
    st.lists(st.tuples(st.floats(-pi, pi), st.floats(1.1, 5.9)), min_size=2, max_size=8),
    places,
    st.floats(0.0, 0.5),
)
def test_a_shrinking_robot_drifts_into_the_larger_of_its_two_gaps(ring, target, w):
    # Enclosure is not asked for here: the drift must be right in any formation.
    parameters = replace(P, enclosure_rad=0.0, allowance_rad=w)
    positions = [(target[0] + far * cos(b), target[1] + far * sin(b)) for b, far in ring]
    for own, (bearing, far) in enumerate(ring):
        others = [b for k, (b, _) in enumerate(ring) if k != own]
        ahead = min((b - bearing) % (2 * pi) for b in others)
        behind = min((bearing - b) % (2 * pi) for b in others)
        assume(min(ahead, behind) > 1e-5 and abs(ahead - behind) > 1e-5)
        choice = decided(view(positions, own, target, parameters=parameters))
        assert choice.mode == "shrink"
        assert hypot(*choice.step) <= P.step_m_max + 1e-9
        x = positions[own][0] + choice.step[0] - target[0]
        y = positions[own][1] + choice.step[1] - target[1]
        turn = wrapped(atan2(y, x) - bearing)
        ideal, large, small = 2 * pi / len(ring), max(ahead, behind), min(ahead, behind)
        too_wide = large > ideal + w + 1e-6 and small < ideal + w - 1e-6
        too_narrow = small < ideal - w - 1e-6 and abs(large - ideal) < w - 1e-6
        if too_wide or too_narrow:  # the two cases of Eq. 6
            assert (turn > 0) == (ahead > behind), "into the larger gap"
            assert abs(turn) < (large - small) / 2, "and not past its middle"
        elif abs(turn) > 1e-9:
            assert (turn > 0) == (ahead > behind)
        assert hypot(x, y) <= far + 0.05


def test_the_sideways_step_is_at_most_half_the_way_to_the_middle_of_the_neighbours():
    # At the stop distance, with steps long enough to overshoot: gaps of a quarter turn plus and
    # minus 0.02, so the middle is 0.02 away.
    parameters = replace(P, allowance_rad=0.0, step_m_max=1.0)
    positions = [(1.25 * cos(b), 1.25 * sin(b)) for b in (-0.02, pi / 2, pi, -pi / 2)]
    x, y = decided(view(positions, parameters=parameters)).step
    turn = wrapped(atan2(positions[0][1] + y, positions[0][0] + x) + 0.02)
    assert turn == pytest.approx(0.01, rel=0.01)


@pytest.mark.parametrize("bearings", [(0.0, 0.3, 0.6, 3.3), (0.0, 2.0, 2.2, 4.0), (0, 0.4, 2, 3.5)])
def test_a_lopsided_ring_evens_out_around_a_target_that_stands(bearings):
    parameters = replace(P, enclosure_rad=0.0)
    positions = [(5 * cos(b), 5 * sin(b)) for b in bearings]
    for _ in range(200):
        steps = [decided(view(positions, own, parameters=parameters)).step for own in range(4)]
        positions = [(x + u, y + v) for (x, y), (u, v) in zip(positions, steps, strict=True)]
    around = sorted(atan2(y, x) for x, y in positions)
    gaps = np.diff([*around, around[0] + 2 * pi])
    assert gaps.max() <= pi / 2 + P.allowance_rad + 0.05
    assert all(1.0 <= hypot(x, y) <= P.stop_distance_m + 0.01 for x, y in positions)


def test_names_stand_for_the_same_strategies_here_and_as_entry_points():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    assert project["project"]["entry-points"][STRATEGIES] == SHIPPED_POLICIES
    assert len({policy_named(name) for name in SHIPPED_POLICIES}) == len(SHIPPED_POLICIES)


def test_an_unknown_strategy_is_refused_and_each_known_one_listed_once():
    with pytest.raises(ValueError, match="unknown policy; known are") as caught:
        policy_named("dance")
    listed = str(caught.value).split("known are: ")[1].split(", ")
    assert sorted(listed) == sorted(SHIPPED_POLICIES)


@pytest.mark.parametrize("name", SHIPPED_POLICIES)
def test_a_strategy_is_pure(name):
    seen = view([(5.0, 1.0), (-3.0, 4.0), (0.0, -5.0)], own=1)
    copy = View(*seen)
    assert policy_named(name)(None, seen) == policy_named(name)(None, seen)
    assert seen == copy
