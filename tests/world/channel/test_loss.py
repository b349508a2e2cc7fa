"""Losses against theory: by distance, by range, and in bursts given by rate and length."""

import numpy as np
import pytest
from helpers_channel import ALPHA, Flown, channel, distances, links_of
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from encircle.world.channel.loss_causes import Cause

FALLOFF = "channel.loss={{model='distance', midpoint_m={}, width_m={}}}"


def binomial(lost, chance):
    return stats.binomtest(int(lost.sum()), lost.size, chance).pvalue


@pytest.mark.parametrize(("midpoint", "width"), [(6.0, 1.0), (3.0, 2.5), (10.0, 0.2)])
def test_loss_by_distance_follows_the_logistic_curve_at_every_distance(midpoint, width):
    # Robots on a line at 0, 1, 3, 7 and 15 m: ten distances from 1 to 15 m, both ways.
    places = np.array([[2.0**k - 1.0, 0.0] for k in range(5)])
    apart = distances(places)
    flown = Flown(
        channel(FALLOFF.format(midpoint, width), robots=5), 4000, distances_m=distances(places)
    )
    lost = flown.lost(Cause.DISTANCE_LOSS)
    assert (lost == flown.lost()).all()
    # False alarms: 10 distances, each with ALPHA / 10.
    for distance in np.unique(apart[links_of(5)]):
        chance = 1.0 / (1.0 + np.exp(-(distance - midpoint) / width))
        assert binomial(lost[:, apart == distance], chance) > ALPHA / 10, distance


def test_loss_by_distance_follows_robots_that_move():
    # The pair's distance sweeps 0 to 12 m over and over; whole residuals against the curve.
    swept = np.tile(np.linspace(0.0, 12.0, 200), 40)

    def apart(tick):
        return np.where(np.eye(2, dtype=bool), 0.0, swept[tick])

    lost = Flown(channel(FALLOFF.format(6.0, 1.5), robots=2), len(swept), distances_m=apart).lost()
    chance = 1.0 / (1.0 + np.exp(-(swept - 6.0) / 1.5))
    for link in ((0, 1), (1, 0)):
        excess = (lost[:, *link] - chance).sum()
        deviation = (chance * (1 - chance)).sum() ** 0.5
        assert abs(excess) < stats.norm.isf(ALPHA / 2) * deviation


def test_extreme_curves_are_steps():
    apart = np.array([[0.0, 9.99], [1e5, 0.0]])
    lost = Flown(channel(FALLOFF.format(10.0, 0.001), robots=2), 50, distances_m=apart).lost()
    assert not lost[:, 0, 1].any()
    assert lost[:, 1, 0].all()


@pytest.mark.parametrize(
    "loss", ["model='range', cutoff_m=5", "model='distance', midpoint_m=90, width_m=1, cutoff_m=5"]
)
def test_beyond_the_cutoff_everything_is_lost_and_at_it_nothing(loss):
    apart = np.array([[0.0, 5.0, 4.99], [5.0, 0.0, np.nextafter(5.0, 6.0)], [80.0, 5.01, 0.0]])
    flown = Flown(channel(f"channel.loss={{{loss}}}", robots=3), 200, distances_m=apart)
    beyond = apart > 5.0
    assert flown.lost(Cause.OUT_OF_RANGE)[:, beyond].all()
    assert not flown.lost()[:, ~beyond].any()


def test_a_cutoff_adds_losses_and_changes_none_within_it():
    curve = "channel.loss={model='distance', midpoint_m=6, width_m=2"
    apart = distances(np.array([[0.0, 0.0], [4.0, 0.0], [0.0, 7.0], [9.0, 9.0]]))
    plain, cut = (
        Flown(channel(curve + more), 500, distances_m=apart) for more in ("}", ", cutoff_m=8}")
    )
    near = apart <= 8.0
    assert (plain.due[:, near] == cut.due[:, near]).all()
    assert cut.lost(Cause.OUT_OF_RANGE)[:, ~near].all()


@settings(deadline=None, derandomize=True, max_examples=20)
@given(rate=st.floats(0.05, 0.9), distance=st.floats(0.5, 20.0))
def test_bernoulli_and_distance_meet_the_same_draws(rate, distance):
    # So an arm that loses more by distance loses what Bernoulli loses, and others.
    chance = 1.0 / (1.0 + np.exp(-(distance - 8.0) / 2.0))
    apart = np.full((3, 3), distance)
    by_rate = Flown(channel(f"channel.loss={{model='bernoulli', rate={rate}}}", robots=3), 60)
    by_distance = Flown(channel(FALLOFF.format(8, 2), robots=3), 60, distances_m=apart)
    more, less = (by_rate, by_distance) if rate >= chance else (by_distance, by_rate)
    assert (more.lost() | ~less.lost()).all()


