"""Paired comparisons of two cells of a study: differences, tests and verdicts.

Both cells run the same seeds, so runs are compared seed by seed. A difference is called higher or
lower only if two things agree: its test has p of at most ``ALPHA`` after correction for the number
of tests (Holm), and its 95 % interval leaves out zero.

Both also hold where runs fail so rarely that a sample of 20 or 100 seeds shows no failure. The
tests assume only that the seeds are exchangeable. The interval of a mean time is computed with two
additional pairs: in one only cell a captures, and at once; in the other only cell b does.

The sign-flip test tests whether the two runs of a seed are exchangeable, which is a statement about
whole distributions. If the distributions differ but their means are equal, p can be small; then
only the interval keeps the verdict undecided.

The functions take arrays of runs. They do not read tables and do not choose what is compared.
"""

from collections.abc import Sequence
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special, stats

from encircle.statistics.intervals import (
    CONFIDENCE,
    Flags,
    Floats,
    Interval,
    capture_rate,
    checked_flags,
    checked_values,
)

ALPHA = 0.05
RELATIVE_ROUNDING = 1e-9
SUMS_MAX = 2**17
"""The largest number of distinct sums of differences. Finer sums are rounded to this many."""


class Verdict(StrEnum):
    """What the data allow to say of a difference."""

    HIGHER = "higher"
    LOWER = "lower"
    UNDECIDED = "undecided"


class Difference(NamedTuple):
    """A cell b compared with a cell a on common seeds: b minus a.

    ``mean`` is the mean difference with its interval, in the unit of the values.
    ``effect_size`` has no unit; the function that makes the difference says which effect size
    it is. ``better``, ``worse`` and ``ties`` count the ``pairs`` in which b is better than,
    worse than or equal to a. ``p`` is the two-sided p of this test alone. ``p_corrected`` is p
    corrected for all tests of a family; it is NaN until ``holm_corrected`` has set it.
    """

    mean: Interval
    effect_size: Interval
    better: int
    worse: int
    ties: int
    pairs: int
    p: float
    p_corrected: float = np.nan

    @property
    def verdict(self) -> Verdict:
        """The verdict after correction for the number of tests."""
        return self._verdict_by(self.p_corrected)

    @property
    def uncorrected_verdict(self) -> Verdict:
        """The verdict that this test would give if it were the only one."""
        return self._verdict_by(self.p)

    def _verdict_by(self, p: float) -> Verdict:
        if p <= ALPHA and self.mean.low > 0.0:
            return Verdict.HIGHER
        if p <= ALPHA and self.mean.high < 0.0:
            return Verdict.LOWER
        return Verdict.UNDECIDED


def rate_difference(captured_a: ArrayLike, captured_b: ArrayLike) -> Difference:
    """Capture rate of b minus capture rate of a, from flags (S,) of the same S > 0 seeds.

    ``mean`` has Newcombe's interval (1998, Statistics in Medicine 17, 2635-2650, method 10).
    That interval keeps a width even if no pair differs. ``effect_size`` is Cohen's g: among the
    discordant pairs, in which exactly one of the two captured, the share in which b did, minus
    1/2. It has Clopper and Pearson's interval, and is NaN without discordant pairs. ``p`` is
    that of McNemar's exact test, 1 without discordant pairs. Raises ``ValueError`` if a list is
    empty, holds anything but true and false, or differs in length from the other.
    """
    a = checked_flags("captured_a", captured_a)
    b = checked_flags("captured_b", captured_b, a.size)
    better, worse = int((b & ~a).sum()), int((a & ~b).sum())
    effect, p = _discordant_pairs_test(better, worse)
    return Difference(
        _newcombe_interval(a, b), effect, better, worse, int((a == b).sum()), a.size, p
    )


