"""The tables of a study's report: cells, comparisons, tolerances, and the mean of every measure.

Long tables are cut, and say so; ``summary.csv`` has every cell, ``comparisons.csv`` every
comparison.
"""

from collections.abc import Sequence

import numpy as np

from encircle.measures.registry import measure_named
from encircle.statistics.comparisons import Difference, holm
from encircle.statistics.intervals import Interval
from encircle.studies.charts.views import label, varied
from encircle.studies.csv_files import CELLS, COMPARISONS
from encircle.studies.plan import DELIVERED, Axis, Plan
from encircle.studies.report import page
from encircle.studies.report.claims import (
    axis_of,
    bounds_text,
    decided,
    p_text,
    place_text,
    where_text,
)
from encircle.studies.summary import Cell, Comparison, Summary, Tolerance

ROWS_MAX, MEASURED_ROWS_MAX = 1000, 200
SIDE_BY_SIDE_MAX = 4
NONE = "\N{EN DASH}"
DELAY_HEAD = ("Mean delay, asked (s)", "Mean delay, delivered (s)")


def tables(summary: Summary) -> list[str]:
    """Cells, comparisons and tolerances."""
    plan = summary.plan
    axes = plan.all_axes
    delayed = any(cell.delay.s_mean for cell in summary.cells)
    head = [*([axis.title for axis in axes] or ["Cell"]), *(DELAY_HEAD if delayed else ())]
    head += ["Runs", "Captured"]
    head += ["Capture rate (%)", "Mean time to capture, up to the limit (s)", "Median time (s)"]
    rows = [
        (
            *_levels(plan, cell.cell),
            *(_delays(cell) if delayed else ()),
            str(cell.runs),
            str(int(summary.captured[cell.cell].sum())),
            interval_text(cell.rate, ".1f", 100.0),
            interval_text(cell.time_s, ".2f"),
            _number(cell.survival.median * summary.tick_s[cell.cell], ".2f"),
        )
        for cell in summary.cells[:ROWS_MAX]
    ]
    caption = "Cells, with 95 % intervals" + cut_text(len(summary.cells), ROWS_MAX, CELLS)
    parts = [page.heading("Tables"), page.table(caption, head, rows, max(1, len(axes)))]
    if summary.comparisons:
        heading_text = f"All numbers of {many(len(summary.comparisons), 'comparison')}"
        parts.append(page.folded(heading_text, [_comparisons(summary)]))
    if summary.tolerated:
        parts.append(_tolerances(summary))
    return parts


def _delays(cell: Cell) -> tuple[str, str]:
    """The mean delay that a cell's scenario asks for, and the one that came of it."""
    model, s_mean = cell.delay
    return f"{s_mean:.4g} ({model})", interval_text(cell.means[DELIVERED], ".4g")


def _comparisons(summary: Summary) -> str:
    plan, axis = summary.plan, summary.plan.compared
    assert axis is not None
    others = [other for other in varied(plan) if other is not axis]
    head = [axis.title, *(other.title for other in others), "Capture rate, difference (points)"]
    head += ["Only one captured: it / baseline", "Cohen's g", "p (McNemar)"]
    head += ["Seeds in which it is later / earlier", "Later less earlier (points)", "p (order)"]
    head += [
        "Mean time to capture, up to the limit, difference (s)",
        "d_z",
        "p (signs)",
        "p (log-rank)",
    ]
    logrank = holm([one.logrank_p for one in summary.comparisons])
    rows = [
        (
            axis.shown(one.level),
            *(other.shown(one.others[other.name]) for other in others),
            *_differences(one, float(p)),
        )
        for one, p in zip(summary.comparisons[:ROWS_MAX], logrank, strict=False)
    ]
    baseline = axis.shown(summary.comparisons[0].baseline)
    caption = (
        f"Comparisons with {label(axis)} {baseline}{f' {axis.unit}' if axis.unit else ''}, which is"
        f" subtracted, on {many(summary.comparisons[0].rate.pairs, 'common seed')}; p corrected for"
        f" {many(summary.tests, 'test')}, in brackets uncorrected; *: decided"
    )
    cut = cut_text(len(summary.comparisons), ROWS_MAX, COMPARISONS)
    return page.table(caption + cut, head, rows, 1 + len(others))


def _differences(one: Comparison, logrank_p: float) -> tuple[str, ...]:
    rate, order, time_s = one.rate, one.order, one.time_s
    return (
        interval_text(rate.mean, "+z.1f", 100.0),
        f"{rate.better} / {rate.worse}",
        interval_text(rate.effect, "+z.2f"),
        tested_text(rate),
        f"{order.worse} / {order.better}",
        interval_text(order.mean, "+z.1f", 100.0),
        tested_text(order),
        interval_text(time_s.mean, "+z.2f"),
        interval_text(time_s.effect, "+z.2f"),
        tested_text(time_s),
        _p(logrank_p, one.logrank_p),
    )


