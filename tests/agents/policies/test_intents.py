"""Intents: who hears a claim with priority yields. Oracle: the serial dictatorship."""

from functools import partial

import numpy as np
import pytest
from helpers_negotiation import (
    CHANNELS,
    Channel,
    Negotiation,
    all_links,
    costs_mm,
    teams,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.agents.policies.intents import intents
from encircle.protocol.wire.payload import payload

CHEAP = settings(max_examples=80, deadline=None, derandomize=True)
RECLAIMS = st.sampled_from([1, 3, 5, 1000])


def dictated(positions):
    """Each robot's point if they choose one after the other, in robot order."""
    costs, free, chosen = costs_mm(positions), list(range(len(positions))), []
    for row in costs:
        chosen.append(min(free, key=row.__getitem__))
        free.remove(chosen[-1])
    return chosen


@CHEAP
@given(teams(), RECLAIMS)
def test_all_in_range_of_each_other_end_with_the_serial_dictatorship_in_n_ticks(drawn, reclaim):
    positions, _ = drawn
    count = len(positions)
    team = Negotiation(partial(intents, reclaim_ticks=reclaim), positions, all_links(count))
    # Robot k has its point after k ticks: nothing is heard at the first.
    for tick in range(count):
        assert team.step()[: tick + 1] == dictated(positions)[: tick + 1]
    assert [team.step() for _ in range(7)] == [dictated(positions)] * 7


@CHEAP
@given(teams(), CHANNELS, RECLAIMS)
def test_after_loss_delay_duplicates_and_another_order_conflicts_are_resolved_by_priority(
    drawn, channel, reclaim
):
    positions, _ = drawn
    count = len(positions)
    policy = partial(intents, reclaim_ticks=reclaim)
    team = Negotiation(policy, positions, all_links(count), channel)
    team.run(channel.quiet_tick)
    assert sorted(team.run(count + 1)) == list(range(count))
    # With claims renewed the outcome is the same whatever was heard before.
    if reclaim < 1000:
        assert team.run(reclaim * count + 9) == dictated(positions)


def test_the_robot_without_priority_yields_and_the_other_stays():
    positions = [(9.0, 0.0), (5.0, 0.0), (-9.0, 0.0)]
    team = Negotiation(intents, positions, all_links(3))
    assert team.step()[:2] == [0, 0]
    assert team.step()[:2] == [0, 1]


def test_a_claim_goes_one_hop_alone():
    # The limit that the module's text names: r1 and r3 never hear of each other.
    positions = [(5.0, 0.0), (-9.0, 0.0), (5.5, 0.0)]
    team = Negotiation(intents, positions, [(0, 1), (1, 2)])
    points = team.run(20)
    assert points[0] == points[2] == 0


def test_a_claim_is_made_anew_when_it_is_old():
    positions = [(6.0, 0.0), (-6.0, 0.0)]
    team = Negotiation(partial(intents, reclaim_ticks=5), positions, [(0, 1)])
    assert team.run(3) == [0, 1]
    team.positions = positions[::-1]
    assert [team.step() for _ in range(2)] == [[0, 1]] * 2
    since = team.memories[0].tick
    team.step()
    assert (since, team.memories[0].tick) == (0, 5)
    assert team.run(5) == [1, 0]


def test_a_lost_robots_point_is_free_and_taken_again_when_it_is_back():
    positions = [(6.0, 0.0), (0.0, 6.0), (-6.0, 0.0), (0.0, -6.0)]
    team = Negotiation(intents, positions, all_links(4))
    assert team.run(4) == [0, 1, 2, 3]
    team.silent = {0}
    team.planned = [(0, 1, 2, 3)] + [(1, 2, 3)] * 3
    assert sorted(team.run(3)[1:]) == [0, 1, 2]
    team.silent, team.planned = set(), [(0, 1, 2, 3)] * 4
    assert team.run(8) == [0, 1, 2, 3]


@CHEAP
@given(teams(5), CHANNELS)
def test_one_run_is_as_another(drawn, channel):
    one, other = (Negotiation(intents, *drawn, channel) for _ in range(2))
    for _ in range(30):
        assert one.step() == other.step()
        assert one.decisions == other.decisions


@pytest.mark.parametrize(
    "said",
    [
        {},
        {"point": "0", "points": 2},
        {"point": 7, "points": 2},
        {"point": 0, "points": 3},
        {"point": True, "points": 2},
        {"points": 2},
    ],
)
def test_what_is_no_claim_on_this_ring_is_passed_over(said):
    def other(memory, view):
        _, decision = intents(None, view)
        return memory, decision._replace(say=payload(said))

    positions = [(6.0, 0.0), (7.0, 0.0)]
    team = Negotiation(
        lambda memory, view: (other if view.robot == "r1" else intents)(memory, view),
        positions,
        [(0, 1)],
    )
    assert team.run(8)[1] == 0


@pytest.mark.parametrize("seed", range(3))
def test_with_loss_that_never_stops_bodies_that_stand_still_are_agreed_on(seed):
    random = np.random.default_rng(seed)
    positions = [tuple(place) for place in random.uniform(-9.0, 9.0, (5, 2)).tolist()]
    channel = Channel(0.5, 0.2, 4, quiet_tick=10_000, seed=seed)
    team = Negotiation(intents, positions, all_links(5), channel)
    settled = [team.step() for _ in range(90)][60:]
    assert all(points == dictated(positions) for points in settled)
