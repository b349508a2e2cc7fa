"""The fate of each packet: what it depends on and what it does not, and that none is forgotten."""

import numpy as np
import pytest
from helpers_world import frozen, small
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.world.channel import channel as radio
from encircle.world.channel.loss_causes import Cause

LATE = "channel.delay={model='gamma', mean_s=0.4, std_s=0.4}"
WIDE = "channel.delay={model='uniform', low_s=0.0, high_s=1.0}"
SKEWED = "channel.delay={model='lognormal', mean_s=0.3, std_s=0.6}"
LOSSY = "channel.loss={model='bernoulli', rate=0.3}"
BURSTY = "channel.loss={model='gilbert-elliott', good_to_bad=0.2, bad_to_good=0.3, loss_good=0.1}"
KEPT = "channel.order=kept"
LOSSES = [LOSSY, BURSTY]
DELAYS = [LATE, WIDE, SKEWED]


def channel(*overrides, robots=5, seed=1):
    return radio.build(small(*overrides, team={"robots": robots}), seed)


def flown(chan, ticks, silent=None):
    """(T, N, N) fates of the packets of T ticks, and what was delivered when."""
    state, fates, delivered = radio.initial(chan), [], []
    for tick in range(ticks):
        state, due = radio.deliver(state, tick)
        delivered.append(due)
        state, (fate, _) = radio.transmit(
            chan, state, radio.Sending(tick, silent=silent(tick) if silent else None)
        )
        fates.append(fate)
    return np.array(fates), delivered


def fates_of(*overrides, ticks=120, **sizes):
    return flown(channel(*overrides, **sizes), ticks)[0]


def every(fates):
    return fates[:, ~np.eye(fates.shape[1], dtype=bool)]


def test_a_robot_sends_nothing_to_itself():
    fates = fates_of(LOSSY, LATE)
    assert (fates[:, np.eye(5, dtype=bool)] == 0).all()
    assert (every(fates) != 0).all()


@settings(deadline=None, derandomize=True, max_examples=40)
@given(
    model=st.sampled_from(["constant", "uniform", "gamma", "lognormal"]),
    mean=st.floats(1e-3, 5.0),
    spread=st.floats(1e-3, 5.0),
    order=st.sampled_from(["kept", "free"]),
    tick_s=st.sampled_from([0.01, 0.1, 1.0]),
)
def test_no_packet_arrives_before_the_next_tick_or_overtakes_if_order_is_kept(
    model, mean, spread, order, tick_s
):
    law = {
        "constant": f"mean_s={mean}",
        "uniform": f"low_s={min(mean, spread)}, high_s={max(mean, spread)}",
    }.get(model, f"mean_s={mean}, std_s={spread}")
    changes = [f"channel.delay={{model='{model}', {law}}}", f"tick_s={tick_s}"]
    fates = fates_of(*changes, f"channel.order={order}", LOSSY, ticks=40)
    assert ((fates <= 0) | (fates > np.arange(40)[:, None, None])).all()
    if order == "kept":
        for link in every(fates).T:
            assert (np.diff(link[link > 0]) >= 0).all()


@pytest.mark.parametrize("delay", DELAYS)
def test_packets_overtake_each_other_if_order_is_free(delay):
    assert any((np.diff(link) < 0).any() for link in every(fates_of(delay)).T)


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("delay", DELAYS)
def test_keeping_order_holds_a_packet_back_until_the_latest_that_went_before(loss, delay):
    free, kept = every(fates_of(loss, delay)), every(fates_of(loss, delay, KEPT))
    for before, after in zip(free.T, kept.T, strict=True):
        assert ((before < 0) == (after < 0)).all()
        survived = before > 0
        assert (after[survived] == np.maximum.accumulate(before[survived])).all()


def test_packets_due_together_are_delivered_in_the_order_they_were_sent():
    _, delivered = flown(channel(SKEWED, KEPT), 150)
    together = [[flight.sent_tick for flight in due] for due in delivered if len(due) > 1]
    assert together
    assert all(sent == sorted(sent) for sent in together)


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("delay", DELAYS)
def test_switching_delay_on_loses_the_same_packets(loss, delay):
    for order in ("kept", "free"):
        late = fates_of(loss, delay, f"channel.order={order}")
        assert ((late < 0) == (fates_of(loss) < 0)).all()


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("delay", DELAYS)
def test_switching_loss_on_delays_the_survivors_as_before(loss, delay):
    lossy, whole = fates_of(loss, delay), fates_of(delay)
    assert (lossy < 0).any()
    assert (lossy[lossy > 0] == whole[lossy > 0]).all()


@pytest.mark.parametrize("low", [0.1, 0.3])
def test_more_loss_loses_the_same_packets_and_others(low):
    less, more = (
        fates_of(f"channel.loss={{model='bernoulli', rate={rate}}}") < 0 for rate in (low, 2 * low)
    )
    assert (more | ~less).all()
    assert more.sum() > less.sum()


@pytest.mark.parametrize("changes", [(LOSSY, LATE), (BURSTY, WIDE), (BURSTY, SKEWED, KEPT)])
def test_a_links_fates_do_not_depend_on_the_size_of_the_team(changes):
    few, many = (fates_of(*changes, robots=n) for n in (4, 7))
    assert (many[:, :4, :4] == few).all()