def order_difference(a: ArrayLike, b: ArrayLike) -> Difference:
    """Share of pairs in which b is later than a, minus the share in which b is earlier.

    ``a``, ``b``: times (S,), S > 0, of the same seeds, in any unit. Only the order within a
    pair counts, so a run without capture can have any time after its limit. Pairs with a NaN
    are left out. ``mean`` has Bonett and Price's interval (see ``bounded_mean``).
    ``effect_size`` is the share of the untied pairs in which b is later, minus 1/2. ``p`` is
    that of the exact sign test, NaN without pairs. Raises ``ValueError`` if the lists differ in
    length or hold infinite numbers.
    """
    change = _paired_differences(a, b)
    earlier, later = int((change < 0.0).sum()), int((change > 0.0).sum())
    mean = bounded_mean(np.sign(change), 1.0)
    effect, p = _discordant_pairs_test(later, earlier)
    ties = change.size - earlier - later
    return Difference(mean, effect, earlier, later, ties, change.size, p if change.size else np.nan)


def paired_difference(
    a: ArrayLike, b: ArrayLike, span: float, *, less_is_better: bool = True
) -> Difference:
    """``b`` minus ``a``: values (S,) between 0 and ``span``, of the same seeds.

    Pairs with a NaN are left out. ``mean`` is made by ``bounded_mean``. ``effect_size`` is
    Cohen's d_z: the mean of the differences over their standard deviation. It has no interval,
    because one rare difference that the sample lacks could change it; it is NaN if the
    deviation is 0. ``p`` is that of the exact sign-flip test (``sign_flip_p``), NaN without
    pairs. ``less_is_better`` says which sign of a difference counts as ``better``. Raises
    ``ValueError`` if two values differ by more than ``span``, if the lists differ in length, or
    if they hold infinite numbers.
    """
    change = _paired_differences(a, b)
    if (np.abs(change) > span * (1.0 + RELATIVE_ROUNDING)).any():
        raise ValueError(f"{span=:g} must be the most that values differ, {np.abs(change).max():g}")
    order = (-1, 1, 0) if less_is_better else (1, -1, 0)
    better, worse, ties = (int((np.sign(change) == sign).sum()) for sign in order)
    effect = Interval()
    if change.size > 1 and change.std() > RELATIVE_ROUNDING * np.abs(change).max():
        effect = Interval(float(change.mean() / change.std(ddof=1)))
    p = sign_flip_p(change) if change.size else np.nan
    return Difference(bounded_mean(change, span), effect, better, worse, ties, change.size, p)


def bounded_mean(change: Floats, span: float, confidence: float = CONFIDENCE) -> Interval:
    """Mean of differences (S,) between -``span`` and ``span``, with its interval.

    There are no bounds if S < 2. The interval is Student's, computed from the differences and
    two more, ``span`` and -``span``. For differences of -1, 0 and 1 that is the interval of
    Bonett and Price (2012), Journal of Educational and Behavioral Statistics 37, 479-488, with
    t in place of z. ``confidence`` is between 0 and 1.
    """
    if change.size < 2:
        return Interval(float(change[0]) if change.size else np.nan)
    more = np.append(change, (span, -span))
    half = special.stdtrit(more.size - 1, (1.0 + confidence) / 2.0) * stats.sem(more)
    low, high = np.clip((more.mean() - half, more.mean() + half), -span, span)
    return Interval(float(change.mean()), float(low), float(high))


def sign_flip_p(change: Floats) -> float:
    """Two-sided p of the sign-flip test for differences (S,): each sign is + or - with chance 1/2.

    p is the chance that the absolute sum of the differences is at least the observed one. It is
    exact: the distribution of all 2^S sums is computed by the algorithm of Pagano and Tritchler
    (1983), Journal of the American Statistical Association 78, 435-440. The algorithm needs
    differences that are multiples of a unit, as ticks are. If there is no common unit, or if
    the unit makes more than ``SUMS_MAX`` sums, differences are rounded, symmetrically about 0.
    """
    sizes = np.abs(change[change != 0.0])
    if not sizes.size:
        return 1.0
    unit = max(_common_divisor(sizes), float(sizes.sum()) / SUMS_MAX)
    steps = np.rint(change / unit).astype(np.int64)
    sums = np.zeros(int(np.abs(steps).sum()) + 1)
    sums[0], last = 1.0, 0
    for step in np.abs(steps[steps != 0]).tolist():
        # sums[k]: the chance that the differences so far whose sign is + add up to k units.
        sums[step : last + step + 1] += sums[: last + 1].copy()
        sums[: last + step + 1] *= 0.5
        last += step
    far = (last + abs(int(steps.sum()))) // 2
    return min(1.0, 2.0 * float(sums[far:].sum())) if steps.sum() else 1.0


