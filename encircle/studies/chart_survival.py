"""Survival curves: the share of runs whose target is still free, against time.

Kaplan and Meier's estimate with its pointwise interval; a run without capture is censored at the
limit, where a stroke across the curve says that some end so.
"""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from encircle.studies.chart_frames import Drawn, frame, line_handles, look, outer_labels
from encircle.studies.chart_lines import (
    PANEL_IN,
    PANEL_IN_SMALL,
    PERCENT,
    limit_text,
    runs_text,
    span,
)
from encircle.studies.summary import Summary
from encircle.studies.views import View, view

STROKE: dict[str, Any] = {"ls": "", "marker": "|", "ms": 7, "mew": 1.2}
ROOM = 1.03
BAND_ALPHA, BAND_ALPHA_MANY, MANY = 0.16, 0.1, 3


def draw_survival(summary: Summary) -> Drawn:
    """A curve for each level of the compared axis, or of the first, a panel for each setting."""
    shape = view(summary.plan)
    single = len(shape.settings) == 1
    handles = line_handles(shape.lines, shape.places)
    for handle, line in zip(handles, shape.places, strict=False):
        handle.set(marker="")
        if single:
            handle.set(label=f"{handle.get_label()}: {_outcome(summary, shape, line)}")
    if not summary.captured.all():
        handles.append(Line2D([], [], color="black", **STROKE, label="not captured"))
    titles = [shape.title(setting) for setting in shape.settings]
    legend = (shape.lines.title if shape.lines is not None else "", handles)
    figure, panels = frame(titles, PANEL_IN if single else PANEL_IN_SMALL, legend, wide=False)
    for axes, setting in zip(panels, shape.settings, strict=True):
        for number, line in enumerate(shape.places):
            _draw_curve(axes, summary, shape.cell(setting, line), shape, number)
        axes.set(xlabel="time (s)", ylabel="share still free (%)")
        axes.set(ylim=PERCENT["lim"], yticks=PERCENT["ticks"])
        axes.grid(alpha=0.25, lw=0.5)
    # Shared by all panels, so only now that all curves are drawn.
    panels[0].set_xlim(0.0, ROOM * max(axes.dataLim.xmax for axes in panels))
    outer_labels(panels)
    told = f" {_outcome(summary, shape, 0)}." if shape.lines is None else ""
    strokes = (
        f" Strokes: runs end there without capture, at the limit, {limit_text(summary)}."
        if not summary.captured.all()
        else ""
    )
    caption = (
        f"Share of runs whose target is still free (Kaplan-Meier){shape.spread};"
        f" {runs_text(summary)} per curve.{told} Bands: pointwise 95 % intervals.{strokes}"
        f" {shape.left_out}"
    )
    free = [100.0 * cell.survival.share[-1] for cell in summary.cells]
    alt = (
        f"Survival curves{shape.spread}: at the end {span(free)} % of targets are still free, over"
        " all cells."
    )
    return Drawn("survival", figure, caption.strip(), alt)


def _outcome(summary: Summary, shape: View, line: int) -> str:
    flags = summary.captured[shape.cell(shape.settings[0], line)]
    return f"{int(flags.sum())} of {flags.size} captured"


def _draw_curve(axes: Axes, summary: Summary, cell: int, shape: View, number: int) -> None:
    curve, tick_s = summary.cells[cell].survival, summary.tick_s[cell]
    style = {**look(shape.lines, number, len(shape.places)), "marker": ""}
    times_s = np.append(0.0, curve.ticks * tick_s)
    share, low, high = (
        100.0 * np.append(1.0, bound) for bound in (curve.share, curve.low, curve.high)
    )
    alpha = BAND_ALPHA if len(shape.places) <= MANY else BAND_ALPHA_MANY
    axes.fill_between(times_s, low, high, step="post", color=style["color"], alpha=alpha, lw=0)
    axes.step(times_s, share, where="post", **style, lw=1.3)
    censored = np.unique(summary.ticks[cell][~summary.captured[cell]])
    left = share[1 + np.searchsorted(curve.ticks, censored)]
    axes.plot(censored * tick_s, left, color=style["color"], **STROKE)
