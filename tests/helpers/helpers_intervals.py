"""Oracles and distributions of runs for the tests of intervals and comparisons."""

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
    """Assert that a coverage in [least, most] is not refuted; false alarms are rarer than 1e-6."""
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


TICKS_MAX = 300
"""A run that has not captured by then is one without capture, and its time this."""


class Shape:
    """A joint distribution of the ticks (0 to ``TICKS_MAX``) of two cells on a seed, and its truth.

    ``joint``: (T, T), the chance of each pair of ticks, a's by row.
    """

    def __init__(self, joint):
        self.joint = joint / joint.sum()
        a, b = self.joint.sum(axis=1), self.joint.sum(axis=0)
        ticks = np.arange(TICKS_MAX + 1)
        self.mean_b = float(b @ ticks)
        self.mean = self.mean_b - float(a @ ticks)
        self.order = float(np.triu(self.joint, 1).sum() - np.tril(self.joint, -1).sum())
        self.rate = float(a[-1] - b[-1])

    def runs(self, rng, studies, seeds):
        """Ticks (studies, seeds, 2) drawn from the distribution."""
        outcomes = np.searchsorted(self.joint.ravel().cumsum(), rng.random((studies, seeds)))
        outcomes = np.minimum(outcomes, self.joint.size - 1)
        return np.stack(np.divmod(outcomes, TICKS_MAX + 1), axis=-1).astype(float)


def cell(middle, spread, failing, late=0.0):
    """Chances of each tick: rounded normal times, some late ones, some runs without capture.

    Without ``spread`` all times are the same tick.
    """
    ticks = np.arange(TICKS_MAX + 1)
    at_once = stats.norm.pdf(ticks, middle, spread) if spread else (ticks == middle) * 1.0
    later = ((ticks > 2 * middle) & (ticks < TICKS_MAX)) * 1.0
    chances = (1 - late) * at_once / at_once.sum() + late * later / later.sum()
    chances[-1] = 0.0
    chances *= (1 - failing) / chances.sum()
    chances[-1] = failing
    return chances


def exponential(mean):
    """Chances of each tick if captures come at a constant rate."""
    free = np.exp(-np.arange(TICKS_MAX + 1) / mean)
    return np.concatenate(([0.0], free[:-2] - free[1:-1], free[-2:-1]))


def apart(a, b):
    """Two cells whose runs are independent."""
    return Shape(np.outer(a, b))


def on_common_seeds(failing_both, failing_b, moved):
    """Two cells whose runs mostly end at the same tick.

    ``moved``: share in which b's differ by one.
    """
    same = np.diag(cell(36, 2, 0.0))
    joint = (1 - 2 * moved) * same + moved * np.roll(same, 1, axis=1) + moved * np.roll(same, -1, 1)
    shown = np.zeros_like(joint)
    shown[-1, -1] = failing_both
    shown += (1 - failing_both) * (1 - failing_b) * joint
    shown[:, -1] += (1 - failing_both) * failing_b * joint.sum(axis=1)
    return Shape(shown)


SHAPES = {
    "alike, 1 % fail": apart(cell(36, 2, 0.01), cell(36, 2, 0.01)),
    "alike, 2 % fail": apart(cell(36, 2, 0.02), cell(36, 2, 0.02)),
    "alike, 5 % fail": apart(cell(36, 2, 0.05), cell(36, 2, 0.05)),
    "alike, equal times, 2 % fail": apart(cell(36, 0, 0.02), cell(36, 0, 0.02)),
    "alike, on common seeds, 2 % fail in both": on_common_seeds(0.02, 0.0, 0.05),
    "alike, 8 % late, 2 % fail": apart(cell(36, 2, 0.02, 0.08), cell(36, 2, 0.02, 0.08)),
    "alike, exponential, 2 % fail": apart(exponential(80), exponential(80)),
    "alike, 98 % fail": apart(cell(36, 2, 0.98), cell(36, 2, 0.98)),
    "later by 2, 2 % fail": apart(cell(36, 2, 0.02), cell(38, 2, 0.02)),
    "0 against 2 % fail": apart(cell(36, 2, 0.0), cell(36, 2, 0.02)),
    "1 against 5 % fail": apart(cell(36, 2, 0.01), cell(36, 2, 0.05)),
    "3 against 37 % fail": apart(cell(36, 2, 0.03), cell(36, 2, 0.37)),
    "on common seeds, 3 % more fail": on_common_seeds(0.1, 0.03, 0.05),
    "exponential, slower": apart(exponential(30), exponential(80)),
    "0 against 5 % late": apart(cell(36, 2, 0.0), cell(36, 2, 0.0, 0.05)),
    "mostly earlier, 1.5 % fail, same mean": apart(cell(36, 0, 0.0), cell(32, 0, 4 / 268)),
}
