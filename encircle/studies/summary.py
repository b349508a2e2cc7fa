"""What a study's table says: each cell, levels against each other, how much is tolerated.

Statistics are ``encircle.statistics.intervals``'s. Cells are read from the table one at a time and
only the columns needed, so a summary takes no more memory for a long table than for a short one.
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
    ROUNDING,
    Difference,
    corrected,
    order_difference,
    paired_difference,
    rate_difference,
)
from encircle.statistics.intervals import (
    Interval,
    Survival,
    capture_rate,
    mean,
    restricted_mean_ticks,
    survival,
    tolerance,
)
from encircle.statistics.intervals import logrank as logrank_of
from encircle.studies.plan import DELIVERED, Axis, Plan
from encircle.studies.table import StudyTable
from encircle.world.channel.delay_means import RequestedDelay, delivered_s_mean, requested_delay

CAPTURED, TICKS = "captured", "ticks"
CLAIMS = ("rate", "order", "time_s")
"""What a comparison is tested for; all tests of a study are corrected for one another."""


class Cell(NamedTuple):
    """One cell: its levels, how often and when it captures, and the means of its measures.

    ``time_s``: mean time to capture up to the limit of the run, ``limit_s``. ``delay``: what its
    scenario asks of the radio; what came of it is among the means.
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
    """One level of the compared axis against the baseline, all other levels alike.

    ``rate``, ``order`` and ``time_s`` are differences on common seeds, level minus baseline:
    how often the target is captured, in which share of the seeds later less in which earlier, and
    the mean time up to the limit, the lower one of the two. ``logrank_p`` takes all times to
    capture into account; nothing rests on it.
    """

    level: Any
    baseline: Any
    others: Mapping[str, Any]
    rate: Difference
    order: Difference
    time_s: Difference
    logrank_p: float


class Overall(NamedTuple):
    """One level of the compared axis against the baseline over all settings of the other axes.

    Rates and times are averaged over the settings within each seed before anything is inferred:
    seeds are the independent units. ``order`` is that of these averages.
    """

    level: Any
    baseline: Any
    settings: int
    rate: Difference
    order: Difference
    time_s: Difference


class Tolerance(NamedTuple):
    """Up to which level of a numeric axis the capture rate stays at or above a given one.

    ``rising``: from which level on, since the rate is below at the first level and not at the last.
    """

    axis: str
    others: Mapping[str, Any]
    level: Interval
    rising: bool


T = TypeVar("T", Comparison, Overall)


@dataclass(frozen=True)
class Summary:
    """A study summed up. ``raw``: (C, S) of each cell's ``captured`` and ``ticks``, by seed."""

    plan: Plan
    cells: tuple[Cell, ...]
    captured: NDArray[np.bool_]
    ticks: NDArray[np.float64]
    tick_s: tuple[float, ...]

    @property
    def comparisons(self) -> tuple[Comparison, ...]:
        """Every level of the compared axis against the baseline, in every setting of the others."""
        return self._compared[0]

    @property
    def overall(self) -> tuple[Overall, ...]:
        """Every level of the compared axis against the baseline; empty for a single setting."""
        return self._compared[1]

    @property
    def tests(self) -> int:
        """How many tests the p of each is corrected for."""
        return len(CLAIMS) * (len(self.comparisons) + len(self.overall))

    @cached_property
    def _compared(self) -> tuple[tuple[Comparison, ...], tuple[Overall, ...]]:
        """All comparisons, corrected for each other."""
        axis = self.plan.compared
        if axis is None:
            return (), ()
        rows = list(rows_along(self.plan, axis))
        base = baseline_of(self.plan, axis)
        places = [index for index in range(len(axis.levels)) if index != base]
        single = [
            self._comparison(axis, others, row, base, index)
            for others, row in rows
            for index in places
        ]
        over = [self._overall(axis, [row for _, row in rows], base, index) for index in places]
        over = over if len(rows) > 1 else []
        tests = corrected([getattr(one, name) for one in (*single, *over) for name in CLAIMS])
        first = len(CLAIMS) * len(single)
        return _with(single, tests[:first]), _with(over, tests[first:])

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
            self._sized(paired_difference(times_a_s, times_b_s, self._limit_s(a, b)), [a], [b]),
            logrank_of(seconds[0], self.captured[a], seconds[1], self.captured[b]),
        )

    def _overall(self, axis: Axis, rows: Sequence[Sequence[int]], base: int, index: int) -> Overall:
        pairs = [(row[base], row[index]) for row in rows]
        rate_a, rate_b = self.captured[np.array(pairs)].mean(axis=0)
        times_a_s, times_b_s = np.mean([self._times_s(a, b) for a, b in pairs], axis=0)
        limit_s = float(np.mean([self._limit_s(a, b) for a, b in pairs]))
        return Overall(
            axis.levels[index],
            axis.levels[base],
            len(rows),
            paired_difference(rate_a, rate_b, 1.0, less_is_better=False),
            order_difference(times_a_s, times_b_s),
            self._sized(
                paired_difference(times_a_s, times_b_s, limit_s), *zip(*pairs, strict=True)
            ),
        )

    def _sized(self, found: Difference, a: Sequence[int], b: Sequence[int]) -> Difference:
        """A difference of times; without effect size if all runs of one side are censored.

        The spread of their times is then that of the other side alone, and says nothing of theirs.
        """
        known = all(self.captured[list(cells)].any() for cells in (a, b))
        return found if known else found._replace(effect=Interval())

    def _limit_s(self, a: int, b: int) -> float:
        """Up to when the times of two cells can be compared."""
        return min(self.cells[a].limit_s, self.cells[b].limit_s)

    def _times_s(self, a: int, b: int, *, beyond: bool = False) -> NDArray[np.float64]:
        """Times (2, S) of two cells up to their limit; ``beyond`` it if there is no capture."""
        limit_s = self._limit_s(a, b)
        pair = np.array([self.ticks[k] * self.tick_s[k] for k in (a, b)])
        never_s = 2.0 * limit_s if beyond else limit_s
        # Rounded ticks may come to a little more than the limit that they are.
        in_time = self.captured[[a, b]] & (pair <= limit_s * (1.0 + ROUNDING))
        return np.where(in_time, np.minimum(pair, limit_s), never_s)

    @cached_property
    def tolerated(self) -> tuple[Tolerance, ...]:
        """For each numeric axis and setting of the others, how far capture holds."""
        found = []
        for axis in self.plan.all_axes:
            if not axis.numeric or len(axis.levels) < 3 or self.captured.shape[1] < 2:
                continue
            levels = list(axis.shown_values)
            if levels != sorted(set(levels)):
                continue
            for others, row in rows_along(self.plan, axis):
                held, rising = _held(levels, self.captured[list(row)], self.plan.tolerated_rate)
                found.append(Tolerance(axis.name, others, held, rising))
        return tuple(found)


