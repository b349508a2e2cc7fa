"""What spreads between robots, whatever happens to it under way; and the way to a point at xi*."""

import random
from dataclasses import replace
from math import exp, hypot, pi, sin

import msgpack
import numpy as np
import pytest
from helpers_negotiation import NEVER_SHRINKS, Channel, Negotiation, all_links, drifting
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.agents.policies.auction import auction
from encircle.agents.policies.hungarian_consensus import hungarian_consensus
from encircle.agents.policies.intents import intents
from encircle.agents.policies.interface import Decision
from encircle.agents.policies.negotiation import (
    ENTRIES_MAX,
    MM_MAX,
    fixed_ring,
    head_for,
    millimetres,
    newest_entries,
    say_entries,
)
from encircle.protocol.messages import Pose
from encircle.protocol.wire.limits import COUNT_MAX, SAY_BYTES_MAX
from encircle.protocol.wire.payload import payload
from encircle.world.scenario.fields import ROBOTS_MAX

CHEAP = settings(max_examples=100, deadline=None, derandomize=True)
POLICIES = (auction, hungarian_consensus, intents)
KEY = "bids"
OWN = 0
plain = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**53) + 1, 2**53 - 1) | st.text(max_size=3),
    lambda inner: st.lists(inner, max_size=5) | st.dictionaries(st.text(max_size=3), inner),
    max_leaves=8,
)
numbers = st.integers(-3, 60)
nearly = st.lists(st.lists(numbers | plain, min_size=3, max_size=6), max_size=6) | plain
entries = st.lists(
    st.tuples(st.integers(0, 3), st.integers(0, 20), st.integers(0, 9)).map(list), max_size=4
)


def packet(said, robot="r2", tick=20):
    return Pose(
        *(robot, tick, tick, (5.0, 0.0), (0.0, 0.0), None, "encircle", 0.0, 0, (), None),
        payload(said),
    )


def view(tick=21, count=4, planned=None, heard=()):
    """What r1 sees, at a tick, of a team in which it plans with ``planned``."""
    team = Negotiation(auction, [(5.0, float(k)) for k in range(count)], [])
    seen = team.view(0)
    members = tuple(range(count)) if planned is None else planned
    positions = tuple([team.positions[k] for k in members])
    return seen._replace(tick=tick, members=members, positions=positions, heard=tuple(heard))


@CHEAP
@given(st.lists(entries, max_size=6), st.randoms(use_true_random=False), st.integers(1, 3))
def test_what_is_known_does_not_depend_on_order_and_copies_and_how_it_is_spread(
    payloads, shuffled, parts
):
    packets = [packet({KEY: entry}) for entry in payloads]
    once = newest_entries(None, view(heard=packets), KEY, 1, 1000)
    assert once.keys() == {e[0] for said in payloads for e in said} - {OWN}
    newest = {}
    for robot, *values in (entry for said in payloads for entry in said if entry[0] != OWN):
        newest[robot] = max(newest.get(robot, []), values)
    assert once == {robot: tuple(values) for robot, values in newest.items()}
    again = packets * 2
    shuffled.shuffle(again)
    known = {}
    for part in range(parts):
        known = newest_entries(known, view(heard=again[part::parts]), KEY, 1, 1000)
    assert known == once
    assert list(known) == sorted(known)


def test_of_itself_a_robot_believes_only_itself_and_of_others_nothing_from_the_future():
    heard = [packet({KEY: [[OWN, 20, 1], [2, 22, 1], [3, 21, 1]]})]
    mine = (3, 7)
    assert newest_entries({OWN: mine}, view(heard=heard), KEY, 1, 5) == {OWN: mine, 3: (21, 1)}


@CHEAP
@given(nearly, st.sampled_from(POLICIES), st.sampled_from(["bids", "rows", "point", "points"]))
def test_what_peers_say_may_be_anything_and_nobody_fails(said, policy, key):
    def babbling(memory, view):
        return memory, Decision("encircle", (0.0, 0.0), (0.0, 0.0), say={key: said})

    def either(memory, view):
        return (babbling if view.robot == "r2" else policy)(memory, view)

    team = Negotiation(either, [(5.0, 0.0), (5.0, 1.0), (-5.0, 1.0)], all_links(3))
    for _ in range(7):
        points = team.step()
        assert points[0] != points[2] or team.tick == 1
        assert {points[0], points[2]} <= {0, 1, 2}


def test_an_old_entry_goes_unless_its_robot_is_planned_with():
    known = {0: (1, 5), 1: (1, 5), 2: (10, 5), 3: (11, 5)}
    assert newest_entries(known, view(planned=(0, 1)), KEY, 1, 10).keys() == {0, 1, 3}
    # Nor is it taken over again from who still has it.
    heard = [packet({KEY: [[2, 10, 5]]})]
    assert newest_entries({}, view(planned=(0, 1), heard=heard), KEY, 1, 10) == {}


@pytest.mark.parametrize("values", [(MM_MAX, -MM_MAX), (ROBOTS_MAX, ROBOTS_MAX - 1, MM_MAX)])
def test_as_many_entries_as_a_packet_takes_are_not_too_long(values):
    robots = [OWN, *range(ROBOTS_MAX - ENTRIES_MAX, ROBOTS_MAX)]
    known = dict.fromkeys(robots, (COUNT_MAX, *values))
    said = say_entries(known, view(count=ROBOTS_MAX), KEY)
    assert len(said[KEY]) == ENTRIES_MAX
    size = len(msgpack.packb(payload(said)))
    assert SAY_BYTES_MAX - 60 < size <= SAY_BYTES_MAX


