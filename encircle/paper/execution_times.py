"""Execution times of four policies over many runs, and capture rates of simulation 4.

The paper's Fig. 7 shows one run of simulation 5 per policy and start of R3. Without noise a run
repeats exactly, so one run shows how that start went, not which policy is faster. Here each start
is run with many seeds. A seed moves every robot's start by up to ``JITTER_M`` along each axis and
draws the detection noise; it does so in the same way for every policy and every start of R3.
Comparisons are therefore paired. The seeds are the independent units: differences are averaged
within a seed before an interval is computed.

A run that does not capture within ``ticks_max`` is censored: its execution time is at least that.
It is never dropped. The mean counts it as ``ticks_max`` and is therefore a lower bound. Most hunts
succeed at once and some take ten times as long, so a few runs dominate the mean. Its interval is
wide, because there may be more such runs than the seeds show. The typical time is given too: the
mean of the middle half of the runs. Censored runs do not change it as long as they are fewer than a
quarter.

Three policies are compared with xi*. Their three intervals hold together with 95 % (Bonferroni), so
that they can decide the paper's claim.
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
from encircle.statistics.intervals import capture_rate, restricted_mean_time
from encircle.world.loading.load import load

POLICIES = {"xi-0": "xi = 0", "xi-1": "xi = 1", "xi-3": "xi = 3", "xi-star": "xi*"}
XI_STAR = list(POLICIES).index("xi-star")
X_OF_R3_M = tuple(float(x) for x in range(7, 16))
JITTER_M = 0.25
NOISE_M_STD = 0.02
SLOW_STEP_M = 0.2
SURROUNDED_M = 2.6
CONFIDENCE = 0.95
CONFIDENCE_EACH = 1.0 - (1.0 - CONFIDENCE) / (len(POLICIES) - 1)
"""Confidence of each difference from xi*, such that all of them hold with ``CONFIDENCE``."""
RESAMPLES = 2000
TRIMMED_SHARE = 0.25
CHUNK_RUNS = 4


class RunOutcome(NamedTuple):
    """How one run ended.

    ``ticks``: its length. ``farthest_m``: distance at the end from the target to the farthest
    robot.
    """

    ticks: int
    captured: bool
    farthest_m: float


class MeanInterval(NamedTuple):
    """A mean with its confidence interval, 95 % unless its function says otherwise."""

    mean: float
    low: float
    high: float

    def __format__(self, sign: str) -> str:
        """As a time, or with ``+`` as a difference: with a sign and one more digit."""
        spec = f"{sign}.{2 if sign else 1}f"
        return f"{self.mean:{spec}} [{self.low:{spec}}, {self.high:{spec}}]"


class CaptureCount(NamedTuple):
    """How many of how many runs captured, with Wilson's 95 % interval of the share."""

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
    """The runs of simulation 5 by start of R3, policy and seed: arrays (X, P, S).

    ``x_m``: (X,) starting x of R3 in m. ``ticks``: length of each run. ``captured``: whether it
    captured. ``farthest_m``: distance at the end from the target to the farthest robot.
    ``ticks_max``: limit of a run.
    """

    x_m: tuple[float, ...]
    ticks: NDArray[np.int64]
    captured: NDArray[np.bool_]
    farthest_m: NDArray[np.float64]
    ticks_max: int

    @property
    def surrounded_count(self) -> int:
        """How many runs end without capture although every robot is within ``SURROUNDED_M``."""
        return int((~self.captured & (self.farthest_m <= SURROUNDED_M)).sum())

    @property
    def missed(self) -> NDArray[np.int64]:
        """Number of runs without capture: (X, P)."""
        return np.asarray((~self.captured).sum(axis=2))

    def typical(self, start_index: int, policy: int) -> MeanInterval:
        """Typical time at a start, in ticks."""
        return trimmed_mean_interval(self.ticks[start_index, policy], TRIMMED_SHARE)

    def mean(self, start_index: int, policy: int) -> MeanInterval:
        """Mean time at a start, in ticks; a lower bound if there are runs without capture."""
        return self._restricted_mean(
            self.ticks[start_index, policy], self.captured[start_index, policy]
        )

    def overall(self, policy: int) -> MeanInterval:
        """Typical time over all starts, in ticks."""
        return trimmed_mean_interval(self.ticks[:, policy], TRIMMED_SHARE)

    def overall_mean(self, policy: int) -> MeanInterval:
        """Mean time over all starts, in ticks; a lower bound if there are runs without capture."""
        return self._restricted_mean(self.ticks[:, policy], self.captured[:, policy])

    def difference(self, policy: int) -> MeanInterval:
        """Typical difference in ticks: a policy's time minus that of xi*, over all pairs.

        The bounds are plus and minus the longest time if there are too few seeds: so few
        that even the same sign in all of them would not be significant.
        """
        interval = trimmed_mean_interval(
            self._differences_from_xi_star(policy), TRIMMED_SHARE, CONFIDENCE_EACH
        )
        few = 2.0 ** (1 - self.ticks.shape[2]) > 1.0 - CONFIDENCE_EACH
        return MeanInterval(interval.mean, -self.ticks_max, self.ticks_max) if few else interval

    def difference_mean(self, policy: int) -> MeanInterval:
        """Mean difference in ticks: a policy's time minus that of xi*."""
        by_seed = self._differences_from_xi_star(policy).mean(axis=0)
        return MeanInterval(*bounded_mean(by_seed, self.ticks_max, CONFIDENCE_EACH))

    def _differences_from_xi_star(self, policy: int) -> NDArray[np.int64]:
        return np.asarray(self.ticks[:, policy] - self.ticks[:, XI_STAR])

    def _restricted_mean(
        self, ticks: NDArray[np.int64], captured: NDArray[np.bool_]
    ) -> MeanInterval:
        return MeanInterval(*restricted_mean_time(ticks, captured, self.ticks_max))

    def order(self, policy: int) -> tuple[int, int, int]:
        """In how many pairs xi* captures earlier, later, and neither of the two."""
        late = np.where(self.captured, self.ticks, self.ticks_max + 1)
        sign = np.sign(late[:, policy] - late[:, XI_STAR])
        return int((sign > 0).sum()), int((sign < 0).sum()), int((sign == 0).sum())


