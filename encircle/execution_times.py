"""Many runs of simulations 4 and 5: execution times of four policies, and rates of capture.

The paper's Fig. 7 shows one run per policy and start of R3. Without noise a run repeats exactly,
so one run says how that start went, not which policy is faster. Here each start is run over many
seeds: a seed moves every robot's start by up to ``JITTER_M`` along each axis and draws the
detection noise, the same for every policy and every x of R3. What is compared is therefore paired,
and the seeds are the independent units: differences are averaged within a seed before anything is
inferred.

A run that does not capture within ``ticks_max`` is censored: its execution time is at least that.
It is never dropped. The mean counts it as ``ticks_max`` and so is a lower bound. A hunt mostly
succeeds at once or takes ten times as long, so that a few runs make the mean; the typical time is
given too, the mean of the middle half of the runs, which censored runs do not touch as long as they
are fewer than a quarter.
"""

import os
import signal
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from encircle.hunts import run
from world.scenario import load

POLICIES = {"xi-0": "xi = 0", "xi-1": "xi = 1", "xi-3": "xi = 3", "xi-star": "xi*"}
STAR = list(POLICIES).index("xi-star")
X_OF_R3_M = tuple(float(x) for x in range(7, 16))
JITTER_M = 0.25
NOISE_M_STD = 0.02
SLOW_STEP_M = 0.2
HELD_M = 2.6
CONFIDENCE = 0.95
RESAMPLES = 2000
MIDDLE_HALF = 0.25
CHUNK_RUNS = 4


class Outcome(NamedTuple):
    """What came of one run. ``farthest_m``: from the target to the farthest robot, at the end."""

    ticks: int
    captured: bool
    farthest_m: float


class Estimate(NamedTuple):
    """A mean with its 95 % interval."""

    mean: float
    low: float
    high: float

    def __format__(self, sign: str) -> str:
        """With a sign (``+``) or without."""
        return f"{self.mean:{sign}.1f} [{self.low:{sign}.1f}, {self.high:{sign}.1f}]"


class Rate(NamedTuple):
    """How many of how many, with Wilson's 95 % interval."""

    captured: int
    runs: int
    low: float
    high: float

    def __str__(self) -> str:
        return (
            f"{self.captured} of {self.runs}, {100 * self.captured / self.runs:.0f} %"
            f" [{100 * self.low:.0f}, {100 * self.high:.0f}]"
        )


@dataclass(frozen=True, slots=True)
class ExecutionTimes:
    """The runs of simulation 5: ``ticks``, ``captured`` (X, P, S) over starts, policies, seeds.

    ``farthest_m``: (X, P, S) distance at the end from the target to the robot farthest from it.
    """

    x_m: tuple[float, ...]
    ticks: NDArray[np.int64]
    captured: NDArray[np.bool_]
    farthest_m: NDArray[np.float64]
    ticks_max: int

    @property
    def held(self) -> int:
        """Runs without capture that end with every robot close around the target."""
        return int((~self.captured & (self.farthest_m <= HELD_M)).sum())

    @property
    def missed(self) -> NDArray[np.int64]:
        """(X, P) runs without capture."""
        return np.asarray((~self.captured).sum(axis=2))

    def typical(self, place: int, policy: int) -> Estimate:
        """Typical time at a start."""
        return estimate(self.ticks[place, policy], MIDDLE_HALF)

    def mean(self, place: int, policy: int) -> Estimate:
        """Mean time at a start, a lower bound if runs did not capture."""
        return estimate(self.ticks[place, policy], 0.0)

    def overall(self, policy: int, trim: float) -> Estimate:
        """Time over all starts, without ``trim`` of the runs at either end."""
        return estimate(self.ticks[:, policy], trim)

    def difference(self, policy: int, trim: float) -> Estimate:
        """Time of a policy minus that of xi* over all pairs, trimmed likewise."""
        return estimate(self.ticks[:, policy] - self.ticks[:, STAR], trim)

    def order(self, policy: int) -> tuple[int, int, int]:
        """In how many pairs xi* captures earlier, later, and at the same tick or neither does."""
        late = np.where(self.captured, self.ticks, self.ticks_max + 1)
        sign = np.sign(late[:, policy] - late[:, STAR])
        return int((sign > 0).sum()), int((sign < 0).sum()), int((sign == 0).sum())


def estimate(values: NDArray[np.int64], trim: float) -> Estimate:
    """Mean without ``trim`` of the values at either end, and percentile bootstrap over seeds.

    ``values``: (S,) or (X, S); seeds, the last axis, are resampled whole. The resamples are the
    same at every call: same table, same interval.
    """
    table = np.atleast_2d(values).astype(float)
    seeds = table.shape[1]
    rows = np.random.default_rng(0).integers(seeds, size=(RESAMPLES, seeds))
    resampled = table[:, rows].transpose(1, 0, 2).reshape(RESAMPLES, -1)
    tail = (1.0 - CONFIDENCE) / 2
    low, high = np.quantile(stats.trim_mean(resampled, trim, axis=1), (tail, 1.0 - tail))
    return Estimate(float(stats.trim_mean(table, trim, axis=None)), float(low), float(high))


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
    ticks, captured, farthest_m = (
        np.array(column).reshape(shape) for column in zip(*outcomes, strict=True)
    )
    paired, exact = (
        ExecutionTimes(
            tuple(x_m),
            ticks[..., part],
            captured[..., part],
            farthest_m[..., part],
            load("sim5").ticks_max,
        )
        for part in (slice(1, None), slice(0, 1))
    )
    return paired, exact


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

    ``fast``: random starts; ``slow``: the same with the target's step of the other simulations,
    ``SLOW_STEP_M``; ``near``: the scenario's own start, jittered as in simulation 5.
    """
    fast = load("sim4").model_dump(mode="json", exclude_unset=True)
    robots = len(fast["team"]["positions"])
    team = {**{k: v for k, v in fast["team"].items() if k != "positions"}, "robots": robots}
    slow = {**fast, "target": {**fast["target"], "step_m_max": SLOW_STEP_M}}
    seeds = range(1, runs + 1)
    near = [
        {**fast["team"], "positions": jittered(fast["team"]["positions"], seed)} for seed in seeds
    ]
    jobs = [
        *({**fast, "team": team, "seed": seed} for seed in seeds),
        *({**slow, "team": team, "seed": seed} for seed in seeds),
        *({**fast, "team": own, "seed": seed} for own, seed in zip(near, seeds, strict=True)),
    ]
    captured = [outcome.captured for outcome in run_many(jobs)]
    thirds = (captured[k * runs : (k + 1) * runs] for k in range(3))
    return dict(zip(("fast", "slow", "near"), map(rate, thirds), strict=True))


def run_many(jobs: Sequence[Mapping[str, Any]]) -> list[Outcome]:
    """Run scenarios in memory, on all processors; what came of them, in their order."""
    # Not forked: a forked copy of a process with threads, as Zenoh's, may hang.
    pool = ProcessPoolExecutor(os.cpu_count(), get_context("spawn"), _ignore_interrupts)
    try:
        return list(pool.map(_outcome, jobs, chunksize=CHUNK_RUNS))
    finally:
        pool.shutdown(cancel_futures=True)


def _ignore_interrupts() -> None:
    """Ctrl-C reaches the whole group; the parent alone ends the work in order."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _outcome(scenario: Mapping[str, Any]) -> Outcome:
    result = run(scenario, link="memory").result
    return Outcome(result.ticks, result.captured, max(result.distances_m))
