"""What the modules of measures share: units, means that may be undefined, pairs, caching.

A mean over nothing is NaN: an average over ticks of a kind that did not occur says nothing, and
must not look like a zero.
"""

from collections.abc import Callable
from functools import lru_cache, wraps
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from encircle.runlog.runlog import NAN, Floats, Integers, RunLog

A = TypeVar("A")
Measuring = TypeVar("Measuring", bound=Callable[[RunLog], Any])


def cached_per_log(function: Callable[[RunLog], A]) -> Callable[[RunLog], A]:
    """Let a function of a log work only once per log; what it returns must not be changed."""
    name = f"{function.__module__}.{function.__name__}"

    @wraps(function)
    def from_cache(log: RunLog) -> A:
        if name not in log.cached_results:
            log.cached_results[name] = function(log)
        cached: A = log.cached_results[name]
        return cached

    return from_cache


def in_unit(unit: str) -> Callable[[Measuring], Measuring]:
    """Declare the unit of a measure's number, 1 for none."""

    def declared(function: Measuring) -> Measuring:
        function.unit = unit  # type: ignore[attr-defined]
        return function

    return declared


def of_each_robot(function: Measuring) -> Measuring:
    """Declare that a measure answers (N,) numbers, one of each robot, in robot order."""
    function.of_each_robot = True  # type: ignore[attr-defined]
    return function


def mean_or_nan(values: Floats | Integers | NDArray[np.bool_]) -> float:
    """The mean of all values; of truth values, the share of true ones."""
    return float(values.mean()) if values.size else NAN


def rms_or_nan(values: Floats) -> float:
    """The root of the mean square of all values."""
    return float(np.sqrt((values * values).mean())) if values.size else NAN


def percentile_or_nan(values: Floats | Integers, percent: float) -> float:
    """A percentile of all values, linear between two."""
    return float(np.percentile(values, percent)) if values.size else NAN


@lru_cache(maxsize=64)
def links(count: int) -> NDArray[np.bool_]:
    """(N, N) true for directed links: from each robot to each other one."""
    return ~np.eye(count, dtype=bool)


@cached_per_log
def links_there(log: RunLog) -> NDArray[np.bool_]:
    """(T, N (N - 1)) whether both ends of each directed link took part in each round."""
    both = log.there[:, :, None] & log.there[:, None, :]
    return np.asarray(both[:, links(log.count)])


@lru_cache(maxsize=64)
def pairs(count: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """The first and the second of each unordered pair of N."""
    return np.triu_indices(count, 1)
