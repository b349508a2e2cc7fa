"""Paired comparisons against enumeration, published tables and scipy."""

from itertools import product
from math import comb, isnan, sqrt

import numpy as np
import pytest
from helpers_intervals import holds, paired_flags, wilson
from scipy import stats

from encircle.statistics import comparisons
from encircle.statistics.comparisons import Difference, Verdict
from encircle.statistics.intervals import Interval


def test_sign_changes_by_enumeration():
    rng = np.random.default_rng(0)
    for trial in range(150):
        change = rng.integers(-5, 6, rng.integers(1, 12)) * (1.0, 0.1, 1 / 30, 0.1 / 9)[trial % 4]
        signs = np.array(list(product((-1, 1), repeat=change.size)))
        p = np.mean(abs(signs @ change) >= abs(change.sum()) - 1e-9)
        assert comparisons.sign_flip_p(change) == pytest.approx(p, rel=1e-12)


def test_sign_changes_of_values_without_a_common_unit_are_as_scipy_draws_them():
    change = np.random.default_rng(5).normal(0.4, 1.0, 30)
    drawn = stats.permutation_test(
        (change,), np.mean, permutation_type="samples", n_resamples=19999, rng=1
    )
    assert 0.01 < drawn.pvalue < 0.5
    # p is twice a share of the draws; five standard errors make a false alarm rarer than 1e-6.
    tolerated = 5 * sqrt(2 * drawn.pvalue / 19999)
    assert comparisons.sign_flip_p(change) == pytest.approx(drawn.pvalue, abs=tolerated)


def test_the_smallest_p_is_two_of_all_sign_changes():
    # A usual number of random draws could not resolve such a p, so that no study with many tests
    # could pass Holm's bound.
    assert comparisons.sign_flip_p(np.full(100, 0.3)) == pytest.approx(2.0**-99, rel=1e-9)
    assert comparisons.sign_flip_p(np.array([2.0])) == 1.0
    assert comparisons.sign_flip_p(np.zeros(9)) == 1.0


def test_paired_difference_by_hand():
    a = np.array([3.0, 1.0, 4.0, 1.0, 5.0, 9.0, 2.0, 6.0])
    b = np.array([5.0, 1.0, 3.0, 4.0, 9.0, 9.0, 7.0, 5.0])
    change = b - a
    result = comparisons.paired_difference(a, b, 10.0)
    assert (result.better, result.worse, result.ties, result.pairs) == (2, 4, 2, 8)
    assert result.p == comparisons.sign_flip_p(change)
    two_more = stats.ttest_1samp([*change, 10.0, -10.0], 0.0).confidence_interval()
    assert result.mean == pytest.approx((change.mean(), two_more.low, two_more.high))
    assert result.effect_size.value == pytest.approx(change.mean() / np.std(change, ddof=1))
    assert all(map(isnan, result.effect_size[1:]))


def test_order_by_hand():
    # Bonett and Price (2012): Laplace's estimates of both shares; here with t in place of z.
    later, earlier, level = 12, 5, 8
    a = np.zeros(25)
    b = np.repeat([3.0, -1.0, 0.0], (later, earlier, level))
    result = comparisons.order_difference(a, b)
    p, q = (later + 1) / 27, (earlier + 1) / 27
    half = stats.t.isf(0.025, 26) * sqrt((p + q - (p - q) ** 2) / 26)
    assert result.mean == pytest.approx((7 / 25, p - q - half, p - q + half))
    assert result.p == pytest.approx(stats.binomtest(later, later + earlier).pvalue)
    exact = stats.binomtest(later, later + earlier).proportion_ci(method="exact")
    expected = [x - 0.5 for x in (later / (later + earlier), exact.low, exact.high)]
    assert result.effect_size == pytest.approx(expected)
    assert (result.better, result.worse, result.ties, result.pairs) == (earlier, later, level, 25)


def test_how_much_later_does_not_matter_to_the_order():
    rng = np.random.default_rng(3)
    a, b = rng.integers(20, 60, (2, 40)).astype(float)
    assert comparisons.order_difference(a, b) == comparisons.order_difference(a**3, b**3)


