"""Estimates from the runs of a study, with 95 % confidence intervals.

All cells of a study run the same seeds. Seeds are therefore the independent units, and resampling
draws whole seeds. A run that does not capture within its limit is censored: its time to capture is
at least the limit. Such a run is never dropped and never counted as a capture.

A bootstrap cannot show what the sample lacks. If all runs of a sample ended alike, all its
resamples end alike, although the true rate need not be 0 or 1. Therefore rates have Wilson's
interval, the interval of a mean time is widened by Wilson's interval for the share of runs without
capture, and the interval of a tolerated level is widened to where Wilson's bounds cross the rate.
Means of measures have a bootstrap interval only: its width is 0 if all values are equal, which does
not mean that the mean is known. The bootstrap's random stream is fixed, so the same values always
give the same interval.

``encircle.statistics.comparisons`` compares cells with each other.
"""

import warnings
from collections.abc import Callable
from functools import lru_cache
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special, stats

CONFIDENCE = 0.95
QUANTILE_UPPER = (1.0 + CONFIDENCE) / 2.0
Z_UPPER = float(stats.norm.ppf(QUANTILE_UPPER))
RESAMPLES = 2000
BOOTSTRAP_SEED = 0
KEPT_DRAWS_MAX = 4_000_000
"""Up to so many draws of a bootstrap are kept for the next one of as many values."""
ABSOLUTE_ROUNDING = 1e-12

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


class Interval(NamedTuple):
    """An estimate and its 95 % interval. NaN: undefined. An infinite bound: open on that side."""

    value: float = np.nan
    low: float = np.nan
    high: float = np.nan

    def __format__(self, spec: str) -> str:
        """``0.85 [0.71, 0.93]``; ``spec`` formats each number, ``.3g`` by default."""
        value, low, high = (format(number, spec or ".3g") for number in self)
        return f"{value} [{low}, {high}]"

    def signed_text(self, scale: float = 1.0) -> str:
        """``-2.1 [-8.3, +4.1]``, each number times ``scale``; the value alone without bounds."""
        # Differences that cancel each other can leave a mean of about 1e-17, which means 0.
        value, low, high = (
            0.0 if abs(bound) < ABSOLUTE_ROUNDING else scale * bound for bound in self
        )
        return f"{value:+.3g}" if np.isnan(low) else f"{value:+.3g} [{low:+.3g}, {high:+.3g}]"


class Survival(NamedTuple):
    """A survival curve: the share of runs whose target is still free after each tick.

    ``ticks``: (K,) ascending, the ticks at which some run ended. ``share``, ``low``, ``high``:
    (K,) the share after that tick and its pointwise interval. The share is 1 before the first
    tick and constant between two ticks. ``median``: the first tick after which at most half are
    free, NaN if there is none.
    """

    ticks: Floats
    share: Floats
    low: Floats
    high: Floats
    median: float


def capture_rate(captured: ArrayLike) -> Interval:
    """Share of runs that captured, from flags (S,), S > 0, with Wilson's interval.

    Raises ``ValueError`` if the list is empty or holds anything but true and false.
    """
    flags = checked_flags("captured", captured)
    return wilson_interval(float(flags.mean()), flags.size)


def wilson_interval(share: float, count: int) -> Interval:
    """Wilson's score interval for a share of ``count`` independent units.

    Wilson (1927), Journal of the American Statistical Association 22, 209-212. If each unit has
    a share of its own between 0 and 1, and ``share`` is their mean, the interval is wider than
    necessary, because no distribution on [0, 1] varies more than one that is 0 or 1.
    """
    square = Z_UPPER**2 / count
    centre = (share + square / 2.0) / (1.0 + square)
    half = np.sqrt(share * (1.0 - share) * square + square**2 / 4.0) / (1.0 + square)
    low, high = np.clip((centre - half, centre + half), 0.0, 1.0)
    return Interval(share, float(min(low, share)), float(max(high, share)))


