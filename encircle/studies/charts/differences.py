"""The forest plot of a study's comparisons: each level minus the baseline, on common seeds.

Rates differ in percentage points. A filled marker means that the difference is decided: its
interval leaves out zero, and its p, corrected for all tests of the study, is small enough.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from encircle.figures.drawing import DOTS_PER_INCH, WIDTH_IN
from encircle.statistics.comparisons import Difference, Verdict
from encircle.studies.charts.frames import (
    TALL_IN,
    DrawnFigure,
    add_legend,
    legend_layout,
    line_handles,
    line_style,
)
from encircle.studies.charts.layout import (
    axis_label,
    drawing_order,
    evenly_chosen,
    evenly_spaced,
    level_text,
    setting_text,
    settings_of,
    wrapped,
)
from encircle.studies.charts.lines import limit_text
from encircle.studies.plan import Axis
from encircle.studies.summary import OUTCOMES, Comparison, Summary, baseline_index

ROW_IN, GROUP_IN, NAME_LINE_IN, AROUND_IN = 0.14, 0.1, 0.14, 1.05
NAME_COLUMNS = 26
LEVELS_MAX = 8
POINTS_SPAN_MIN, TIME_SPAN_MIN = 5.0, 0.02
"""Scales reach at least so far from zero, in points and as a share of the limit of a run."""
SCALES = {"rate": 100.0, "order": 100.0, "time_s": 1.0}
LABELS = {
    "rate": "difference in\ncapture rate (points)\nright is better",
    "order": "seeds captured later\nless earlier (points)\nleft is better",
    "time_s": "difference in mean\ntime to capture,\nup to the limit (s)\nleft is better",
}


def draw_differences(summary: Summary) -> DrawnFigure | None:
    """Draw the differences of all levels from the baseline; None if nothing is compared.

    Settings of the other axes are groups of rows, and levels are markers in them. Without
    settings each level is a row.
    """
    plan, comparisons = summary.plan, summary.comparisons
    axis = plan.compared_axis
    if axis is None or not comparisons:
        return None
    base = baseline_index(plan, axis)
    levels = [index for index in range(len(axis.levels)) if index != base]
    shown_first = [levels.index(index) for index in drawing_order(axis) if index != base]
    settings = settings_of([other for other in plan.all_axes if other is not axis])
    if len(settings) == 1:
        groups = [[comparisons[k]] for k in shown_first]
        names = [level_text(axis, levels[k]) for k in shown_first]
        marker_levels: list[int] = []
    else:
        chosen = evenly_chosen(shown_first, LEVELS_MAX)
        starts = range(0, len(comparisons), len(levels))
        groups = [[comparisons[start + k] for k in chosen] for start in starts]
        names = [setting_text(plan, setting) for setting in settings]
        marker_levels = [levels[k] for k in chosen]
    names = [wrapped(name, NAME_COLUMNS) for name in names]
    row_in = max(
        max(ROW_IN * len(row), NAME_LINE_IN * (1 + name.count("\n")))
        for row, name in zip(groups, names, strict=True)
    )
    shown_rows = evenly_spaced(len(groups), int(TALL_IN / (row_in + GROUP_IN)))
    rows = [groups[k] for k in shown_rows]
    figure = _draw(
        summary, axis, marker_levels, rows, [names[k] for k in shown_rows], row_in + GROUP_IN
    )
    shown = [one for row in rows for one in row]
    decided = sum(any(_is_decided(getattr(one, name)) for name in OUTCOMES) for one in shown)
    alt = (
        f"Forest plot of {len(shown)} comparisons with {level_text(axis, base, named=True)}:"
        " differences in capture rate, in who captures later, and in mean time to capture;"
        f" {decided} of them decided in one or more."
    )
    return DrawnFigure("differences", figure, _caption(summary, axis, base, len(shown)), alt)


def _draw(
    summary: Summary,
    axis: Axis,
    marker_levels: Sequence[int],
    rows: Sequence[Sequence[Comparison]],
    names: Sequence[str],
    row_in: float,
) -> Figure:
    """Draw the plot.

    ``marker_levels``: the levels that are markers, none if each level is a row.
    """
    baseline = level_text(axis, baseline_index(summary.plan, axis))
    legend = legend_layout(
        f"{axis.title} against {baseline}", _handles(axis, marker_levels), WIDTH_IN
    )
    size = (WIDTH_IN, row_in * len(rows) + AROUND_IN + legend.high_in)
    figure = Figure(size, DOTS_PER_INCH, layout="constrained")
    panels = figure.subplots(1, len(OUTCOMES), sharey=True)
    for number, row in enumerate(rows):
        for k, one in enumerate(row):
            at = number + 0.5 + ROW_IN / row_in * (k - (len(row) - 1) / 2)
            style = line_style(axis, k, len(row)) if marker_levels else line_style(None, 0, 1)
            for axes, name in zip(panels, OUTCOMES, strict=True):
                _draw_row(axes, at, getattr(one, name), SCALES[name], style)
    time_s_min = TIME_SPAN_MIN * max(cell.limit_s for cell in summary.cells)
    for axes, name in zip(panels, OUTCOMES, strict=True):
        reach = time_s_min if name == "time_s" else POINTS_SPAN_MIN
        axes.set_xlabel(LABELS[name])
        for number in range(1, len(rows), 2):
            axes.axhspan(number, number + 1, color="0.94", lw=0, zorder=0)
        low, high = axes.get_xlim()
        axes.set(xlim=(min(low, -reach), max(high, reach)), ylim=(len(rows), 0))
        axes.axvline(0.0, color="black", lw=0.7, zorder=1)
        axes.grid(axis="x", alpha=0.25, lw=0.5)
        axes.tick_params(axis="y", length=0)
        axes.locator_params(axis="x", nbins=4)
    panels[0].set_yticks(np.arange(len(rows)) + 0.5, names)
    add_legend(figure, legend)
    return figure


def _handles(axis: Axis, marker_levels: Sequence[int]) -> list[Artist]:
    handles = line_handles(axis, marker_levels, joined=False) if marker_levels else []
    plain: dict[str, Any] = {"color": "0.35", "marker": "o", "ls": "", "ms": 4}
    handles.append(Line2D([], [], **plain, label="decided"))
    handles.append(Line2D([], [], **plain, mfc="white", label="undecided"))
    return handles


def _is_decided(test: Difference) -> bool:
    return test.verdict is not Verdict.UNDECIDED


def _draw_row(
    axes: Axes, at: float, test: Difference, scale: float, style: Mapping[str, Any]
) -> None:
    value, low, high = (scale * bound for bound in test.mean)
    axes.plot((low, high), (at, at), color=style["color"], lw=1.0, zorder=2)
    face = style["color"] if _is_decided(test) else "white"
    axes.plot(value, at, **{**style, "ls": ""}, mfc=face, ms=4, zorder=3)


def _caption(summary: Summary, axis: Axis, base: int, shown: int) -> str:
    every, pairs = len(summary.comparisons), summary.comparisons[0].rate.pairs
    return (
        f"Differences from {level_text(axis, base, named=True)}: each level of"
        f" {axis_label(axis)} minus it, on {pairs} common seed{'s' * (pairs != 1)}: how often"
        " it captures, in which share of the seeds later less in which earlier, and when on"
        " average. Bars: 95 % intervals, each for itself, which allow for failures that"
        " the seeds do not show; runs without capture"
        f" count as the limit, {limit_text(summary)}. Decided: by p corrected for {summary.tests}"
        " tests, too." + (f" {shown} of {every} are shown." if shown < every else "")
    )