def test_other_seeds_other_fates_and_the_same_seed_the_same():
    first, again, other = (fates_of(LOSSY, LATE, seed=s) for s in (3, 3, 4))
    assert (first == again).all()
    assert (first != other).any()


@pytest.mark.parametrize(
    ("override", "links"),
    [
        ("{sender='r2', receiver='r4', ", [(1, 3)]),
        ("{sender='r3', ", [(2, k) for k in (0, 1, 3, 4)]),
        ("{receiver='r1', ", [(k, 0) for k in (1, 2, 3, 4)]),
        ("{", [(s, r) for s in range(5) for r in range(5) if s != r]),
    ],
)
@pytest.mark.parametrize("base", [(LOSSY, LATE), (BURSTY,), ()])
def test_an_override_changes_its_own_links_and_no_other(override, links, base):
    affected = np.zeros((5, 5), bool)
    affected[tuple(np.transpose(links))] = True
    plain = fates_of(*base)
    cut = fates_of(*base, f"channel.links=[{override}loss={{model='bernoulli', rate=1.0}}}}]")
    assert (cut[:, affected] == -Cause.LOSS).all()
    assert (cut[:, ~affected] == plain[:, ~affected]).all()
    slow = fates_of(*base, f"channel.links=[{override}delay={{mean_s=0.9}}}}]")
    assert ((slow < 0) == (plain < 0)).all()
    late = (slow - np.arange(120)[:, None, None])[:, affected]
    assert (late[late > 0] == 9).all()
    assert (slow[:, ~affected] == plain[:, ~affected]).all()


def test_of_two_overrides_of_a_link_the_later_counts_for_what_it_says():
    first = "{sender='r1', loss={model='bernoulli', rate=1.0}, delay={mean_s=0.5}}"
    later = "{sender='r1', receiver='r2', loss={model='none'}}"
    fates = fates_of(f"channel.links=[{first}, {later}]", ticks=3)
    assert fates[:, 0, 1].tolist() == [5, 6, 7]
    assert (fates[:, 0, 2:] == -Cause.LOSS).all()


def test_bursts_on_one_link_leave_the_others_without_bursts():
    burst = "loss={model='gilbert-elliott', good_to_bad=1.0, bad_to_good=0.0}"
    fates = fates_of(f"channel.links=[{{sender='r1', receiver='r2', {burst}}}]")
    assert (fates[:, 0, 1] == -Cause.BURST_LOSS).all()
    fates[:, 0, 1] = 0
    assert (fates >= 0).all()


def test_a_silent_radio_neither_sends_nor_receives_and_says_which_was_silent():
    def silent(tick):
        return np.array([False, 20 <= tick < 30, False, tick == 25, False])

    plain = fates_of(LOSSY, LATE)
    fates = flown(channel(LOSSY, LATE), 120, silent)[0]
    for tick in range(120):
        off = silent(tick)
        for sender in range(5):
            for receiver in range(5):
                fate = fates[tick, sender, receiver]
                if sender == receiver:
                    assert fate == 0
                elif off[sender]:
                    assert radio.CAUSES[-fate] == "sender-silent"
                elif off[receiver]:
                    assert radio.CAUSES[-fate] == "receiver-silent"
                else:
                    assert fate == plain[tick, sender, receiver]


@pytest.mark.parametrize("order", ["kept", "free"])
@pytest.mark.parametrize("changes", [(LOSSY, LATE), (BURSTY, SKEWED), (WIDE,), ()])
def test_every_packet_is_delivered_or_lost_or_on_its_way_at_every_tick(changes, order):
    chan = channel(*changes, f"channel.order={order}")
    state, arrived, lost = radio.initial(chan), 0, 0
    waiting = {}
    for tick in range(100):
        state, due = radio.deliver(state, tick)
        for sent_tick, links in due:
            for sender, receiver in np.argwhere(links).tolist():
                assert waiting.pop((sent_tick, sender, receiver)) == tick
                arrived += 1
        assert tick not in waiting.values()
        state, (fates, _) = radio.transmit(chan, state, radio.Sending(tick))
        for sender, receiver in np.argwhere(fates > 0).tolist():
            waiting[tick, sender, receiver] = int(fates[sender, receiver])
        lost += int((fates < 0).sum())
        assert radio.in_flight(state) == len(waiting)
        assert 20 * (tick + 1) == arrived + lost + len(waiting)


def test_sending_and_delivering_leave_the_state_they_were_given_as_it_was():
    chan = channel(BURSTY, SKEWED, KEPT)
    state = radio.initial(chan)
    for tick in range(10):
        before = frozen(state)
        after, _ = radio.transmit(chan, radio.deliver(state, tick)[0], radio.Sending(tick))
        radio.transmit(chan, state, radio.Sending(tick))
        assert frozen(state) == before
        state = after


def test_a_team_of_one_has_nobody_to_send_to():
    fates = fates_of(LOSSY, LATE, robots=1, ticks=3)
    assert fates.tolist() == [[[0]]] * 3
