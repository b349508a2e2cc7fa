"""The radio against theory: loss, bursts and delays by their declared distributions."""

from decimal import Decimal

import numpy as np
import pytest
from helpers_world import small
from scipy import stats

from encircle.world.channel import channel as radio
from encircle.world.channel.delay import QUANTILES, whole_ticks
from encircle.world.channel.loss_causes import Cause
from encircle.world.scenario.delay_models import DELAY_MODELS, Delay
from encircle.world.scenario.errors import ScenarioError

ALPHA = 1e-3


def channel(*overrides, robots=4, seed=1):
    scenario = small(*overrides, team={"robots": robots})
    return radio.build(scenario, seed)


def fates_of(chan, ticks):
    """(T, N, N) fates of the packets of the first T ticks."""
    state, found = radio.initial(chan), []
    for tick in range(ticks):
        state, _ = radio.deliver(state, tick)
        state, (fates, _) = radio.transmit(chan, state, radio.Sending(tick))
        found.append(fates)
    return np.array(found)


def on_links(fates):
    """(T, L) the fates of the links between two robots."""
    count = fates.shape[1]
    return fates[:, ~np.eye(count, dtype=bool)]


@pytest.mark.parametrize("rate", [0.01, 0.3, 0.9])
def test_bernoulli_loses_at_its_rate_on_every_link_alike(rate):
    fates = on_links(
        fates_of(channel("channel.loss.model=bernoulli", f"channel.loss.rate={rate}"), 4000)
    )
    lost = fates == -Cause.LOSS
    assert ((fates > 0) | lost).all()
    assert stats.binomtest(int(lost.sum()), lost.size, rate).pvalue > ALPHA
    per_link = lost.sum(axis=0)
    expected = 4000 * rate
    homogeneity = ((per_link - expected) ** 2 / (expected * (1 - rate))).sum()
    assert ALPHA < stats.chi2.sf(homogeneity, len(per_link)) < 1 - ALPHA


def test_bernoulli_losses_are_independent_from_tick_to_tick_and_from_link_to_link():
    lost = on_links(
        fates_of(channel("channel.loss.model=bernoulli", "channel.loss.rate=0.4"), 4000)
    )
    series = np.array(lost < 0, float).T
    bound = stats.norm.isf(ALPHA / 2 / 100) / 4000**0.5
    assert abs(np.corrcoef(series)[np.triu_indices(12, 1)]).max() < bound
    assert all(abs(np.corrcoef(s[1:], s[:-1])[0, 1]) < bound for s in series)


@pytest.mark.parametrize(("rate", "lost"), [(0.0, 0), (1.0, 12 * 50)])
def test_certain_loss_and_no_loss_are_exact(rate, lost):
    fates = fates_of(channel("channel.loss.model=bernoulli", f"channel.loss.rate={rate}"), 50)
    assert (on_links(fates) < 0).sum() == lost


BURSTS = [(0.05, 0.25, 0.0, 1.0), (0.3, 0.3, 0.1, 0.8), (0.8, 0.9, 0.02, 0.6)]


def bursty(good_to_bad, bad_to_good, loss_good, loss_bad, robots=12):
    return channel(
        "channel.loss.model=gilbert-elliott",
        f"channel.loss.good_to_bad={good_to_bad}",
        f"channel.loss.bad_to_good={bad_to_good}",
        f"channel.loss.loss_good={loss_good}",
        f"channel.loss.loss_bad={loss_bad}",
        robots=robots,
    )


