"""Which row of a trace a packet meets: repeated, shifted and resampled, in step and per link."""

import numpy as np
import pytest
from helpers_channel import ALPHA, Flown, channel, links_of
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from encircle.world.channel.loss_causes import Cause

BITS = st.lists(st.integers(0, 1), min_size=1, max_size=40)


def lost(values, mode="repeat", ticks=200, robots=4, seed=1):
    changes = f"channel.loss={{model='trace', mode='{mode}', values={values}}}"
    flown = Flown(channel(changes, robots=robots, seed=seed), ticks)
    assert (flown.lost() == flown.lost(Cause.TRACE_LOSS)).all()
    return flown.lost()[:, links_of(robots)]


@settings(deadline=None, derandomize=True, max_examples=30)
@given(values=BITS)
def test_a_repeated_trace_loses_what_the_recording_lost_on_every_link(values):
    rows = np.resize(np.array(values, bool), 200)
    assert (lost(values) == rows[:, None]).all()


@settings(deadline=None, derandomize=True, max_examples=30)
@given(values=BITS, seed=st.integers(0, 1000))
def test_a_shifted_trace_is_the_same_trace_begun_elsewhere(values, seed):
    found = lost(values, "shifted", seed=seed)
    turns = [np.resize(np.roll(np.array(values, bool), -k), 200) for k in range(len(values))]
    for link in found.T:
        assert any((link == turn).all() for turn in turns)


def starts(seed, robots=8, length=101):
    """Where each link of a shifted trace begins, found by the one row that is lost."""
    found = lost([1] + [0] * (length - 1), "shifted", length, robots, seed)
    return (length - found.argmax(axis=0)) % length


def test_links_begin_at_rows_of_their_own_uniformly_drawn_by_seed():
    drawn = np.concatenate([starts(seed) for seed in range(60)])
    counts = np.bincount(drawn * 10 // 101, minlength=10)
    expected = np.bincount(np.arange(101) * 10 // 101) / 101 * len(drawn)
    assert stats.chisquare(counts, expected).pvalue > ALPHA
    assert (starts(1) != starts(2)).any()
    assert (starts(1) == starts(1)).all()


def test_a_link_begins_at_the_same_row_in_a_larger_team():
    few = lost([1] + [0] * 30, "shifted", 62, 3)
    many = Flown(
        channel(
            f"channel.loss={{model='trace', mode='shifted', values={[1] + [0] * 30}}}", robots=6
        ),
        62,
    ).lost()
    assert (many[:, :3, :3][:, links_of(3)] == few).all()


@pytest.mark.parametrize("mode", ["repeat", "shifted"])
def test_loss_and_delay_of_one_recording_stay_in_step(mode):
    # The delay tells the row: row k takes k + 1 ticks, and every third is lost.
    rows = [(k % 3 == 0, k + 1) for k in range(25)]
    losses = [int(gone) for gone, _ in rows]
    delays = [0.1 * ticks for _, ticks in rows]
    flown = Flown(
        channel(
            f"channel.loss={{model='trace', mode='{mode}', values={losses}}}",
            f"channel.delay={{model='trace', mode='{mode}', values={delays}}}",
        ),
        100,
    )
    for sender, receiver in np.argwhere(links_of(4)).tolist():
        arrived = flown.ticks[:, sender, receiver]
        assert set(arrived[arrived > 0].tolist()) == {t for gone, t in rows if not gone}
        starts_at = (int(arrived[arrived > 0][0]) - 1 - int((arrived > 0).argmax())) % 25
        expected = [
            0 if rows[(starts_at + k) % 25][0] else rows[(starts_at + k) % 25][1]
            for k in range(100)
        ]
        assert arrived.tolist() == expected


@pytest.mark.parametrize("values", [[1, 0, 0, 0, 1, 1, 0, 0], [0, 1], [0] * 5, [1] * 4])
def test_a_resampled_trace_loses_at_the_recordings_rate_and_independently(values):
    found = lost(values, "resample", 2000)
    rate = sum(values) / len(values)
    assert stats.binomtest(int(found.sum()), found.size, rate).pvalue > ALPHA
    if 0 < rate < 1:
        bound = stats.norm.isf(ALPHA / 2 / 12) / 2000**0.5
        series = found.T.astype(float)
        assert all(abs(np.corrcoef(s[1:], s[:-1])[0, 1]) < bound for s in series)


def test_links_with_rows_of_their_own_meet_those_and_the_others_the_rest():
    links = (
        "[{sender='r1', receiver='r2', values=[1, 0]}, {sender='r2', receiver='r1', values=[1]}]"
    )
    flown = Flown(
        channel(f"channel.loss={{model='trace', values=[0, 0, 1], links={links}}}", robots=3), 60
    ).lost()
    assert (flown[:, 0, 1] == (np.arange(60) % 2 == 0)).all()
    assert flown[:, 1, 0].all()
    for sender, receiver in ((0, 2), (1, 2), (2, 0), (2, 1)):
        assert (flown[:, sender, receiver] == (np.arange(60) % 3 == 2)).all()


def test_an_override_takes_a_trace_to_its_links_alone():
    override = "{sender='r3', loss={model='trace', values=[1, 0]}}"
    changes = ("channel.loss={model='bernoulli', rate=0.3}",)
    plain = Flown(channel(*changes), 80)
    mixed = Flown(channel(*changes, f"channel.links=[{override}]"), 80)
    assert (mixed.lost(Cause.TRACE_LOSS)[:, 2, :2] == (np.arange(80) % 2 == 0)[:, None]).all()
    others = [0, 1, 3]
    assert (mixed.due[:, others] == plain.due[:, others]).all()


def test_rows_go_on_while_nothing_is_sent():
    sizes = np.random.default_rng(2).integers(0, 2, (90, 4))
    changes = (
        "channel.loss={model='trace', mode='shifted', values=[1, 0, 0, 1, 0]}",
        "channel.delay={model='trace', values=[0.1, 0.5, 0.9]}",
    )
    always = Flown(channel(*changes), 90)
    sometimes = Flown(channel(*changes), 90, sizes_bytes=lambda tick: sizes[tick])
    assert (sometimes.due == np.where(sizes[:, :, None] > 0, always.due, 0)).all()
