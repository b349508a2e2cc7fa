"""The score of a policy, its interval, and how sure the order of the policies is.

The score is the mean over tasks of the share of seeds in which the target was captured; every task
has the same weight. The time score, which decides nothing, is the mean over tasks and seeds of the
time to capture as a share of the task's limit, where a run without capture counts as 1.

Two questions have two intervals. *Over seeds*: what would other seeds give on these tasks? The
independent units are seeds, each with its mean over the tasks. The interval is Student's with two
more seeds, one in which everything is captured and one in which nothing is
(``comparisons.bounded_mean``), so that it keeps a width if all runs end alike. *Over seeds and
tasks*: what would other seeds and other tasks of this kind give? Tasks and seeds are both drawn
with replacement, each resample for all policies together (Owen 2007, The pigeonhole bootstrap,
Annals of Applied Statistics 1, 386-411: such intervals are rather too wide than too narrow), and
the bounds are percentiles. As resamples lack what the runs lack, these bounds are moved outwards to
the bounds over seeds where they lie inside them. Of a single seed there are no bounds of either
kind, and no shares of ranks: what another seed would give is then unknown, and with it all else.

Of the same resamples it is counted how often each policy holds each rank; policies with equal
scores share their ranks in equal parts. What may be said of two policies follows from the
differences within seeds on these tasks (``comparisons.paired_difference``), all pairs corrected
together by Holm's procedure. The ranks that these decisions leave open go from one more than the
number of policies that are decidedly better, to the number of those that are not decidedly worse.
"""

from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from encircle.benchmark.outcomes import Floats, Outcomes
from encircle.statistics.comparisons import (
    Difference,
    Verdict,
    bounded_mean,
    holm_corrected,
    paired_difference,
)
from encircle.statistics.intervals import ABSOLUTE_ROUNDING, CONFIDENCE, RESAMPLES, Interval

STREAM = 1
"""Seed of the resampling: the same runs give the same bounds and rank shares."""
TAILS = ((1.0 - CONFIDENCE) / 2.0, (1.0 + CONFIDENCE) / 2.0)


class Score(NamedTuple):
    """What is said of one policy; all but ranks are shares from 0 to 1.

    ``over_all``: the score with its interval over seeds and tasks. ``over_seeds``: the same score
    with its interval over seeds. ``time``: the time score, with its interval over seeds.
    ``rank``: 1 for the highest score; equal scores have equal ranks. ``best``, ``worst``: the
    ranks that the decided differences leave open. ``rank_shares``: (P,) the share of resamples in
    which the policy held rank 1, 2, .... Bounds and shares of ranks are NaN if S < 2.
    """

    policy: str
    over_all: Interval
    over_seeds: Interval
    time: Interval
    rank: int
    best: int
    worst: int
    rank_shares: Floats

    @property
    def is_bounded(self) -> bool:
        """Whether there are bounds and shares of ranks: not of a single seed."""
        return not np.isnan(self.over_all.low)


class Pair(NamedTuple):
    """The score of ``b`` minus the score of ``a`` on common seeds."""

    a: str
    b: str
    difference: Difference


class Scores(NamedTuple):
    """All policies, the highest score first, and all pairs of them in this order."""

    of: tuple[Score, ...]
    pairs: tuple[Pair, ...]

    def pair(self, a: str, b: str) -> Difference:
        """``b`` minus ``a`` for two policies of which ``a`` stands first."""
        (difference,) = [pair.difference for pair in self.pairs if (pair.a, pair.b) == (a, b)]
        return difference


