"""Many runs of simulations 4 and 5: execution times of four policies, and rates of capture.

The paper's Fig. 7 shows one run per policy and start of R3. Without noise a run repeats exactly, so
one run says how that start went, not which policy is faster. Here each start is run over many
seeds: a seed moves every robot's start by up to ``JITTER_M`` along each axis and draws the detection
noise, the same for every policy and every x of R3. What is compared is therefore paired, and the
seeds are the independent units: differences are averaged within a seed before anything is inferred.

A run that does not capture within ``ticks_max`` is censored: its execution time is at least that. It
is never dropped silently. Means are given twice: over the seeds at which all policies captured, a
selection that says how fast a hunt is that succeeds; and over all, censored runs counted as
``ticks_max``, a lower bound of the mean that says how much a policy pays for what escapes it.
"""

import os
import signal
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from math import isfinite, nan
from multiprocessing import get_context
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from encircle.hunts import run
from encircle.tracks import Floats
from world.scenario import load

POLICIES = {"xi-0": "xi = 0", "xi-1": "xi = 1", "xi-3": "xi = 3", "xi-star": "xi*"}
STAR = list(POLICIES).index("xi-star")
X_OF_R3_M = tuple(float(x) for x in range(7, 16))
JITTER_M = 0.25
NOISE_M_STD = 0.02
CONFIDENCE = 0.95
RESAMPLES = 4000
CHUNK_RUNS = 4


class Estimate(NamedTuple):
    """A mean with its 95 % interval; NaN where there is too little to tell."""

    mean: float
    low: float
    high: float

    def as_dict(self) -> dict[str, float | None]:
        """For JSON, which has no NaN."""
        return {k: v if isfinite(v) else None for k, v in self._asdict().items()}

    def __str__(self) -> str:
        return f"{self.mean:.1f} [{self.low:.1f}, {self.high:.1f}]"


class Rate(NamedTuple):
    """How many of how many, with Wilson's 95 % interval."""

    count: int
    total: int
    low: float
    high: float

    def __str__(self) -> str:
        return (
            f"{self.count} of {self.total}, {100 * self.count / self.total:.0f} %"
            f" [{100 * self.low:.0f}, {100 * self.high:.0f}]"
        )


@dataclass(frozen=True, slots=True)
class ExecutionTimes:
    """The runs of simulation 5. ``ticks``, ``captured``: (X, P, S) over starts, policies, seeds."""

    x_m: tuple[float, ...]
    ticks: NDArray[np.int64]
    captured: NDArray[np.bool_]

    @property
    def escaped(self) -> NDArray[np.int64]:
        """(X, P) runs without capture."""
        return np.asarray((~self.captured).sum(axis=2))

    def typical(self, place: int, policy: int) -> Estimate:
        """Mean time at a start over the seeds at which every policy captured; t interval."""
        chosen = self.captured[place].all(axis=0)
        return t_interval(self.ticks[place, policy][chosen])

    def bounded(self, place: int, policy: int) -> Estimate:
        """Mean time at a start over all seeds, at least; bootstrap interval."""
        return bootstrap_interval(self.ticks[place, policy])

    def bounded_overall(self, policy: int) -> Estimate:
        """Mean time over all starts and seeds, at least; bootstrap over seeds."""
        return bootstrap_interval(self.ticks[:, policy].mean(axis=0))

    def difference(self, policy: int) -> Estimate:
        """Time of a policy minus that of xi*, over pairs that both captured; t over seeds."""
        both = self.captured[:, policy] & self.captured[:, STAR]
        difference = self.ticks[:, policy] - self.ticks[:, STAR]
        return t_interval([d[b].mean() for d, b in zip(difference.T, both.T, strict=True) if b.any()])

    def bounded_difference(self, policy: int) -> Estimate:
        """The same over all pairs, runs without capture at ``ticks_max``; bootstrap over seeds."""
        return bootstrap_interval((self.ticks[:, policy] - self.ticks[:, STAR]).mean(axis=0))


def t_interval(values: Sequence[float] | NDArray[Any]) -> Estimate:
    """Mean and Student's interval."""
    sample = np.asarray(values, dtype=float)
    if len(sample) < 2:
        return Estimate(float(sample[0]) if len(sample) else nan, nan, nan)
    mean = float(sample.mean())
    error = float(stats.sem(sample))
    half = error * float(stats.t.ppf(0.5 + CONFIDENCE / 2, len(sample) - 1))
    return Estimate(mean, mean - half, mean + half)


