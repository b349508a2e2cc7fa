"""Delays against scipy's distributions: normal cut off at zero, exponential, and resampled."""

import numpy as np
import pytest
from helpers_channel import ALPHA, Flown, channel, links_of
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from encircle.world.channel import delay
from encircle.world.channel.delay import QUANTILES, whole_ticks
from encircle.world.loading.load import load
from encircle.world.random_streams import Purpose
from encircle.world.scenario.channel_model import delay_parts


def truncated(mean_s, std_s):
    return stats.truncnorm(-mean_s / std_s, np.inf, loc=mean_s, scale=std_s)


LAWS = [
    ("normal", 0.3, 0.1, truncated(0.3, 0.1)),
    ("normal", 0.1, 0.3, truncated(0.1, 0.3)),
    ("normal", 0.0, 0.2, stats.halfnorm(scale=0.2)),
    ("normal", 5.0, 0.01, stats.norm(5.0, 0.01)),
    ("exponential", 0.25, 0.0, stats.expon(scale=0.25)),
]


def drawn_s(text, ticks=2000, robots=4, purpose=Purpose.DELAY, **tree):
    """(T, L) delays in s of the links between robots."""
    scenario = load({"team": {"robots": robots}, **tree}, [f"channel.delay={{{text}}}"])
    delays = delay.build(delay_parts(scenario.channel, scenario.ids), scenario.ids, 0.1, 1, purpose)
    return np.array([delay.seconds(delays, tick)[links_of(robots)] for tick in range(ticks)])


@pytest.mark.parametrize(("model", "mean_s", "std_s", "law"), LAWS)
def test_quantiles_are_those_of_the_law(model, mean_s, std_s, law):
    levels = np.array([1e-12, 1e-6, 0.1, 0.5, 0.9, 0.999999, 1 - 1e-12])
    found = QUANTILES[model](levels, np.float64(mean_s), np.float64(std_s))
    # The left tail of a law that zero hardly cuts is exact only as 1 - p is: to some 1e-5 of s.
    np.testing.assert_allclose(found, law.ppf(levels), rtol=1e-7, atol=3e-5 * max(std_s, 1e-9))


@pytest.mark.parametrize(("model", "mean_s", "std_s", "law"), LAWS)
def test_delays_follow_the_law_on_every_link_and_altogether(model, mean_s, std_s, law):
    parameters = f"mean_s={mean_s}" + (f", std_s={std_s}" if model == "normal" else "")
    drawn = drawn_s(f"model='{model}', {parameters}")
    assert stats.kstest(drawn.ravel(), law.cdf).pvalue > ALPHA
    assert min(stats.kstest(link, law.cdf).pvalue for link in drawn.T) > ALPHA / 12
    assert drawn.min() >= 0.0
    mean = (drawn.mean() - law.mean()) / (law.std() / drawn.size**0.5)
    assert abs(mean) < stats.norm.isf(ALPHA / 2)


@pytest.mark.parametrize("model", ["normal", "exponential", "gamma", "lognormal", "uniform"])
def test_the_ends_of_the_unit_interval_give_no_nonsense(model):
    ends = np.array([0.0, 2.0**-53, 1.0 - 2.0**-53])
    for mean_s, std_s in ((0.1, 0.1), (600.0, 0.6), (1e-3, 1.0), (600.0, 600.0)):
        found = QUANTILES[model](ends, np.float64(mean_s), np.float64(std_s))
        assert np.isfinite(found).all()
        assert (found >= 0.0).all()
        if model != "uniform":
            assert (np.diff(found) >= 0.0).all()


@settings(deadline=None, derandomize=True, max_examples=60)
@given(
    delay_s=st.floats(0.0, 600.0),
    waited=st.floats(0.0, 50.0),
    tick_s=st.sampled_from([0.01, 0.03, 0.1, 1.0]),
)
def test_waiting_adds_to_the_delay_before_it_is_rounded_up(delay_s, waited, tick_s):
    taken = int(whole_ticks(np.float64(delay_s), tick_s, waited))
    exact = delay_s / tick_s + waited
    assert taken >= 1
    assert exact - 1e-6 <= taken
    assert taken < exact + 1.0 or taken == 1


VALUES = [0.05, None, 0.3, 0.3, None, 0.9, 0.15]


def shown(values):
    """As TOML cannot say null, the tests say it in a mapping."""
    return {"channel": {"delay": {"model": "trace", "values": values}}}


