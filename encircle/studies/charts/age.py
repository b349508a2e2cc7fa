"""Outcome against age of information: capture rate and time of each cell against its mean age.

If loss and delay act through the age of what robots know about each other, cells with different
loss and delay lie on one curve. Colours show the first axis; markers show the compared axis or the
second.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from encircle.figures.drawing import COLOURS, DOTS_PER_INCH, MARKERS, WIDTH_IN
from encircle.statistics.intervals import Interval
from encircle.studies.charts.frames import (
    COLOUR_MAP,
    DrawnFigure,
    Floats,
    add_legend,
    colour_scale,
    error_bars,
    fitted_title,
    legend_layout,
    scaled_levels,
    spans_decades,
)
from encircle.studies.charts.layout import axis_label, evenly_spaced, level_text, varied_axes
from encircle.studies.charts.lines import RATE, TIME, limit_text, runs_text, set_quantity
from encircle.studies.plan import Axis, Plan
from encircle.studies.summary import Cell, Summary

AGE = "age_ticks_mean"
POINTS_MAX, BARS_MAX, NAMED_LEVELS_MAX = 2000, 60, 12
HEIGHT_IN = 2.5
PLAIN = "0.35"


def draw_age(summary: Summary) -> DrawnFigure | None:
    """Draw the two scatter plots; None if the age is not measured or equal in all cells."""
    plan = summary.plan
    if AGE not in plan.measure_names:
        return None
    cells = [summary.cells[k] for k in evenly_spaced(len(summary.cells), POINTS_MAX)]
    shown = [cell for cell in cells if np.isfinite(cell.means[AGE].value)]
    if len({cell.means[AGE].value for cell in shown}) < 2:
        return None
    first, second = _colour_and_marker_axes(plan)
    left = legend_layout(axis_label(first), _colour_handles(first, second), WIDTH_IN / 2)
    title = second.title if second is not None else ""
    right = legend_layout(title, _marker_handles(second), WIDTH_IN / (2 if left.handles else 1))
    high_in = HEIGHT_IN + max(left.high_in, right.high_in)
    figure = Figure((WIDTH_IN, high_in), DOTS_PER_INCH, layout="constrained")
    panels = figure.subplots(1, 2)
    for axes, quantity in zip(panels, (RATE, TIME), strict=True):
        at = np.array([_age_s(summary, cell) for cell in shown])
        outcome = np.array([quantity.interval(cell) for cell in shown])
        _draw_cells(axes, at, outcome, [_style(plan, cell, first, second) for cell in shown])
        set_quantity(axes, summary, quantity, "y")
        axes.set_xlabel("mean age of information (s)")
        axes.locator_params(axis="x", nbins=5, steps=[1, 2, 2.5, 5, 10])
        axes.grid(alpha=0.25, lw=0.5)
    if first.numeric:
        _add_colour_bar(figure, panels, first)
    both = bool(left.handles and right.handles)
    add_legend(figure, left, "left" if both else "center")
    add_legend(figure, right, "right" if both else "center")
    return DrawnFigure("age", figure, _caption(summary, shown, first, second), _alt(summary, shown))


def _age_s(summary: Summary, cell: Cell) -> Interval:
    tick_s = summary.tick_s[cell.cell]
    return Interval(*(bound * tick_s for bound in cell.means[AGE]))


def _colour_and_marker_axes(plan: Plan) -> tuple[Axis, Axis | None]:
    """The axes that colours and markers stand for; the second is None if it has too many levels."""
    first, *others = varied_axes(plan)
    second = plan.compared_axis if plan.compared_axis in others else (others[0] if others else None)
    if second is not None and len(second.levels) > len(MARKERS):
        second = None
    return first, second


def _style(plan: Plan, cell: Cell, first: Axis, second: Axis | None) -> dict[str, Any]:
    level_indices = dict(zip((a.name for a in plan.all_axes), plan.cells[cell.cell], strict=True))
    index = level_indices[first.name]
    style = _cell_style_along(first, index)
    if second is not None:
        style["marker"] = MARKERS[level_indices[second.name]]
    return style


def _cell_style_along(first: Axis, index: int) -> dict[str, Any]:
    if first.numeric:
        shade = colour_scale(first)(first.display_values[index] * first.scale)
        return {"color": matplotlib.colormaps[COLOUR_MAP](shade), "marker": MARKERS[0]}
    if len(first.levels) > NAMED_LEVELS_MAX:
        return {"color": COLOURS[0], "marker": MARKERS[0]}
    # When colours repeat, their markers differ.
    marker = MARKERS[(index + index // len(COLOURS)) % len(MARKERS)]
    return {"color": COLOURS[index % len(COLOURS)], "marker": marker}


def _colour_handles(first: Axis, second: Axis | None) -> list[Artist]:
    if first.numeric or len(first.levels) > NAMED_LEVELS_MAX:
        return []
    handles: list[Artist] = []
    for index in range(len(first.levels)):
        style = _cell_style_along(first, index) | (
            {"marker": MARKERS[0]} if second is not None else {}
        )
        handles.append(Line2D([], [], ls="", ms=5, **style, label=level_text(first, index)))
    return handles


def _marker_handles(second: Axis | None) -> list[Artist]:
    if second is None:
        return []
    return [
        Line2D(
            [], [], ls="", ms=5, color=PLAIN, marker=MARKERS[index], label=level_text(second, index)
        )
        for index in range(len(second.levels))
    ]


def _draw_cells(
    axes: Axes, ages_s: Floats, outcomes: Floats, styles: Sequence[Mapping[str, Any]]
) -> None:
    """Draw cells as points, with error bars if there are few; ages and outcomes: (C, 3)."""
    few = len(styles) <= BARS_MAX
    if few:
        across, along = error_bars(ages_s), error_bars(outcomes)
        bar_style: dict[str, Any] = {"fmt": "none", "ecolor": "0.7", "elinewidth": 0.7, "zorder": 1}
        axes.errorbar(ages_s[:, 0], outcomes[:, 0], along, across, **bar_style)
    size: dict[str, Any] = {
        "s": (5.0 if few else 3.0) ** 2,
        "edgecolors": "black",
        "linewidths": 0.4,
    }
    for marker in dict.fromkeys(style["marker"] for style in styles):
        with_marker = [k for k, style in enumerate(styles) if style["marker"] == marker]
        colours = [styles[k]["color"] for k in with_marker]
        axes.scatter(
            ages_s[with_marker, 0],
            outcomes[with_marker, 0],
            c=colours,
            marker=marker,
            zorder=2,
            **size,
        )


def _add_colour_bar(figure: Figure, panels: Sequence[Axes], first: Axis) -> None:
    scale = colour_scale(first)
    bar = figure.colorbar(ScalarMappable(scale, COLOUR_MAP), ax=list(panels), aspect=25)
    bar.set_label(fitted_title(first, HEIGHT_IN - 0.5))
    if spans_decades(scaled_levels(first)):
        bar.ax.yaxis.set_major_formatter(lambda value, _place: f"{value:g}")


def _caption(summary: Summary, shown: Sequence[Cell], first: Axis, second: Axis | None) -> str:
    by = (
        [f"colours show {axis_label(first)}"]
        if first.numeric or len(first.levels) <= NAMED_LEVELS_MAX
        else []
    )
    by += [f"markers show {axis_label(second)}"] if second is not None else []
    every = len(summary.cells)
    return (
        f"Outcome against mean age of information, a point for each cell of {runs_text(summary)}"
        + "".join(f"; {clause}" for clause in by)
        + ("; bars: 95 % intervals." if len(shown) <= BARS_MAX else ".")
        + f" Runs without capture count as the limit, {limit_text(summary)}."
        + (f" {len(shown)} of {every} cells are shown." if len(shown) < every else "")
    )


def _alt(summary: Summary, shown: Sequence[Cell]) -> str:
    ages = [_age_s(summary, cell).value for cell in shown]
    return (
        f"Two scatter plots of {len(shown)} cells: capture rate, and mean time to capture, against"
        f" mean age of information from {min(ages):.3g} to {max(ages):.3g} s."
    )