@pytest.mark.parametrize(
    ("policy", "bytes_max"), [(auction, 300), (hungarian_consensus, 300), (intents, 16)]
)
@pytest.mark.parametrize("count", [4, 16, ENTRIES_MAX])
def test_a_team_of_46_says_all_in_each_packet(policy, count, bytes_max):
    random.seed(1)
    places = [(random.uniform(-90, 90), random.uniform(-90, 90)) for _ in range(count)]
    team = Negotiation(policy, places, all_links(count))
    team.tick = 100_000
    team.run(3)
    sizes = [len(msgpack.packb(decision.say)) for decision in team.decisions]
    assert max(sizes) <= (bytes_max if count <= 16 else SAY_BYTES_MAX)
    if policy is not intents:
        assert {len(next(iter(d.say.values()))) for d in team.decisions} == {count}


def test_a_larger_team_says_its_own_entry_always_and_the_others_in_turn():
    count = 2 * ENTRIES_MAX + 5
    known = {robot: (50, robot) for robot in range(count)}
    turns = [
        [entry[0] for entry in say_entries(known, view(tick, count), KEY)[KEY]]
        for tick in range(50, 53)
    ]
    assert all(turn[0] == OWN and len(turn) == ENTRIES_MAX for turn in turns)
    assert {robot for turn in turns for robot in turn} == set(range(count))


def test_the_turns_are_those_of_packets_that_are_published():
    count, every = 2 * ENTRIES_MAX - 1, 2
    known = {robot: (50, robot) for robot in range(count)}
    seen = view(count=count)
    seen = seen._replace(parameters=replace(seen.parameters, publish_every_ticks=every))
    said = {
        entry[0]
        for tick in range(50, 54, every)
        for entry in say_entries(known, seen._replace(tick=tick), KEY)[KEY]
    }
    assert said == set(range(count))


@pytest.mark.parametrize("policy", [auction, hungarian_consensus])
def test_a_larger_team_still_agrees(policy):
    count = ENTRIES_MAX + 14
    bearings = np.arange(count) * 2 * pi / count + 0.01
    places = [(9.0 * float(np.cos(b)), 9.0 * float(np.sin(b))) for b in bearings]
    # In a line, so that entries have to be passed on, and in turn.
    links = [(k, k + 1) for k in range(count - 1)]
    team = Negotiation(policy, places, links)
    assert team.run(3) == list(range(count))


@CHEAP
@given(st.integers(2, 12), st.floats(0.0, 1.0), st.floats(0.0, 2 * pi))
def test_an_index_is_one_place_to_all_whose_views_of_the_target_are_near(count, error_m, bearing):
    ring = fixed_ring(count, 4.0)
    assert np.hypot(*ring.T) == pytest.approx(np.full(count, 4.0))
    moved = ring + error_m * np.array([np.cos(bearing), np.sin(bearing)])
    away = np.hypot(*(ring[:, None] - moved[None]).T)
    if error_m < 0.99 * 4.0 * sin(pi / count):
        # Of all points of another's ring the one of the same index is the nearest.
        assert (away.argmin(axis=0) == np.arange(count)).all()
    assert np.diag(away) == pytest.approx(np.full(count, error_m))


@CHEAP
@given(
    st.lists(st.tuples(st.floats(-9, 9), st.floats(-9, 9)), min_size=1, max_size=5),
    st.data(),
)
def test_the_step_ahead_is_the_one_at_which_the_ways_are_most_alike(places, data):
    count = len(places)
    points = data.draw(st.permutations(range(count)))
    seen = view(count=count)._replace(
        positions=tuple(places),
        position=places[0],
        predict=lambda grid: drifting((0.0, 0.0), grid),
    )
    ring = fixed_ring(count, 4.0)
    decision = head_for(seen, ring, dict(enumerate(points)))
    weighted = {}
    for xi in NEVER_SHRINKS.xi_grid:
        ways = [
            hypot(ring[q][0] + 0.1 * xi - x, ring[q][1] - y)
            for (x, y), q in zip(places, points, strict=True)
        ]
        weighted[xi] = exp(0.05 * xi) * float(np.var(ways))
    assert weighted[decision.xi] <= min(weighted.values()) + 1e-4
    goal = (ring[points[0]][0] + 0.1 * decision.xi, ring[points[0]][1])
    assert decision.goal == pytest.approx(goal)
    assert decision.step == pytest.approx((goal[0] - places[0][0], goal[1] - places[0][1]))
    assert (decision.mode, decision.point) == ("encircle", points[0])


def test_lengths_are_whole_millimetres_within_what_fits():
    assert [millimetres(x) for x in (0.0, 1.2344, -1.2346, 1e9, -1e9)] == [
        *(0, 1234, -1235, MM_MAX, -MM_MAX)
    ]


@pytest.mark.parametrize("policy", POLICIES)
def test_views_and_memories_stay_as_they_are(policy):
    channel = Channel(0.3, 0.3, 3, quiet_tick=99, seed=4)
    team = Negotiation(policy, [(5.0, 0.0), (5.0, 1.0), (-5.0, 1.0)], all_links(3), channel)
    for _ in range(20):
        before = [repr(memory) for memory in team.memories]
        kept = list(team.memories)
        team.step()
        assert [repr(memory) for memory in kept] == before
