"""Closed ring: the slack it maximises by brute force, when it is closed by theory, and hunts."""

from math import asin, atan2, cos, hypot, pi, sin

import numpy as np
import pytest
from helpers_agents import view_of
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import encircle
from encircle.agents.estimation.kalman import Estimate
from encircle.agents.policies.closed_ring import closed_ring
from encircle.agents.policies.interface import Decision
from encircle.protocol.parameters import Parameters

P = Parameters()
CHEAP = settings(max_examples=80, deadline=None, derandomize=True)
bearings = st.floats(-pi, pi)
distances = st.floats(1.1, 12.0)
rings = st.lists(st.tuples(bearings, distances), min_size=1, max_size=8)


def placed(ring):
    return [(distance * cos(bearing), distance * sin(bearing)) for bearing, distance in ring]


def view(positions, own=0, velocity=(3.0, 0.0)):
    """A view of a target at the origin that runs at 3 m/s, a robot's full speed."""
    seen = view_of(positions, own, (0.0, 0.0), lambda grid: pytest.fail("it predicts nothing"))
    return seen._replace(target=Estimate(0.0, 0.0, *velocity, (1e-4, 0.0, 1.0)))


def decided(seen, memory=None, **parameters):
    return closed_ring(memory, seen, **parameters)[1]


def in_and_aside(seen, step):
    """A step's parts towards the target and counter-clockwise about it."""
    x, y = seen.position
    distance = hypot(x, y)
    return -(step[0] * x + step[1] * y) / distance, (step[1] * x - step[0] * y) / distance


@pytest.mark.parametrize("count", [2, 3, 4])
def test_robots_in_one_line_with_the_target_leave_it_to_both_sides(count):
    # Between the last of them and the first is the whole turn, not nothing.
    line = [(5.0 + 2.0 * k, 0.0) for k in range(count)]
    aside = [in_and_aside(view(line, k), decided(view(line, k)).step)[1] for k in range(count)]
    assert min(aside) < -0.1
    assert max(aside) > 0.1


def lesser_slack(bearing, others, half_rad):
    """The lesser of a robot's two slacks were it at ``bearing``, all half-angles being equal."""
    ahead = min((other - bearing) % (2 * pi) for other in others)
    behind = min((bearing - other) % (2 * pi) for other in others)
    return 2 * half_rad - max(ahead, behind)


@CHEAP
@given(ring=st.lists(st.tuples(bearings, st.floats(5.0, 12.0)), min_size=2, max_size=8))
def test_its_goal_has_the_greatest_lesser_slack_of_all_between_its_neighbours(ring):
    own, *others = [bearing for bearing, _ in ring]
    gaps = [abs((other - own + pi) % (2 * pi) - pi) for other in others]
    assume(min(gaps) > 0.01)
    seen = view(placed(ring), velocity=(6.0, 0.0))
    decision = decided(seen)
    assume(decision.mode == "encircle")
    goal = atan2(decision.goal[1], decision.goal[0])
    ahead = min((other - own) % (2 * pi) for other in others)
    behind = min((own - other) % (2 * pi) for other in others)
    moves = own + np.linspace(-behind, ahead, 2003)[1:-1]
    best = max(lesser_slack(bearing, others, 0.5) for bearing in moves)
    assert lesser_slack(goal, others, 0.5) >= best - 1e-9
    assert hypot(*decision.goal) == pytest.approx(ring[0][1])
    aside = in_and_aside(seen, decision.step)[1]
    turn = (goal - own + pi) % (2 * pi) - pi
    assert aside * turn > 0.0 or abs(turn) < 1e-6 or abs(abs(turn) - pi) < 1e-6


@pytest.mark.parametrize("count", range(3, 9))
@pytest.mark.parametrize("ratio", [0.45, 0.6, 0.75, 0.95])
def test_an_even_ring_far_out_is_closed_by_as_many_robots_as_theory_wants(count, ratio):
    far = placed([(2 * pi * k / count, 1e6) for k in range(count)])
    seen = view(far, velocity=(3.0 / ratio, 0.0))
    closed = count >= pi / asin(ratio)
    assert decided(seen, margin_rad=0.0).mode == ("shrink" if closed else "encircle")


def test_the_ring_is_closed_for_the_speed_of_late_not_of_now():
    even = placed([(pi * k / 2, 8.0) for k in range(4)])
    still, running = view(even, velocity=(0.0, 0.0)), view(even, velocity=(8.0, 0.0))
    memory, decision = closed_ring(None, running)
    assert (memory, decision.mode) == (8.0, "encircle")
    memory, decision = closed_ring(memory, still)
    assert decision.mode == "encircle"
    assert memory == pytest.approx(6.4)
    for _ in range(20):
        memory, decision = closed_ring(memory, still)
    assert decision.mode == "shrink"


@CHEAP
@given(ring=rings, own=st.integers(0, 7), speed=st.floats(0.0, 8.0), heading=bearings)
def test_a_step_is_whole_and_keeps_its_distances(ring, own, speed, heading):
    own %= len(ring)
    seen = view(placed(ring), own, (speed * cos(heading), speed * sin(heading)))
    decision = decided(seen)
    distance, mean = ring[own][1], sum(d for _, d in ring) / len(ring)
    inward, aside = in_and_aside(seen, decision.step)
    assert hypot(*decision.step) <= P.step_m_max + 1e-9
    assert inward >= -1e-9
    if distance <= P.stop_distance_m:
        assert inward <= 1e-9
    if decision.mode == "encircle" and distance > 4.0:
        assert inward <= max(0.0, distance - max(4.0, mean - 0.5)) + 1e-9
    limit = 0.99 * P.step_m_max
    assert abs(aside) <= limit + 1e-9


def test_only_those_whose_gap_the_target_runs_into_may_spend_all_aside():
    # East, and two close together in the west: the target runs north-east, between r1 and r2.
    ring = placed([(0.0, 4.0), (pi - 0.2, 4.0), (pi + 0.6, 4.0)])
    velocity = (3.5 * cos(0.7), 3.5 * sin(0.7))
    shares = [
        abs(in_and_aside(seen, decided(seen, hold_m=0.0, lead_m=50.0).step)[1]) / P.step_m_max
        for seen in (view(ring, own, velocity) for own in range(3))
    ]
    assert shares == pytest.approx([0.99, 0.99, 0.9])


def test_two_at_one_bearing_part():
    ring = placed([(1.0, 5.0), (1.0, 7.0), (-2.0, 5.0)])
    turns = [in_and_aside(view(ring, own), decided(view(ring, own)).step)[1] for own in (0, 1)]
    assert turns[0] * turns[1] < 0.0


def test_alone_it_goes_straight_for_the_target():
    seen = view([(9.0, 0.0)])
    assert decided(seen, lead_m=1.0).step == pytest.approx((-P.step_m_max, 0.0))


def test_without_an_estimate_it_searches_and_remembers():
    search = Decision("search", (0.1, 0.0), (3.0, 0.0))
    seen = view_of([(0.0, 0.0)], 0, None, lambda grid: pytest.fail("there is none"), search=search)
    assert closed_ring(2.5, seen) == (2.5, search)


def test_a_faster_target_is_captured_from_more_starts_than_by_the_paper_s_policy():
    captures = {}
    for policy in ("xi-star", "closed-ring"):
        scenario = {
            "ticks_max": 120,
            "team": {"robots": 6, "strategy": policy},
            "target": {"step_m_max": 0.36},
        }
        captures[policy] = sum(
            encircle.run(scenario, seed=seed, link="memory").captured for seed in range(1, 9)
        )
    assert captures["closed-ring"] >= captures["xi-star"] + 3
