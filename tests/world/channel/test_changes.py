"""Changes of the radio by events: against channels that are so from the start, and theory."""

import numpy as np
import pytest
from helpers_channel import ALPHA, APART, DELAY, LOSS, Flown, channel, links_of
from helpers_world import small
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import binomtest

from encircle.world.channel.loss_causes import Cause
from encircle.world.loading.remarks import remarks_on
from encircle.world.scenario.channel_events import NEVER, cut_spans

TICKS = 60
FEW = settings(deadline=None, derandomize=True, max_examples=40)
SPANS = st.tuples(st.integers(0, 30), st.integers(1, 25))
RATES = st.sampled_from([0.0, 0.2, 0.7, 1.0])
DELAYS = st.sampled_from([(0.0, 1), (0.05, 1), (0.1, 1), (0.3, 3), (0.31, 4), (1.2, 12)])
"""A delay in s, and what it is in ticks of 0.1 s."""
RANGES_M = st.sampled_from([3.0, 8.0, 12.0, 40.0])


def six(*overrides, events=(), **sections):
    return channel(*overrides, robots=6, events=list(events), **sections)


def flown(chan):
    return Flown(chan, TICKS, distances_m=APART)


def with_radio(loss, delay, *more):
    return [f"channel.loss={{{loss}}}", f"channel.delay={{{delay}}}", *more]


@FEW
@given(LOSS, DELAY, RATES, SPANS)
def test_packets_of_the_loss_ticks_meet_bernoulli_and_all_others_their_own(loss, delay, rate, span):
    first, many = span
    own = with_radio(loss, delay)
    event = {"kind": "loss", "tick": first, "ticks": many, "rate": rate}
    changed = flown(six(*own, events=[event])).due
    without = flown(six(*own)).due
    bernoulli = flown(six(*with_radio(f"model='bernoulli', rate={rate}", delay))).due
    during = slice(first, first + many)
    np.testing.assert_array_equal(changed[during], bernoulli[during])
    changed[during] = without[during]
    np.testing.assert_array_equal(changed, without)


@FEW
@given(LOSS, DELAY, DELAYS, SPANS)
def test_packets_of_the_delay_ticks_take_that_time_and_are_lost_as_ever(loss, delay, new, span):
    (first, many), (delay_s, whole) = span, new
    own = with_radio(loss, delay, "channel.duplication.rate=0.3")
    event = {"kind": "delay", "tick": first, "ticks": many, "delay_s": delay_s}
    changed, without = flown(six(*own, events=[event])), flown(six(*own))
    during = slice(first, first + many)
    for table, before in ((changed.due, without.due), (changed.copies, without.copies)):
        sent = np.arange(TICKS)[during, None, None]
        expected = np.where(before[during] > 0, sent + whole, before[during])
        np.testing.assert_array_equal(table[during], expected)
        table[during] = before[during]
        np.testing.assert_array_equal(table, before)


@FEW
@given(LOSS, DELAY, RANGES_M, SPANS)
def test_beyond_the_range_all_is_lost_and_within_it_what_the_loss_takes(loss, delay, range_m, span):
    first, many = span
    own = with_radio(loss, delay)
    event = {"kind": "range", "tick": first, "ticks": many, "range_m": range_m}
    changed, without = flown(six(*own, events=[event])).due, flown(six(*own)).due
    far = (range_m < APART) & links_of(6)
    near = (range_m >= APART) & links_of(6)
    during = slice(first, first + many)
    assert (changed[during][:, far] == -Cause.OUT_OF_RANGE).all()
    own_cut = without[during][:, near] == -Cause.OUT_OF_RANGE
    # Where the scenario's own cut-off stood, another one stands now.
    np.testing.assert_array_equal(
        changed[during][:, near][~own_cut], without[during][:, near][~own_cut]
    )
    assert (changed[during][:, near] != -Cause.OUT_OF_RANGE).all()
    changed[during] = without[during]
    np.testing.assert_array_equal(changed, without)


