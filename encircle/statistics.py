"""What the runs of a study say, with 95 % intervals.

Every cell of a study runs the same seeds, so cells are compared seed by seed, and whole seeds are
resampled. A run that does not capture within the limit is censored: its time is at least the limit.
It is never dropped and never taken for a capture.

Resampling cannot show what the sample lacks: runs that all ended alike have resamples that all end
alike, though the true rate need not be 0 or 1. So rates have Wilson's intervals, their differences
Newcombe's, made of Wilson's, and a tolerance is widened to where Wilson's bounds cross. Means have
the bootstrap's alone: no width says that all values were equal, not that the mean is known.
Resamples are the same at every call. Nothing here corrects for the number of comparisons.
"""

import warnings
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

CONFIDENCE = 0.95
RESAMPLES = 2000
PERMUTATIONS = 9999
ROUNDING = 1e-12

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


class Interval(NamedTuple):
    """An estimate and its 95 % interval; NaN is undefined, an infinite bound is an open side."""

    value: float = np.nan
    low: float = np.nan
    high: float = np.nan

    def __format__(self, spec: str) -> str:
        """``0.85 [0.71, 0.93]``; ``spec`` holds for each number, three digits without one."""
        value, low, high = (format(number, spec or ".3g") for number in self)
        return f"{value} [{low}, {high}]"


class Survival(NamedTuple):
    """Share of runs whose target is still free after each tick at which some run ended.

    ``ticks``: (K,) ascending; ``share``, ``low``, ``high``: (K,), the interval being pointwise.
    The share is 1 before the first tick and constant between two. ``median``: the first tick at
    which at most half are free, NaN if there is none.
    """

    ticks: Floats
    share: Floats
    low: Floats
    high: Floats
    median: float


class Difference(NamedTuple):
    """A cell b compared with a cell a on common seeds: b minus a.

    ``effect``: the difference without unit, as the function says that made it. ``better``,
    ``worse``, ``ties``: in how many of the ``pairs`` b does so. ``p``: two-sided.
    """

    mean: Interval
    effect: Interval
    better: int
    worse: int
    ties: int
    pairs: int
    p: float


def capture_rate(captured: ArrayLike) -> Interval:
    """Share of runs (S,), S > 0, that captured, with Wilson's interval."""
    flags = _flags("captured", captured)
    found = stats.binomtest(int(flags.sum()), flags.size).proportion_ci(CONFIDENCE, "wilson")
    return Interval(float(flags.mean()), float(found.low), float(found.high))


def survival(ticks: ArrayLike, captured: ArrayLike) -> Survival:
    """Kaplan and Meier's estimate from the ticks of runs (S,), S > 0, and whether they captured.

    The interval is Greenwood's on the scale log(-log(share)), where a share of 1 or 0 has no
    place. There it is Wilson's for the runs that lasted to that tick, none or all of which
    captured by its end. As a share never rises, the upper bound before a share of 0 holds too.
    """
    times, flags = _times(ticks, captured)
    free = stats.ecdf(stats.CensoredData.right_censored(times, ~flags)).sf
    share = free.probabilities
    with warnings.catch_warnings():
        # The bounds without a value that scipy warns of are those replaced below, and no others.
        warnings.filterwarnings("ignore", "The confidence interval is undefined", RuntimeWarning)
        found: Any = free.confidence_interval(CONFIDENCE, method="log-log")
    low, high = found.low.probabilities.copy(), found.high.probabilities.copy()
    for k in np.flatnonzero((share == 0.0) | (share == 1.0)):
        lasted = times[times >= free.quantiles[k]]
        _, low[k], high[k] = capture_rate(np.full(lasted.size, share[k]))
        if k and not share[k]:
            high[k] = min(high[k], high[k - 1])
    late = free.quantiles[share <= 0.5 + ROUNDING]
    return Survival(free.quantiles, share, low, high, float(late[0]) if late.size else np.nan)


def logrank(
    ticks_a: ArrayLike, captured_a: ArrayLike, ticks_b: ArrayLike, captured_b: ArrayLike
) -> float:
    """Two-sided p of the log-rank test that two cells capture equally fast.

    NaN if the runs cannot tell, as without any capture. The test takes the cells for independent;
    if common seeds make their times alike, p is rather too large than too small.
    """
    runs = _times(ticks_a, captured_a), _times(ticks_b, captured_b)
    a, b = (stats.CensoredData.right_censored(times, ~flags) for times, flags in runs)
    # A variance of 0 says that they cannot tell; rounding makes the statistic 0/0 or x/0 then.
    with np.errstate(divide="ignore", invalid="ignore"):
        found = stats.logrank(a, b)
    return float(found.pvalue) if np.isfinite(found.statistic) else np.nan


