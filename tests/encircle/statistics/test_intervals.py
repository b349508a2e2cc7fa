"""Statistics of a study: published tables, hand computations, enumeration, and coverage.

Coverage is counted over simulated studies whose truth is known. An interval of a finite sample
does not cover 95 % exactly: each test says between which bounds its coverage lies, as more studies
than the test runs have shown, and fails by chance below 1e-6. Its seeds are fixed besides.
"""

from fractions import Fraction
from itertools import product
from math import isnan, sqrt

import numpy as np
import pytest
from helpers_intervals import Z, assert_covers, holds, wilson
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from encircle.statistics import intervals as statistics
from encircle.statistics.intervals import Interval

# Freireich et al. (1963), Blood 21, 699-716: weeks of remission under 6-MP and under placebo.
WEEKS_6MP = [6, 6, 6, 6, 7, 9, 10, 10, 11, 13, 16, 17, 19, 20, 22, 23, 25, 32, 32, 34, 35]
RELAPSED_6MP = [1, 1, 1, 0, 1, 0, 1, 0, 0, 1, 1, 0, 0, 0, 1, 1, 0, 0, 0, 0, 0]
WEEKS_PLACEBO = [1, 1, 2, 2, 3, 4, 4, 5, 5, 8, 8, 8, 8, 11, 11, 12, 12, 15, 17, 22, 23]
RELAPSED_PLACEBO = [1] * 21

runs = st.lists(st.tuples(st.integers(0, 6), st.booleans()), min_size=1, max_size=12)


def test_an_interval_prints_its_three_numbers_alike():
    assert f"{Interval(0.85, 0.7149, 0.9266)}" == "0.85 [0.715, 0.927]"
    assert f"{Interval(0.85, 0.7149, 0.9266):.2f}" == "0.85 [0.71, 0.93]"
    assert f"{Interval(-1.0, float('nan'), float('inf')):+.1f}" == "-1.0 [+nan, +inf]"


# Newcombe (1998), Statistics in Medicine 17, 857-872, table I, method 3.
@pytest.mark.parametrize(
    ("captured", "n", "low", "high"),
    [
        (81, 263, 0.2553, 0.3662),
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0, 0.1611),
        (1, 29, 0.0061, 0.1718),
    ],
)
def test_rate_has_the_published_bounds(captured, n, low, high):
    result = statistics.capture_rate(np.arange(n) < captured)
    assert result.value == captured / n
    assert (round(result.low, 4), round(result.high, 4)) == (low, high)


def test_rate_solves_wilsons_equation():
    for n in range(1, 12):
        for captured in range(n + 1):
            result = statistics.capture_rate([True] * captured + [False] * (n - captured))
            assert result[1:] == pytest.approx(wilson(captured, n), abs=1e-12)


def test_rate_covers_by_enumeration():
    # Computed exactly. Wilson's coverage oscillates about 95 % with the rate and is low near 0, 1.
    n = 40
    bounds = [statistics.capture_rate(np.arange(n) < k) for k in range(n + 1)]
    rates = np.linspace(0.01, 0.99, 99)
    coverage = [
        sum(stats.binom.pmf(k, n, p) for k in range(n + 1) if holds(bounds[k], p)) for p in rates
    ]
    assert 0.945 < np.mean(coverage) < 0.96
    assert min(coverage) > 0.89


def test_survival_of_a_textbook_trial():
    # Shares and bounds as in Kleinbaum and Klein, Survival Analysis, and Stata's sts list.
    result = statistics.kaplan_meier(WEEKS_6MP, RELAPSED_6MP)
    expected = {
        6: (0.8571, 0.6197, 0.9516),
        7: (0.8067, 0.5631, 0.9228),
        10: (0.7529, 0.5032, 0.8894),
        13: (0.6902, 0.4316, 0.8491),
        16: (0.6275, 0.3675, 0.8049),
        22: (0.5378, 0.2678, 0.7468),
        23: (0.4482, 0.1881, 0.6801),
    }
    for week, row in expected.items():
        k = list(result.ticks).index(week)
        assert [round(x[k], 4) for x in (result.share, result.low, result.high)] == list(row)
    assert result.median == 23
    assert list(result.ticks) == sorted(set(WEEKS_6MP))


