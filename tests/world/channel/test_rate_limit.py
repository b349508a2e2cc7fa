"""The transmitter's queue against a simulation packet by packet in exact fractions."""

from fractions import Fraction

import numpy as np
import pytest
from helpers_channel import Flown, channel, links_of
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.world.channel import channel as radio
from encircle.world.channel.loss_causes import Cause
from encircle.world.channel.rate_limit import Transmitter, idle, send


def queued(takes, waiting_max):
    """One sender by the book: (T,) exact ticks until each packet has left, None if dropped.

    ``takes``: (T,) exact ticks that each tick's packet takes to send, None where there is none.
    """
    leaves, found = [], []
    for tick, takes_ticks in enumerate(takes):
        leaves = [time for time in leaves if time > tick]
        if takes_ticks is None or len(leaves) > waiting_max:
            found.append(None)
            continue
        time = max([Fraction(tick), *leaves]) + takes_ticks
        leaves.append(time)
        found.append(time - tick)
    return found


SIZES = st.lists(st.sampled_from([0, 40, 100, 150, 155, 300, 700]), min_size=1, max_size=60)
RATES = st.sampled_from([None, *(Fraction(n, 3) for n in (1, 4, 10, 29, 30, 31, 60, 100))])


@settings(deadline=None, derandomize=True, max_examples=200)
@given(
    sizes=SIZES,
    packets_per_s=RATES,
    bytes_per_s=st.sampled_from([None, 100, 333, 1000, 1500, 3000, 4500]),
    waiting_max=st.integers(0, 4),
    tick=st.sampled_from(["0.1", "0.02", "0.3", "1"]),
)
def test_packets_leave_when_a_queue_by_the_book_lets_them(
    sizes, packets_per_s, bytes_per_s, waiting_max, tick
):
    if packets_per_s is None and bytes_per_s is None:
        return
    tick_s, per_packet = Fraction(tick), 1 / packets_per_s if packets_per_s else Fraction(0)
    per_byte = Fraction(1, bytes_per_s) if bytes_per_s else Fraction(0)
    takes = [max(per_packet, size * per_byte) / tick_s if size else None for size in sizes]
    transmitter = Transmitter(float(per_packet / tick_s), float(per_byte / tick_s), waiting_max)
    queues = idle(transmitter, 1)
    for size, exact in zip(sizes, queued(takes, waiting_max), strict=True):
        queues, left, dropped = send(
            transmitter, queues, np.array([size > 0]), np.array([size], np.int64)
        )
        assert dropped[0] == (size > 0 and exact is None)
        if exact is not None:
            assert left[0] == pytest.approx(float(exact), abs=1e-9)


@pytest.mark.parametrize("takes", ["5/3", "6/5", "7/6", "11/10", "13/7", "17/6"])
def test_what_leaves_at_a_tick_has_left_though_its_time_is_no_binary_fraction(takes):
    transmitter, exact = Transmitter(float(Fraction(takes)), 0.0, 2), Fraction(takes)
    queues, found = idle(transmitter, 1), []
    for _ in range(300):
        queues, left, dropped = send(transmitter, queues, np.array([True]), None)
        found.append(None if dropped[0] else float(left[0]))
    expected = queued([exact] * 300, 2)
    assert [left is None for left in found] == [left is None for left in expected]


def test_senders_do_not_wait_for_each_other():
    transmitter = Transmitter(2.5, 0.0, 2)
    draws = np.random.default_rng(1).integers(0, 2, (80, 3)).astype(bool)
    together, alone = idle(transmitter, 3), [idle(transmitter, 1) for _ in range(3)]
    for sending in draws:
        together, left, dropped = send(transmitter, together, sending, None)
        for k in range(3):
            alone[k], mine, gone = send(transmitter, alone[k], sending[[k]], None)
            assert (left[k], dropped[k]) == (mine[0], gone[0])


LIMIT = "channel.rate_limit={{packets_per_s={}, queue_packets_max={}}}"


@pytest.mark.parametrize("per_s", [10.0, 11.0, 50.0, 1e6])
def test_a_rate_that_suffices_changes_nothing_where_a_packet_takes_a_tick_at_most(per_s):
    plain = Flown(channel(), 50)
    limited = Flown(channel(LIMIT.format(per_s, 0)), 50)
    assert (limited.due == plain.due).all()


