"""The tables of a study's report: cells, comparisons, tolerances, and the mean of every measure.

Long tables are cut, and their captions say so. ``summary.csv`` has every cell, ``comparisons.csv``
every comparison.
"""

from collections.abc import Sequence

import numpy as np

from encircle.measures.registry import measure_named
from encircle.scene.counts import counted
from encircle.statistics.comparisons import Difference, holm_p
from encircle.statistics.intervals import Interval
from encircle.studies.charts.layout import axis_label, varied_axes
from encircle.studies.csv_files import CELLS_FILE, COMPARISONS_FILE
from encircle.studies.plan import DELIVERED_DELAY, Axis, Plan
from encircle.studies.report import page
from encircle.studies.report.sentences import (
    axis_of,
    axis_value_text,
    bounds_text,
    is_decided,
    levels_text,
    p_text,
)
from encircle.studies.summary import Cell, Comparison, Summary, Tolerance

ROWS_MAX, MEASURED_ROWS_MAX = 1000, 200
SIDE_BY_SIDE_MAX = 4
NO_VALUE = "\N{EN DASH}"
DELAY_HEAD = ("Mean delay, asked (s)", "Mean delay, delivered (s)")


def result_tables(summary: Summary) -> list[str]:
    """Tables of cells, comparisons and tolerances."""
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
    caption = "Cells, with 95 % intervals" + truncation_text(
        len(summary.cells), ROWS_MAX, CELLS_FILE
    )
    parts = [page.heading("Tables"), page.table(caption, head, rows, max(1, len(axes)))]
    if summary.comparisons:
        heading_text = f"All numbers of {counted(len(summary.comparisons), 'comparison')}"
        parts.append(page.collapsible(heading_text, [_comparison_table(summary)]))
    if summary.tolerances:
        parts.append(_tolerance_table(summary))
    return parts


def _delays(cell: Cell) -> tuple[str, str]:
    """The mean delay that a cell's scenario requests, and the one that was delivered."""
    model, s_mean = cell.delay
    return f"{s_mean:.4g} ({model})", interval_text(cell.means[DELIVERED_DELAY], ".4g")


def _comparison_table(summary: Summary) -> str:
    plan, axis = summary.plan, summary.plan.compared_axis
    assert axis is not None
    others = [other for other in varied_axes(plan) if other is not axis]
    head = [axis.title, *(other.title for other in others), "Capture rate, difference (points)"]
    head += ["Only one captured: it / baseline", "Cohen's g", "p (McNemar)"]
    head += ["Seeds in which it is later / earlier", "Later less earlier (points)", "p (order)"]
    head += [
        "Mean time to capture, up to the limit, difference (s)",
        "d_z",
        "p (signs)",
        "p (log-rank)",
    ]
    logrank = holm_p([comparison.logrank_p for comparison in summary.comparisons])
    rows = [
        (
            axis.display_level(comparison.level),
            *(other.display_level(comparison.others[other.name]) for other in others),
            *_differences(comparison, float(p)),
        )
        for comparison, p in zip(summary.comparisons[:ROWS_MAX], logrank, strict=False)
    ]
    baseline = axis.display_level(summary.comparisons[0].baseline)
    caption = (
        f"Comparisons with {axis_label(axis)} {baseline}{f' {axis.unit}' if axis.unit else ''},"
        f" which is subtracted, on {counted(summary.comparisons[0].rate.pairs, 'common seed')};"
        f" p corrected for {counted(summary.tests, 'test')}, in brackets uncorrected; *: decided"
    )
    cut = truncation_text(len(summary.comparisons), ROWS_MAX, COMPARISONS_FILE)
    return page.table(caption + cut, head, rows, 1 + len(others))


def _differences(comparison: Comparison, logrank_p: float) -> tuple[str, ...]:
    rate, order, time_s = comparison.rate, comparison.order, comparison.time_s
    return (
        interval_text(rate.mean, "+z.1f", 100.0),
        f"{rate.better} / {rate.worse}",
        interval_text(rate.effect_size, "+z.2f"),
        test_text(rate),
        f"{order.worse} / {order.better}",
        interval_text(order.mean, "+z.1f", 100.0),
        test_text(order),
        interval_text(time_s.mean, "+z.2f"),
        interval_text(time_s.effect_size, "+z.2f"),
        test_text(time_s),
        _p_values_text(logrank_p, comparison.logrank_p),
    )