def test_the_exact_interval_of_unlike_pairs_and_their_p_decide_alike():
    for one, other in product(range(30), repeat=2):
        if one + other:
            result = comparisons.rate_difference(*paired_flags(3, other, one, 3))
            apart = result.effect_size.low > 0.0 or result.effect_size.high < 0.0
            assert apart == (result.p < 0.05)


def test_the_other_way_round_the_paired_difference_is_opposite():
    rng = np.random.default_rng(6)
    a, b = rng.uniform(0.0, 3.0, (2, 30))
    there, back = (comparisons.paired_difference(*x, 3.0) for x in ((a, b), (b, a)))
    assert back.mean == pytest.approx((-there.mean.value, -there.mean.high, -there.mean.low))
    assert (back.better, back.worse, back.p) == (there.worse, there.better, there.p)
    more = comparisons.paired_difference(a, b, 3.0, less_is_better=False)
    assert (more.better, more.worse) == (there.worse, there.better)
    assert (more.mean, more.effect_size.value, more.p) == (
        there.mean,
        there.effect_size.value,
        there.p,
    )


def test_pairs_with_an_undefined_value_are_dropped():
    nan = float("nan")
    result = comparisons.paired_difference([1, nan, 3, 4, 8], [2, 5, nan, 4, 3], 9.0)
    complete = comparisons.paired_difference([1, 4, 8], [2, 4, 3], 9.0)
    assert (result.mean, result.effect_size.value, result.p) == (
        complete.mean,
        complete.effect_size.value,
        complete.p,
    )
    assert (result.pairs, result.better, result.worse, result.ties) == (3, 1, 1, 1)
    for compare in (
        lambda a, b: comparisons.paired_difference(a, b, 9.0),
        comparisons.order_difference,
    ):
        nothing = compare([nan, 1.0], [2.0, nan])
        assert nothing.pairs == 0
        assert all(map(isnan, (*nothing.mean, *nothing.effect_size, nothing.p)))
        one = compare([1.0], [2.0])
        assert one.p == 1.0
        assert isnan(one.mean.low)
        assert one.uncorrected_verdict is Verdict.UNDECIDED


def test_differences_that_are_all_the_same_have_no_standardised_size():
    shifted = comparisons.paired_difference([0.2, 0.3, 0.7], [0.3, 0.4, 0.8], 1.0)
    same = comparisons.paired_difference([0.2, 0.3, 0.7], [0.2, 0.3, 0.7], 1.0)
    assert all(map(isnan, (*shifted.effect_size, *same.effect_size)))
    assert (same.p, same.ties, same.mean.value) == (1.0, 3, 0.0)
    assert same.mean.low < 0.0 < same.mean.high


def test_rounding_makes_no_difference_of_none():
    seconds = np.arange(1, 300) * 0.1
    again = np.array([tick / 10 for tick in range(1, 300)])
    assert (seconds != again).any()
    for result in (
        comparisons.order_difference(seconds, again),
        comparisons.paired_difference(seconds, again, 30.0),
    ):
        assert (result.ties, result.p) == (299, 1.0)


def test_rate_difference_of_a_published_table():
    # Fagerland, Lydersen and Laake (2017), Statistical Analysis of Contingency Tables, chapter 8:
    # complete response before and after consolidation therapy, Newcombe's interval.
    after, before = paired_flags(59, 6, 16, 80)
    result = comparisons.rate_difference(before, after)
    assert [round(x, 4) for x in result.mean] == [-0.0621, -0.1186, -0.0046]
    assert (result.better, result.worse, result.ties, result.pairs) == (6, 16, 139, 161)
    assert result.p == pytest.approx(2 * sum(comb(22, k) for k in range(7)) / 2**22)
    exact = stats.binomtest(6, 22).proportion_ci(method="exact")
    assert result.effect_size == pytest.approx([x - 0.5 for x in (6 / 22, exact.low, exact.high)])
    back = comparisons.rate_difference(after, before)
    assert back.mean == pytest.approx((-result.mean.value, -result.mean.high, -result.mean.low))