def tested_text(test: Difference) -> str:
    """The p of a test, corrected and not, with a star where it is decided."""
    mark = " *" if decided(test) else ""
    return f"{_p(test.p_corrected, test.p)}{mark}"


def _tolerances(summary: Summary) -> str:
    plan = summary.plan
    rate = f"{100.0 * plan.tolerated_rate:g} %"
    rows = []
    for one in summary.tolerated[:ROWS_MAX]:
        axis = axis_of(plan, one)
        held = where_text(plan, {a.name: one.others[a.name] for a in varied(plan) if a is not axis})
        rows.append((axis.title, held or NONE, *_tolerance(axis, one)))
    caption = f"Up to which level the capture rate stays at or above {rate}, or from which on"
    head = ("Axis", "At", "Level", "95 % interval")
    return page.table(caption + cut_text(len(summary.tolerated), ROWS_MAX), head, rows, 2)


def _tolerance(axis: Axis, one: Tolerance) -> tuple[str, str]:
    first, last = (place_text(axis, axis.shown_values[k]) for k in (0, -1))
    value, _low, high = one.level
    level = place_text(axis, value) if np.isfinite(value) else f"none (below from {first} on)"
    if np.isinf(high) and value == axis.shown_values[-1]:
        level = f"{last}, the last"
    return f"from {level} on" if one.rising else level, bounds_text(axis, one.level)


def measures(summary: Summary) -> list[str]:
    """Every measure's mean in every cell, folded."""
    names = list(summary.cells[0].means)
    if not names:
        return []
    if len(summary.cells) <= SIDE_BY_SIDE_MAX:
        content = [_measures_beside(summary, names)]
    else:
        content = [_measured(summary, name) for name in names]
    heading_text = f"Means of {many(len(names), 'measure')} in every cell"
    return [page.heading("Measures"), page.folded(heading_text, content)]


def _measures_beside(summary: Summary, names: Sequence[str]) -> str:
    """One table, a column for each of few cells."""
    plan = summary.plan
    head = ["Measure", "Unit", *(_cell_name(plan, cell.cell) for cell in summary.cells)]
    rows = [
        (
            f"{name}: {measure_named(name).description}",
            measure_named(name).unit,
            *(interval_text(cell.means[name], ".4g") for cell in summary.cells),
        )
        for name in names
    ]
    return page.table("Means over runs, with 95 % intervals", head, rows)


def _measured(summary: Summary, name: str) -> str:
    """One measure's own table, a row for each cell."""
    plan, measure = summary.plan, measure_named(name)
    unit = f" ({measure.unit})" if measure.unit != "1" else ""
    rows = [
        (*_levels(plan, cell.cell), interval_text(cell.means[name], ".4g"))
        for cell in summary.cells[:MEASURED_ROWS_MAX]
    ]
    head = [*(axis.title for axis in plan.all_axes), f"Mean{unit}"]
    caption = f"{name}: {measure.description} Means over runs, with 95 % intervals"
    caption += cut_text(len(summary.cells), MEASURED_ROWS_MAX, CELLS)
    return page.folded(f"{name}{unit}", [page.table(caption, head, rows, len(plan.all_axes))])


def _levels(plan: Plan, cell: int) -> tuple[str, ...]:
    """Levels of a cell as names of a row; a study without axes has one cell, named so."""
    levels = plan.levels(cell)
    return tuple(axis.shown(levels[axis.name]) for axis in plan.all_axes) or ("all",)


def _cell_name(plan: Plan, cell: int) -> str:
    levels = plan.levels(cell)
    named = (f"{axis.title} {axis.shown(levels[axis.name])}" for axis in varied(plan))
    return ", ".join(named) or "Mean"


def interval_text(interval: Interval, spec: str, scale: float = 1.0) -> str:
    """``+4.0 [-1.5, +9.5]``, the value alone if it has no bounds, a dash if there is none."""
    value, low, high = (scale * bound for bound in interval)
    if np.isnan(value):
        return NONE
    if np.isnan(low) and np.isnan(high):
        return f"{value:{spec}}"
    return f"{value:{spec}} [{low:{spec}}, {high:{spec}}]"


def _number(value: float, spec: str) -> str:
    return NONE if np.isnan(value) else f"{value:{spec}}"


def _p(corrected: float, alone: float) -> str:
    return NONE if np.isnan(alone) else f"{p_text(corrected)} ({p_text(alone)})"


def many(count: int, what: str) -> str:
    """``3 cells``."""
    return f"{count} {what}{'s' * (count != 1)}"


def cut_text(count: int, most: int, file: str = "") -> str:
    """What is said of a table whose rows are more than are shown, and where they all are."""
    all_in = f", all in {file}" if file else ""
    return f"; the first {most} of {count}{all_in}" if count > most else ""