def trace(values, mode, ticks, purpose=Purpose.DELAY, robots=4):
    tree = {"team": {"robots": robots}, **shown(values)}
    scenario = load(tree, [f"channel.delay.mode={mode}"])
    delays = delay.build(delay_parts(scenario.channel, scenario.ids), scenario.ids, 0.1, 1, purpose)
    return np.array([delay.seconds(delays, tick)[links_of(robots)] for tick in range(ticks)])


def test_a_repeated_trace_gives_every_link_its_rows_in_order_again_and_again():
    filled = [0.05, 0.05, 0.3, 0.3, 0.3, 0.9, 0.15]
    drawn = trace(VALUES, "repeat", 70)
    assert (drawn == np.array(filled * 10)[:, None]).all()


def test_rows_lost_before_the_first_received_one_take_its_delay():
    assert (
        trace([None, None, 0.4, None, 0.2], "repeat", 5)[:, 0] == [0.4, 0.4, 0.4, 0.4, 0.2]
    ).all()


def test_a_resampled_trace_has_the_distribution_of_its_received_rows():
    drawn = trace(VALUES, "resample", 3000)
    counts = [(drawn == value).sum() for value in (0.05, 0.15, 0.3, 0.9)]
    assert sum(counts) == drawn.size
    expected = np.array([1, 1, 2, 1]) / 5 * drawn.size
    assert stats.chisquare(counts, expected).pvalue > ALPHA


def test_a_resampled_trace_is_independent_from_tick_to_tick():
    drawn = trace(VALUES, "resample", 3000)
    bound = stats.norm.isf(ALPHA / 2 / 12) / 3000**0.5
    assert all(abs(np.corrcoef(s[1:], s[:-1])[0, 1]) < bound for s in drawn.T)


def test_a_long_resampled_trace_meets_the_quantiles_of_the_law_it_was_drawn_from():
    # The trace's rows are a law's quantiles: then both arms meet nearly the same delays.
    levels = (np.arange(5000) + 0.5) / 5000
    values = np.random.default_rng(1).permutation(stats.gamma(4.0, scale=0.05).ppf(levels))
    by_trace = trace([float(value) for value in values], "resample", 200)
    by_law = drawn_s("model='gamma', mean_s=0.2, std_s=0.1", ticks=200)
    common = by_law < 0.45
    assert common.mean() > 0.98
    assert abs(by_trace - by_law)[common].max() < 5e-3


@pytest.mark.parametrize("mode", ["repeat", "shifted", "resample"])
def test_copies_draw_from_the_received_rows_whatever_the_mode(mode):
    copies = trace(VALUES, mode, 500, Purpose.COPY_DELAY)
    assert (copies == trace(VALUES, "resample", 500, Purpose.COPY_DELAY)).all()
    assert (copies != trace(VALUES, "resample", 500)).any()
    assert set(np.unique(copies)) == {0.05, 0.15, 0.3, 0.9}


def test_laws_of_single_links_stand_beside_each_other():
    links = [
        "{sender='r1', delay={model='exponential', mean_s=0.2}}",
        "{receiver='r1', delay={model='gamma', mean_s=0.2, std_s=0.1}}",
        "{sender='r2', receiver='r3', delay={model='gamma', mean_s=0.4, std_s=0.4}}",
        "{sender='r3', receiver='r2', delay={model='trace', values=[0.1, 0.7]}}",
        "{sender='r3', receiver='r4', delay={model='trace', mode='resample', values=[0.2, 0.8]}}",
    ]
    settings_ = ["channel.delay={model='uniform', low_s=0.1, high_s=0.4}"]
    every = Flown(channel(*settings_, f"channel.links=[{', '.join(links)}]"), 300).ticks
    alone = {
        (0, 2): "model='exponential', mean_s=0.2",
        (2, 0): "model='gamma', mean_s=0.2, std_s=0.1",
        (1, 2): "model='gamma', mean_s=0.4, std_s=0.4",
        (2, 1): "model='trace', values=[0.1, 0.7]",
        (2, 3): "model='trace', mode='resample', values=[0.2, 0.8]",
        (1, 3): "model='uniform', low_s=0.1, high_s=0.4",
    }
    for (sender, receiver), text in alone.items():
        only = Flown(channel(f"channel.delay={{{text}}}"), 300).ticks
        assert (every[:, sender, receiver] == only[:, sender, receiver]).all(), text