def holm_p(p: ArrayLike) -> Floats:
    """The p of tests (K,), each corrected for all of them by Holm's procedure.

    A NaN stands for no test. Holm (1979), Scandinavian Journal of Statistics 6, 65-70. If every
    p of at most ``ALPHA`` is taken as a rejection, the chance of rejecting any true hypothesis
    is at most ``ALPHA``, however the tests depend on each other.
    """
    alone = np.asarray(p, np.float64)
    order = np.argsort(alone)
    left = np.maximum((~np.isnan(alone)).sum() - np.arange(alone.size), 1)
    p_values = np.empty_like(alone)
    p_values[order] = np.minimum(np.maximum.accumulate(alone[order] * left), 1.0)
    return p_values


def holm_corrected(tests: Sequence[Difference]) -> list[Difference]:
    """The tests of one family, in order, each with ``p_corrected`` set by Holm's procedure."""
    p_values = holm_p([test.p for test in tests])
    return [test._replace(p_corrected=float(p)) for test, p in zip(tests, p_values, strict=True)]


def _paired_differences(a: ArrayLike, b: ArrayLike) -> Floats:
    """The differences b minus a of pairs without a NaN; rounding errors become 0."""
    first = checked_values("a", a)
    second = checked_values("b", b, first.size)
    change = second - first
    change[np.abs(change) <= RELATIVE_ROUNDING * np.maximum(np.abs(first), np.abs(second))] = 0.0
    return np.asarray(change[~np.isnan(change)])


def _discordant_pairs_test(one: int, other: int) -> tuple[Interval, float]:
    """Share of one kind of discordant pairs minus 1/2, and p that both kinds are as likely."""
    if not one + other:
        return Interval(), 1.0
    pairs, tail = one + other, (1.0 - CONFIDENCE) / 2.0
    low = special.betaincinv(one, other + 1, tail) if one else 0.0
    high = special.betaincinv(one + 1, other, 1.0 - tail) if other else 1.0
    effect = (float(share) - 0.5 for share in (one / pairs, low, high))
    return Interval(*effect), min(1.0, 2.0 * float(special.bdtr(min(one, other), pairs, 0.5)))


def _common_divisor(sizes: NDArray[np.float64]) -> float:
    """The greatest number that divides all sizes, but for rounding, by Euclid's algorithm."""
    least = RELATIVE_ROUNDING * float(sizes.max())
    unit = 0.0
    for size in np.unique(sizes).tolist():
        rest = size
        while rest > least:
            unit, rest = rest, abs(unit - rest * round(unit / rest))
    return unit


def _newcombe_interval(a: Flags, b: Flags) -> Interval:
    """Difference of the rates of flags (S,), with Newcombe's interval.

    Newcombe (1998), Statistics in Medicine 17, 2635-2650, method 10.
    """
    covariance, spread = (a & b).mean() - a.mean() * b.mean(), a.std() * b.std()
    if covariance > 0.0:
        covariance = max(covariance - 0.5 / a.size, 0.0)  # continuity correction
    correlation = covariance / spread if spread else 0.0
    (rate_a, low_a, high_a), (rate_b, low_b, high_b) = capture_rate(a), capture_rate(b)
    x = np.array([rate_b - low_b, high_b - rate_b])
    y = np.array([high_a - rate_a, rate_a - low_a])
    down, up = np.sqrt(x**2 - 2.0 * correlation * x * y + y**2)
    return Interval(rate_b - rate_a, float(rate_b - rate_a - down), float(rate_b - rate_a + up))
