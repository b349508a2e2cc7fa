"""What the figures of studies share: sizes, panels, line styles, scales, legends, files.

A figure of one panel is as wide as a column of a paper if its points fit; other figures are as wide
as the text. Type has the same size in both. Levels of a numeric axis have colours from dark to
light (viridis); other levels have the colours of Okabe and Ito. Markers and dashes differ too, so
that no information depends on colour. Names come from the user and are never parsed as formulas.
"""

from collections.abc import Mapping, Sequence
from math import ceil, log10
from pathlib import Path
from typing import Any, Literal, NamedTuple

import matplotlib
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator, NullFormatter
from numpy.typing import ArrayLike, NDArray

from encircle.figures.drawing import (
    BASE_STYLE,
    COLOURS,
    DOTS_PER_INCH,
    LINE_STYLES,
    MARKERS,
    WIDTH_IN,
)
from encircle.statistics.intervals import Interval
from encircle.studies.charts.layout import ELLIPSIS, drawing_order, level_text, wrapped
from encircle.studies.plan import Axis

COLUMN_IN = 3.5
EDGE_IN, TEXT_LINE_IN, LETTER_IN, LABEL_LETTER_IN, KEY_IN = 0.3, 0.165, 0.068, 0.072, 0.45
TALL_IN = 8.0
"""The height above which rows of names are left out."""

COLOUR_MAP, COLOUR_MAP_END = "viridis", 0.85
LOG_SPAN_MIN = 100.0
SIDE_STEP_SHARE = 0.011
"""Step between points of neighbouring lines, as a share of the axis: bars must not touch."""

NAME_COLUMNS = 34
STUDY_STYLE: dict[Any, Any] = {
    **BASE_STYLE,
    "font.size": 8.5,
    "axes.titlesize": 8.5,
    "legend.fontsize": 8.0,
    "legend.title_fontsize": 8.0,
    "legend.columnspacing": 1.2,
    "legend.borderpad": 0.2,
    "text.parse_math": False,
    "axes.formatter.use_mathtext": False,
    "pdf.fonttype": 42,
}
Floats = NDArray[np.float64]


class DrawnFigure(NamedTuple):
    """A figure with the stem of its file names, its caption, and its alternative text."""

    name: str
    figure: Figure
    caption: str
    alt: str


class LegendLayout(NamedTuple):
    """A legend below a figure.

    ``across``: how many entries stand beside each other. ``high_in``: height with the title, in
    inches.
    """

    title: str
    handles: Sequence[Artist]
    labels: Sequence[str]
    across: int
    high_in: float


def legend_layout(title: str, handles: Sequence[Artist], width_in: float) -> LegendLayout:
    """A legend that fits a width, long names on several lines; empty without handles."""
    labels = [wrapped(str(handle.get_label()), NAME_COLUMNS) or " " for handle in handles]
    if not labels:
        return LegendLayout(title, handles, labels, 0, 0.0)
    widest = max(len(line) for text in labels for line in text.split("\n"))
    fit = max(1, int(width_in / (KEY_IN + LETTER_IN * widest)))
    down = ceil(len(labels) / fit)
    heights = [1 + text.count("\n") for text in labels]
    tallest = max(sum(heights[k : k + down]) for k in range(0, len(heights), down))
    title = wrapped(title, int(width_in / LETTER_IN))
    lines = tallest + (1 + title.count("\n") if title else 0)
    return LegendLayout(
        title, handles, labels, ceil(len(labels) / down), TEXT_LINE_IN * lines + 0.1
    )


def add_legend(
    figure: Figure, legend: LegendLayout, side: Literal["left", "center", "right"] = "center"
) -> None:
    """Add a legend below a figure; a second legend can stand at the other side."""
    location: dict[str, Any] = {"loc": f"outside lower {side}"}
    if legend.handles:
        figure.legend(
            handles=list(legend.handles),
            labels=list(legend.labels),
            title=legend.title or None,
            **location,
            ncols=legend.across,
            frameon=False,
        )


