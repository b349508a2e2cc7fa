"""Oracles and shapes of runs for the tests of intervals and tests."""

from math import sqrt

import numpy as np
from scipy import stats

Z = 1.959963984540054


def wilson(captured, n):
    """Roots of (p - rate)^2 = z^2 p (1 - p) / n."""
    rate = captured / n
    centre = (rate + Z**2 / (2 * n)) / (1 + Z**2 / n)
    half = Z / (1 + Z**2 / n) * sqrt(rate * (1 - rate) / n + Z**2 / (4 * n**2))
    return centre - half, centre + half


def assert_covers(hits, least, most):
    """That coverage in [least, most] is not refuted; it would be by chance below 1e-6."""
    hits = list(hits)
    fewest = stats.binom.ppf(5e-7, len(hits), least)
    largest = stats.binom.isf(5e-7, len(hits), most)
    assert fewest <= sum(hits) <= largest, f"{sum(hits)} of {len(hits)}"


def holds(interval, truth):
    return interval.low <= truth <= interval.high


def paired_flags(both, only_a, only_b, neither):
    counts = (both, only_a, only_b, neither)
    return np.repeat([True, True, False, False], counts), np.repeat(
        [True, False, True, False], counts
    )
