"""Many runs of simulations 4 and 5: execution times of four policies, and rates of capture.

The paper's Fig. 7 shows one run per policy and start of R3. Without noise a run repeats exactly,
so one run says how that start went, not which policy is faster. Here each start is run over many
seeds: a seed moves every robot's start by up to ``JITTER_M`` along each axis and draws the
detection noise, the same for every policy and every x of R3. What is compared is therefore paired,
and the seeds are the independent units: differences are averaged within a seed before anything is
inferred.

A run that does not capture within ``ticks_max`` is censored: its execution time is at least that.
It is never dropped. The mean counts it as ``ticks_max`` and so is a lower bound. A hunt mostly
succeeds at once or takes ten times as long, so that a few runs make the mean, and its interval is
wide, as more of them may be than the seeds show. The typical time is given too, the mean of the
middle half of the runs, which censored runs do not touch as long as they are fewer than a quarter.

Three policies are compared with xi*. The intervals of the three differences are 95 % for all of
them together (Bonferroni), so that the paper's claim may be called true or false by them.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from encircle.progress import Tell, no_progress
from encircle.runner.hunts import run
from encircle.runner.process_pool import in_order
from encircle.statistics.comparisons import bounded_mean
from encircle.statistics.intervals import capture_rate, restricted_mean_ticks
from encircle.world.loading.load import load

POLICIES = {"xi-0": "xi = 0", "xi-1": "xi = 1", "xi-3": "xi = 3", "xi-star": "xi*"}
STAR = list(POLICIES).index("xi-star")
X_OF_R3_M = tuple(float(x) for x in range(7, 16))
JITTER_M = 0.25
NOISE_M_STD = 0.02
SLOW_STEP_M = 0.2
HELD_M = 2.6
CONFIDENCE = 0.95
CONFIDENCE_EACH = 1.0 - (1.0 - CONFIDENCE) / (len(POLICIES) - 1)
"""For each of the differences from xi*, so that all of them hold with ``CONFIDENCE``."""
RESAMPLES = 2000
MIDDLE_HALF = 0.25
CHUNK_RUNS = 4


class Outcome(NamedTuple):
    """What came of one run. ``farthest_m``: from the target to the farthest robot, at the end."""

    ticks: int
    captured: bool
    farthest_m: float


class MeanInterval(NamedTuple):
    """A mean with its 95 % interval."""

    mean: float
    low: float
    high: float

    def __format__(self, sign: str) -> str:
        """A difference, with a sign (``+``) and finer, or a time."""
        spec = f"{sign}.{2 if sign else 1}f"
        return f"{self.mean:{spec}} [{self.low:{spec}}, {self.high:{spec}}]"


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
    def surrounded(self) -> int:
        """Runs without capture that end with every robot close around the target."""
        return int((~self.captured & (self.farthest_m <= HELD_M)).sum())

    @property
    def missed(self) -> NDArray[np.int64]:
        """(X, P) runs without capture."""
        return np.asarray((~self.captured).sum(axis=2))

    def typical(self, start_index: int, policy: int) -> MeanInterval:
        """Typical time at a start."""
        return estimate(self.ticks[start_index, policy], MIDDLE_HALF)

    def mean(self, start_index: int, policy: int) -> MeanInterval:
        """Mean time at a start, a lower bound if runs did not capture."""
        return self._mean(self.ticks[start_index, policy], self.captured[start_index, policy])

    def overall(self, policy: int) -> MeanInterval:
        """Typical time over all starts."""
        return estimate(self.ticks[:, policy], MIDDLE_HALF)

    def overall_mean(self, policy: int) -> MeanInterval:
        """Mean time over all starts, a lower bound if runs did not capture."""
        return self._mean(self.ticks[:, policy], self.captured[:, policy])

    def difference(self, policy: int) -> MeanInterval:
        """Typical difference: of a policy's time from that of xi*, over all pairs.

        Without bounds but the longest time if so few seeds could not tell even by all being alike.
        """
        found = estimate(self._changes(policy), MIDDLE_HALF, CONFIDENCE_EACH)
        few = 2.0 ** (1 - self.ticks.shape[2]) > 1.0 - CONFIDENCE_EACH
        return MeanInterval(found.mean, -self.ticks_max, self.ticks_max) if few else found

    def difference_mean(self, policy: int) -> MeanInterval:
        """Mean difference of a policy's time from that of xi*."""
        by_seed = self._changes(policy).mean(axis=0)
        return MeanInterval(*bounded_mean(by_seed, self.ticks_max, CONFIDENCE_EACH))

    def _changes(self, policy: int) -> NDArray[np.int64]:
        return np.asarray(self.ticks[:, policy] - self.ticks[:, STAR])

    def _mean(self, ticks: NDArray[np.int64], captured: NDArray[np.bool_]) -> MeanInterval:
        return MeanInterval(*restricted_mean_ticks(ticks, captured, self.ticks_max))

    def order(self, policy: int) -> tuple[int, int, int]:
        """In how many pairs xi* captures earlier, later, and at the same tick or neither does."""
        late = np.where(self.captured, self.ticks, self.ticks_max + 1)
        sign = np.sign(late[:, policy] - late[:, STAR])
        return int((sign > 0).sum()), int((sign < 0).sum()), int((sign == 0).sum())