def test_an_idle_transmitter_delays_by_the_time_that_sending_takes():
    # 2.5 ticks to send and 1.3 on the way: there after 4, when one packet in ten ticks is sent.
    sizes = np.where(np.arange(60)[:, None] % 10 == 0, [[100, 100]], 0)
    flown = Flown(
        channel(LIMIT.format(4.0, 0), "channel.delay.mean_s=0.13", robots=2),
        60,
        sizes_bytes=lambda tick: sizes[tick],
    )
    taken = flown.ticks[:, 0, 1]
    assert (taken[::10] == 4).all()
    assert taken.sum() == 24


@pytest.mark.parametrize(("per_s", "room"), [(5.0, 3), (8.0, 5), (2.5, 0), (7.0, 20)])
def test_an_overloaded_transmitter_passes_on_what_it_can_and_drops_the_rest(per_s, room):
    ticks = 3000
    flown = Flown(channel(LIMIT.format(per_s, room)), ticks)
    passed = (flown.due > 0)[:, links_of(4)]
    # What has been served by the end, and what stands in the queue or is on its way out.
    assert abs(passed.sum(axis=0) - ticks * per_s / 10).max() <= room + 2
    assert (flown.lost(Cause.QUEUE_FULL)[:, links_of(4)] == ~passed).all()
    assert (flown.lost(Cause.QUEUE_FULL).any(axis=2) == flown.lost().any(axis=2)).all()
    # In the steady state the queue is full: a packet takes the time of room + 1 or less.
    taken = flown.ticks[ticks // 2 :][:, links_of(4)]
    assert taken.max() <= np.ceil((room + 1) * 10 / per_s - 1e-9)
    assert taken.max() >= room * 10 / per_s


def test_a_packet_is_queued_once_for_all_its_receivers():
    flown = Flown(channel(LIMIT.format(6.0, 2)), 200)
    for sender in range(4):
        others = [k for k in range(4) if k != sender]
        assert (flown.due[:, sender, others] == flown.due[:, sender, others[:1]]).all()


def test_large_packets_take_longer():
    sizes = np.tile([100, 200, 400, 50], (100, 1))
    limit = "channel.rate_limit={bytes_per_s=1000, queue_packets_max=1000}"
    chan = channel(limit)
    assert chan.rated
    flown = Flown(chan, 100, sizes_bytes=lambda tick: sizes[tick])
    # 100 bytes in a tick: r1 and r4 keep up, r2 falls back by a tick per packet, r3 by three.
    tick = np.arange(100)
    assert (flown.ticks[:, 0, 1] == 1).all()
    assert (flown.ticks[:, 3, 1] == 1).all()
    assert (flown.ticks[:, 1, 0] == 2 + tick).all()
    assert (flown.ticks[:, 2, 0] == 4 + 3 * tick).all()


def test_a_limit_on_packets_alone_asks_for_no_sizes():
    assert not channel(LIMIT.format(6.0, 2)).rated
    assert not channel().rated


def test_a_silent_senders_packets_take_no_time_and_lost_ones_do():
    silent = np.array([True, False, False, False])

    def off(tick):
        return silent if tick % 3 else None

    flown = Flown(channel(LIMIT.format(5.0, 0)), 100, silent=off)
    # Two ticks to send: r1, silent at two ticks of three, gets all its others through.
    assert (flown.due[::3, 0, 1:] > 0).all()
    assert (flown.lost(Cause.SENDER_SILENT)[1::3, 0, 1:]).all()
    lossy = "channel.loss={model='bernoulli', rate=1.0}"
    full = Flown(channel(LIMIT.format(5.0, 0), lossy), 100).lost(Cause.QUEUE_FULL)
    assert (full == Flown(channel(LIMIT.format(5.0, 0)), 100).lost(Cause.QUEUE_FULL)).all()
    assert full.any()


def test_nothing_drifts_in_a_long_run():
    # A third of a tick over: each packet waits a third longer, until 1000 wait; then every fourth
    # is dropped, and after 9000 ticks the times are still the same three.
    chan = channel("channel.rate_limit={packets_per_s=7.5, queue_packets_max=1000}", robots=2)
    state, found = radio.initial(chan), []
    for tick in range(9000):
        state, _ = radio.deliver(state, tick)
        state, fates = radio.transmit(chan, state, radio.Sending(tick))
        found.append(int(fates.due[0, 1]))
    steady = [due - tick if due > 0 else 0 for tick, due in enumerate(found)][-4000:]
    assert steady == steady[:4] * 1000
    assert steady.count(0) == 1000