def panels_figure(
    titles: Sequence[str], panel_in: float, legend: tuple[str, Sequence[Artist]], wide: bool
) -> tuple[Figure, list[Axes]]:
    """A figure with a panel for each title, and a legend (title, handles) below.

    ``panel_in``: height of a panel in inches. ``wide``: even a single panel has the whole
    width. Panels share their scales.
    """
    panels = len(titles)
    columns = {1: 1, 2: 2, 4: 2}.get(panels, 3)
    rows = ceil(panels / columns)
    width_in = WIDTH_IN if wide or panels > 1 else COLUMN_IN
    titles = [wrapped(title, int(width_in / columns / LETTER_IN) - 6) for title in titles]
    titles_in = TEXT_LINE_IN * max((1 + t.count("\n") for t in titles if t), default=0)
    below = legend_layout(*legend, width_in)
    high_in = rows * (panel_in + titles_in) + EDGE_IN + below.high_in
    figure = Figure((width_in, high_in), DOTS_PER_INCH, layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    for empty in list(grid.flat)[panels:]:
        empty.remove()
    used = list(grid.flat)[:panels]
    for axes, text in zip(used, titles, strict=True):
        axes.set_title(text)
    add_legend(figure, below)
    return figure, used


def fitted_title(axis: Axis, room_in: float) -> str:
    """An axis' title on lines of a length; if that is still too long, its name and unit."""
    text = wrapped(axis.title, max(8, int(room_in / LABEL_LETTER_IN)))
    if not text.endswith(ELLIPSIS):
        return text
    return axis.name + (f" ({axis.unit})" if axis.unit else "")


def outer_labels(panels: Sequence[Axes]) -> None:
    """Keep axis labels only at the outer panels, including those above an empty position."""
    for index, axes in enumerate(panels):
        spec = axes.get_subplotspec()
        assert spec is not None
        rows, columns = spec.get_gridspec().nrows, spec.get_gridspec().ncols
        if not spec.is_first_col():
            axes.set_ylabel("")
        if index + columns < len(panels):
            axes.set_xlabel("")
        elif index + columns < rows * columns:
            # These labels reach into the empty position below, so the layout ignores them.
            axes.xaxis.set_in_layout(False)
            axes.tick_params(labelbottom=True)


def line_style(axis: Axis | None, number: int, count: int) -> dict[str, Any]:
    """Colour, dashes and marker of line ``number`` of ``count``.

    The lines are levels of an axis.
    """
    colour: Any = COLOURS[number % len(COLOURS)]
    if axis is not None and axis.numeric:
        colour = matplotlib.colormaps[COLOUR_MAP](COLOUR_MAP_END * number / max(count - 1, 1))
    return {
        "color": colour,
        "ls": LINE_STYLES[number % len(LINE_STYLES)],
        # After the last colour the colours repeat, with other markers.
        "marker": MARKERS[(number + number // len(COLOURS)) % len(MARKERS)],
    }


def line_handles(
    axis: Axis | None, level_indices: Sequence[int], joined: bool = True
) -> list[Artist]:
    """Legend entries of lines, or of points that are not ``joined``; none for a single line."""
    if axis is None:
        return []
    handles: list[Artist] = []
    for number, index in enumerate(level_indices):
        style = line_style(axis, number, len(level_indices))
        style["ls"] = style["ls"] if joined else ""
        handles.append(Line2D([], [], **style, lw=1.1, ms=4, label=level_text(axis, index)))
    return handles


def draw_points(
    axes: Axes,
    at: ArrayLike,
    intervals: Sequence[Interval],
    style: Mapping[str, Any],
    upright: bool = True,
) -> None:
    """Draw estimates with their bars.

    If ``upright``, the positions ``at`` are along x, and points are joined; otherwise they are
    along y.
    """
    bounds = np.array(intervals, float).reshape(-1, 3)
    value, bars = bounds[:, 0], error_bars(bounds)
    kind = {**style, "ms": 4, "lw": 1.0, "elinewidth": 0.8, "capsize": 2}
    if upright:
        axes.errorbar(at, value, yerr=bars, **kind)
    else:
        axes.errorbar(value, at, xerr=bars, **{**kind, "ls": ""})


def error_bars(bounds: Floats) -> Floats:
    """Lengths (2, C) of bars below and above the values, for rows (C, 3) of value, low, high."""
    value, low, high = bounds.T
    return np.maximum([value - low, high - value], 0.0)


def scaled_levels(axis: Axis) -> Floats:
    """Levels of a numeric axis in the unit in which they are shown, ascending."""
    return np.array([axis.display_values[index] * axis.scale for index in drawing_order(axis)])


def spans_decades(values: Floats) -> bool:
    """Whether levels span so many decades that a linear scale would crowd the small ones."""
    return bool(values.min() > 0.0 and values.max() / values.min() >= LOG_SPAN_MIN)


def colour_scale(axis: Axis) -> Normalize:
    """The colour scale of a numeric axis."""
    values = scaled_levels(axis)
    return (LogNorm if spans_decades(values) else Normalize)(values.min(), values.max())


def side_by_side(values: Floats, number: int, count: int) -> Floats:
    """Positions for line ``number`` of ``count``.

    They are moved sideways, so that error bars do not hide each other.
    """
    positions = np.log(values) if spans_decades(values) else values
    gaps = np.diff(positions)
    gaps = gaps[gaps > 0.0]  # delivered delays of two levels may be equal
    step = min(0.6 / count * gaps.min(), SIDE_STEP_SHARE * np.ptp(positions)) if gaps.size else 0.1
    moved = positions + step * (number - (count - 1) / 2)
    return np.asarray(np.exp(moved) if spans_decades(values) else moved)


def set_scale(axes: Axes, values: Floats) -> None:
    """Set scale and ticks along x for levels: whole numbers, or powers of ten for a wide span."""
    if spans_decades(values):
        axes.set_xscale("log")
        decades = np.arange(int(np.floor(log10(values.min()))), ceil(log10(values.max())) + 1)
        axes.xaxis.set_major_locator(FixedLocator(list(10.0**decades)))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _place: f"{value:g}"))
        axes.xaxis.set_minor_formatter(NullFormatter())
        return
    whole = bool((values == values.round()).all())
    axes.xaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 2.5, 5, 10], integer=whole))


def save_png_and_pdf(drawn: DrawnFigure, directory: Path) -> None:
    """Write a figure as PNG and PDF; the same figure gives the same bytes."""
    FigureCanvasAgg(drawn.figure)
    drawn.figure.savefig(directory / f"{drawn.name}.png", format="png")
    # Laid out once: the page of the PDF has the same size.
    drawn.figure.set_layout_engine("none")
    drawn.figure.savefig(
        directory / f"{drawn.name}.pdf", format="pdf", metadata={"CreationDate": None}
    )