def mean(values: ArrayLike, *, resamples: int = RESAMPLES) -> Interval:
    """Mean of values (S,) but for NaNs, with a BCa bootstrap interval; no bounds if S < 2.

    Of few and skewed values it covers less than 95 %: about 92 % for 40 exponential ones.
    """
    found = _column("values", values)
    return _bootstrap(found[~np.isnan(found)], np.mean, resamples)


def restricted_mean_ticks(
    ticks: ArrayLike, captured: ArrayLike, limit: float, *, resamples: int = RESAMPLES
) -> Interval:
    """Mean of min(time to capture, ``limit``) over runs (S,), as the area under their survival.

    A run without capture that ends before the limit is a ValueError: its time is not known.
    """
    times, flags = _times(ticks, captured)
    if (~flags & (times < limit)).any():
        raise ValueError(f"ticks={times[~flags].min():g} without capture, must reach {limit=:g}")
    return mean(np.minimum(times, limit), resamples=resamples)


def paired_difference(
    a: ArrayLike, b: ArrayLike, *, less_is_better: bool = True, resamples: int = RESAMPLES
) -> Difference:
    """``b`` minus ``a``, values (S,) of the same seeds; pairs with a NaN are dropped.

    ``effect`` is Cohen's d_z, the mean of the differences over their standard deviation: NaN if
    that is 0; a bound is infinite where it is 0 in resamples. ``p`` is by changing signs of
    differences, in all ways up to 13 pairs, else in ``PERMUTATIONS`` drawn ones. It supposes that
    a difference is as likely as its opposite. Unlike Wilcoxon's it needs no rule for ties.
    """
    first = _column("a", a)
    change = _column("b", b, first.size) - first
    change = change[~np.isnan(change)]
    order = (-1, 1, 0) if less_is_better else (1, -1, 0)
    better, worse, ties = (int((np.sign(change) == sign).sum()) for sign in order)
    effect, p = Interval(), 1.0 if change.size else np.nan
    if change.size > 1:
        signs: dict[str, Any] = {"permutation_type": "samples", "n_resamples": PERMUTATIONS}
        p = float(stats.permutation_test((change,), np.mean, rng=0, **signs).pvalue)
        if change.std() > ROUNDING * np.abs(change).max():
            effect = _bootstrap(change, _standardised, resamples)
    centre = _bootstrap(change, np.mean, resamples)
    return Difference(centre, effect, better, worse, ties, change.size, p)


def rate_difference(captured_a: ArrayLike, captured_b: ArrayLike) -> Difference:
    """Rate of capture of b minus that of a, runs (S,), S > 0, of the same seeds.

    ``mean`` has Newcombe's interval, which keeps a width where no pair differs. ``effect`` is
    Cohen's g: b's share of the pairs in which one captured and the other did not, minus 1/2, with
    Wilson's interval, NaN without such pairs. ``p`` is McNemar's exact, 1 without such pairs.
    """
    a = _flags("captured_a", captured_a)
    b = _flags("captured_b", captured_b, a.size)
    better, worse, ties = (int(pairs.sum()) for pairs in (b & ~a, a & ~b, a == b))
    effect, p = Interval(), 1.0
    if better + worse:
        effect = Interval(*(bound - 0.5 for bound in capture_rate(b[a != b])))
        p = float(stats.binomtest(better, better + worse).pvalue)
    return Difference(_newcombe(a, b), effect, better, worse, ties, a.size, p)


