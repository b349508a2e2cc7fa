"""Rates and times along an axis: joined points over numbers, groups of points beside names.

Times are means up to the limit of a run. A run without capture counts as the limit, so that no run
is dropped; the mean is a lower bound of the mean time to capture.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes

from encircle.statistics.intervals import Interval
from encircle.studies.charts.frames import (
    TALL_IN,
    DrawnFigure,
    Floats,
    draw_points,
    fitted_title,
    line_handles,
    line_style,
    outer_labels,
    panels_figure,
    scaled_levels,
    set_scale,
    side_by_side,
)
from encircle.studies.charts.layout import (
    FigureLayout,
    axis_label,
    drawing_order,
    evenly_spaced,
    figure_layout,
    level_text,
    wrapped,
)
from encircle.studies.plan import Axis
from encircle.studies.summary import Cell, Summary

PANEL_IN, PANEL_IN_SMALL = 2.2, 1.75
POINT_IN, NAME_LINE_IN, NAME_GAP_IN = 0.11, 0.15, 0.12
NAME_COLUMNS = 20
CROWDED_POINTS = 24
PERCENT: dict[str, Any] = {"lim": (-4.0, 104.0), "ticks": (0, 25, 50, 75, 100)}
NEAR_LIMIT, ABOVE_LIMIT = 0.6, 1.12
LIMIT_LINE: dict[str, Any] = {"color": "0.35", "ls": (0, (1, 1.5)), "lw": 1.0, "zorder": 1}
LIMIT_PT = 7.0


class Quantity(NamedTuple):
    """A quantity that is drawn for each cell.

    ``file_stem``: for names of files. ``name``: in sentences. ``axis``: label of its axis.
    ``bars``: what its error bars are. ``interval``: a cell's value and bounds in the unit of
    the axis.
    """

    file_stem: str
    name: str
    axis: str
    bars: str
    interval: Callable[[Cell], Interval]


RATE = Quantity(
    "rate",
    "capture rate",
    "capture rate (%)",
    "95 % Wilson intervals",
    lambda cell: Interval(*(100.0 * bound for bound in cell.rate)),
)
TIME = Quantity(
    "time",
    "mean time to capture up to the limit of a run",
    "mean time to capture,\nup to the limit (s)",
    "95 % intervals, which allow for failures that the runs do not show",
    lambda cell: cell.time_s,
)


def draw_along_axis(summary: Summary, along: Axis, quantity: Quantity) -> DrawnFigure:
    """Draw a quantity along an axis, a line for each level of another, a panel for each setting."""
    shape = figure_layout(summary.plan, along)
    count = len(shape.level_indices)
    rows, names, high_in = _rows_along(along, count)
    if along.numeric:
        high_in = PANEL_IN if len(shape.settings) == 1 else PANEL_IN_SMALL
    legend = (
        shape.lines.title if shape.lines is not None else "",
        line_handles(shape.lines, shape.level_indices, joined=along.numeric),
    )
    titles = [shape.title(setting) for setting in shape.settings]
    crowded = along.numeric and count * len(rows) > CROWDED_POINTS
    figure, panels = panels_figure(titles, high_in, legend, crowded)
    width_in = panels[0].bbox.width / figure.dpi
    for axes, setting in zip(panels, shape.settings, strict=True):
        for number, line in enumerate(shape.level_indices):
            cells = [summary.cells[shape.cell(setting, line, index)] for index in rows]
            at = _row_positions(along, len(rows), number, count)
            style = line_style(shape.lines, number, count)
            draw_points(axes, at, [quantity.interval(cell) for cell in cells], style, along.numeric)
        if along.numeric:
            axes.set_xlabel(fitted_title(along, width_in))
            set_scale(axes, scaled_levels(along))
        else:
            axes.set_yticks(range(len(names)), names)
            axes.set_ylim(len(names) - 0.5, -0.5)
            axes.tick_params(axis="y", length=0)
        set_quantity(axes, summary, quantity, "y" if along.numeric else "x")
        axes.grid(alpha=0.25, lw=0.5)
    outer_labels(panels)
    stem = f"{quantity.file_stem}-by-{along.name}"
    caption = _caption(summary, shape, along, quantity, len(rows))
    return DrawnFigure(stem, figure, caption, _alt(summary, shape, along, quantity))


def _rows_along(along: Axis, count: int) -> tuple[tuple[int, ...], list[str], float]:
    """Indices of the levels that fit, their names, and the height in inches of names and points."""
    every = drawing_order(along)
    if along.numeric:
        return every, [], 0.0
    names = [wrapped(level_text(along, index), NAME_COLUMNS) for index in every]
    lines = max(1 + name.count("\n") for name in names)
    row_in = max(POINT_IN * count, NAME_LINE_IN * lines) + NAME_GAP_IN
    chosen = evenly_spaced(len(every), int(TALL_IN / row_in))
    return chosen, [names[index] for index in chosen], row_in * len(chosen) + 0.25


def _row_positions(along: Axis, rows: int, number: int, count: int) -> Floats:
    if along.numeric:
        return side_by_side(scaled_levels(along), number, count)
    return np.arange(rows, dtype=float) + min(0.2, 0.7 / count) * (number - (count - 1) / 2)


def set_quantity(axes: Axes, summary: Summary, quantity: Quantity, side: str) -> None:
    """Set label and scale of a quantity along ``side``, x or y; show the limit of a run if near."""
    axes.set(**{f"{side}label": quantity.axis})
    if quantity is RATE:
        axes.set(**{f"{side}{key}": value for key, value in PERCENT.items()})
        return
    limit_s = _near_limit(summary)
    if limit_s is None:
        return
    axes.set(**{f"{side}lim": (0.0, ABOVE_LIMIT * limit_s)})
    text: dict[str, Any] = {"fontsize": LIMIT_PT, "color": "0.25"}
    if side == "y":
        axes.axhline(limit_s, **LIMIT_LINE)
        text |= {"xy": (0.0, limit_s), "xycoords": ("axes fraction", "data")}
        text |= {"xytext": (3, 1.5), "ha": "left"}
    else:
        axes.axvline(limit_s, **LIMIT_LINE)
        text |= {"xy": (limit_s, 1.0), "xycoords": ("data", "axes fraction")}
        text |= {"xytext": (0, 1.5), "ha": "center"}
    axes.annotate(f"limit {limit_s:g} s", textcoords="offset points", va="bottom", **text)


def _near_limit(summary: Summary) -> float | None:
    """The limit of a run in s, if it is the same in all cells and times come near it."""
    limits = {cell.limit_s for cell in summary.cells}
    highest = max(np.nanmax(cell.time_s) for cell in summary.cells)
    return limits.pop() if len(limits) == 1 and highest >= NEAR_LIMIT * max(limits) else None


def limit_text(summary: Summary) -> str:
    """The limit of a run: ``60 s``, or from the lowest to the highest of all cells."""
    limits = sorted({cell.limit_s for cell in summary.cells})
    return f"{limits[0]:g} s" if len(limits) == 1 else f"{limits[0]:g} to {limits[-1]:g} s"


def runs_text(summary: Summary) -> str:
    """``40 runs``: the number of runs in each cell."""
    runs = summary.cells[0].runs
    return f"{runs} run{'s' * (runs != 1)}"


def _caption(
    summary: Summary, shape: FigureLayout, along: Axis, quantity: Quantity, rows: int
) -> str:
    drawn = quantity.name[0].upper() + quantity.name[1:]
    parts = [f"{drawn} against {axis_label(along)}{shape.split_text}."]
    bars = quantity.bars
    if quantity is TIME and summary.cells[0].runs == 1:
        bars = "none, as a single run has no interval"
    parts.append(f"{runs_text(summary)} per point; bars: {bars}.")
    if quantity is TIME:
        parts.append(f"Runs without capture count as the limit, {limit_text(summary)}.")
    if along.numeric and len(shape.level_indices) > 1:
        parts.append("Points of one level stand side by side.")
    if rows < len(along.levels):
        parts.append(f"{rows} of {len(along.levels)} levels of {axis_label(along)} are shown.")
    return " ".join([*parts, shape.left_out]).strip()


def _alt(summary: Summary, shape: FigureLayout, along: Axis, quantity: Quantity) -> str:
    values = [quantity.interval(cell).value for cell in summary.cells]
    unit = "%" if quantity is RATE else "s"
    return (
        f"{'Line' if along.numeric else 'Dot'} chart of {quantity.name} against {along.title}"
        f"{shape.split_text}: {value_range_text(values)} {unit} over all cells."
    )


def value_range_text(values: Sequence[float]) -> str:
    """``from 10 to 90``, or the number if all are equal."""
    low, high = (f"{bound:.3g}" for bound in (min(values), max(values)))
    return low if low == high else f"from {low} to {high}"