def trimmed_mean_interval(
    values: NDArray[np.int64], trim: float, confidence: float = CONFIDENCE
) -> MeanInterval:
    """Mean of ``values`` without the share ``trim`` at either end, with its interval.

    ``values``: (S,) or (X, S), S > 1. The bootstrap resamples whole seeds, the last axis. The
    interval is Student's with the bootstrap's standard error, because bootstrap percentiles
    cover too little if seeds are few. The random stream is fixed: the same table gives the same
    interval.
    """
    table = np.atleast_2d(values).astype(float)
    seeds = table.shape[1]
    rows = np.random.default_rng(0).integers(seeds, size=(RESAMPLES, seeds))
    resampled = table[:, rows].transpose(1, 0, 2).reshape(RESAMPLES, -1)
    error = stats.trim_mean(resampled, trim, axis=1).std() * np.sqrt(seeds / (seeds - 1))
    half = float(stats.t.ppf((1.0 + confidence) / 2.0, seeds - 1) * error)
    value = float(stats.trim_mean(table, trim, axis=None))
    return MeanInterval(value, value - half, value + half)


def capture_count(captured: ArrayLike) -> CaptureCount:
    """Count and share of captures, with Wilson's interval; flags of any shape."""
    outcomes = np.asarray(captured, bool)
    _, low, high = capture_rate(outcomes)
    return CaptureCount(int(outcomes.sum()), outcomes.size, low, high)


def jittered(positions: Sequence[Sequence[float]], seed: int) -> list[list[float]]:
    """Starts (N, 2) in m, each moved by up to ``JITTER_M`` per axis, as the seed says."""
    starts = np.array(positions)
    moved = starts + np.random.default_rng(seed).uniform(-JITTER_M, JITTER_M, starts.shape)
    rounded: list[list[float]] = moved.round(6).tolist()
    return rounded


def measure_execution_times(
    x_m: Sequence[float], seeds: int, tell: Tell = no_progress
) -> tuple[ExecutionTimes, ExecutionTimes]:
    """Run simulation 5 for each start of R3: over paired seeds, and once each without noise.

    ``x_m``: starts of R3 in m. ``tell`` is called with the number of finished runs and of all
    runs. Returns the paired runs (X, P, ``seeds``) and the exact ones (X, P, 1).
    """
    base = load("sim5").model_dump(mode="json", exclude_unset=True)
    cases = [(x, policy, seed) for x in x_m for policy in POLICIES for seed in range(seeds + 1)]
    outcomes = run_many([_scenario_of_case(base, *case) for case in cases], tell)
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


def _scenario_of_case(
    base: Mapping[str, Any], x_m: float, policy: str, seed: int
) -> dict[str, Any]:
    """The scenario of one run of simulation 5; seed 0 stands for the shipped one, without noise."""
    starts = [list(p) for p in base["team"]["positions"]]
    starts[2][0] = x_m
    if seed == 0:
        return {**base, "team": {**base["team"], "positions": starts, "strategy": policy}}
    team = {**base["team"], "positions": jittered(starts, seed), "strategy": policy}
    return {**base, "team": team, "sensing": {"noise_m_std": NOISE_M_STD}, "seed": seed}


def execution_times_as_dict(times: ExecutionTimes, exact: ExecutionTimes) -> dict[str, Any]:
    """All numbers behind figure and table, for JSON."""
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


def measure_captures(runs: int, tell: Tell = no_progress) -> dict[str, NDArray[np.bool_]]:
    """Which runs of simulation 4 capture, by seed: flags (S,), S = ``runs``, of three variants.

    ``fast``: random starts. ``slow``: the same starts, and the target's step of the other
    simulations, ``SLOW_STEP_M``. ``near``: the shipped starts, jittered as in simulation 5.
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


def run_many(jobs: Sequence[Mapping[str, Any]], tell: Tell = no_progress) -> list[RunOutcome]:
    """Run scenarios in memory on all processors; returns their outcomes in the order of ``jobs``.

    ``tell`` is called with the number of finished runs and of all runs.
    """
    return in_order(_run_outcome, jobs, os.cpu_count() or 1, CHUNK_RUNS, tell)


def _run_outcome(scenario: Mapping[str, Any]) -> RunOutcome:
    result = run(scenario, link="memory").result
    return RunOutcome(result.ticks, result.captured, max(result.distances_m))
