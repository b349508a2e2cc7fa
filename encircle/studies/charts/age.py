"""Outcome against age of information: each cell's capture rate and time against its mean age.

If bad communication acts through the age of what robots know of each other, cells of whatever loss
and delay lie on one curve. Colours show the first axis, markers the compared or the second.
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
    MAP,
    DrawnFigure,
    Floats,
    add_legend,
    bars_of,
    colour_scale,
    fitted,
    is_log,
    legend_of,
    scaled,
)
from encircle.studies.charts.lines import RATE, TIME, limit_text, runs_text, set_quantity
from encircle.studies.charts.views import evenly, label, level_text, varied
from encircle.studies.plan import Axis, Plan
from encircle.studies.summary import Cell, Summary

AGE = "age_ticks_mean"
POINTS_MAX, BARS_MAX, NAMED_MAX = 2000, 60, 12
HEIGHT_IN = 2.5
PLAIN = "0.35"


def draw_age(summary: Summary) -> DrawnFigure | None:
    """The two scatter plots; None if the age is not measured or the same in all cells."""
    plan = summary.plan
    if AGE not in plan.columns:
        return None
    cells = [summary.cells[k] for k in evenly(len(summary.cells), POINTS_MAX)]
    shown = [cell for cell in cells if np.isfinite(cell.means[AGE].value)]
    if len({cell.means[AGE].value for cell in shown}) < 2:
        return None
    first, second = _shown_by(plan)
    left = legend_of(label(first), _colour_handles(first, second), WIDTH_IN / 2)
    title = second.title if second is not None else ""
    right = legend_of(title, _marker_handles(second), WIDTH_IN / (2 if left.handles else 1))
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


def _shown_by(plan: Plan) -> tuple[Axis, Axis | None]:
    """The axes that colours and markers stand for; more levels than markers have none."""
    first, *others = varied(plan)
    second = plan.compared if plan.compared in others else (others[0] if others else None)
    if second is not None and len(second.levels) > len(MARKERS):
        second = None
    return first, second


def _style(plan: Plan, cell: Cell, first: Axis, second: Axis | None) -> dict[str, Any]:
    places = dict(zip((a.name for a in plan.all_axes), plan.cells[cell.cell], strict=True))
    index = places[first.name]
    style = _look(first, index)
    if second is not None:
        style["marker"] = MARKERS[places[second.name]]
    return style


def _look(first: Axis, index: int) -> dict[str, Any]:
    if first.numeric:
        shade = colour_scale(first)(first.shown_values[index] * first.scale)
        return {"color": matplotlib.colormaps[MAP](shade), "marker": MARKERS[0]}
    if len(first.levels) > NAMED_MAX:
        return {"color": COLOURS[0], "marker": MARKERS[0]}
    # The second round of colours has other markers than the first.
    marker = MARKERS[(index + index // len(COLOURS)) % len(MARKERS)]
    return {"color": COLOURS[index % len(COLOURS)], "marker": marker}


def _colour_handles(first: Axis, second: Axis | None) -> list[Artist]:
    if first.numeric or len(first.levels) > NAMED_MAX:
        return []
    handles: list[Artist] = []
    for index in range(len(first.levels)):
        style = _look(first, index) | ({"marker": MARKERS[0]} if second is not None else {})
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
    """Points of cells (C, 3) with bars to both sides if there are few."""
    few = len(styles) <= BARS_MAX
    if few:
        across, along = bars_of(ages_s), bars_of(outcomes)
        look: dict[str, Any] = {"fmt": "none", "ecolor": "0.7", "elinewidth": 0.7, "zorder": 1}
        axes.errorbar(ages_s[:, 0], outcomes[:, 0], along, across, **look)
    size: dict[str, Any] = {
        "s": (5.0 if few else 3.0) ** 2,
        "edgecolors": "black",
        "linewidths": 0.4,
    }
    for marker in dict.fromkeys(style["marker"] for style in styles):
        kept = [k for k, style in enumerate(styles) if style["marker"] == marker]
        colours = [styles[k]["color"] for k in kept]
        axes.scatter(ages_s[kept, 0], outcomes[kept, 0], c=colours, marker=marker, zorder=2, **size)


def _add_colour_bar(figure: Figure, panels: Sequence[Axes], first: Axis) -> None:
    scale = colour_scale(first)
    bar = figure.colorbar(ScalarMappable(scale, MAP), ax=list(panels), aspect=25)
    bar.set_label(fitted(first, HEIGHT_IN - 0.5))
    if is_log(scaled(first)):
        bar.ax.yaxis.set_major_formatter(lambda value, _place: f"{value:g}")


def _caption(summary: Summary, shown: Sequence[Cell], first: Axis, second: Axis | None) -> str:
    by = [f"colours show {label(first)}"] if first.numeric or len(first.levels) <= NAMED_MAX else []
    by += [f"markers show {label(second)}"] if second is not None else []
    every = len(summary.cells)
    return (
        f"Outcome against mean age of information, a point for each cell of {runs_text(summary)}"
        + "".join(f"; {words}" for words in by)
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