def scores(outcomes: Outcomes, resamples: int = RESAMPLES) -> Scores:
    """Scores, intervals, ranks and pairs of all policies; no bounds and rank shares if S < 2."""
    means = outcomes.captured.mean(axis=1)
    times = outcomes.time_shares.mean(axis=1)
    values = means.mean(axis=1)
    drawn = resampled_scores(outcomes.captured, resamples)
    several = len(outcomes.seeds) > 1
    shares = rank_shares(drawn) if several else np.full((len(values), len(values)), np.nan)
    order = sorted(range(len(values)), key=lambda k: (-values[k], k))
    pairs = _pairs(outcomes.policies, means, order)
    of = []
    for k in order:
        within = share_interval(means[k])
        best, worst = _open_ranks(outcomes.policies[k], pairs, len(values))
        of.append(
            Score(
                outcomes.policies[k],
                _widened(values[k], drawn[:, k], within),
                within,
                share_interval(times[k]),
                1 + int((values > values[k] + ABSOLUTE_ROUNDING).sum()),
                best,
                worst,
                shares[k],
            )
        )
    return Scores(tuple(of), pairs)


def share_interval(means: Floats) -> Interval:
    """The mean of S independent shares with its interval; no bounds if S < 2."""
    centred = bounded_mean(2.0 * np.asarray(means, np.float64) - 1.0, 1.0)
    return Interval(*((bound + 1.0) / 2.0 for bound in centred))


def resampled_scores(captured: NDArray[np.bool_], resamples: int = RESAMPLES) -> Floats:
    """Scores (B, P) of resamples of runs (P, T, S): tasks and seeds drawn with replacement."""
    _, tasks, seeds = captured.shape
    stream = np.random.default_rng(STREAM)
    of_task = stream.multinomial(tasks, np.full(tasks, 1.0 / tasks), resamples) / tasks
    of_seed = stream.multinomial(seeds, np.full(seeds, 1.0 / seeds), resamples) / seeds
    by_policy = [((of_task @ runs.astype(np.float64)) * of_seed).sum(axis=1) for runs in captured]
    return np.stack(by_policy, axis=1)


def rank_shares(drawn: Floats) -> Floats:
    """The share (P, P) of resamples (B, P) in which policy p holds rank 1 + r, by [p, r].

    Policies with equal scores hold the ranks that they take together, each in equal parts.
    """
    resamples, policies = drawn.shape
    above = (drawn[:, None, :] > drawn[:, :, None] + ABSOLUTE_ROUNDING).sum(axis=2)
    equal = (np.abs(drawn[:, None, :] - drawn[:, :, None]) <= ABSOLUTE_ROUNDING).sum(axis=2)
    ranks = np.arange(policies)
    first, size = above[:, :, None], equal[:, :, None]
    held = ((ranks >= first) & (ranks < first + size)) / size
    return np.asarray(held.sum(axis=0) / resamples)


def independent_difference(a: Interval, b: Interval) -> Interval:
    """``b`` minus ``a`` for two estimates from different seeds, with its interval.

    The distances to their bounds are combined as roots of sums of squares (Zou and Donner 2008,
    Statistics in Medicine 27, 1693-1702).
    """
    value = b.value - a.value
    down = np.hypot(b.value - b.low, a.high - a.value)
    up = np.hypot(b.high - b.value, a.value - a.low)
    return Interval(value, float(value - down), float(value + up))


def _widened(value: float, drawn: Floats, within: Interval) -> Interval:
    if np.isnan(within.low):
        return Interval(float(value))
    low, high = np.quantile(drawn, TAILS, method="inverted_cdf")
    return Interval(float(value), float(min(low, within.low)), float(max(high, within.high)))


def _pairs(policies: Sequence[str], means: Floats, order: Sequence[int]) -> tuple[Pair, ...]:
    couples = list(combinations(order, 2))
    tests = [paired_difference(means[a], means[b], 1.0, less_is_better=False) for a, b in couples]
    corrected = holm_corrected(tests)
    return tuple(
        Pair(policies[a], policies[b], test)
        for (a, b), test in zip(couples, corrected, strict=True)
    )


def _open_ranks(name: str, pairs: Sequence[Pair], policies: int) -> tuple[int, int]:
    """The best and the worst rank that the decided pairs leave to a policy."""
    better = worse = 0
    for a, b, difference in pairs:
        if name not in (a, b) or difference.verdict is Verdict.UNDECIDED:
            continue
        wins = (difference.verdict is Verdict.HIGHER) == (name == b)
        better, worse = better + (not wins), worse + wins
    return 1 + better, policies - worse