@settings(deadline=None, derandomize=True, max_examples=150)
@given(runs)
def test_survival_is_the_product_limit_and_stays_within_its_bounds(sample):
    result = statistics.kaplan_meier(*zip(*sample, strict=True))
    share = Fraction(1)
    for k, tick in enumerate(result.ticks):
        lasted = sum(t >= tick for t, _ in sample)
        captured = sum(t == tick and c for t, c in sample)
        share *= 1 - Fraction(captured, lasted)
        assert result.share[k] == pytest.approx(float(share), abs=1e-12)
    assert (result.low >= 0).all()
    assert (result.high <= 1).all()
    assert (result.low <= result.share + 1e-12).all()
    assert (result.high >= result.share - 1e-12).all()
    half = [t for t, s in zip(result.ticks, result.share, strict=True) if s < 0.5 + 1e-9]
    assert result.median == half[0] if half else isnan(result.median)


def test_without_censoring_the_last_bound_is_the_one_before_or_wilsons():
    result = statistics.kaplan_meier([3, 5, 9], [True] * 3)
    assert list(result.share) == pytest.approx([2 / 3, 1 / 3, 0])
    assert (result.low[-1], result.high[-1]) == (0, min(result.high[-2], wilson(0, 1)[1]))
    at_once = statistics.kaplan_meier([4] * 30, [True] * 30)
    assert at_once.high[0] == pytest.approx(wilson(0, 30)[1])
    assert at_once.median == 4


def test_runs_that_never_capture_stay_free_as_surely_as_they_are_many():
    result = statistics.kaplan_meier([500] * 30, [False] * 30)
    assert (list(result.ticks), list(result.share)) == ([500], [1])
    assert (result.low[0], result.high[0]) == pytest.approx(wilson(30, 30))
    assert isnan(result.median)


@pytest.mark.parametrize("captured", [True, False])
def test_one_run_says_little(captured):
    result = statistics.kaplan_meier([7], [captured])
    assert result.share[0] == 1 - captured
    assert (result.low[0], result.high[0]) == pytest.approx(wilson(1 - captured, 1))


def test_a_capture_at_the_limit_is_not_a_censored_run():
    assert list(statistics.kaplan_meier([9, 9], [True, False]).share) == [0.5]
    assert list(statistics.kaplan_meier([9, 9], [False, False]).share) == [1]


@pytest.mark.parametrize("n", [2, 24, 38, 44])
def test_median_is_where_exactly_half_are_left(n):
    # The product of the shares of 24, 38 and 44 runs exceeds one half by a rounding error.
    half = np.arange(n) < n // 2
    assert statistics.kaplan_meier(range(1, n + 1), half).median == n // 2
    assert isnan(statistics.kaplan_meier(range(n + 1), [*half, False]).median)


def test_survival_covers_at_a_tick():
    # About a fifth of the runs are observed for a shorter time than this tick.
    rng = np.random.default_rng(1)

    def study():
        capture, watched = rng.exponential(1.5, 60), rng.uniform(0.2, 4.0, 60)
        result = statistics.kaplan_meier(np.minimum(capture, watched), capture <= watched)
        k = np.searchsorted(result.ticks, 1.0, side="right") - 1
        return result.low[k] <= np.exp(-1.0 / 1.5) <= result.high[k]

    assert_covers((study() for _ in range(1000)), 0.94, 0.96)


def test_logrank_of_a_textbook_trial():
    # Chi-squared of 16.79 in textbooks; two-sided p by its distribution.
    p = statistics.logrank_p(WEEKS_6MP, RELAPSED_6MP, WEEKS_PLACEBO, RELAPSED_PLACEBO)
    assert stats.chi2.isf(p, 1) == pytest.approx(16.79, abs=0.005)
    swapped = statistics.logrank_p(WEEKS_PLACEBO, RELAPSED_PLACEBO, WEEKS_6MP, RELAPSED_6MP)
    assert swapped == pytest.approx(p)


