"""The auction: Theorem 1 of Choi, Brunet, How 2009 by trial, and what losses and changes do to it.

Oracles: the sequential greedy algorithm, and the best assignment by scipy.
"""

import pickle
from functools import partial
from math import cos, pi, sin

import numpy as np
import pytest
from helpers_negotiation import (
    CHANNELS,
    Channel,
    Negotiation,
    all_links,
    costs_by_projection,
    costs_mm,
    diameter,
    teams,
)
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment

from encircle.agents.policies.auction import auction

CHEAP = settings(max_examples=60, deadline=None, derandomize=True)
COSTS = {"distance": costs_mm, "projection": costs_by_projection}
KINDS = st.sampled_from(sorted(COSTS))
REBIDS = st.sampled_from([1, 3, 5, 1000])
LINE = [(k, k + 1) for k in range(6)]
QUEUE = [(5.0 + 0.3 * rank, 0.01) for rank in (0, 2, 4, 6, 5, 3, 1)]
"""All want the same points, and who is nearer than the next stands at the line's other end."""


def greedy(costs):
    """Each robot's point by the sequential greedy algorithm: the cheapest pair, and so on."""
    pairs = sorted((costs[i][j], i, j) for i in range(len(costs)) for j in range(len(costs)))
    chosen = {}
    for _, robot, point in pairs:
        if robot not in chosen and point not in chosen.values():
            chosen[robot] = point
    return [chosen[robot] for robot in range(len(costs))]


def agreed(team):
    """What all know of each other's bids, if they all know the same."""
    points = [{r: bid[2] for r, bid in memory.items()} for memory in team.memories]
    return points[0] if all(known == points[0] for known in points) else None


@CHEAP
@given(teams(), REBIDS, KINDS)
@example((QUEUE, LINE), 1000, "distance")
@example((QUEUE, LINE), 1, "distance")
def test_without_loss_it_ends_with_the_greedy_assignment_within_the_known_bound(drawn, rebid, cost):
    positions, links = drawn
    count, longest = len(positions), diameter(len(positions), links)
    team = Negotiation(partial(auction, rebid_ticks=rebid, cost=cost), positions, links)
    expected = greedy(COSTS[cost](positions))
    # The first bids are made at tick 0: (N - 1) D rounds later none changes any more.
    assert team.run((count - 1) * longest + 1) == expected
    team.run(longest)
    assert agreed(team) == dict(enumerate(expected))
    assert [team.step() for _ in range(7)] == [expected] * 7


def test_the_bound_is_reached_up_to_a_few_rounds():
    # Else the test above would pass with any slower algorithm's bound.
    team = Negotiation(partial(auction, rebid_ticks=1000, cost="distance"), QUEUE, LINE)
    expected, rounds = greedy(costs_mm(QUEUE)), 0
    while team.step() != expected:
        rounds += 1
    assert 15 < rounds <= 36


@CHEAP
@given(teams(), KINDS)
def test_the_sum_of_scores_is_at_least_half_of_the_best(drawn, cost):
    positions, links = drawn
    count = len(positions)
    team = Negotiation(partial(auction, cost=cost), positions, links)
    points = team.run(count * diameter(count, links) + 1)
    costs = np.array(COSTS[cost](positions))
    scores = costs.max() - costs
    best = scores[linear_sum_assignment(scores, maximize=True)].sum()
    assert 2 * scores[range(count), points].sum() >= best


@CHEAP
@given(teams(), CHANNELS, REBIDS, KINDS)
def test_after_loss_delay_duplicates_and_another_order_it_ends_the_same(
    drawn, channel, rebid, cost
):
    positions, links = drawn
    count, longest = len(positions), diameter(len(positions), links)
    policy = partial(auction, rebid_ticks=rebid, cost=cost)
    team = Negotiation(policy, positions, links, channel)
    team.run(channel.quiet_tick)
    expected = greedy(COSTS[cost](positions))
    assert team.run(count * longest + 1) == expected
    # What was under way may still come late; it changes nothing.
    assert [team.step() for _ in range(9)] == [expected] * 9


@CHEAP
@given(teams(), REBIDS, KINDS)
def test_who_is_not_heard_directly_is_known_by_the_bids_that_others_pass_on(drawn, rebid, cost):
    positions, links = drawn
    count, longest = len(positions), diameter(len(positions), links)
    policy = partial(auction, rebid_ticks=rebid, bid_age_ticks_max=1000, cost=cost)
    team = Negotiation(policy, positions, links)
    team.planned = [tuple(sorted({k, *team.neighbours[k]})) for k in range(count)]
    # D rounds until all know how many they are, then those of the auction.
    assert team.run((count + 1) * longest + 1) == greedy(COSTS[cost](positions))