@pytest.mark.parametrize("burst", BURSTS)
def test_gilbert_elliott_loses_at_its_stationary_rate(burst):
    good_to_bad, bad_to_good, loss_good, loss_bad = burst
    lost = on_links(fates_of(bursty(*burst), 1500)) == -Cause.BURST_LOSS
    bad = good_to_bad / (good_to_bad + bad_to_good)
    rate = bad * loss_bad + (1 - bad) * loss_good
    # Variance of a mean over a two-state chain: its correlation decays as memory**lag.
    memory = 1 - good_to_bad - bad_to_good
    chain = bad * (1 - bad) * (loss_bad - loss_good) ** 2
    noise = bad * loss_bad * (1 - loss_bad) + (1 - bad) * loss_good * (1 - loss_good)
    deviation = ((chain * (1 + memory) / (1 - memory) + noise) / lost.size) ** 0.5
    assert abs(lost.mean() - rate) < stats.norm.isf(ALPHA / 2) * deviation


@pytest.mark.parametrize("burst", BURSTS)
def test_gilbert_elliott_starts_in_its_stationary_state(burst):
    good_to_bad, bad_to_good, loss_good, loss_bad = burst
    lost = on_links(fates_of(bursty(*burst, robots=120), 2)) < 0
    bad = good_to_bad / (good_to_bad + bad_to_good)
    rate = bad * loss_bad + (1 - bad) * loss_good
    for tick in (0, 1):
        assert stats.binomtest(int(lost[tick].sum()), lost[tick].size, rate).pvalue > ALPHA


@pytest.mark.parametrize("bad_to_good", [0.5, 0.2, 0.05])
def test_bursts_are_geometric_with_the_declared_mean_length(bad_to_good):
    lost = on_links(fates_of(bursty(0.05, bad_to_good, 0.0, 1.0), 1500)) < 0
    # Bursts that begin early enough to be seen whole; a longer one is beyond all probability.
    lengths = []
    for series in lost.T:
        edges = np.diff(series.astype(int), prepend=series[0], append=0)
        begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
        ends = ends[1:] if series[0] else ends
        lengths += [e - b for b, e in zip(begins, ends, strict=True) if b < 1000]
    lengths = np.array(lengths)
    deviation = (1 - bad_to_good) ** 0.5 / bad_to_good / len(lengths) ** 0.5
    assert abs(lengths.mean() - 1 / bad_to_good) < stats.norm.isf(ALPHA / 2) * deviation
    single = int((lengths == 1).sum())
    assert stats.binomtest(single, len(lengths), bad_to_good).pvalue > ALPHA


def lognormal(mean, spread):
    variance = np.log1p((spread / mean) ** 2)
    return stats.lognorm(variance**0.5, scale=mean * np.exp(-variance / 2))


DELAYS = [
    (DELAY_MODELS["uniform"](model="uniform", low_s=0.05, high_s=0.62), stats.uniform(0.05, 0.57)),
    (DELAY_MODELS["gamma"](model="gamma", mean_s=0.25, std_s=0.2), stats.gamma(1.5625, scale=0.16)),
    (
        DELAY_MODELS["gamma"](model="gamma", mean_s=0.3, std_s=0.05),
        stats.gamma(36.0, scale=0.3 / 36),
    ),
    (DELAY_MODELS["lognormal"](model="lognormal", mean_s=0.2, std_s=0.3), lognormal(0.2, 0.3)),
    (DELAY_MODELS["lognormal"](model="lognormal", mean_s=0.4, std_s=0.1), lognormal(0.4, 0.1)),
]
BY_DELAY = pytest.mark.parametrize(
    ("delay", "law"), DELAYS, ids=lambda d: d.model if isinstance(d, Delay) else ""
)


@BY_DELAY
def test_the_declared_law_has_the_declared_mean_and_deviation(delay, law):
    if delay.model != "uniform":
        assert law.mean() == pytest.approx(delay.mean_s)
        assert law.std() == pytest.approx(delay.std_s)


def quantile(delay):
    by_ends = delay.model == "uniform"
    first = delay.low_s if by_ends else delay.mean_s
    second = delay.high_s if by_ends else delay.std_s
    return lambda p: QUANTILES[delay.model](p, np.float64(first), np.float64(second))