@settings(deadline=None, derandomize=True, max_examples=150)
@given(runs, runs)
def test_logrank_by_hand(a, b):
    observed, expected, variance = Fraction(0), Fraction(0), Fraction(0)
    for tick in sorted({t for t, c in a + b if c}):
        at_risk, of_a = (sum(t >= tick for t, _ in x) for x in (a + b, a))
        captured = sum(t == tick and c for t, c in a + b)
        observed += sum(t == tick and c for t, c in a)
        expected += Fraction(captured * of_a, at_risk)
        if at_risk > 1:
            others = of_a * (at_risk - of_a) * captured * (at_risk - captured)
            variance += Fraction(others, at_risk**2 * (at_risk - 1))
    p = statistics.logrank_p(*zip(*a, strict=True), *zip(*b, strict=True))
    if variance == 0:
        assert isnan(p)
    else:
        z = float(observed - expected) / sqrt(variance)
        assert p == pytest.approx(2 * stats.norm.sf(abs(z)), abs=1e-12)


def test_logrank_is_not_fooled_by_rounding():
    # Only runs of a are observed at a's captures: 1 - 49 * (1 / 49) must not count as a difference.
    captured = [True] + [False] * 48
    assert isnan(statistics.logrank_p([5] + [9] * 48, captured, [1] * 9, [False] * 9))
    assert isnan(statistics.logrank_p([9, 9], [False] * 2, [9], [False]))


def test_mean_of_many_is_as_students():
    values = np.random.default_rng(2).normal(5.0, 2.0, 2000)
    result = statistics.bootstrap_mean(values)
    expected = stats.ttest_1samp(values, 0.0).confidence_interval()
    assert result.value == pytest.approx(values.mean())
    # A bound of 2000 resamples is off by about 3 % of a half-width; 15 % is five times that.
    tolerated = 0.15 * (expected.high - result.value)
    assert result[1:] == pytest.approx((expected.low, expected.high), abs=tolerated)


def test_mean_of_skewed_values_is_bounded_as_the_expansion_says():
    # Efron (1987): BCa bounds lie at z + (2 z^2 + 1) skewness / (6 sqrt(n)) standard errors, but
    # for 1/n; percentiles lie at z + (z^2 - 1) of it, here 0.2 lower.
    values = np.random.default_rng(10).exponential(size=100)
    result = statistics.bootstrap_mean(values, resamples=20000)
    error = np.std(values, ddof=1) / 10
    for bound, z in ((result.low, -Z), (result.high, Z)):
        expected = z + (2 * z**2 + 1) * stats.skew(values) / 60
        assert (bound - result.value) / error == pytest.approx(expected, abs=0.1)


def test_mean_leaves_out_what_is_undefined_and_repeats_itself():
    values = [3.0, float("nan"), 1.0, 4.0, float("nan"), 1.0]
    assert statistics.bootstrap_mean(values) == statistics.bootstrap_mean([3.0, 1.0, 4.0, 1.0])
    assert statistics.bootstrap_mean(values) == statistics.bootstrap_mean(values)
    assert statistics.bootstrap_mean(values).low < 2.25 < statistics.bootstrap_mean(values).high


def test_mean_of_too_few_or_equal_values():
    assert all(map(isnan, statistics.bootstrap_mean([])))
    assert all(map(isnan, statistics.bootstrap_mean([float("nan")])))
    assert statistics.bootstrap_mean([3.0])[0] == 3.0
    assert all(map(isnan, statistics.bootstrap_mean([3.0])[1:]))
    for n in range(2, 40):
        alike = statistics.bootstrap_mean([0.1] * n)
        assert alike.low == alike.value == alike.high == pytest.approx(0.1)


def test_mean_covers_less_if_the_values_are_skewed():
    # Of 40 values BCa covers less than 95 %: 94 % if they are normal, 92 % if exponential.
    rng = np.random.default_rng(3)
    studies = range(300)
    normal = [holds(statistics.bootstrap_mean(rng.normal(size=40)), 0.0) for _ in studies]
    skewed = [holds(statistics.bootstrap_mean(rng.exponential(size=40)), 1.0) for _ in studies]
    assert_covers(normal, 0.93, 0.945)
    assert_covers(skewed, 0.915, 0.935)


