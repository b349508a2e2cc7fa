"""The summary of a study's table: cells, comparisons with a baseline, tolerated levels.

The statistics are those of ``encircle.statistics``. Cells are read from the table one at a time and
only in the columns that are needed, so a summary of a long table needs no more memory than one of a
short table.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby
from typing import Any, NamedTuple, TypeVar

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from encircle.statistics.comparisons import (
    RELATIVE_ROUNDING,
    Difference,
    holm_corrected,
    order_difference,
    paired_difference,
    rate_difference,
)
from encircle.statistics.intervals import (
    Interval,
    Survival,
    bootstrap_mean,
    capture_rate,
    kaplan_meier,
    restricted_mean_time,
    tolerated_level,
)
from encircle.statistics.intervals import logrank_p as logrank_of
from encircle.studies.plan import DELIVERED_DELAY, Axis, Plan
from encircle.studies.study_table import StudyTable
from encircle.world.channel.delay_means import RequestedDelay, delivered_s_mean, requested_delay

CAPTURED, TICKS = "captured", "ticks"
OUTCOMES = ("rate", "order", "time_s")
"""The outcomes that a comparison tests: capture rate, order of times, mean time.
The p of all tests of a study are corrected together."""


class Cell(NamedTuple):
    """One cell: its levels, how often and when it captures, and the means of its measures.

    ``time_s``: mean time to capture in s, up to the limit of a run, ``limit_s``. ``delay``: the
    delay that its scenario requests; the delivered delay is one of ``means``.
    """

    cell: int
    levels: Mapping[str, Any]
    runs: int
    rate: Interval
    time_s: Interval
    limit_s: float
    survival: Survival
    delay: RequestedDelay
    means: Mapping[str, Interval]


class Comparison(NamedTuple):
    """One level of the compared axis against the baseline, with all other levels equal.

    The differences are level minus baseline, on common seeds. ``rate``: capture rate.
    ``order``: the share of seeds in which the level captures later, minus the share in which it
    captures earlier. ``time_s``: mean time in s up to the limit of a run, the lower limit of
    the two. ``logrank_p``: p of the log-rank test on all times to capture; no verdict depends
    on it.
    """

    level: Any
    baseline: Any
    others: Mapping[str, Any]
    rate: Difference
    order: Difference
    time_s: Difference
    logrank_p: float


class OverallComparison(NamedTuple):
    """One level of the compared axis against the baseline, over all settings of the other axes.

    Rates and times are averaged over the settings within each seed before anything is tested,
    because seeds are the independent units. ``order`` is the order of these averages.
    """

    level: Any
    baseline: Any
    settings: int
    rate: Difference
    order: Difference
    time_s: Difference


class Tolerance(NamedTuple):
    """Up to which level of a numeric axis the capture rate stays at or above a given rate.

    ``rising``: it is the level from which on, because the rate is below at the first level and
    not at the last.
    """

    axis: str
    others: Mapping[str, Any]
    level: Interval
    rising: bool


T = TypeVar("T", Comparison, OverallComparison)


@dataclass(frozen=True)
class Summary:
    """The summary of a study.

    ``captured``, ``ticks``: (C, S) whether each run captured and its length, by cell and seed.
    ``tick_s``: (C,) duration of a tick in each cell.
    """

    plan: Plan
    cells: tuple[Cell, ...]
    captured: NDArray[np.bool_]
    ticks: NDArray[np.float64]
    tick_s: tuple[float, ...]

    @property
    def comparisons(self) -> tuple[Comparison, ...]:
        """Every level of the compared axis against the baseline, in every setting of the others."""
        return self._all_comparisons[0]

    @property
    def overall(self) -> tuple[OverallComparison, ...]:
        """Every level of the compared axis against the baseline; empty for a single setting."""
        return self._all_comparisons[1]

    @property
    def tests(self) -> int:
        """The number of tests that each p is corrected for."""
        return len(OUTCOMES) * (len(self.comparisons) + len(self.overall))

    @cached_property
    def _all_comparisons(self) -> tuple[tuple[Comparison, ...], tuple[OverallComparison, ...]]:
        """All comparisons, their p corrected together."""
        axis = self.plan.compared_axis
        if axis is None:
            return (), ()
        rows = list(cells_along(self.plan, axis))
        base = baseline_index(self.plan, axis)
        level_indices = [index for index in range(len(axis.levels)) if index != base]
        single = [
            self._comparison(axis, others, row, base, index)
            for others, row in rows
            for index in level_indices
        ]
        over = [
            self._overall(axis, [row for _, row in rows], base, index) for index in level_indices
        ]
        over = over if len(rows) > 1 else []
        tests = holm_corrected(
            [getattr(one, name) for one in (*single, *over) for name in OUTCOMES]
        )
        first = len(OUTCOMES) * len(single)
        return _with_tests(single, tests[:first]), _with_tests(over, tests[first:])

    def _comparison(
        self, axis: Axis, others: Mapping[str, Any], row: Sequence[int], base: int, index: int
    ) -> Comparison:
        a, b = row[base], row[index]
        seconds = [self.ticks[k] * self.tick_s[k] for k in (a, b)]
        times_a_s, times_b_s = self._times_s(a, b)
        return Comparison(
            axis.levels[index],
            axis.levels[base],
            others,
            rate_difference(self.captured[a], self.captured[b]),
            order_difference(*self._times_s(a, b, beyond=True)),
            self._with_effect_size(
                paired_difference(times_a_s, times_b_s, self._limit_s(a, b)), [a], [b]
            ),
            logrank_of(seconds[0], self.captured[a], seconds[1], self.captured[b]),
        )

    def _overall(
        self, axis: Axis, rows: Sequence[Sequence[int]], base: int, index: int
    ) -> OverallComparison:
        pairs = [(row[base], row[index]) for row in rows]
        rate_a, rate_b = self.captured[np.array(pairs)].mean(axis=0)
        times_a_s, times_b_s = np.mean([self._times_s(a, b) for a, b in pairs], axis=0)
        limit_s = float(np.mean([self._limit_s(a, b) for a, b in pairs]))
        return OverallComparison(
            axis.levels[index],
            axis.levels[base],
            len(rows),
            paired_difference(rate_a, rate_b, 1.0, less_is_better=False),
            order_difference(times_a_s, times_b_s),
            self._with_effect_size(
                paired_difference(times_a_s, times_b_s, limit_s), *zip(*pairs, strict=True)
            ),
        )

    def _with_effect_size(
        self, difference: Difference, a: Sequence[int], b: Sequence[int]
    ) -> Difference:
        """A difference of times; without effect size if all runs of one side are censored.

        All times of that side are then equal, so that the spread is that of the other side
        alone.
        """
        known = all(self.captured[list(cells)].any() for cells in (a, b))
        return difference if known else difference._replace(effect_size=Interval())

    def _limit_s(self, a: int, b: int) -> float:
        """The time in s up to which two cells can be compared."""
        return min(self.cells[a].limit_s, self.cells[b].limit_s)

    def _times_s(self, a: int, b: int, *, beyond: bool = False) -> NDArray[np.float64]:
        """Times (2, S) in s of two cells up to their common limit.

        A run without capture counts as the limit, or with ``beyond`` as later than the
        limit.
        """
        limit_s = self._limit_s(a, b)
        pair = np.array([self.ticks[k] * self.tick_s[k] for k in (a, b)])
        never_s = 2.0 * limit_s if beyond else limit_s
        # Ticks times tick_s may exceed the limit by a rounding error.
        in_time = self.captured[[a, b]] & (pair <= limit_s * (1.0 + RELATIVE_ROUNDING))
        return np.where(in_time, np.minimum(pair, limit_s), never_s)

    @cached_property
    def tolerances(self) -> tuple[Tolerance, ...]:
        """For each numeric axis and setting of the others, the tolerated level."""
        results = []
        for axis in self.plan.all_axes:
            if not axis.numeric or len(axis.levels) < 3 or self.captured.shape[1] < 2:
                continue
            levels = list(axis.display_values)
            if levels != sorted(set(levels)):
                continue
            for others, row in cells_along(self.plan, axis):
                level, rising = _tolerance_along(
                    levels, self.captured[list(row)], self.plan.tolerated_rate
                )
                results.append(Tolerance(axis.name, others, level, rising))
        return tuple(results)


def _tolerance_along(
    levels: list[float], captured: NDArray[np.bool_], rate: float
) -> tuple[Interval, bool]:
    """The tolerated level, and whether capture holds from it on (True) or up to it (False)."""
    first, last = captured[0].mean(), captured[-1].mean()
    if not first < rate <= last:
        return tolerated_level(levels, captured, rate), False
    # Seen from the other end of the axis a rising rate is a falling one.
    mirrored = tolerated_level([-level for level in levels[::-1]], captured[::-1], rate)
    return Interval(-mirrored.value, -mirrored.high, -mirrored.low), True


def _with_tests(comparisons: Sequence[T], tests: Sequence[Difference]) -> tuple[T, ...]:
    """Comparisons with their tests replaced, in order."""
    parts = zip(tests[0::3], tests[1::3], tests[2::3], strict=True)
    return tuple(
        one._replace(rate=rate, order=order, time_s=time_s)
        for one, (rate, order, time_s) in zip(comparisons, parts, strict=True)
    )


def summarise(plan: Plan, table: StudyTable) -> Summary:
    """Summarise a complete table.

    Seeds with a failed run in some cell are left out of every cell, so that all cells have the
    same seeds. At least one seed must be left (``StudyTable.complete_seeds``).
    """
    seeds = pa.array(table.complete_seeds)
    cells, captured, ticks, tick_s = [], [], [], []
    for index in range(len(plan.cells)):
        rows = table.read([CAPTURED, TICKS, *plan.measure_names], slice(index, index + 1))
        rows = rows.filter(pc.is_in(rows["seed"], seeds))
        scenario = plan.scenario_of(index)
        flags = rows[CAPTURED].to_numpy() > 0.5
        times = rows[TICKS].to_numpy().astype(float)
        limit_s = scenario.ticks_max * scenario.tick_s
        seconds = times * scenario.tick_s
        cells.append(
            Cell(
                index,
                plan.levels(index),
                len(flags),
                capture_rate(flags),
                restricted_mean_time(seconds, flags, limit_s),
                limit_s,
                kaplan_meier(times, flags),
                requested_delay(scenario.channel, scenario.ids),
                {
                    name: bootstrap_mean(rows[name].to_numpy())
                    for name in plan.measure_names
                    if name != CAPTURED
                },
            )
        )
        captured.append(flags)
        ticks.append(times)
        tick_s.append(scenario.tick_s)
    shown = {
        axis.name: _delivered_s(plan, axis, cells) for axis in plan.axes if axis.show == "delivered"
    }
    plan = plan.as_delivered(shown) if shown else plan
    return Summary(plan, tuple(cells), np.array(captured), np.array(ticks), tuple(tick_s))


def _delivered_s(plan: Plan, axis: Axis, cells: Sequence[Cell]) -> list[float]:
    """Mean delivered delay in s at each level of an axis, over cells in which packets arrived.

    If no packet arrived, it is the delay that a single packet would have.
    """
    along = plan.all_axes.index(axis)
    by_level: list[list[Cell]] = [[] for _ in axis.levels]
    for cell in cells:
        by_level[plan.cells[cell.cell][along]].append(cell)
    return [_delivered_s_mean(plan, level) for level in by_level]


def _delivered_s_mean(plan: Plan, cells: Sequence[Cell]) -> float:
    means_s = np.array([cell.means[DELIVERED_DELAY].value for cell in cells])
    if np.isnan(means_s).all():
        scenario = plan.scenario_of(cells[0].cell)
        return delivered_s_mean(scenario.channel.delay, scenario.tick_s)
    return float(np.nanmean(means_s))


def cells_along(plan: Plan, axis: Axis) -> Iterator[tuple[dict[str, Any], tuple[int, ...]]]:
    """Cells along one axis, for each setting of the others.

    Yields the levels of the other axes, and the cells by level of this axis.
    """
    along = plan.all_axes.index(axis)

    def others(cell: int) -> tuple[int, ...]:
        level_indices = plan.cells[cell]
        return (*level_indices[:along], *level_indices[along + 1 :])

    for _, group in groupby(sorted(range(len(plan.cells)), key=others), key=others):
        row = tuple(group)
        levels = plan.levels(row[0])
        del levels[axis.name]
        yield levels, row


def baseline_index(plan: Plan, axis: Axis) -> int:
    """Index of the level that the others are compared with: the plan's baseline, or the first."""
    named = [k for k, level in enumerate(axis.levels) if str(level) == plan.baseline]
    return named[0] if named else 0