def tolerance(
    levels: ArrayLike, captured: ArrayLike, rate: float, *, resamples: int = RESAMPLES
) -> Interval:
    """The largest level up to which the rate of capture stays at or above ``rate``.

    ``levels``: (L,) ascending; ``captured``: (L, S) over common seeds; L, S > 1. The first fall
    below ``rate`` is interpolated linearly. NaN, with ``low`` -inf, if the first level is below;
    the last level, with ``high`` inf, if none is. A bound past an end is that end or infinite.

    The interval is a percentile bootstrap over seeds, widened to where Wilson's bounds cross if
    all runs ended alike at a level next to the crossing. Where the true rate lies near ``rate``
    over many levels, chance alone makes the first crossing early.
    """
    steps, table = _column("levels", levels), np.asarray(captured)
    if steps.size < 2 or not (np.diff(steps) > 0.0).all():
        raise ValueError(f"levels={steps!r} must be two or more, ascending")
    if table.ndim != 2 or len(table) != steps.size or table.shape[1] < 2:
        raise ValueError(f"captured.shape={table.shape} must be ({steps.size}, two or more seeds)")
    if not 0.0 < rate <= 1.0:
        raise ValueError(f"rate={rate!r} must be above 0 and at most 1")
    wilson = np.array([capture_rate(row) for row in table])

    def crossing(seeds: NDArray[np.int64], *, axis: int = -1) -> Floats:
        return _crossing(steps, np.moveaxis(table[:, seeds].mean(axis=axis), 0, -1), rate)

    seeds = np.arange(table.shape[1])
    value = float(crossing(seeds))
    low, high = _bounds(seeds, crossing, resamples, "percentile")
    after = max(int(np.append(wilson[:-1, 0] < rate, True).argmax()), 1)
    if np.isin(wilson[after - 1 : after + 1, 0], (0.0, 1.0)).any():
        low = min(low, float(_crossing(steps, wilson[:, 1], rate)))
        high = max(high, float(_crossing(steps, wilson[:, 2], rate)))
    first, last = float(steps[0]), float(steps[-1])
    known = np.nan if value < first else min(value, last)
    return Interval(known, min(low, last), max(high, value, first))


def _column(name: str, values: ArrayLike, size: int | None = None) -> Floats:
    column = np.asarray(values, np.float64)
    if column.ndim != 1 or np.isinf(column).any() or size not in (None, column.size):
        count = "" if size is None else f" of {size}"
        raise ValueError(f"{name}={column!r} must be a list{count}, of finite numbers or NaN")
    return column


def _flags(name: str, captured: ArrayLike, size: int | None = None) -> Flags:
    flags = _column(name, captured, size)
    if not flags.size or not np.isin(flags, (0.0, 1.0)).all():
        raise ValueError(f"{name}={flags!r} must be one or more of true and false")
    return flags.astype(np.bool_)


def _times(ticks: ArrayLike, captured: ArrayLike) -> tuple[Floats, Flags]:
    flags = _flags("captured", captured)
    times = _column("ticks", ticks, flags.size)
    if not (times >= 0.0).all():
        raise ValueError(f"ticks={times!r} must be 0 or more")
    return times, flags


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


def _standardised(values: Floats, *, axis: int) -> Floats:
    """Mean over standard deviation: without deviation infinite, or 0 if the mean is."""
    count, centre = values.shape[axis], values.mean(axis=axis)
    spread = values.std(axis=axis) * np.sqrt(count / max(count - 1, 1))  # ddof warns of one value
    ratio = centre / np.where(spread > ROUNDING * np.abs(centre), spread, 0.0)
    return np.asarray(np.where(np.isnan(ratio), 0.0, ratio))


def _bootstrap(values: Floats, statistic: Callable[..., Any], resamples: int) -> Interval:
    value = float(statistic(values, axis=-1)) if values.size else np.nan
    if values.size < 2:
        return Interval(value)
    if np.ptp(values) == 0.0:
        return Interval(value, value, value)
    return Interval(value, *_bounds(values, statistic, resamples, "BCa"))


def _bounds(
    values: NDArray[Any], statistic: Callable[..., Any], resamples: int, method: str
) -> tuple[float, float]:
    """Bootstrap bounds; where ``method`` has none or infinite ones, percentiles as they stand."""
    # Warnings are of infinite resamples, which are meant, and of missing bounds, replaced below.
    with np.errstate(divide="ignore", invalid="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore", stats.DegenerateDataWarning)
        how: dict[str, Any] = {"n_resamples": resamples, "method": method, "rng": 0}
        found = stats.bootstrap((values,), statistic, confidence_level=CONFIDENCE, **how)
    low, high = found.confidence_interval
    if not np.isfinite((low, high)).all():
        tails = (1.0 - CONFIDENCE) / 2, (1.0 + CONFIDENCE) / 2
        low, high = np.quantile(found.bootstrap_distribution, tails, method="inverted_cdf")
    return float(low), float(high)


def _crossing(levels: Floats, shares: Floats, rate: float) -> Floats:
    """Level at which shares (..., L) first fall below; -inf if from the start, inf if never."""
    below = shares < rate
    after = np.maximum(below.argmax(axis=-1), 1)
    pair = np.stack((after - 1, after), axis=-1)
    start, end = np.moveaxis(np.take_along_axis(shares, pair, axis=-1), -1, 0)
    fall = np.where(start > end, start - end, 1.0)
    inside = levels[after - 1] + (start - rate) / fall * (levels[after] - levels[after - 1])
    return np.where(below[..., 0], -np.inf, np.where(below.any(axis=-1), inside, np.inf))