def _held(levels: list[float], captured: NDArray[np.bool_], rate: float) -> tuple[Interval, bool]:
    """How far capture holds, and whether that is from a level on rather than up to it."""
    first, last = captured[0].mean(), captured[-1].mean()
    if not first < rate <= last:
        return tolerance(levels, captured, rate), False
    # From the other end it is a falling rate again.
    held = tolerance([-level for level in levels[::-1]], captured[::-1], rate)
    return Interval(-held.value, -held.high, -held.low), True


def _with(found: Sequence[T], tests: Sequence[Difference]) -> tuple[T, ...]:
    """Comparisons with their tests, in order."""
    parts = zip(tests[0::3], tests[1::3], tests[2::3], strict=True)
    return tuple(
        one._replace(rate=rate, order=order, time_s=time_s)
        for one, (rate, order, time_s) in zip(found, parts, strict=True)
    )


def summarise(plan: Plan, table: StudyTable) -> Summary:
    """Sum up a complete table, but for seeds of which a run failed in some cell.

    Those are left out of every cell, so that all have the same ones. Some must be left
    (``StudyTable.whole_seeds``).
    """
    seeds = pa.array(table.whole_seeds)
    cells, captured, ticks, tick_s = [], [], [], []
    for index in range(len(plan.cells)):
        rows = table.read([CAPTURED, TICKS, *plan.columns], slice(index, index + 1))
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
                restricted_mean_ticks(seconds, flags, limit_s),
                limit_s,
                survival(times, flags),
                requested_delay(scenario.channel, scenario.ids),
                {name: mean(rows[name].to_numpy()) for name in plan.columns if name != CAPTURED},
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
    """Mean delay in s delivered at each level of an axis, over the cells in which any is.

    Where nothing was delivered it is the delay that would have been, of a packet alone.
    """
    along = plan.all_axes.index(axis)
    by_level: list[list[Cell]] = [[] for _ in axis.levels]
    for cell in cells:
        by_level[plan.cells[cell.cell][along]].append(cell)
    return [_delivered_s_mean(plan, level) for level in by_level]


def _delivered_s_mean(plan: Plan, cells: Sequence[Cell]) -> float:
    means_s = np.array([cell.means[DELIVERED].value for cell in cells])
    if np.isnan(means_s).all():
        scenario = plan.scenario_of(cells[0].cell)
        return delivered_s_mean(scenario.channel.delay, scenario.tick_s)
    return float(np.nanmean(means_s))


def rows_along(plan: Plan, axis: Axis) -> Iterator[tuple[dict[str, Any], tuple[int, ...]]]:
    """Cells along one axis for each setting of the others: (other levels, cells by level)."""
    along = plan.all_axes.index(axis)

    def others(cell: int) -> tuple[int, ...]:
        places = plan.cells[cell]
        return (*places[:along], *places[along + 1 :])

    for _, group in groupby(sorted(range(len(plan.cells)), key=others), key=others):
        row = tuple(group)
        levels = plan.levels(row[0])
        del levels[axis.name]
        yield levels, row


def baseline_of(plan: Plan, axis: Axis) -> int:
    """Place of the level that the others are compared with: the plan's, or the first."""
    named = [k for k, level in enumerate(axis.levels) if str(level) == plan.baseline]
    return named[0] if named else 0