def test_restricted_mean_is_the_area_under_the_survival_curve():
    rng = np.random.default_rng(4)
    times = rng.geometric(0.01, 50)
    captured = times <= 120
    ticks = np.minimum(times, 120)
    free = statistics.kaplan_meier(ticks, captured)
    edges = np.concatenate(([0], free.ticks))
    area = np.diff(edges) @ np.concatenate(([1], free.share[:-1]))
    result = statistics.restricted_mean_time(ticks, captured, 120)
    assert result.value == pytest.approx(area)
    assert statistics.restricted_mean_time(ticks, captured, 60).value == pytest.approx(
        np.minimum(times, 60).mean()
    )


def table(*captured, seeds=20):
    """Flags (L, S): at each level the first seeds capture, as many as given."""
    return np.array([np.arange(seeds) < count for count in captured])


@pytest.mark.parametrize(
    ("levels", "captured", "rate", "expected"),
    [
        ([0, 1, 2, 3], [20, 18, 8, 2], 0.9, 1.0),
        ([0, 1, 2, 3], [20, 18, 8, 2], 0.5, 1.8),
        ([0, 1, 4, 5], [19, 18, 6, 2], 0.6, 2.5),
        ([0.1, 0.2, 0.4], [20, 10, 0], 0.75, 0.15),
        ([0, 1, 2, 3], [18, 8, 18, 2], 0.8, 0.2),
        ([0, 1, 2, 3], [18, 16, 17, 16], 0.8, 3.0),
        ([0, 1, 2, 3], [15, 20, 20, 20], 0.8, float("nan")),
        ([-1, 1], [20, 0], 1.0, -1.0),
    ],
)
def test_tolerance_by_hand(levels, captured, rate, expected):
    result = statistics.tolerated_level(levels, table(*captured), rate, resamples=100)
    assert result.value == pytest.approx(expected, nan_ok=True)
    assert (result.high == float("inf")) >= (expected == levels[-1])
    assert (result.low == float("-inf")) >= isnan(expected)


def test_tolerance_beyond_the_levels_is_open():
    # All levels have exactly this rate, so nearly every resample falls below it at some level.
    exact = np.array([np.roll(row, k) for k, row in enumerate(table(*[16] * 12))])
    assert statistics.tolerated_level(range(12), exact, 0.8)[::2] == (11.0, float("inf"))
    many = statistics.tolerated_level([0.0, 0.5], table(400, 400, seeds=400), 0.9)
    assert many == (0.5, 0.5, float("inf"))
    few = statistics.tolerated_level([0.0, 0.5], table(3, 3, seeds=3), 0.9)
    assert few == (0.5, float("-inf"), float("inf"))
    none = statistics.tolerated_level([0.2, 0.5], table(0, 0, seeds=400), 0.9)
    assert none == (pytest.approx(float("nan"), nan_ok=True), float("-inf"), 0.2)


def test_tolerance_has_the_bounds_of_all_resamples():
    # Both bounds lie well inside an atom of the exact distribution, so random draws give them too.
    levels, rate = [0.0, 1.0, 3.0, 4.0], 0.5
    captured = np.array([[1] * 6, [1, 1, 1, 1, 1, 0], [0, 1, 0, 0, 0, 1], [0] * 6], bool)

    def crossing(shares):
        k = next(k for k, share in enumerate(shares) if share < rate)
        part = (shares[k - 1] - rate) / (shares[k - 1] - shares[k])
        return levels[k - 1] + part * (levels[k] - levels[k - 1])

    every = [crossing(captured[:, seeds].mean(axis=1)) for seeds in product(range(6), repeat=6)]
    result = statistics.tolerated_level(levels, captured, rate)
    for share in (0.02, 0.03):
        assert result.low == pytest.approx(np.quantile(every, share))
        assert result.high == pytest.approx(np.quantile(every, 1 - share))


def test_a_cliff_between_levels_where_all_runs_end_alike_is_not_certain():
    levels = [0.0, 1.0, 2.0, 3.0]
    result = statistics.tolerated_level(levels, table(10, 10, 0, 0, seeds=10), 0.5)
    (low, _), (_, high) = wilson(10, 10), wilson(0, 10)
    assert result.value == 1.5
    assert result.low == pytest.approx(1 + (low - 0.5) / (low - wilson(0, 10)[0]))
    assert result.high == pytest.approx(1 + (1 - 0.5) / (1 - high))