@pytest.mark.parametrize(
    ("events", "written"),
    [
        (
            [{"kind": "range", "tick": 0, "range_m": 8.0}],
            ["channel.loss={model='range', cutoff_m=8}"],
        ),
        (
            [{"kind": "range", "tick": 0, "range_m": 7.0}],
            ["channel.loss={model='distance', midpoint_m=7, width_m=2, cutoff_m=7}"],
        ),
        (
            [
                {"kind": "loss", "tick": 0, "rate": 0.4},
                {"kind": "delay", "tick": 0, "delay_s": 0.3},
            ],
            ["channel.loss={model='bernoulli', rate=0.4}", "channel.delay.mean_s=0.3"],
        ),
    ],
)
@pytest.mark.parametrize(
    "more", [[], ["channel.order=kept"], ["channel.rate_limit.packets_per_s=7"]]
)
def test_a_change_from_the_start_is_the_channel_that_has_it_written(events, written, more):
    links = ["channel.links=[{sender='r1', loss={model='bernoulli', rate=0.9}}]"]
    base = "channel.loss={model='distance', midpoint_m=7, width_m=2, cutoff_m=9}"
    if events[0]["kind"] == "range":
        links, base = [], base if "distance" in written[0] else "channel.loss={model='none'}"
    changed = flown(six(base, *links, *more, events=events))
    expected = flown(six(*written, *more))
    np.testing.assert_array_equal(changed.due, expected.due)


def test_the_share_that_is_lost_is_the_rate_before_and_after():
    events = [{"kind": "loss", "tick": 300, "rate": 0.35}]
    lost = Flown(six("channel.loss={model='bernoulli', rate=0.1}", events=events), 600).lost()
    for part, rate in ((lost[:300], 0.1), (lost[300:], 0.35)):
        packets = part[:, links_of(6)]
        assert binomtest(int(packets.sum()), packets.size, rate).pvalue > ALPHA


def test_of_several_changes_the_one_that_began_last_counts_and_none_given_is_the_own_again():
    events = [
        {"kind": "delay", "tick": 10, "delay_s": 0.5},
        {"kind": "delay", "tick": 20, "ticks": 5, "delay_s": 0.8},
        {"kind": "delay", "tick": 40},
        {"kind": "delay", "tick": 30, "delay_s": 0.9},
        {"kind": "delay", "tick": 30, "delay_s": 0.4},
    ]
    taken = Flown(channel("channel.delay.mean_s=0.2", events=events), 50).ticks[:, 0, 1].tolist()
    assert taken == [2] * 10 + [5] * 10 + [8] * 5 + [5] * 5 + [4] * 10 + [2] * 10


def test_what_a_cut_ends_by_is_its_ticks_or_a_heal_whichever_is_earlier():
    def cut(tick, **more):
        return {"kind": "outage", "tick": tick, "sender": "r1", **more}

    events = [
        cut(5),
        cut(5, ticks=2),
        {"kind": "heal", "tick": 9},
        cut(9),
        {"kind": "heal", "tick": 30},
    ]
    spans = [(first, after) for _, first, after in cut_spans(small(events=events).events)]
    assert spans == [(5, 9), (5, 7), (9, 30)]
    lost = Flown(channel(events=events), 40).lost(Cause.OUTAGE)[:, 0, 1]
    assert np.flatnonzero(lost).tolist() == list(range(5, 30))
    swapped = [{"kind": "heal", "tick": 9}, cut(9)]
    assert cut_spans(small(events=swapped).events)[0][1:] == (9, NEVER)
    assert cut_spans(small(events=swapped[::-1]).events) == []


@pytest.mark.parametrize(
    ("event", "said"),
    [
        (
            "{kind='range', tick=1, range_m=0.4}",
            "events.0.range_m = 0.4: two robots of radius 0.5 m",
        ),
        ("{kind='delay', tick=1, delay_s=0.02}", "events.0.delay_s = 0.02: is at most half a tick"),
    ],
)
def test_a_change_that_may_not_be_meant_is_remarked_on(event, said):
    (line,) = remarks_on(small(f"events=[{event}]"))
    assert line.startswith(said)
    assert (
        remarks_on(small("events=[{kind='range', tick=1}, {kind='delay', tick=1, delay_s=0.2}]"))
        == []
    )