def test_text(test: Difference) -> str:
    """The p of a test, corrected and uncorrected, with a star if the test is decided."""
    mark = " *" if is_decided(test) else ""
    return f"{_p_values_text(test.p_corrected, test.p)}{mark}"


def _tolerance_table(summary: Summary) -> str:
    plan = summary.plan
    rate = f"{100.0 * plan.tolerated_rate:g} %"
    rows = []
    for tolerance in summary.tolerances[:ROWS_MAX]:
        axis = axis_of(plan, tolerance)
        setting = levels_text(
            plan, {a.name: tolerance.others[a.name] for a in varied_axes(plan) if a is not axis}
        )
        rows.append((axis.title, setting or NO_VALUE, *_tolerance(axis, tolerance)))
    caption = f"Up to which level the capture rate stays at or above {rate}, or from which on"
    head = ("Axis", "At", "Level", "95 % interval")
    return page.table(caption + truncation_text(len(summary.tolerances), ROWS_MAX), head, rows, 2)


def _tolerance(axis: Axis, tolerance: Tolerance) -> tuple[str, str]:
    first, last = (axis_value_text(axis, axis.display_values[k]) for k in (0, -1))
    value, _low, high = tolerance.level
    level = axis_value_text(axis, value) if np.isfinite(value) else f"none (below from {first} on)"
    if np.isinf(high) and value == axis.display_values[-1]:
        level = f"{last}, the last"
    return f"from {level} on" if tolerance.rising else level, bounds_text(axis, tolerance.level)


def measure_tables(summary: Summary) -> list[str]:
    """Every measure's mean in every cell, collapsed."""
    names = list(summary.cells[0].means)
    if not names:
        return []
    if len(summary.cells) <= SIDE_BY_SIDE_MAX:
        content = [_measures_side_by_side(summary, names)]
    else:
        content = [_measure_table(summary, name) for name in names]
    heading_text = f"Means of {counted(len(names), 'measure')} in every cell"
    return [page.heading("Measures"), page.collapsible(heading_text, content)]


def _measures_side_by_side(summary: Summary, names: Sequence[str]) -> str:
    """One table with a column for each cell, if there are few cells."""
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


def _measure_table(summary: Summary, name: str) -> str:
    """The table of one measure, a row for each cell."""
    plan, measure = summary.plan, measure_named(name)
    unit = f" ({measure.unit})" if measure.unit != "1" else ""
    rows = [
        (*_levels(plan, cell.cell), interval_text(cell.means[name], ".4g"))
        for cell in summary.cells[:MEASURED_ROWS_MAX]
    ]
    head = [*(axis.title for axis in plan.all_axes), f"Mean{unit}"]
    caption = f"{name}: {measure.description} Means over runs, with 95 % intervals"
    caption += truncation_text(len(summary.cells), MEASURED_ROWS_MAX, CELLS_FILE)
    return page.collapsible(f"{name}{unit}", [page.table(caption, head, rows, len(plan.all_axes))])


def _levels(plan: Plan, cell: int) -> tuple[str, ...]:
    """Levels of a cell as names of a row; a study without axes has one cell, called ``all``."""
    levels = plan.levels(cell)
    return tuple(axis.display_level(levels[axis.name]) for axis in plan.all_axes) or ("all",)


def _cell_name(plan: Plan, cell: int) -> str:
    levels = plan.levels(cell)
    named = (f"{axis.title} {axis.display_level(levels[axis.name])}" for axis in varied_axes(plan))
    return ", ".join(named) or "Mean"


def interval_text(interval: Interval, spec: str, scale: float = 1.0) -> str:
    """``+4.0 [-1.5, +9.5]``, the value alone without bounds, a dash without a value."""
    value, low, high = (scale * bound for bound in interval)
    if np.isnan(value):
        return NO_VALUE
    if np.isnan(low) and np.isnan(high):
        return f"{value:{spec}}"
    return f"{value:{spec}} [{low:{spec}}, {high:{spec}}]"


def _number(value: float, spec: str) -> str:
    return NO_VALUE if np.isnan(value) else f"{value:{spec}}"


def _p_values_text(corrected: float, alone: float) -> str:
    return NO_VALUE if np.isnan(alone) else f"{p_text(corrected)} ({p_text(alone)})"


def truncation_text(count: int, most: int, file: str = "") -> str:
    """That a table is cut after ``most`` rows, and which file has all; empty if it is not cut."""
    all_in = f", all in {file}" if file else ""
    return f"; the first {most} of {count}{all_in}" if count > most else ""
