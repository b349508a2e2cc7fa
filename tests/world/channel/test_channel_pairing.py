"""Fair comparisons: no stage of the radio, no other robot and no order disturbs a draw."""

import numpy as np
import pytest
from helpers_channel import (
    AIR,
    ALPHA,
    APART,
    COMPOSED,
    CUTS,
    DELAY,
    DELAYS,
    LIMIT,
    LOSS,
    LOSSES,
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
from encircle.world.channel.loss_causes import CAUSES, Cause

MEMORY = ("gilbert", "burst", "coherence", "shadowing_s")


def test_losses_and_copies_are_drawn_independently():
    lossy = flown(loss=LOSSES[1], copies=0.5, silent=False, ticks=2000)
    plain = flown(copies=0.5, silent=False, ticks=2000)
    survived = lossy.due > 0
    assert (lossy.copies[survived] == plain.copies[survived]).all()
    made = plain.copies[plain.due > 0] > 0
    gone = lossy.due[plain.due > 0] < 0
    correlation = np.corrcoef(made, gone)[0, 1]
    assert abs(correlation) < stats.norm.isf(ALPHA / 2) / len(made) ** 0.5


@COMPOSED
@given(
    loss=LOSS,
    delay=DELAY,
    limit=st.none() | LIMIT,
    copies=st.sampled_from([0.0, 0.4]),
    order=st.sampled_from(["kept", "free"]),
    air=st.none() | st.just(AIR),
)
def test_what_loss_takes_is_the_same_whatever_the_other_stages_do(
    loss, delay, limit, copies, order, air
):
    alone = flown(loss=loss, silent=False)
    stages = {"delay": delay, "limit": limit, "copies": copies, "order": order, "air": air}
    found = flown(loss=loss, **stages, events=CUTS)
    # A weightier cause may be named instead, but what loss would not take it does not.
    named = found.lost(
        *set(CAUSES)
        - {
            Cause.QUEUE_FULL,
            Cause.OUTAGE,
            Cause.PARTITION,
            Cause.SENDER_SILENT,
            Cause.RECEIVER_SILENT,
            Cause.CONTENTION,
        }
    )
    assert (found.due[named] == alone.due[named]).all()
    assert not alone.lost()[found.due > 0].any()


@COMPOSED
@given(loss=LOSS, delay=DELAY, copies=st.sampled_from([0.0, 0.4]))
def test_how_long_a_packet_takes_is_the_same_whatever_is_lost(loss, delay, copies):
    alone = flown(delay=delay, silent=False)
    found = flown(loss=loss, delay=delay, copies=copies, events=CUTS)
    assert (found.due[found.due > 0] == alone.due[found.due > 0]).all()


@COMPOSED
@given(loss=LOSS, delay=DELAY, limit=LIMIT, copies=st.sampled_from([0.0, 0.4]))
def test_the_queue_is_the_same_whatever_becomes_of_the_packets(loss, delay, limit, copies):
    alone = flown(delay="model='constant', mean_s=0.0", limit=limit)
    found = flown(loss=loss, delay=delay, limit=limit, copies=copies, events=CUTS[1:2])
    cut = found.lost(Cause.OUTAGE)
    full = Cause.QUEUE_FULL
    assert (found.lost(full)[~cut] == alone.lost(full)[~cut]).all()
    # What arrives takes its own delay and what the queue takes, rounded up once.
    unlimited = flown(delay=delay)
    arrives = found.due > 0
    assert (found.ticks >= unlimited.ticks)[arrives].all()
    assert (found.ticks <= unlimited.ticks + alone.ticks)[arrives].all()


@COMPOSED
@given(
    loss=LOSS,
    delay=DELAY,
    limit=st.none() | LIMIT,
    copies=st.sampled_from([0.0, 0.4]),
    order=st.sampled_from(["kept", "free"]),
    more=st.integers(1, 2),
)
def test_a_link_meets_the_same_fates_in_a_larger_team(loss, delay, limit, copies, order, more):
    stages = {"loss": loss, "delay": delay, "limit": limit, "copies": copies, "order": order}
    few, many = flown(**stages, events=CUTS), flown(4 + more, **stages, events=CUTS)
    assert (many.due[:, :4, :4] == few.due).all()
    assert (many.copies[:, :4, :4] == few.copies).all()


@COMPOSED
@given(loss=LOSS.filter(lambda text: not any(word in text for word in MEMORY)), delay=DELAY)
def test_without_memory_ticks_can_be_evaluated_in_any_order(loss, delay):
    chan = channel(*tables(loss, delay, copies=0.3))
    start = radio.initial(chan)
    forward = flown(loss=loss, delay=delay, copies=0.3, silent=False)
    for tick in np.random.default_rng(5).permutation(TICKS).tolist():
        sending = radio.Sending(tick, sizes_at(tick), APART[:4, :4])
        _, (due, copies) = radio.transmit(chan, start, sending)
        assert (due == forward.due[tick]).all()
        assert (copies == forward.copies[tick]).all()


@COMPOSED
@given(loss=LOSS, delay=DELAY, copies=st.sampled_from([0.0, 0.4]))
def test_who_else_sends_does_not_matter_without_a_rate_limit(loss, delay, copies):
    chan = channel(*tables(loss, delay, copies=copies))
    every = Flown(chan, TICKS, distances_m=APART[:4, :4])
    some = Flown(chan, TICKS, distances_m=APART[:4, :4], sizes_bytes=sizes_at)
    sent = np.array([sizes_at(tick) > 0 for tick in range(TICKS)])[:, :, None]
    assert (some.due == np.where(sent, every.due, 0)).all()
    assert (some.copies == np.where(sent, every.copies, 0)).all()


@pytest.mark.parametrize("delay", DELAYS)
def test_a_packet_that_was_not_sent_holds_nobody_back_in_a_channel_that_keeps_order(delay):
    found = flown(loss=LOSSES[1], delay=delay, order="kept", silent=False)
    free = flown(loss=LOSSES[1], delay=delay, silent=False)
    for sender, receiver in np.argwhere(links_of(4)).tolist():
        arrives = free.due[:, sender, receiver] > 0
        in_order = np.maximum.accumulate(free.due[:, sender, receiver][arrives])
        assert (found.due[:, sender, receiver][arrives] == in_order).all()
