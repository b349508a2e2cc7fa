"""Survival curves: the share of runs whose target is still free, against time.

They are Kaplan and Meier's estimates with pointwise intervals, up to the last run under
observation. A run without capture is censored at its limit; a stroke across the curve marks where
such runs end. If all captures are early, the time axis ends soon after the last of them: the curves
are constant from there to the limit, and all changes would be squeezed to the left side.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from encircle.studies.charts.frames import (
    DrawnFigure,
    line_handles,
    line_style,
    outer_labels,
    panels_figure,
)
from encircle.studies.charts.layout import FigureLayout, figure_layout
from encircle.studies.charts.lines import (
    PANEL_IN,
    PANEL_IN_SMALL,
    PERCENT,
    limit_text,
    runs_text,
    value_range_text,
)
from encircle.studies.summary import Summary

STROKE: dict[str, Any] = {"ls": "", "marker": "|", "ms": 7, "mew": 1.2}
TIME_MARGIN, CUT_TIME_MARGIN = 1.03, 1.25
CUT_BELOW = 0.5
"""If the last capture is earlier than this share of the longest run, the time axis is cut."""
BAND_ALPHA, BAND_ALPHA_MANY, FEW_CURVES_MAX = 0.16, 0.1, 3


def draw_survival(summary: Summary) -> DrawnFigure:
    """Draw a curve for each level of the compared axis, or of the first, a panel per setting."""
    shape = figure_layout(summary.plan)
    single = len(shape.settings) == 1
    handles = line_handles(shape.lines, shape.level_indices)
    for handle, line in zip(handles, shape.level_indices, strict=False):
        handle.set(marker="")
        if single:
            handle.set(label=f"{handle.get_label()}: {_outcome(summary, shape, line)}")
    if not summary.captured.all():
        handles.append(Line2D([], [], color="black", **STROKE, label="not captured"))
    titles = [shape.title(setting) for setting in shape.settings]
    legend = (shape.lines.title if shape.lines is not None else "", handles)
    figure, panels = panels_figure(
        titles, PANEL_IN if single else PANEL_IN_SMALL, legend, wide=False
    )
    cells = [
        [shape.cell(setting, line) for line in shape.level_indices] for setting in shape.settings
    ]
    end_s, cut = _end_s(summary, [cell for row in cells for cell in row])
    for axes, row in zip(panels, cells, strict=True):
        for number, cell in enumerate(row):
            _draw_curve(axes, summary, cell, shape, number, end_s)
        axes.set(xlabel="time (s)", ylabel="share still free (%)")
        axes.set(ylim=PERCENT["lim"], yticks=PERCENT["ticks"])
        axes.grid(alpha=0.25, lw=0.5)
    # All panels share the x axis.
    panels[0].set_xlim(0.0, TIME_MARGIN * end_s)
    outer_labels(panels)
    remark = f" {_outcome(summary, shape, 0)}." if shape.lines is None else ""
    limit = f"at the limit, {limit_text(summary)}"
    strokes = f" Strokes: runs end there without capture, {limit}."
    if cut:
        strokes = (
            f" Nothing changes after {end_s:.3g} s; strokes: runs end without capture, {limit}."
        )
    strokes = "" if summary.captured.all() else strokes
    caption = (
        f"Share of runs whose target is still free (Kaplan-Meier){shape.split_text};"
        f" {runs_text(summary)} per curve.{remark} Bands: pointwise 95 % intervals.{strokes}"
        f" {shape.left_out}"
    )
    free = [100.0 * cell.survival.share[-1] for cell in summary.cells]
    alt = (
        f"Survival curves{shape.split_text}: at the end {value_range_text(free)} % of targets are"
        " still free, over all cells."
    )
    return DrawnFigure("survival", figure, caption.strip(), alt)


def _end_s(summary: Summary, cells: Sequence[int]) -> tuple[float, bool]:
    """The end of the time axis in s, and whether some runs last longer."""
    times_s = np.array([summary.ticks[cell] * summary.tick_s[cell] for cell in cells])
    longest_s = float(times_s.max())
    last_s = CUT_TIME_MARGIN * float(times_s.max(initial=0.0, where=summary.captured[list(cells)]))
    cut = 0.0 < last_s < CUT_BELOW * longest_s
    return (last_s if cut else longest_s), cut


def _outcome(summary: Summary, shape: FigureLayout, line: int) -> str:
    flags = summary.captured[shape.cell(shape.settings[0], line)]
    return f"{int(flags.sum())} of {flags.size} captured"


def _draw_curve(
    axes: Axes, summary: Summary, cell: int, shape: FigureLayout, number: int, end_s: float
) -> None:
    curve, tick_s = summary.cells[cell].survival, summary.tick_s[cell]
    style = {**line_style(shape.lines, number, len(shape.level_indices)), "marker": ""}
    times_s = np.minimum(np.append(0.0, curve.ticks * tick_s), end_s)
    share, low, high = (
        100.0 * np.append(1.0, bound) for bound in (curve.share, curve.low, curve.high)
    )
    alpha = BAND_ALPHA if len(shape.level_indices) <= FEW_CURVES_MAX else BAND_ALPHA_MANY
    axes.fill_between(times_s, low, high, step="post", color=style["color"], alpha=alpha, lw=0)
    axes.step(times_s, share, where="post", **style, lw=1.3)
    censored = np.unique(summary.ticks[cell][~summary.captured[cell]])
    left = share[1 + np.searchsorted(curve.ticks, censored)]
    at_s = np.minimum(censored * tick_s, end_s)
    axes.plot(at_s, left, color=style["color"], **STROKE)
