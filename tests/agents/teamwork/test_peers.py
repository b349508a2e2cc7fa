"""The peer table: the newest thing known of each peer, and who belongs to the team."""

from dataclasses import replace

import pytest
from helpers_agents import TICK_S, pose
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.agents.teamwork.peers import incorporate, planning_team
from encircle.protocol.parameters import Parameters

CHEAP = settings(max_examples=80, deadline=None, derandomize=True)
NOBODY = (None, None, None)
P = Parameters()


def packet(index, tick, position, velocity=(0.0, 0.0)):
    return index, pose(f"r{index + 1}", tick, position, velocity)


def test_a_packet_gives_position_and_velocity_per_tick():
    table = incorporate(NOBODY, [packet(1, 4, (1.0, 2.0), (3.0, -5.0))], [], 6, TICK_S)
    assert table[0] is table[2] is None
    assert table[1] == pytest.approx((4, 1.0, 2.0, 0.3, -0.5))


def test_a_late_packet_does_not_overwrite_newer_knowledge():
    table = incorporate(NOBODY, [packet(1, 4, (1.0, 2.0))], [], 6, TICK_S)
    assert incorporate(table, [packet(1, 3, (9.0, 9.0))], [], 7, TICK_S) == table
    assert incorporate(table, [packet(1, 4, (9.0, 9.0))], [], 7, TICK_S) == table
    assert incorporate(table, [packet(1, 5, (9.0, 9.0))], [], 7, TICK_S)[1][:3] == (5, 9.0, 9.0)


@CHEAP
@given(
    st.lists(st.tuples(st.integers(1, 2), st.integers(0, 9)), min_size=1, unique=True),
    st.randoms(use_true_random=False),
)
def test_the_newest_packet_of_each_peer_counts_whatever_the_order(heard, random):
    packets = [packet(index, tick, (float(tick), float(index))) for index, tick in heard]
    shuffled = packets[:]
    random.shuffle(shuffled)
    table = incorporate(NOBODY, shuffled, [], 10, TICK_S)
    assert table == incorporate(NOBODY, packets, [], 10, TICK_S)
    for index in (1, 2):
        ticks = [tick for i, tick in heard if i == index]
        assert (table[index][0] if ticks else None) == max(ticks, default=None)


def test_a_peer_in_sight_is_where_it_is_seen_whatever_it_said():
    table = incorporate(NOBODY, [packet(1, 4, (1.0, 2.0))], [(1, 5.0, 6.0)], 8, TICK_S)
    # Four ticks from (1, 2) to (5, 6): a metre per tick on both axes.
    assert table[1] == (8, 5.0, 6.0, 1.0, 1.0)


def test_two_sightings_give_the_velocity_in_between():
    table = incorporate(NOBODY, [], [(2, 1.0, 1.0)], 3, TICK_S)
    assert table[2] == (3, 1.0, 1.0, 0.0, 0.0)
    assert incorporate(table, [], [(2, 2.0, 0.0)], 5, TICK_S)[2] == (5, 2.0, 0.0, 0.5, -0.5)


def test_seeing_a_peer_twice_at_one_tick_changes_nothing():
    table = incorporate(NOBODY, [], [(2, 1.0, 1.0)], 3, TICK_S)
    assert incorporate(table, [], [(2, 1.0, 1.0)], 3, TICK_S) == table


def test_the_table_given_stays_as_it_is():
    table = ((0, 1.0, 1.0, 0.0, 0.0), None, None)
    incorporate(table, [packet(1, 4, (1.0, 2.0))], [(0, 5.0, 5.0)], 5, TICK_S)
    assert table == ((0, 1.0, 1.0, 0.0, 0.0), None, None)


def test_the_team_is_this_robot_and_every_peer_known_in_robot_order():
    table = ((5, 1.0, 1.0, 0.0, 0.0), None, None, (6, 3.0, 3.0, 0.0, 0.0))
    team = planning_team(table, 2, (2.0, 2.0), 6, P)
    assert team.members == (0, 2, 3)
    assert team.own == 1
    assert team.positions == ((1.0, 1.0), (2.0, 2.0), (3.0, 3.0))


@pytest.mark.parametrize(("policy", "x"), [("hold", 1.0), ("extrapolate", 2.0)])
def test_a_stale_peer_is_held_or_moved_on_by_its_velocity(policy, x):
    table = ((2, 1.0, 5.0, 0.25, 0.0), None)
    team = planning_team(table, 1, (0.0, 0.0), 6, replace(P, peer_policy=policy))
    assert team.positions[0] == (x, 5.0)


@pytest.mark.parametrize(
    ("trusted", "x"), [(0, 1.0), (1, 1.25), (3, 1.75), (4, 2.0), (5, 2.0), (100_000, 2.0)]
)
def test_a_peer_is_moved_on_no_further_than_extrapolation_is_trusted(trusted, x):
    table = ((2, 1.0, 5.0, 0.25, -0.5), None)
    team = planning_team(table, 1, (0.0, 0.0), 6, replace(P, extrapolate_ticks_max=trusted))
    assert team.positions[0] == (x, 5.0 - 2.0 * (x - 1.0))


def test_by_default_extrapolation_is_trusted_for_as_long_as_a_peer_may_belong_to_the_team():
    oldest = 100_000  # the largest that peer_age_ticks_max may be
    assert replace(P, peer_age_ticks_max=oldest).problems() == []
    assert replace(P, peer_age_ticks_max=oldest + 1).problems() != []
    table = ((0, 1.0, 5.0, 0.25, 0.0), None)
    team = planning_team(table, 1, (0.0, 0.0), oldest, replace(P, peer_age_ticks_max=oldest))
    assert team.positions[0] == (1.0 + 0.25 * oldest, 5.0)


def test_each_peer_has_its_own_age():
    table = ((6, 1.0, 0.0, 1.0, 0.0), (2, 2.0, 0.0, 1.0, 0.0), (4, 3.0, 0.0, 1.0, 0.0))
    team = planning_team((*table, None), 3, (9.0, 9.0), 6, replace(P, extrapolate_ticks_max=2))
    assert team.positions == ((1.0, 0.0), (4.0, 0.0), (5.0, 0.0), (9.0, 9.0))


@pytest.mark.parametrize("policy", ["hold", "extrapolate"])
def test_this_robot_is_where_it_is_whatever_the_table_says_of_it(policy):
    table = ((2, 9.0, 9.0, 1.0, 1.0), (6, 1.0, 1.0, 0.0, 0.0))
    team = planning_team(table, 0, (4.0, 5.0), 6, replace(P, peer_policy=policy))
    assert team.positions[team.own] == (4.0, 5.0)


@pytest.mark.parametrize(("age", "members"), [(7, (0, 1)), (8, (1,))])
def test_a_peer_not_heard_of_for_longer_than_the_limit_is_left_out(age, members):
    table = ((20 - age, 1.0, 1.0, 0.0, 0.0), None)
    assert (
        planning_team(table, 1, (0.0, 0.0), 20, replace(P, peer_age_ticks_max=7)).members == members
    )