def kaplan_meier(ticks: ArrayLike, captured: ArrayLike) -> Survival:
    """Kaplan and Meier's survival curve from last ticks (S,) and capture flags (S,), S > 0.

    Kaplan and Meier (1958), Journal of the American Statistical Association 53, 457-481. The
    interval is Greenwood's on the scale log(-log(share)). That scale has no value for a share
    of 1 or 0; there the interval is Wilson's for the runs that were still under observation at
    that tick. As a share never rises, the upper bound at a share of 0 is at most the one
    before. Raises ``ValueError`` for negative ticks or lists of different length.
    """
    times, flags = checked_times(ticks, captured)
    free = stats.ecdf(stats.CensoredData.right_censored(times, ~flags)).sf
    share = free.probabilities
    with warnings.catch_warnings():
        # scipy warns of undefined bounds; exactly these are replaced below.
        warnings.filterwarnings("ignore", "The confidence interval is undefined", RuntimeWarning)
        bounds: Any = free.confidence_interval(CONFIDENCE, method="log-log")
    low, high = bounds.low.probabilities.copy(), bounds.high.probabilities.copy()
    for k in np.flatnonzero((share == 0.0) | (share == 1.0)):
        lasted = times[times >= free.quantiles[k]]
        _, low[k], high[k] = capture_rate(np.full(lasted.size, share[k]))
        if k and not share[k]:
            high[k] = min(high[k], high[k - 1])
    late = free.quantiles[share <= 0.5 + ABSOLUTE_ROUNDING]
    return Survival(free.quantiles, share, low, high, float(late[0]) if late.size else np.nan)


def logrank_p(
    ticks_a: ArrayLike, captured_a: ArrayLike, ticks_b: ArrayLike, captured_b: ArrayLike
) -> float:
    """Two-sided p of the log-rank test that two cells capture equally fast.

    ``ticks_a``, ``ticks_b``: last ticks of the runs, (S,) and (R,); ``captured_a``,
    ``captured_b``: whether they captured. NaN if the runs carry no information, as without any
    capture. The test assumes independent cells. If common seeds make the times of both cells
    alike, p is rather too large than too small. Raises ``ValueError`` as ``kaplan_meier`` does.
    """
    runs = checked_times(ticks_a, captured_a), checked_times(ticks_b, captured_b)
    a, b = (stats.CensoredData.right_censored(times, ~flags) for times, flags in runs)
    # Without information the variance is 0, and the statistic 0/0 or x/0.
    with np.errstate(divide="ignore", invalid="ignore"):
        test = stats.logrank(a, b)
    return float(test.pvalue) if np.isfinite(test.statistic) else np.nan


def bootstrap_mean(values: ArrayLike, *, resamples: int = RESAMPLES) -> Interval:
    """Mean of values (S,) without NaNs, with a BCa bootstrap interval; no bounds if S < 2.

    Efron (1987), Journal of the American Statistical Association 82, 171-185. For few and
    skewed values the interval covers less than 95 %: about 92 % for 40 exponential values, and
    far less if rare large values are missing from the sample. Raises ``ValueError`` for
    infinite values.
    """
    defined = checked_values("values", values)
    defined = defined[~np.isnan(defined)]
    value = float(defined.mean()) if defined.size else np.nan
    if defined.size < 2:
        return Interval(value)
    if np.ptp(defined) == 0.0:
        return Interval(value, value, value)
    means = defined[_draws(defined.size, resamples)].mean(axis=-1)
    return Interval(value, *_bootstrap_bounds(defined, np.mean, resamples, "BCa", means))