def bootstrap_interval(values: Sequence[float] | NDArray[Any]) -> Estimate:
    """Mean and percentile bootstrap interval, for samples with a few very long runs.

    The resamples are the same at every call: same table, same interval.
    """
    sample = np.asarray(values, dtype=float)
    rows = np.random.default_rng(0).integers(len(sample), size=(RESAMPLES, len(sample)))
    tail = (1.0 - CONFIDENCE) / 2
    low, high = np.quantile(sample[rows].mean(axis=1), (tail, 1.0 - tail))
    return Estimate(float(sample.mean()), float(low), float(high))


def rate(captured: Iterable[bool]) -> Rate:
    """Share of captures with Wilson's interval."""
    outcomes = list(captured)
    found = stats.binomtest(sum(outcomes), len(outcomes)).proportion_ci(CONFIDENCE, "wilson")
    return Rate(sum(outcomes), len(outcomes), float(found.low), float(found.high))


def jittered(positions: Sequence[Sequence[float]], seed: int) -> list[list[float]]:
    """Starts (N, 2) in m, each moved by up to ``JITTER_M`` per axis; the seed alone decides."""
    starts = np.array(positions)
    moved = starts + np.random.default_rng(seed).uniform(-JITTER_M, JITTER_M, starts.shape)
    found: list[list[float]] = moved.round(6).tolist()
    return found


def execution_times(x_m: Sequence[float], seeds: int) -> tuple[ExecutionTimes, ExecutionTimes]:
    """Runs of simulation 5 at each start of R3: over paired seeds, and one each without noise."""
    base = load("sim5").model_dump(mode="json", exclude_unset=True)
    cases = [(x, policy, seed) for x in x_m for policy in POLICIES for seed in range(seeds + 1)]
    outcomes = run_many([_case(base, *case) for case in cases])
    shape = (len(x_m), len(POLICIES), seeds + 1)
    ticks = np.array([ticks for ticks, _ in outcomes]).reshape(shape)
    captured = np.array([captured for _, captured in outcomes]).reshape(shape)
    exact, noisy = (slice(0, 1), slice(1, None))
    return (
        ExecutionTimes(tuple(x_m), ticks[..., noisy], captured[..., noisy]),
        ExecutionTimes(tuple(x_m), ticks[..., exact], captured[..., exact]),
    )


def _case(base: Mapping[str, Any], x_m: float, policy: str, seed: int) -> dict[str, Any]:
    """One run of simulation 5; seed 0 stands for the scenario as it is, without noise."""
    starts = [list(p) for p in base["team"]["positions"]]
    starts[2][0] = x_m
    if seed == 0:
        return {**base, "team": {**base["team"], "positions": starts, "strategy": policy}}
    team = {**base["team"], "positions": jittered(starts, seed), "strategy": policy}
    return {**base, "team": team, "sensing": {"noise_m_std": NOISE_M_STD}, "seed": seed}


def capture_rates(runs: int) -> dict[str, Rate]:
    """Rates of capture for simulation 4: from random starts at two speeds, and near its own start.

    ``fast``: random starts; ``slow``: the same with the target's step of the other simulations;
    ``near``: the scenario's own start, jittered as in simulation 5.
    """
    fast = load("sim4").model_dump(mode="json", exclude_unset=True)
    slow_m = load("sim1").target.step_m_max
    robots = len(fast["team"]["positions"])
    team = {**{k: v for k, v in fast["team"].items() if k != "positions"}, "robots": robots}
    slow = {**fast, "target": {**fast["target"], "step_m_max": slow_m}}
    seeds = range(1, runs + 1)
    near = [
        {**fast["team"], "positions": jittered(fast["team"]["positions"], seed)} for seed in seeds
    ]
    jobs = [
        *({**fast, "team": team, "seed": seed} for seed in seeds),
        *({**slow, "team": team, "seed": seed} for seed in seeds),
        *({**fast, "team": own, "seed": seed} for own, seed in zip(near, seeds, strict=True)),
    ]
    captured = [captured for _, captured in run_many(jobs)]
    thirds = (captured[k * runs : (k + 1) * runs] for k in range(3))
    return dict(zip(("fast", "slow", "near"), map(rate, thirds), strict=True))


def run_many(jobs: Sequence[Mapping[str, Any]]) -> list[tuple[int, bool]]:
    """Run scenarios in memory, on all processors; ticks and whether captured, in their order."""
    # Not forked: a forked copy of a process with threads, as Zenoh's, may hang.
    pool = ProcessPoolExecutor(os.cpu_count(), get_context("spawn"), _ignore_interrupts)
    try:
        return list(pool.map(_outcome, jobs, chunksize=CHUNK_RUNS))
    finally:
        pool.shutdown(cancel_futures=True)


def _ignore_interrupts() -> None:
    """Ctrl-C reaches the whole group; the parent alone ends the work in order."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _outcome(scenario: Mapping[str, Any]) -> tuple[int, bool]:
    result = run(scenario, link="memory").result
    return result.ticks, result.captured
