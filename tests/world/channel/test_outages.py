"""Outages and partitions: what is cut, when, and for whom; against the rules read one by one."""

import numpy as np
import pytest
from helpers_channel import Flown, channel, links_of
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.world.channel.loss_causes import Cause

IDS = [f"r{k + 1}" for k in range(5)]
MAYBE = st.none() | st.sampled_from(IDS)
OUTAGES = st.fixed_dictionaries(
    {
        "kind": st.just("outage"),
        "tick": st.integers(0, 30),
        "ticks": st.integers(1, 20),
        "sender": MAYBE,
        "receiver": MAYBE,
    }
).filter(lambda event: event["sender"] is None or event["sender"] != event["receiver"])


@st.composite
def partitions(draw):
    groups = draw(
        st.lists(st.integers(-1, 2), min_size=5, max_size=5).filter(
            lambda numbers: len({n for n in numbers if n >= 0}) > 1
        )
    )
    members = [[r for r, n in zip(IDS, groups, strict=True) if n == k] for k in range(3)]
    return {
        "kind": "partition",
        "tick": draw(st.integers(0, 30)),
        "ticks": draw(st.integers(1, 20)),
        "groups": [group for group in members if group],
    }


def cuts(event, sender, receiver):
    if event["kind"] == "outage":
        return event["sender"] in (None, sender) and event["receiver"] in (None, receiver)
    of = {robot: k for k, group in enumerate(event["groups"]) for robot in group}
    return sender in of and receiver in of and of[sender] != of[receiver]


@settings(deadline=None, derandomize=True, max_examples=60)
@given(events=st.lists(OUTAGES | partitions(), max_size=5))
def test_a_packet_is_lost_if_an_event_cuts_its_link_as_it_is_sent_and_not_otherwise(events):
    due = Flown(channel(robots=5, events=events), 55).due
    for tick in range(55):
        active = [e for e in events if e["tick"] <= tick < e["tick"] + e["ticks"]]
        for s, sender in enumerate(IDS):
            for r, receiver in enumerate(IDS):
                kinds = {e["kind"] for e in active if cuts(e, sender, receiver)}
                if s == r:
                    assert due[tick, s, r] == 0
                elif kinds:
                    cause = Cause.PARTITION if "partition" in kinds else Cause.OUTAGE
                    assert due[tick, s, r] == -cause
                else:
                    assert due[tick, s, r] == tick + 1


@pytest.mark.parametrize(
    ("ends", "links"),
    [
        ({}, [(s, r) for s in range(4) for r in range(4) if s != r]),
        ({"sender": "r2"}, [(1, 0), (1, 2), (1, 3)]),
        ({"receiver": "r2"}, [(0, 1), (2, 1), (3, 1)]),
        ({"sender": "r2", "receiver": "r3"}, [(1, 2)]),
    ],
)
def test_an_outage_is_of_directed_links_in_its_ticks(ends, links):
    event = {"kind": "outage", "tick": 5, "ticks": 3, **ends}
    lost = Flown(channel(events=[event]), 12).lost(Cause.OUTAGE)
    expected = np.zeros((4, 4), bool)
    expected[tuple(np.transpose(links))] = True
    for tick in range(12):
        assert (lost[tick] == (expected if 5 <= tick < 8 else False)).all()


def test_a_robot_in_no_group_is_the_bridge():
    event = {"kind": "partition", "tick": 0, "ticks": 9, "groups": [["r1", "r2"], ["r4"]]}
    lost = Flown(channel(events=[event]), 9).lost(Cause.PARTITION)
    assert sorted(map(tuple, np.argwhere(lost[0]).tolist())) == [(0, 3), (1, 3), (3, 0), (3, 1)]
    assert (lost == lost[0]).all()


def test_what_was_sent_before_an_outage_arrives_during_it():
    event = {"kind": "outage", "tick": 3, "ticks": 10}
    flown = Flown(channel("channel.delay.mean_s=0.5", events=[event]), 12)
    assert sorted({sent for at in flown.delivered[3:] for sent, _, _ in at}) == [0, 1, 2]
    assert len(flown.delivered[7]) == 12


def test_a_whole_run_can_be_cut():
    event = {"kind": "outage", "tick": 0, "ticks": 10_000_000}
    assert Flown(channel(events=[event]), 30).lost()[:, links_of(4)].all()