@CHEAP
@given(teams(5), CHANNELS)
def test_one_run_is_as_another_and_memory_survives_pickling(drawn, channel):
    positions, links = drawn
    one, other = (Negotiation(auction, positions, links, channel) for _ in range(2))
    for _ in range(30):
        assert one.step() == other.step()
        assert one.decisions == other.decisions
        other.memories = pickle.loads(pickle.dumps(other.memories))


@CHEAP
@given(teams(5), st.integers(0, 4), st.floats(0.0, 2 * pi))
def test_robots_that_see_the_target_a_little_differently_still_take_different_points(
    drawn, off, bearing
):
    positions, _ = drawn
    count = len(positions)
    team = Negotiation(auction, positions, all_links(count))
    seen = [(0.0, 0.0)] * count
    seen[off % count] = (0.4 * cos(bearing), 0.4 * sin(bearing))
    team.targets = seen
    assert sorted(team.run(2 * count + 2)) == list(range(count))
    goals = [decision.goal for decision in team.decisions]
    apart = 2 * 4.0 * sin(pi / count) - 0.4
    # Each goal lies around its own view's target, at most 0.4 m and a step of xi from the others'.
    assert all(
        np.hypot(a[0] - b[0], a[1] - b[1]) > apart - 0.6
        for k, a in enumerate(goals)
        for b in goals[:k]
    )


@CHEAP
@given(teams(5))
def test_the_least_sum_of_projections_is_the_least_sum_of_squared_ways(drawn):
    positions, _ = drawn
    squares = np.array(costs_mm(positions)) ** 2
    rows, points = linear_sum_assignment(costs_by_projection(positions))
    best = squares[linear_sum_assignment(squares)].sum()
    # Costs are whole millimetres, of ways of up to 16 m and a ring of 4 m.
    assert squares[rows, points].sum() - best < len(positions) * 2 * (16_000 + 4_000)


def test_who_stands_out_gets_the_point_there_and_who_is_near_goes_round():
    # By distance r1 holds the point at which it stands, and r2 would have to overtake the target.
    positions = [(4.0, 0.0), (7.0, 0.0)]
    for cost, points in (("distance", [0, 1]), ("projection", [1, 0])):
        team = Negotiation(partial(auction, cost=cost), positions, [(0, 1)])
        assert team.run(4) == points


def test_a_robot_changes_its_mind_when_its_bid_is_old_and_no_sooner():
    positions = [(5.0, 0.1), (-6.0, 0.0)]
    team = Negotiation(partial(auction, rebid_ticks=5), positions, [(0, 1)])
    assert team.run(3) == [0, 1]
    team.positions = positions[::-1]
    # Both bids were made at tick 0. r1's old one is still the price of its point at tick 5.
    assert [team.step() for _ in range(2)] == [[0, 1]] * 2
    assert [bid[0] for bid in team.memories[0].values()] == [0, 0]
    team.step()
    assert [team.memories[robot][robot][0] for robot in range(2)] == [5, 5]
    assert team.run(6) == [1, 0]


def test_a_lost_robot_leaves_the_ring_and_comes_back_to_it():
    positions = [(6.0, 0.0), (0.0, 6.0), (-6.0, 0.0), (0.0, -6.0)]
    team = Negotiation(auction, positions, all_links(4))
    assert team.run(6) == [0, 1, 2, 3]
    team.silent = {3}
    team.planned = [(0, 1, 2)] * 3 + [(0, 1, 2, 3)]
    # Its bid is passed on for 20 ticks, though nobody plans with it any more.
    assert team.run(30) == [*greedy(costs_by_projection(positions[:3])), None]
    team.silent, team.planned = set(), [(0, 1, 2, 3)] * 4
    assert team.run(8) == [0, 1, 2, 3]


def test_a_robot_that_has_lost_the_target_passes_bids_on_and_bids_for_nothing():
    positions = [(6.0, 0.0), (0.0, 6.0), (-6.0, 0.0)]
    team = Negotiation(auction, positions, [(0, 1), (1, 2)])
    team.targets = [(0.0, 0.0), None, (0.0, 0.0)]
    team.run(4)
    said = team.decisions[1].say["bids"]
    assert team.decisions[1].mode == "search"
    assert {entry[0] for entry in said} == {0, 2}
    assert len({team.decisions[0].point, team.decisions[2].point}) == 2


@pytest.mark.parametrize("seed", range(3))
def test_with_loss_that_never_stops_nobody_fails_and_conflicts_are_rare(seed):
    random = np.random.default_rng(seed)
    positions = [tuple(place) for place in random.uniform(-9.0, 9.0, (5, 2)).tolist()]
    channel = Channel(0.5, 0.2, 4, quiet_tick=10_000, seed=seed)
    team = Negotiation(auction, positions, all_links(5), channel)
    settled = [team.step() for _ in range(120)][60:]
    assert all(sorted(points) == list(range(5)) for points in settled)
