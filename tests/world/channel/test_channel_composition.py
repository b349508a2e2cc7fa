"""All stages of the radio together: no packet is forgotten, copies, and which cause is named."""

import numpy as np
import pytest
from helpers_channel import (
    ALPHA,
    COMPOSED,
    CUTS,
    DELAY,
    LIMIT,
    LOSS,
    OVERRIDES,
    TICKS,
    Flown,
    channel,
    flown,
    links_of,
    sizes_at,
    tables,
)
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from encircle.world.channel import channel as radio
from encircle.world.channel.loss_causes import CAUSES


@COMPOSED
@given(
    loss=LOSS,
    delay=DELAY,
    limit=st.none() | LIMIT,
    copies=st.sampled_from([0.0, 0.4, 1.0]),
    order=st.sampled_from(["kept", "free"]),
    links=OVERRIDES,
    events=st.lists(st.sampled_from(CUTS), max_size=3, unique_by=str),
)
def test_sent_and_copied_are_delivered_and_lost_and_in_flight(
    loss, delay, limit, copies, order, links, events
):
    found = flown(
        loss=loss, delay=delay, limit=limit, copies=copies, order=order, links=links, events=events
    )
    sent = 3 * sum(int((sizes_at(tick) > 0).sum()) for tick in range(TICKS))
    assert np.count_nonzero(found.due) == sent
    copied = np.count_nonzero(found.copies)
    lost = sum(int((found.due == -code).sum()) for code in CAUSES)
    assert lost == (found.due < 0).sum()
    delivered = [packet for at in found.delivered for packet in at]
    assert sent + copied == lost + len(delivered) + radio.in_flight(found.state)
    # And each of them as its fate says: at its tick, later than it was sent, copies besides.
    expected = [
        [*zip(*np.nonzero((due == tick) & (due > 0)), strict=True)]
        for tick in range(TICKS)
        for due in (found.due, found.copies)
    ]
    for tick, at in enumerate(found.delivered):
        both = [tuple(map(int, p)) for p in (*expected[2 * tick], *expected[2 * tick + 1])]
        assert sorted(at) == sorted(both)
        assert [sent_tick for sent_tick, _, _ in at] == sorted(p[0] for p in both)
        assert all(sent_tick < tick for sent_tick, _, _ in at)


@COMPOSED
@given(loss=LOSS, delay=DELAY, order=st.sampled_from(["kept", "free"]), links=OVERRIDES)
def test_copies_are_of_packets_that_are_not_lost_and_disturb_nothing(loss, delay, order, links):
    stages = {"loss": loss, "delay": delay, "order": order, "links": links}
    plain, copied = flown(**stages), flown(**stages, copies=0.5)
    assert (plain.due == copied.due).all()
    made = copied.copies > 0
    assert (copied.due[made] > 0).all()
    if order == "kept":
        assert (copied.copies >= copied.due)[made].all()
    every = flown(**stages, copies=1.0)
    assert ((every.copies > 0) == (every.due > 0)).all()
    assert (every.copies[made] == copied.copies[made]).all()


@pytest.mark.parametrize("limit", [None, "packets_per_s=4, queue_packets_max=3"])
def test_a_copy_leaves_with_its_packet_and_a_constant_delay_is_its_own_too(limit):
    found = flown(limit=limit, copies=1.0)
    assert (found.copies == np.maximum(found.due, 0)).all()
    assert (found.due > 0).any()


@pytest.mark.parametrize("rate", [0.05, 0.5])
def test_copies_are_made_at_their_rate_with_delays_of_their_own(rate):
    law = stats.gamma(4.0, scale=0.05)
    found = Flown(
        channel(*tables(delay="model='gamma', mean_s=0.2, std_s=0.1", copies=rate), "tick_s=1e-4"),
        1200,
    )
    made = (found.copies > 0)[:, links_of(4)]
    assert stats.binomtest(int(made.sum()), made.size, rate).pvalue > ALPHA
    first = found.ticks[:, links_of(4)][made] * 1e-4
    second = (found.copies - np.arange(1200)[:, None, None])[:, links_of(4)][made] * 1e-4
    assert stats.kstest(second, law.cdf).pvalue > ALPHA
    correlation = np.corrcoef(first, second)[0, 1]
    assert abs(correlation) < stats.norm.isf(ALPHA / 2) / len(first) ** 0.5


def test_of_several_causes_the_first_in_the_documented_order_is_named():
    # Each stage takes every packet of r1 to r2; they are switched off from the top.
    layers = [
        ("sender-silent", {"silent": np.array([True, True, False])}),
        ("receiver-silent", {"silent": np.array([False, True, False])}),
        ("partition", {"events": [{"kind": "partition", "groups": [["r1"], ["r2"]]}]}),
        ("outage", {"events": [{"kind": "outage", "receiver": "r2"}]}),
        ("queue-full", {"limit": "packets_per_s=0.01, queue_packets_max=0"}),
        ("out-of-range", {"loss": "model='distance', midpoint_m=1, width_m=1, cutoff_m=5"}),
    ]
    below = [
        ("distance-loss", "model='distance', midpoint_m=0.001, width_m=0.001"),
        ("trace-loss", "model='trace', values=[1]"),
        ("weak-signal", "model='path-loss', range_m=0.001, exponent=8"),
        ("burst-loss", "model='gilbert-elliott', good_to_bad=1.0, bad_to_good=0.0"),
        ("loss", "model='bernoulli', rate=1.0"),
    ]
    apart = np.where(np.eye(3, dtype=bool), 0.0, 9.0)
    for start in range(len(layers) + 1):
        for name, loss in below if start == len(layers) else [layers[start]]:
            active = layers[start:]
            events = [
                {"tick": 0, "ticks": 9, **event}
                for _, layer in active
                for event in layer.get("events", ())
            ]
            stages = {
                key: layer[key] for _, layer in active for key in ("limit", "loss") if key in layer
            }
            if start == len(layers):
                stages["loss"] = loss
            silences = [layer["silent"] for _, layer in active if "silent" in layer]
            chan = channel(*tables(**stages), robots=3, events=events)
            found = Flown(chan, 3, distances_m=apart, silent=silences[0] if silences else None)
            # A queue takes the first packet, so the third is looked at.
            assert CAUSES[-found.due[2, 0, 1]] == name


def test_a_radio_that_makes_no_copies_has_none():
    for copies, expected in ((0.0, type(None)), (0.2, np.ndarray)):
        chan = channel(*tables(copies=copies))
        _, fates = radio.transmit(chan, radio.initial(chan), radio.Sending(0))
        assert isinstance(fates.copies, expected)
        assert fates.due.dtype == np.int64


def test_codes_of_causes_are_never_renumbered():
    assert CAUSES == {
        1: "loss",
        2: "burst-loss",
        3: "sender-silent",
        4: "receiver-silent",
        5: "out-of-range",
        6: "distance-loss",
        7: "trace-loss",
        8: "outage",
        9: "partition",
        10: "queue-full",
        11: "weak-signal",
        12: "contention",
    }