def test_rates_without_a_pair_that_differs_may_still_differ():
    result = comparisons.rate_difference([True] * 40, [True] * 40)
    reach = 1 - wilson(40, 40)[0]
    assert result.mean == pytest.approx((0.0, -reach, reach))
    assert (result.p, result.ties) == (1.0, 40)
    assert all(map(isnan, result.effect_size))


def test_rate_difference_covers_by_enumeration():
    # Exact for 12 pairs. Newcombe's interval covers more than 95 % near 0 and 1.
    n = 12
    tables = [
        (x, y, z, n - x - y - z) for x, y, z in product(range(n + 1), repeat=3) if x + y + z <= n
    ]
    result = [comparisons.rate_difference(*paired_flags(*table)).mean for table in tables]
    chances = [
        (0.4, 0.3, 0.2, 0.1),
        (0.5, 0.1, 0.1, 0.3),
        (0.6, 0.05, 0.3, 0.05),
        (0.3, 0.2, 0.2, 0.3),
    ]
    for chance in chances:
        mass = stats.multinomial.pmf(tables, n, chance)
        truth = chance[2] - chance[1]
        coverage = sum(m for m, x in zip(mass, result, strict=True) if holds(x, truth))
        assert 0.93 < coverage < 0.99, chance


def rejected_step_by_step(p, alpha):
    """Holm (1979) as published: p ascending, each times the number of tests left."""
    order = sorted(range(len(p)), key=lambda k: p[k])
    result = set()
    for step, index in enumerate(order):
        if p[index] > alpha / (len(p) - step):
            break
        result.add(index)
    return result


def test_holm_rejects_what_its_steps_do():
    rng = np.random.default_rng(8)
    for _ in range(100):
        p = rng.uniform(size=rng.integers(1, 12)) ** 3
        result = comparisons.holm_p(p)
        for alpha in (0.01, 0.05, 0.3):
            assert set(np.flatnonzero(result <= alpha)) == rejected_step_by_step(p, alpha)
        assert (result >= p).all()
        assert (result <= 1.0).all()


def test_an_undefined_p_is_no_test():
    result = comparisons.holm_p([0.02, float("nan"), 0.04])
    assert isnan(result[1])
    assert list(result[[0, 2]]) == [0.04, 0.04]
    assert comparisons.holm_p([]).size == 0


def difference(low, high, p, p_corrected=float("nan")):
    mean = Interval((low + high) / 2, low, high)
    return Difference(mean, Interval(), 0, 0, 0, 9, p, p_corrected)


@pytest.mark.parametrize(
    ("test", "verdict", "alone"),
    [
        (difference(1, 3, 0.001, 0.01), "higher", "higher"),
        (difference(-3, -1, 0.001, 0.01), "lower", "lower"),
        (difference(1, 3, 0.01, 0.06), "undecided", "higher"),
        (difference(-1, 3, 0.001, 0.01), "undecided", "undecided"),
        (difference(0, 3, 0.001, 0.01), "undecided", "undecided"),
        (difference(1, 3, 0.06, 0.06), "undecided", "undecided"),
        (difference(1, 3, 0.001), "undecided", "higher"),
        (difference(float("nan"), float("nan"), 1.0, 1.0), "undecided", "undecided"),
    ],
)
def test_interval_and_p_decide_together(test, verdict, alone):
    assert (test.verdict, test.uncorrected_verdict) == (verdict, alone)


def test_tests_are_corrected_for_all_that_are_told_together():
    tests = [difference(1, 3, p) for p in (0.01, 0.04, 0.02)]
    assert [test.p_corrected for test in comparisons.holm_corrected(tests)] == [0.03, 0.04, 0.04]
    assert [test.verdict for test in comparisons.holm_corrected(tests)] == ["higher"] * 3


@pytest.mark.parametrize(
    ("call", "named"),
    [
        (lambda: comparisons.paired_difference([1.0, 2.0], [1.0], 3.0), "b="),
        (lambda: comparisons.paired_difference([1.0, 2.0], [1.0, 9.0], 3.0), "span=3.*7"),
        (lambda: comparisons.order_difference([[1.0]], [1.0]), "a="),
        (lambda: comparisons.rate_difference([True], [True, False]), "captured_b"),
    ],
)
def test_bad_input_is_named(call, named):
    with pytest.raises(ValueError, match=named):
        call()