@BY_DELAY
def test_quantiles_of_a_delay_are_those_of_its_law(delay, law):
    levels = np.array([1e-9, 1e-3, 0.1, 0.5, 0.9, 0.999, 1 - 1e-9])
    np.testing.assert_allclose(quantile(delay)(levels), law.ppf(levels), rtol=1e-7)
    drawn = quantile(delay)(np.random.default_rng(1).random(20_000))
    assert stats.kstest(drawn, law.cdf).pvalue > ALPHA


@BY_DELAY
@pytest.mark.parametrize("tick_s", [0.1, 0.03])
def test_delays_in_ticks_follow_the_law_rounded_up(delay, law, tick_s):
    settings = [f"channel.delay.{k}={v!r}" for k, v in delay.model_dump(exclude_unset=True).items()]
    fates = fates_of(channel(f"tick_s={tick_s}", *settings), 1500)
    ticks = on_links(fates - np.arange(1500)[:, None, None]).ravel()
    assert ticks.min() >= 1
    # P(ticks <= k) = F(k tick_s) for k >= 1; bins with few expected are pooled into the last.
    edges = np.arange(1, ticks.max() + 2)
    below = law.cdf(edges * tick_s)
    last = int(np.searchsorted(below, 1 - 20 / len(ticks)))
    first = int(np.searchsorted(below, 20 / len(ticks)))
    expected = np.diff(below[first:last], prepend=0.0, append=1.0) * len(ticks)
    counted = np.array([(ticks <= k).sum() for k in edges[first:last]])
    observed = np.diff(counted, prepend=0, append=len(ticks))
    assert stats.chisquare(observed, expected).pvalue > ALPHA


@pytest.mark.parametrize("tick", ["0.1", "0.02", "0.07", "0.3", "0.001", "0.05", "1e-4", "7.3"])
def test_a_delay_of_exactly_k_ticks_arrives_after_exactly_k_ticks(tick):
    tick_s, whole = float(tick), np.arange(1, 60_000)
    as_written = np.array([float(Decimal(tick) * k) for k in whole.tolist()])
    for delays in (whole * tick_s, as_written):
        assert (whole_ticks(delays, tick_s) == whole).all()
    assert (whole_ticks(whole * tick_s + 1e-3 * tick_s, tick_s) == whole + 1).all()
    assert (whole_ticks(whole * tick_s - 1e-3 * tick_s, tick_s) == whole).all()


@pytest.mark.parametrize("denominator", [3, 7, 11, 60])
def test_so_it_does_if_the_tick_is_no_decimal_fraction(denominator):
    whole = np.arange(1, 60_000)
    assert (whole_ticks(whole / denominator, 1 / denominator) == whole).all()


@pytest.mark.parametrize(
    ("tick_s", "mean_s", "ticks"), [(0.1, 0.3, 3), (0.1, 0.31, 4), (0.5, 0.0, 1), (0.5, 1e-6, 1)]
)
def test_a_constant_delay_is_the_same_for_every_packet(tick_s, mean_s, ticks):
    fates = fates_of(channel(f"tick_s={tick_s}", f"channel.delay.mean_s={mean_s}"), 20)
    assert (on_links(fates) == np.arange(20)[:, None] + ticks).all()


@pytest.mark.parametrize(
    "overrides",
    [
        ["tick_s=1e-300", "channel.delay.mean_s=600"],
        ["channel.delay={model='lognormal', mean_s=1e-200, std_s=1}"],
        ["channel.delay={model='gamma', mean_s=1e-200, std_s=600}"],
        ["channel.delay={model='gamma', mean_s=1e-9, std_s=600}"],
        ["channel.delay={model='gamma', mean_s=600, std_s=1e-9}"],
    ],
)
def test_an_extreme_delay_is_refused_by_the_scenario_or_drawn(overrides):
    try:
        chan = channel(*overrides)
    except ScenarioError:
        return
    assert (on_links(fates_of(chan, 5)) > np.arange(5)[:, None]).all()