def bursts_of(lost):
    """Lengths of the bursts in series (T, L) that begin after its start and end before its end."""
    lengths, pauses = [], []
    for series in lost.T:
        edges = np.flatnonzero(np.diff(series.astype(int))) + 1
        runs = np.diff(edges)
        into_loss = series[edges[:-1]]
        lengths.append(runs[into_loss])
        pauses.append(runs[~into_loss])
    return np.concatenate(lengths), np.concatenate(pauses)


BURSTS = [(0.1, 1.0), (0.1, 4.0), (0.3, 2.0), (0.5, 8.0), (0.75, 3.0), (0.02, 20.0)]


@pytest.mark.parametrize(("rate", "length"), BURSTS)
def test_bursts_have_the_declared_rate_and_geometric_lengths(rate, length):
    flown = Flown(
        channel(f"channel.loss={{model='burst', rate={rate}, burst_packets={length}}}", robots=10),
        4000,
    )
    lost = flown.lost(Cause.BURST_LOSS)[:, links_of(10)]
    assert 0 < lost.sum() == flown.lost().sum()
    # Rate: the variance of a mean over a two-state chain whose memory decays geometrically.
    memory = 1.0 - 1.0 / length - rate / (length * (1.0 - rate))
    deviation = (rate * (1 - rate) * (1 + memory) / (1 - memory) / lost.size) ** 0.5
    assert abs(lost.mean() - rate) < stats.norm.isf(ALPHA / 2) * deviation + 1e-12
    # Lengths: geometric, the runs cut off by either end left out; so are the pauses between.
    for found, leaves in zip(
        bursts_of(lost), (1.0 / length, rate / (length * (1.0 - rate))), strict=True
    ):
        if leaves > 1.0 - 1e-9:
            assert (found == 1).all()
            continue
        law = stats.geom(leaves)
        edges = np.unique(law.ppf(np.linspace(0.0, 0.98, 12)[1:]).astype(int))
        counted = np.array([(found <= edge).sum() for edge in edges])
        observed = np.diff(counted, prepend=0, append=len(found))
        expected = np.diff(law.cdf(edges), prepend=0.0, append=1.0) * len(found)
        kept = expected > 5
        assert kept.sum() > 1
        statistic = ((observed - expected)[kept] ** 2 / expected[kept]).sum()
        # One degree of freedom too many, which makes an alarm no likelier. Runs cut off at the
        # ends are the longer ones: a bias far below this band at T = 4000.
        assert stats.chi2.sf(statistic, int(kept.sum())) > ALPHA


def test_a_burst_model_is_the_gilbert_elliott_chain_it_stands_for():
    burst = "channel.loss={model='burst', rate=0.2, burst_packets=5}"
    chain = "channel.loss={model='gilbert-elliott', good_to_bad=0.05, bad_to_good=0.2}"
    assert (Flown(channel(burst), 400).due == Flown(channel(chain), 400).due).all()


@pytest.mark.parametrize("length", [1.0, 3.5])
def test_bursts_of_rate_zero_lose_nothing(length):
    flown = Flown(channel(f"channel.loss={{model='burst', burst_packets={length}}}"), 100)
    assert (flown.due[:, links_of(4)] > 0).all()


def test_bursts_of_the_highest_rate_leave_one_packet_between():
    flown = Flown(channel(f"channel.loss={{model='burst', rate={2 / 3}, burst_packets=2}}"), 900)
    lost = flown.lost()[:, links_of(4)]
    assert not (~lost[1:] & ~lost[:-1]).any()


def test_a_chain_goes_on_while_nothing_is_sent():
    burst = "channel.loss={model='burst', rate=0.3, burst_packets=6}"
    always = Flown(channel(burst), 300)
    sizes = np.random.default_rng(1).integers(0, 2, (300, 4))
    sometimes = Flown(channel(burst), 300, sizes_bytes=lambda tick: sizes[tick])
    assert (sometimes.due == np.where(sizes[:, :, None] > 0, always.due, 0)).all()