def restricted_mean_time(ticks: ArrayLike, captured: ArrayLike, limit: float) -> Interval:
    """Mean of min(time to capture, ``limit``) over runs: the area under their survival curve.

    ``ticks``: (S,) times of runs with common seeds, or (X, S) of X settings on these seeds,
    which are the independent units; ``captured``: the same shape. ``limit`` is in the unit of
    ``ticks``, which may also be seconds. No bounds if S < 2. Raises ``ValueError`` for a run
    without capture that ends before the limit, since its time is not known.

    Few runs without capture can make up much of the mean, and a sample may hold none of them.
    The mean is therefore split in two: the times of the captures about their mean c, where a
    run without capture counts as c; and the share of runs without capture times (limit - c).
    The first part has Student's interval, the second Wilson's. The distances to their bounds
    are combined as the root of the sum of their squares (Zou and Donner 2008, Statistics in
    Medicine 27, 1693-1702). Without any capture c is 0.
    """
    times = np.asarray(ticks, np.float64)
    flags = np.asarray(captured)
    flat, caught = checked_times(times.ravel(), flags.ravel())
    if (~caught & (flat < limit)).any():
        raise ValueError(f"ticks={flat[~caught].min():g} without capture, must reach {limit=:g}")
    caught = (caught & (flat <= limit)).reshape(times.shape)
    known = np.minimum(times, limit)
    value, seeds = float(known.mean()), times.shape[-1]
    if seeds < 2:
        return Interval(value)
    centre = float(known[caught].mean()) if caught.any() else 0.0
    apart = np.atleast_2d(np.where(caught, known - centre, 0.0)).mean(axis=0)
    half = special.stdtrit(seeds - 1, QUANTILE_UPPER) * stats.sem(apart)
    share, low, high = wilson_interval(float((~caught).mean()), seeds)
    down, up = (limit - centre) * (share - low), (limit - centre) * (high - share)
    bounds = value - np.hypot(half, down), value + np.hypot(half, up)
    return Interval(value, max(float(bounds[0]), 0.0), min(float(bounds[1]), float(limit)))


def tolerated_level(
    levels: ArrayLike, captured: ArrayLike, rate: float, *, resamples: int = RESAMPLES
) -> Interval:
    """The largest level up to which the capture rate stays at or above ``rate``.

    ``levels``: (L,) ascending; ``captured``: (L, S) flags on common seeds; L > 1, S > 1. The
    level is interpolated linearly at the first fall below ``rate``. It is NaN, with ``low``
    -inf, if the first level is already below. It is the last level, with ``high`` inf, if no
    level is below. A bound beyond the first or last level is that level or infinite.

    The interval is a percentile bootstrap over seeds. It is widened to where Wilson's bounds
    cross ``rate`` if all runs ended alike at a level next to the crossing. If the true rate is
    close to ``rate`` over many levels, chance makes the first crossing too early. Raises
    ``ValueError`` if levels do not ascend, shapes do not match, or ``rate`` is not in (0, 1].
    """
    steps, table = checked_values("levels", levels), np.asarray(captured)
    if steps.size < 2 or not (np.diff(steps) > 0.0).all():
        raise ValueError(f"levels={steps!r} must be two or more, ascending")
    if table.ndim != 2 or len(table) != steps.size or table.shape[1] < 2:
        raise ValueError(f"captured.shape={table.shape} must be ({steps.size}, two or more seeds)")
    if not 0.0 < rate <= 1.0:
        raise ValueError(f"rate={rate!r} must be above 0 and at most 1")
    wilson_interval = np.array([capture_rate(row) for row in table])

    def crossing(seeds: NDArray[np.int64], *, axis: int = -1) -> Floats:
        return _crossing_level(steps, np.moveaxis(table[:, seeds].mean(axis=axis), 0, -1), rate)

    seeds = np.arange(table.shape[1])
    value = float(crossing(seeds))
    low, high = _bootstrap_bounds(seeds, crossing, resamples, "percentile")
    after = max(int(np.append(wilson_interval[:-1, 0] < rate, True).argmax()), 1)
    if np.isin(wilson_interval[after - 1 : after + 1, 0], (0.0, 1.0)).any():
        low = min(low, float(_crossing_level(steps, wilson_interval[:, 1], rate)))
        high = max(high, float(_crossing_level(steps, wilson_interval[:, 2], rate)))
    first, last = float(steps[0]), float(steps[-1])
    known = np.nan if value < first else min(value, last)
    return Interval(known, min(low, last), max(high, value, first))