def estimate(
    values: NDArray[np.int64], trim: float, confidence: float = CONFIDENCE
) -> MeanInterval:
    """Mean without ``trim`` of the values at either end, and an interval from two seeds on.

    ``values``: (S,) or (X, S); seeds, the last axis, are resampled whole. The interval is Student's
    with the bootstrap's standard error: percentiles cover less where seeds are few. The resamples
    are the same at every call: same table, same interval.
    """
    table = np.atleast_2d(values).astype(float)
    seeds = table.shape[1]
    rows = np.random.default_rng(0).integers(seeds, size=(RESAMPLES, seeds))
    resampled = table[:, rows].transpose(1, 0, 2).reshape(RESAMPLES, -1)
    error = stats.trim_mean(resampled, trim, axis=1).std() * np.sqrt(seeds / (seeds - 1))
    half = float(stats.t.ppf((1.0 + confidence) / 2.0, seeds - 1) * error)
    value = float(stats.trim_mean(table, trim, axis=None))
    return MeanInterval(value, value - half, value + half)


def rate(captured: ArrayLike) -> Rate:
    """Share of captures with Wilson's interval."""
    outcomes = np.asarray(captured, bool)
    _, low, high = capture_rate(outcomes)
    return Rate(int(outcomes.sum()), outcomes.size, low, high)


def jittered(positions: Sequence[Sequence[float]], seed: int) -> list[list[float]]:
    """Starts (N, 2) in m, each moved by up to ``JITTER_M`` per axis; the seed alone decides."""
    starts = np.array(positions)
    moved = starts + np.random.default_rng(seed).uniform(-JITTER_M, JITTER_M, starts.shape)
    found: list[list[float]] = moved.round(6).tolist()
    return found


def execution_times(
    x_m: Sequence[float], seeds: int, tell: Tell = no_progress
) -> tuple[ExecutionTimes, ExecutionTimes]:
    """Runs of simulation 5 at each start of R3: over paired seeds, and one each without noise."""
    base = load("sim5").model_dump(mode="json", exclude_unset=True)
    cases = [(x, policy, seed) for x in x_m for policy in POLICIES for seed in range(seeds + 1)]
    outcomes = run_many([_case(base, *case) for case in cases], tell)
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


def numbers(times: ExecutionTimes, exact: ExecutionTimes) -> dict[str, Any]:
    """Everything behind figure and table, for JSON."""
    return {
        "x_m": list(times.x_m),
        "ticks_max": times.ticks_max,
        "jitter_m": JITTER_M,
        "noise_m_std": NOISE_M_STD,
        "policies": {
            name: {
                "captured": int(times.captured[:, policy].sum()),
                "runs": int(times.captured[:, policy].size),
                "farthest_m": times.farthest_m[:, policy].tolist(),
                "typical_ticks": times.overall(policy)._asdict(),
                "mean_ticks_at_least": times.overall_mean(policy)._asdict(),
                "minus_xi_star_typical": times.difference(policy)._asdict(),
                "minus_xi_star_mean": times.difference_mean(policy)._asdict(),
                "xi_star_earlier_later_level": times.order(policy),
                "ticks": times.ticks[:, policy].tolist(),
                "captured_runs": times.captured[:, policy].tolist(),
                "exact_ticks": exact.ticks[:, policy, 0].tolist(),
                "exact_captured": exact.captured[:, policy, 0].tolist(),
            }
            for policy, name in enumerate(POLICIES)
        },
    }


def captures(runs: int, tell: Tell = no_progress) -> dict[str, NDArray[np.bool_]]:
    """Which runs of simulation 4 capture: from random starts at two speeds, and near its own.

    ``fast``: random starts; ``slow``: the same with the target's step of the other simulations,
    ``SLOW_STEP_M``; ``near``: the scenario's own start, jittered as in simulation 5. By seed, (S,).
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
    captured = np.array([outcome.captured for outcome in run_many(jobs, tell)]).reshape(3, runs)
    return dict(zip(("fast", "slow", "near"), captured, strict=True))


def run_many(jobs: Sequence[Mapping[str, Any]], tell: Tell = no_progress) -> list[Outcome]:
    """Run scenarios in memory, on all processors; what came of them, in their order.

    ``tell`` gets how many runs are done, and how many there are.
    """
    return in_order(_outcome, jobs, os.cpu_count() or 1, CHUNK_RUNS, tell)


def _outcome(scenario: Mapping[str, Any]) -> Outcome:
    result = run(scenario, link="memory").result
    return Outcome(result.ticks, result.captured, max(result.distances_m))
