"""Two cells of a study compared on common seeds: differences, tests, and what they decide.

A claim is decided by a test and by an interval together, never by one that the other contradicts,
and the p of the test is corrected for the number of claims that are made beside it (Holm). Both
hold where runs fail rarely, which samples of 20 or 100 seeds may well not show: the tests because
they suppose nothing but that seeds are alike, the interval of a mean time because it is made for
two more pairs than there are, one in which only the one cell captures, at once, and one in which
only the other does.

Changing the signs of differences tests that the two cells of a seed could be exchanged. That is
said of whole distributions. Where they differ and their means do not, it is the interval that holds
zero.
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
    column,
    flags_of,
)

ALPHA = 0.05
ROUNDING = 1e-9
SUMS_MAX = 2**17
"""How many different sums of differences are told apart; finer ones are rounded to that."""


class Verdict(StrEnum):
    """What may be said of a difference."""

    HIGHER = "higher"
    LOWER = "lower"
    UNDECIDED = "undecided"


class Difference(NamedTuple):
    """A cell b compared with a cell a on common seeds: b minus a.

    ``effect``: the difference without unit, as the function says that made it. ``better``,
    ``worse``, ``ties``: in how many of the ``pairs`` b does so. ``p``: two-sided, of this test
    alone; ``p_corrected``: among all tests that are told together, NaN before they are.
    """

    mean: Interval
    effect: Interval
    better: int
    worse: int
    ties: int
    pairs: int
    p: float
    p_corrected: float = np.nan

    @property
    def verdict(self) -> Verdict:
        """What is decided after correction."""
        return self._verdict(self.p_corrected)

    @property
    def verdict_alone(self) -> Verdict:
        """What would be decided if this were the only test."""
        return self._verdict(self.p)

    def _verdict(self, p: float) -> Verdict:
        if p <= ALPHA and self.mean.low > 0.0:
            return Verdict.HIGHER
        if p <= ALPHA and self.mean.high < 0.0:
            return Verdict.LOWER
        return Verdict.UNDECIDED


def rate_difference(captured_a: ArrayLike, captured_b: ArrayLike) -> Difference:
    """Rate of capture of b minus that of a, runs (S,), S > 0, of the same seeds.

    ``mean`` has Newcombe's interval, which keeps a width where no pair differs. ``effect`` is
    Cohen's g: b's share of the pairs in which one captured and the other did not, minus 1/2, with
    Clopper and Pearson's interval, NaN without such pairs. ``p`` is McNemar's exact, 1 without.
    """
    a = flags_of("captured_a", captured_a)
    b = flags_of("captured_b", captured_b, a.size)
    better, worse = int((b & ~a).sum()), int((a & ~b).sum())
    effect, p = _of_unlike_pairs(better, worse)
    return Difference(_newcombe(a, b), effect, better, worse, int((a == b).sum()), a.size, p)


def order_difference(a: ArrayLike, b: ArrayLike) -> Difference:
    """In which share of pairs b is later than a, minus in which share earlier; times (S,), S > 0.

    Only the order within a pair counts, so that a run without capture is one that is late, however
    far the limit. ``mean`` has Bonett and Price's interval. ``effect`` is the share of the pairs
    that are not level in which b is later, minus 1/2, and ``p`` the exact sign test's, as
    ``rate_difference`` has them.
    """
    change = _changes(a, b)
    earlier, later = int((change < 0.0).sum()), int((change > 0.0).sum())
    mean = bounded_mean(np.sign(change), 1.0)
    effect, p = _of_unlike_pairs(later, earlier)
    ties = change.size - earlier - later
    return Difference(mean, effect, earlier, later, ties, change.size, p if change.size else np.nan)


def paired_difference(
    a: ArrayLike, b: ArrayLike, span: float, *, less_is_better: bool = True
) -> Difference:
    """``b`` minus ``a``, values (S,) from 0 to ``span`` of the same seeds; NaN pairs are dropped.

    ``mean`` is as ``bounded_mean`` has it. ``effect`` is Cohen's d_z, the mean of the differences
    over their standard deviation: without bounds, as a rare difference that the sample lacks may
    make it another; NaN if there is no deviation. ``p`` is by changing signs of differences in all
    ways: exact if pairs could be exchanged, whatever the ties and however rare the runs that fail.
    """
    change = _changes(a, b)
    if (np.abs(change) > span * (1.0 + ROUNDING)).any():
        raise ValueError(f"{span=:g} must be the most that values differ, {np.abs(change).max():g}")
    order = (-1, 1, 0) if less_is_better else (1, -1, 0)
    better, worse, ties = (int((np.sign(change) == sign).sum()) for sign in order)
    effect = Interval()
    if change.size > 1 and change.std() > ROUNDING * np.abs(change).max():
        effect = Interval(float(change.mean() / change.std(ddof=1)))
    p = sign_change_p(change) if change.size else np.nan
    return Difference(bounded_mean(change, span), effect, better, worse, ties, change.size, p)


def bounded_mean(change: Floats, span: float, confidence: float = CONFIDENCE) -> Interval:
    """Mean of differences (S,) from -``span`` to ``span``; no bounds if S < 2.

    Student's interval of the differences and of two more, ``span`` and its opposite. For
    differences of -1, 0 and 1 that is Bonett and Price's (2012), Journal of Educational and
    Behavioral Statistics 37, 479-488, with t for z.
    """
    if change.size < 2:
        return Interval(float(change[0]) if change.size else np.nan)
    more = np.append(change, (span, -span))
    half = special.stdtrit(more.size - 1, (1.0 + confidence) / 2.0) * stats.sem(more)
    low, high = np.clip((more.mean() - half, more.mean() + half), -span, span)
    return Interval(float(change.mean()), float(low), float(high))


def sign_change_p(change: Floats) -> float:
    """Two-sided p that the sum of differences is so far from 0 if each sign were a coin's.

    Exact, by the distribution of all 2^S sums (Pagano and Tritchler 1983, Journal of the American
    Statistical Association 78, 435-440): differences are multiples of a unit, as ticks are; where
    there are too many, or none is common, they are rounded, alike on both sides of 0.
    """
    sizes = np.abs(change[change != 0.0])
    if not sizes.size:
        return 1.0
    unit = max(_common_unit(sizes), float(sizes.sum()) / SUMS_MAX)
    steps = np.rint(change / unit).astype(np.int64)
    sums = np.zeros(int(np.abs(steps).sum()) + 1)
    sums[0], last = 1.0, 0
    for step in np.abs(steps[steps != 0]).tolist():
        # By sum: the chance that the differences with a plus, of those so far, come to it.
        sums[step : last + step + 1] += sums[: last + 1].copy()
        sums[: last + step + 1] *= 0.5
        last += step
    far = (last + abs(int(steps.sum()))) // 2
    return min(1.0, 2.0 * float(sums[far:].sum())) if steps.sum() else 1.0


def holm(p: ArrayLike) -> Floats:
    """P of (K,) tests, each corrected for all of them by Holm's procedure; NaN is no test.

    Holm (1979), Scandinavian Journal of Statistics 6, 65-70: whatever hangs together, the chance
    that any true hypothesis has one of at most ``ALPHA`` is at most that.
    """
    alone = np.asarray(p, np.float64)
    order = np.argsort(alone)
    left = np.maximum((~np.isnan(alone)).sum() - np.arange(alone.size), 1)
    p_values = np.empty_like(alone)
    p_values[order] = np.minimum(np.maximum.accumulate(alone[order] * left), 1.0)
    return p_values


def corrected(tests: Sequence[Difference]) -> list[Difference]:
    """Tests that are told together, with their corrected p."""
    p_values = holm([test.p for test in tests])
    return [test._replace(p_corrected=float(p)) for test, p in zip(tests, p_values, strict=True)]


def _changes(a: ArrayLike, b: ArrayLike) -> Floats:
    """What b is minus a in pairs without a NaN; 0 where it is no more than rounding."""
    first = column("a", a)
    second = column("b", b, first.size)
    change = second - first
    change[np.abs(change) <= ROUNDING * np.maximum(np.abs(first), np.abs(second))] = 0.0
    return np.asarray(change[~np.isnan(change)])


def _of_unlike_pairs(one: int, other: int) -> tuple[Interval, float]:
    """Share of the one kind of pairs, less 1/2, and p that both kinds are as likely."""
    if not one + other:
        return Interval(), 1.0
    pairs, tail = one + other, (1.0 - CONFIDENCE) / 2.0
    low = special.betaincinv(one, other + 1, tail) if one else 0.0
    high = special.betaincinv(one + 1, other, 1.0 - tail) if other else 1.0
    effect = (float(share) - 0.5 for share in (one / pairs, low, high))
    return Interval(*effect), min(1.0, 2.0 * float(special.bdtr(min(one, other), pairs, 0.5)))


def _common_unit(sizes: NDArray[np.float64]) -> float:
    """The greatest number that all sizes are multiples of but for rounding: Euclid's algorithm."""
    least = ROUNDING * float(sizes.max())
    unit = 0.0
    for size in np.unique(sizes).tolist():
        rest = size
        while rest > least:
            unit, rest = rest, abs(unit - rest * round(unit / rest))
    return unit


def _newcombe(a: Flags, b: Flags) -> Interval:
    """Newcombe (1998), Statistics in Medicine 17, 2635-2650, method 10."""
    covariance, spread = (a & b).mean() - a.mean() * b.mean(), a.std() * b.std()
    if covariance > 0.0:
        covariance = max(covariance - 0.5 / a.size, 0.0)  # corrected for continuity
    correlation = covariance / spread if spread else 0.0
    (rate_a, low_a, high_a), (rate_b, low_b, high_b) = capture_rate(a), capture_rate(b)
    x = np.array([rate_b - low_b, high_b - rate_b])
    y = np.array([high_a - rate_a, rate_a - low_a])
    down, up = np.sqrt(x**2 - 2.0 * correlation * x * y + y**2)
    return Interval(rate_b - rate_a, float(rate_b - rate_a - down), float(rate_b - rate_a + up))