def checked_values(name: str, values: ArrayLike, size: int | None = None) -> Floats:
    """The values as an array (S,).

    Values must be finite numbers or NaN, and ``size`` many if it is given. Raises
    ``ValueError``, which calls them ``name``, if they are not.
    """
    checked = np.asarray(values, np.float64)
    if checked.ndim != 1 or np.isinf(checked).any() or size not in (None, checked.size):
        count = "" if size is None else f" of {size}"
        raise ValueError(f"{name}={checked!r} must be a list{count}, of finite numbers or NaN")
    return checked


def checked_flags(name: str, captured: ArrayLike, size: int | None = None) -> Flags:
    """Capture flags as booleans (S,), S > 0; raises ``ValueError`` for anything else."""
    flags = checked_values(name, captured, size)
    if not flags.size or not np.isin(flags, (0.0, 1.0)).all():
        raise ValueError(f"{name}={flags!r} must be one or more of true and false")
    return flags.astype(np.bool_)


def checked_times(ticks: ArrayLike, captured: ArrayLike) -> tuple[Floats, Flags]:
    """Times (S,) of at least 0 and capture flags (S,); raises ``ValueError`` for anything else."""
    flags = checked_flags("captured", captured)
    times = checked_values("ticks", ticks, flags.size)
    if not (times >= 0.0).all():
        raise ValueError(f"ticks={times!r} must be 0 or more")
    return times, flags


def _draws(count: int, resamples: int) -> NDArray[np.int64]:
    """(R, S) which of ``count`` values each resample takes: scipy's draws from the fixed stream."""
    kept = count * resamples <= KEPT_DRAWS_MAX
    return _kept_draws(count, resamples) if kept else _kept_draws.__wrapped__(count, resamples)


@lru_cache(maxsize=4)
def _kept_draws(count: int, resamples: int) -> NDArray[np.int64]:
    return np.random.default_rng(BOOTSTRAP_SEED).integers(0, count, (resamples, count))


def _bootstrap_bounds(
    values: NDArray[Any],
    statistic: Callable[..., Any],
    resamples: int,
    method: str,
    distribution: Floats | None = None,
) -> tuple[float, float]:
    """Bootstrap bounds by ``method``; where it gives none or infinite ones, plain percentiles.

    ``distribution``: (R,) the statistic of the resamples, if it is known.
    """
    # numpy warns of infinite resamples, which are intended; scipy of missing bounds, which are
    # replaced below.
    with np.errstate(divide="ignore", invalid="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore", stats.DegenerateDataWarning)
        how: dict[str, Any] = {"n_resamples": resamples, "method": method, "rng": BOOTSTRAP_SEED}
        if distribution is not None:
            known = SimpleNamespace(bootstrap_distribution=distribution)
            how |= {"n_resamples": 0, "bootstrap_result": known}
        result = stats.bootstrap((values,), statistic, confidence_level=CONFIDENCE, **how)
    low, high = result.confidence_interval
    if not np.isfinite((low, high)).all():
        tails = (1.0 - CONFIDENCE) / 2, (1.0 + CONFIDENCE) / 2
        low, high = np.quantile(result.bootstrap_distribution, tails, method="inverted_cdf")
    return float(low), float(high)


def _crossing_level(levels: Floats, shares: Floats, rate: float) -> Floats:
    """Level at which shares (..., L) first fall below ``rate``.

    It is -inf if the first share is below, and inf if none is.
    """
    below = shares < rate
    after = np.maximum(below.argmax(axis=-1), 1)
    pair = np.stack((after - 1, after), axis=-1)
    start, end = np.moveaxis(np.take_along_axis(shares, pair, axis=-1), -1, 0)
    fall = np.where(start > end, start - end, 1.0)
    inside = levels[after - 1] + (start - rate) / fall * (levels[after] - levels[after - 1])
    return np.where(below[..., 0], -np.inf, np.where(below.any(axis=-1), inside, np.inf))
