"""What the runs of a study say, with 95 % intervals.

Every cell of a study runs the same seeds, so cells are compared seed by seed, and whole seeds are
resampled. A run that does not capture within the limit is censored: its time is at least the limit.
It is never dropped and never taken for a capture.

Resampling cannot show what the sample lacks: runs that all ended alike have resamples that all end
alike, though the true rate need not be 0 or 1. So rates have Wilson's intervals, a mean time is
widened by what Wilson's leave open of runs without capture, and a tolerance to where Wilson's
bounds cross. Means of measures have the bootstrap's alone: no width says that all values were
equal, not that the mean is known. Resamples are the same at every call.

Cells are compared with each other in ``encircle.statistics.comparisons``.
"""

import warnings
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special, stats

CONFIDENCE = 0.95
UPPER = (1.0 + CONFIDENCE) / 2.0
Z = float(stats.norm.ppf(UPPER))
RESAMPLES = 2000
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

    def signed(self, scale: float = 1.0) -> str:
        """``-2.1 [-8.3, +4.1]``, or the value alone if it has no bounds."""
        # A mean of differences that cancel each other is 0 but for rounding.
        value, low, high = (0.0 if abs(bound) < ROUNDING else scale * bound for bound in self)
        return f"{value:+.3g}" if np.isnan(low) else f"{value:+.3g} [{low:+.3g}, {high:+.3g}]"


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


def capture_rate(captured: ArrayLike) -> Interval:
    """Share of runs (S,), S > 0, that captured, with Wilson's interval."""
    flags = flags_of("captured", captured)
    return wilson(float(flags.mean()), flags.size)


def wilson(share: float, count: int) -> Interval:
    """Wilson's interval for a share of ``count`` independent units.

    If units have shares of their own, the mean of which it is, it is wider than it need be: nothing
    from 0 to 1 varies more than what is 0 or 1.
    """
    square = Z**2 / count
    centre = (share + square / 2.0) / (1.0 + square)
    half = np.sqrt(share * (1.0 - share) * square + square**2 / 4.0) / (1.0 + square)
    low, high = np.clip((centre - half, centre + half), 0.0, 1.0)
    return Interval(share, float(min(low, share)), float(max(high, share)))


def survival(ticks: ArrayLike, captured: ArrayLike) -> Survival:
    """Kaplan and Meier's estimate from the ticks of runs (S,), S > 0, and whether they captured.

    The interval is Greenwood's on the scale log(-log(share)), where a share of 1 or 0 has no
    place. There it is Wilson's for the runs that lasted to that tick, none or all of which
    captured by its end. As a share never rises, the upper bound before a share of 0 holds too.
    """
    times, flags = times_of(ticks, captured)
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
    runs = times_of(ticks_a, captured_a), times_of(ticks_b, captured_b)
    a, b = (stats.CensoredData.right_censored(times, ~flags) for times, flags in runs)
    # A variance of 0 says that they cannot tell; rounding makes the statistic 0/0 or x/0 then.
    with np.errstate(divide="ignore", invalid="ignore"):
        found = stats.logrank(a, b)
    return float(found.pvalue) if np.isfinite(found.statistic) else np.nan


def mean(values: ArrayLike, *, resamples: int = RESAMPLES) -> Interval:
    """Mean of values (S,) but for NaNs, with a BCa bootstrap interval; no bounds if S < 2.

    Of few and skewed values it covers less than 95 %: about 92 % for 40 exponential ones, and far
    less if values that are rare and large are missing from the sample.
    """
    found = column("values", values)
    found = found[~np.isnan(found)]
    value = float(found.mean()) if found.size else np.nan
    if found.size < 2:
        return Interval(value)
    if np.ptp(found) == 0.0:
        return Interval(value, value, value)
    return Interval(value, *_bounds(found, np.mean, resamples, "BCa"))


def restricted_mean_ticks(ticks: ArrayLike, captured: ArrayLike, limit: float) -> Interval:
    """Mean of min(time to capture, ``limit``) over runs (S,), as the area under their survival.

    Or of runs (X, S) of X settings on S common seeds, which are the independent units. No bounds
    if S < 2. A run without capture that ends before the limit is a ValueError: its time is not
    known.

    A few runs without capture make up much of the mean, and a sample may well hold none of them. So
    it is told apart into the times of captures about their mean c, a run without one counting as c,
    and the share of runs without capture times (limit - c). The first has Student's interval, the
    second Wilson's; the distances to their bounds are joined as the sides of a right angle
    (Zou and Donner 2008, Statistics in Medicine 27, 1693-1702). Without any capture c is 0.
    """
    times = np.asarray(ticks, np.float64)
    flags = np.asarray(captured)
    flat, caught = times_of(times.ravel(), flags.ravel())
    if (~caught & (flat < limit)).any():
        raise ValueError(f"ticks={flat[~caught].min():g} without capture, must reach {limit=:g}")
    caught = (caught & (flat <= limit)).reshape(times.shape)
    known = np.minimum(times, limit)
    value, seeds = float(known.mean()), times.shape[-1]
    if seeds < 2:
        return Interval(value)
    centre = float(known[caught].mean()) if caught.any() else 0.0
    apart = np.atleast_2d(np.where(caught, known - centre, 0.0)).mean(axis=0)
    half = special.stdtrit(seeds - 1, UPPER) * stats.sem(apart)
    share, low, high = wilson(float((~caught).mean()), seeds)
    down, up = (limit - centre) * (share - low), (limit - centre) * (high - share)
    bounds = value - np.hypot(half, down), value + np.hypot(half, up)
    return Interval(value, max(float(bounds[0]), 0.0), min(float(bounds[1]), float(limit)))


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
    steps, table = column("levels", levels), np.asarray(captured)
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


def column(name: str, values: ArrayLike, size: int | None = None) -> Floats:
    """Values as a list, of ``size`` if given; a ValueError names what is none."""
    found = np.asarray(values, np.float64)
    if found.ndim != 1 or np.isinf(found).any() or size not in (None, found.size):
        count = "" if size is None else f" of {size}"
        raise ValueError(f"{name}={found!r} must be a list{count}, of finite numbers or NaN")
    return found


def flags_of(name: str, captured: ArrayLike, size: int | None = None) -> Flags:
    """One or more of true and false, as ``column`` takes them."""
    flags = column(name, captured, size)
    if not flags.size or not np.isin(flags, (0.0, 1.0)).all():
        raise ValueError(f"{name}={flags!r} must be one or more of true and false")
    return flags.astype(np.bool_)


def times_of(ticks: ArrayLike, captured: ArrayLike) -> tuple[Floats, Flags]:
    """Times of runs and whether they captured, checked."""
    flags = flags_of("captured", captured)
    times = column("ticks", ticks, flags.size)
    if not (times >= 0.0).all():
        raise ValueError(f"ticks={times!r} must be 0 or more")
    return times, flags


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
