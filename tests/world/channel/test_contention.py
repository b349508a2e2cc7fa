"""Contention against the laws of ALOHA: exp(-2 G), exp(-G), and who counts."""

import numpy as np
import pytest
from helpers_channel import AIR, ALPHA, Flown, channel, distances, flown, links_of
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from encircle.world.channel.loss_causes import Cause

PLACES = np.array([[0.0, 0.0], [4.0, 0.0], [8.0, 0.0], [12.0, 0.0], [40.0, 0.0]])
VULNERABLE = {"slotted-aloha": 1.0, "aloha": 2.0}


def air(access="aloha", packet_s=0.01, range_m=None):
    reach = "" if range_m is None else f", range_m={range_m}"
    return f"channel.contention={{access='{access}', packet_s={packet_s}{reach}}}"


def binomial(lost, chance):
    return stats.binomtest(int(lost.sum()), lost.size, chance).pvalue


@pytest.mark.parametrize("access", VULNERABLE)
@pytest.mark.parametrize("packet_s", [0.002, 0.03])
@pytest.mark.parametrize("robots", [2, 5])
def test_a_team_that_all_sends_loses_as_aloha_says(access, packet_s, robots):
    found = Flown(channel(air(access, packet_s), robots=robots), 3000)
    lost = found.lost(Cause.CONTENTION)
    assert (lost == found.lost()).all()
    load = (robots - 1) * packet_s / 0.1
    chance = 1.0 - np.exp(-VULNERABLE[access] * load)
    assert binomial(lost[:, links_of(robots)], chance) > ALPHA


@pytest.mark.parametrize("access", VULNERABLE)
def test_only_packets_that_are_sent_within_hearing_of_the_receiver_count(access):
    # Robots at 0, 4, 8, 12 and 40 m that hear each other up to 8 m; r3 is silent.
    found = Flown(
        channel(air(access, 0.02, 8.0), robots=5),
        6000,
        distances_m=distances(PLACES),
        sizes_bytes=np.array([100, 100, 0, 100, 100]),
    )
    lost = found.lost(Cause.CONTENTION)
    for sender, receiver, others in (
        (0, 1, [1, 3]),  # r2's own, and r4 at 8 m
        (0, 2, [1, 3]),  # r3 sends nothing
        (1, 0, [0]),  # r1's own; r4 is 12 m away
        (4, 0, [0, 1]),  # who is out of hearing is disturbed as well
        (0, 4, [4]),
    ):
        chance = 1.0 - np.exp(-VULNERABLE[access] * len(others) * 0.02 / 0.1)
        assert binomial(lost[:, sender, receiver], chance) > ALPHA, (sender, receiver)


def test_who_sends_alone_to_a_silent_receiver_loses_nothing():
    sizes = np.array([100, 0, 0])
    found = Flown(channel(air("aloha", 10.0), robots=3), 200, sizes_bytes=sizes)
    assert (found.due[:, 0, 1:] > 0).all()


def test_a_radio_that_is_off_disturbs_nobody():
    silent = np.array([False, True, True])
    found = Flown(channel(air("aloha", 10.0), robots=3), 50, silent=silent)
    assert not found.lost(Cause.CONTENTION).any()


def test_what_finds_no_room_at_its_sender_is_not_on_the_air():
    # One packet is in transmission for ten ticks, no other may wait.
    limit = "channel.rate_limit={packets_per_s=1, queue_packets_max=0}"
    found = Flown(channel(air("aloha", 1e-9), limit, robots=3), 10)
    assert not found.lost(Cause.CONTENTION).any()
    crowded = Flown(channel(air("aloha", 60.0), limit, robots=3), 10)
    assert crowded.lost(Cause.CONTENTION)[0][links_of(3)].all()
    assert crowded.lost(Cause.QUEUE_FULL)[1:][:, links_of(3)].all()


@settings(deadline=None, derandomize=True, max_examples=20)
@given(
    sends=st.lists(st.booleans(), min_size=5, max_size=5),
    more=st.lists(st.booleans(), min_size=5, max_size=5),
    packet_s=st.floats(0.001, 0.05),
)
def test_more_senders_lose_each_other_no_packet_fewer(sends, more, packet_s):
    chan = channel(air("aloha", packet_s, 9.0), robots=5)
    few, many = (
        Flown(chan, 40, distances_m=distances(PLACES), sizes_bytes=np.array(sizes) * 100)
        for sizes in (sends, np.logical_or(sends, more).tolist())
    )
    assert not (few.lost() & ~many.lost()).any()


@settings(deadline=None, derandomize=True, max_examples=20)
@given(sizes=st.lists(st.integers(1, 1000), min_size=4, max_size=4))
def test_bytes_do_not_matter(sizes):
    chan = channel(air("aloha", 0.02), robots=4)
    one, other = (Flown(chan, 30, sizes_bytes=np.array(s)) for s in (sizes, [1, 1, 1, 1]))
    assert (one.due == other.due).all()


def test_contention_takes_only_what_would_have_arrived():
    loss = "model='path-loss', range_m=9, exponent=3, coherence_s=0.4"
    cuts = [{"kind": "outage", "tick": 10, "ticks": 12, "sender": "r2"}]
    without = flown(loss=loss, events=cuts, limit="packets_per_s=8, queue_packets_max=2")
    found = flown(loss=loss, events=cuts, limit="packets_per_s=8, queue_packets_max=2", air=AIR)
    hit = found.lost(Cause.CONTENTION)
    assert hit.any()
    assert (without.due[hit] > 0).all()
    assert (found.due[~hit] == without.due[~hit]).all()


def test_links_are_drawn_apart_and_ticks_as_well():
    lost = Flown(channel(air("aloha", 0.02), robots=3), 6000).lost()
    bound = stats.norm.isf(ALPHA / 2) / 6000**0.5
    assert abs(np.corrcoef(lost[:, 0, 1], lost[:, 0, 2])[0, 1]) < bound
    assert abs(np.corrcoef(lost[:, 0, 1], lost[:, 1, 0])[0, 1]) < bound
    assert abs(np.corrcoef(lost[1:, 0, 1], lost[:-1, 0, 1])[0, 1]) < bound * (6000 / 5999) ** 0.5
