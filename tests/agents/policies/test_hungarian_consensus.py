"""Hungarian consensus: the best assignment as soon as rows have spread, by scipy's account."""

from functools import partial

import numpy as np
import pytest
from helpers_negotiation import (
    CHANNELS,
    RING_M,
    Channel,
    Negotiation,
    all_links,
    costs_mm,
    diameter,
    teams,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment

from encircle.agents.policies.hungarian_consensus import hungarian_consensus

CHEAP = settings(max_examples=80, deadline=None, derandomize=True)
RENEWALS = st.sampled_from([1, 3, 5, 1000])


def best_mm(positions):
    costs = np.array(costs_mm(positions))
    return costs[linear_sum_assignment(costs)].sum()


def is_best(positions, points):
    """Whether this is a way to share the points out, and none is shorter in whole centimetres."""
    count = len(positions)
    costs = np.array(costs_mm(positions))
    # Rays travel in whole millimetres, so two ways may be equally short there and not quite here.
    close = costs[range(count), points].sum() - best_mm(positions) <= 2 * count
    return sorted(points) == list(range(count)) and close


@CHEAP
@given(teams(), RENEWALS)
def test_it_is_the_best_assignment_as_soon_as_rows_have_spread(drawn, renew):
    positions, links = drawn
    team = Negotiation(partial(hungarian_consensus, renew_ticks=renew), positions, links)
    points = team.run(diameter(len(positions), links) + 1)
    assert is_best(positions, points)
    assert [team.step() for _ in range(7)] == [points] * 7


def test_it_is_not_known_sooner_than_rows_have_spread():
    # A robot that is heard of last stands where it changes what is best for the first.
    positions = [(6.0, 0.5), (6.5, 0.0), (-6.0, 0.0), (6.2, 0.2)]
    links = [(0, 1), (1, 2), (2, 3)]
    policy = partial(hungarian_consensus, row_age_ticks_max=1000)
    team = Negotiation(policy, positions, links)
    team.planned = [(0, 1), (0, 1, 2), (1, 2, 3), (2, 3)]
    assert not is_best(positions, team.run(3))
    assert is_best(positions, team.step())


@CHEAP
@given(teams(), CHANNELS, RENEWALS)
def test_after_loss_delay_duplicates_and_another_order_it_is_best_all_the_same(
    drawn, channel, renew
):
    positions, links = drawn
    policy = partial(hungarian_consensus, renew_ticks=renew)
    team = Negotiation(policy, positions, links, channel)
    team.run(channel.quiet_tick)
    points = team.run(diameter(len(positions), links) + 1)
    assert is_best(positions, points)
    assert [team.step() for _ in range(9)] == [points] * 9


@CHEAP
@given(teams(5), CHANNELS)
def test_one_run_is_as_another(drawn, channel):
    one, other = (Negotiation(hungarian_consensus, *drawn, channel) for _ in range(2))
    for _ in range(30):
        assert one.step() == other.step()
        assert one.decisions == other.decisions


@CHEAP
@given(teams(5), st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1)), min_size=5, max_size=5))
def test_robots_with_different_views_of_the_target_solve_one_and_the_same_problem(drawn, errors):
    positions, _ = drawn
    count = len(positions)
    team = Negotiation(hungarian_consensus, positions, all_links(count))
    team.targets = errors[:count]
    points = team.run(3)
    # What each robot believes its own row to be is what counts for all.
    seen = [(x - ex, y - ey) for (x, y), (ex, ey) in zip(positions, errors[:count], strict=True)]
    assert is_best(seen, points)


def test_rays_are_renewed_at_common_ticks_and_by_then_all_have_changed():
    positions = [(6.0, 0.0), (-6.0, 0.0)]
    team = Negotiation(partial(hungarian_consensus, renew_ticks=10), positions, [(0, 1)])
    assert team.run(3) == [0, 1]
    team.positions = positions[::-1]
    assert team.run(7) == [0, 1]
    team.step()
    assert team.step() == [1, 0]


def test_a_lost_robot_leaves_the_ring_and_comes_back_to_it():
    positions = [(6.0, 0.0), (0.0, 6.0), (-6.0, 0.0), (0.0, -6.0)]
    team = Negotiation(hungarian_consensus, positions, all_links(4))
    assert team.run(3) == [0, 1, 2, 3]
    team.silent = {3}
    team.planned = [(0, 1, 2)] * 3 + [(0, 1, 2, 3)]
    assert is_best(positions[:3], team.run(30)[:3])
    team.silent, team.planned = set(), [(0, 1, 2, 3)] * 4
    assert team.run(7) == [0, 1, 2, 3]


def test_who_has_said_no_ray_is_where_it_is_believed_to_be():
    positions = [(6.0, 0.0), (5.0, 0.0), (-6.0, 0.0)]
    team = Negotiation(hungarian_consensus, positions, [])
    assert is_best(positions, team.run(1))


def test_robots_that_say_nothing_go_by_where_they_believe_the_others_to_be():
    positions = [(6.0, 0.0), (5.0, 0.0), (-6.0, 0.0)]
    policy = partial(hungarian_consensus, say_rows=False)
    team = Negotiation(policy, positions, all_links(3))
    assert is_best(positions, team.run(1))
    team.positions = [positions[2], positions[1], positions[0]]
    # Nothing has to be renewed or spread.
    assert is_best(team.positions, team.step())
    assert not any(decision.say for decision in team.decisions)


def test_a_robot_that_has_lost_the_target_passes_rows_on_and_says_none_of_its_own():
    positions = [(6.0, 0.0), (0.0, 6.0), (-6.0, 0.0)]
    team = Negotiation(hungarian_consensus, positions, [(0, 1), (1, 2)])
    team.targets = [(0.0, 0.0), None, (0.0, 0.0)]
    team.run(4)
    said = team.decisions[1].say["rows"]
    assert team.decisions[1].mode == "search"
    assert {entry[0] for entry in said} == {0, 2}


@pytest.mark.parametrize("seed", range(3))
def test_with_loss_that_never_stops_bodies_that_stand_still_are_agreed_on(seed):
    random = np.random.default_rng(seed)
    positions = [tuple(place) for place in random.uniform(-9.0, 9.0, (5, 2)).tolist()]
    channel = Channel(0.5, 0.2, 4, quiet_tick=10_000, seed=seed)
    team = Negotiation(hungarian_consensus, positions, all_links(5), channel)
    settled = [team.step() for _ in range(90)][30:]
    assert all(is_best(positions, points) for points in settled)


def test_the_way_goes_to_the_ring_around_where_the_target_will_be():
    team = Negotiation(hungarian_consensus, [(9.0, 0.0)], [])
    team.step()
    decision = team.decisions[0]
    # Alone, the variance of Eq. 2 is 0 for all steps, and the smallest is taken.
    assert (decision.mode, decision.xi, decision.point) == ("encircle", 0.0, 0)
    assert decision.goal == pytest.approx((RING_M, 0.0))
    assert decision.step == pytest.approx((RING_M - 9.0, 0.0))