@pytest.mark.parametrize(
    ("rates", "rate", "truth", "least", "most"),
    [
        ((0.99, 0.97, 0.9, 0.7, 0.4, 0.1), 0.8, 2.5, 0.935, 0.96),
        ((0.95, 0.85, 0.75, 0.65, 0.55, 0.45), 0.7, 2.5, 0.935, 0.96),
        ((1.0, 0.99, 0.97, 0.02, 0.0, 0.0), 0.5, 2 + 0.47 / 0.95, 0.98, 1.0),
    ],
)
def test_tolerance_covers(rates, rate, truth, least, most):
    # 40 seeds; runs of one seed are correlated over levels (0.7). Where the rate drops steeply, the
    # bootstrap alone would cover 70 %; widened by Wilson's bounds it covers more than 95 %.
    rng = np.random.default_rng(9)
    levels = np.arange(6.0)

    def study():
        common, own = rng.normal(size=40), rng.normal(size=(6, 40))
        easy = stats.norm.cdf(sqrt(0.7) * common + sqrt(0.3) * own)
        result = statistics.tolerated_level(
            levels, easy < np.array(rates)[:, None], rate, resamples=500
        )
        return holds(result, truth)

    assert_covers((study() for _ in range(200)), least, most)


@pytest.mark.parametrize(
    ("call", "named"),
    [
        (lambda: statistics.capture_rate([]), "captured"),
        (lambda: statistics.capture_rate([0, 2]), "captured"),
        (lambda: statistics.kaplan_meier([1.0], [True, False]), "ticks"),
        (lambda: statistics.kaplan_meier([float("nan")], [True]), "ticks"),
        (lambda: statistics.kaplan_meier([-1.0], [True]), "ticks"),
        (lambda: statistics.bootstrap_mean([1.0, float("inf")]), "values"),
        (lambda: statistics.bootstrap_mean([[1.0]]), "values"),
        (lambda: statistics.restricted_mean_time([5, 9], [True, False], 10), "ticks=9.*limit=10"),
        (lambda: statistics.tolerated_level([0.0], [[True, True]], 0.9), "levels"),
        (lambda: statistics.tolerated_level([1.0, 0.0], table(2, 1, seeds=2), 0.9), "levels"),
        (lambda: statistics.tolerated_level([0.0, 1.0], [[True, True]], 0.9), "captured"),
        (lambda: statistics.tolerated_level([0.0, 1.0], [[True], [True]], 0.9), "captured"),
        (lambda: statistics.tolerated_level([0.0, 1.0], table(2, 1, seeds=2), 90), "rate=90"),
    ],
)
def test_bad_input_is_named(call, named):
    with pytest.raises(ValueError, match=named):
        call()


def test_what_is_zero_but_for_rounding_is_shown_as_zero():
    noise = float(np.mean([0.1, 0.2, -0.3]))
    assert noise != 0.0
    assert Interval(noise, -0.03, 0.03).signed_text(100.0) == "+0 [-3, +3]"


@pytest.mark.parametrize("kept_max", [0, statistics.KEPT_DRAWS_MAX])
@pytest.mark.parametrize("count", [2, 3, 17, 100, 301])
def test_the_bootstrap_of_a_mean_is_scipys_to_the_bit(monkeypatch, count, kept_max):
    monkeypatch.setattr(statistics, "KEPT_DRAWS_MAX", kept_max)
    rng = np.random.default_rng(count)
    for values in (rng.exponential(size=count), rng.normal(1e3, 5.0, count), np.arange(count) % 3):
        how = {"confidence_level": 0.95, "n_resamples": statistics.RESAMPLES, "rng": 0}
        expected = stats.bootstrap((values,), np.mean, method="BCa", **how).confidence_interval
        found = statistics.bootstrap_mean(values)
        if np.isfinite(expected).all():  # else percentiles
            assert (found.low, found.high) == expected
        assert found.value == values.mean()
