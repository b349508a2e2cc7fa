"""What the figures of studies share: size, panels, looks of levels, scales, legends, files.

A figure of one panel is as wide as a column of a paper if its points fit, others as wide as its
text; type is of the same size in both. Levels of a numeric axis run from dark to light along
viridis, others have the colours of Okabe and Ito; markers and dashes differ too, so that nothing
hangs on colour. Names come from the user and are never read as mathematics.
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

from encircle.figures.drawing import COLOURS, DOTS_PER_INCH, LINES, MARKERS, STYLE, WIDTH_IN
from encircle.statistics.intervals import Interval
from encircle.studies.charts.views import CUT, level_text, ordered, wrapped
from encircle.studies.plan import Axis

COLUMN_IN = 3.5
EDGE_IN, TEXT_LINE_IN, LETTER_IN, LABEL_LETTER_IN, KEY_IN = 0.3, 0.165, 0.068, 0.072, 0.45
TALL_IN = 8.0
"""The height above which rows of names are left out."""

MAP, PALEST = "viridis", 0.85
LOG_SPAN_MIN = 100.0
BESIDE = 0.011
"""Step between lines beside each other, as a share of the axis; bars must not touch."""

NAME_COLUMNS = 34
LOOK: dict[Any, Any] = {
    **STYLE,
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
    """A figure with the stem of its files, what is said under it, and what in place of it."""

    name: str
    figure: Figure
    caption: str
    alt: str


class Legend(NamedTuple):
    """A legend below a figure: ``across`` entries beside each other, ``high_in`` with its title."""

    title: str
    handles: Sequence[Artist]
    labels: Sequence[str]
    across: int
    high_in: float


def legend_of(title: str, handles: Sequence[Artist], width_in: float) -> Legend:
    """A legend that fits a width, long names on several lines; without handles it is nothing."""
    labels = [wrapped(str(handle.get_label()), NAME_COLUMNS) or " " for handle in handles]
    if not labels:
        return Legend(title, handles, labels, 0, 0.0)
    widest = max(len(line) for text in labels for line in text.split("\n"))
    fit = max(1, int(width_in / (KEY_IN + LETTER_IN * widest)))
    down = ceil(len(labels) / fit)
    heights = [1 + text.count("\n") for text in labels]
    tallest = max(sum(heights[k : k + down]) for k in range(0, len(heights), down))
    title = wrapped(title, int(width_in / LETTER_IN))
    lines = tallest + (1 + title.count("\n") if title else 0)
    return Legend(title, handles, labels, ceil(len(labels) / down), TEXT_LINE_IN * lines + 0.1)


def add_legend(
    figure: Figure, legend: Legend, side: Literal["left", "center", "right"] = "center"
) -> None:
    """Put a legend below a figure, at a side if another has the other."""
    places: dict[str, Any] = {"loc": f"outside lower {side}"}
    if legend.handles:
        figure.legend(
            handles=list(legend.handles),
            labels=list(legend.labels),
            title=legend.title or None,
            **places,
            ncols=legend.across,
            frameon=False,
        )


def frame(
    titles: Sequence[str], panel_in: float, legend: tuple[str, Sequence[Artist]], wide: bool
) -> tuple[Figure, list[Axes]]:
    """A figure with a panel ``panel_in`` high for each title, and a legend (title, handles).

    ``wide``: even a single panel has the whole width. Panels share their scales.
    """
    panels = len(titles)
    columns = {1: 1, 2: 2, 4: 2}.get(panels, 3)
    rows = ceil(panels / columns)
    width_in = WIDTH_IN if wide or panels > 1 else COLUMN_IN
    titles = [wrapped(title, int(width_in / columns / LETTER_IN) - 6) for title in titles]
    titles_in = TEXT_LINE_IN * max((1 + t.count("\n") for t in titles if t), default=0)
    below = legend_of(*legend, width_in)
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


def fitted(axis: Axis, room_in: float) -> str:
    """An axis' title on lines of a length; if it is too long even so, its name and unit."""
    text = wrapped(axis.title, max(8, int(room_in / LABEL_LETTER_IN)))
    if not text.endswith(CUT):
        return text
    return axis.name + (f" ({axis.unit})" if axis.unit else "")


def outer_labels(panels: Sequence[Axes]) -> None:
    """Leave the labels of axes to the panels at the edge; above an empty place is an edge too."""
    for index, axes in enumerate(panels):
        spec = axes.get_subplotspec()
        assert spec is not None
        rows, columns = spec.get_gridspec().nrows, spec.get_gridspec().ncols
        if not spec.is_first_col():
            axes.set_ylabel("")
        if index + columns < len(panels):
            axes.set_xlabel("")
        elif index + columns < rows * columns:
            # What stands in the empty place below needs no room between the rows.
            axes.xaxis.set_in_layout(False)
            axes.tick_params(labelbottom=True)


def look(axis: Axis | None, number: int, count: int) -> dict[str, Any]:
    """Colour, dashes and marker of line ``number`` of ``count``, levels of an axis or a single."""
    colour: Any = COLOURS[number % len(COLOURS)]
    if axis is not None and axis.numeric:
        colour = matplotlib.colormaps[MAP](PALEST * number / max(count - 1, 1))
    return {
        "color": colour,
        "ls": LINES[number % len(LINES)],
        # Beyond the last colour the colours come round again with other markers.
        "marker": MARKERS[(number + number // len(COLOURS)) % len(MARKERS)],
    }


def line_handles(axis: Axis | None, places: Sequence[int], joined: bool = True) -> list[Artist]:
    """Legend entries of lines, or of points that are not ``joined``; none for a single line."""
    if axis is None:
        return []
    handles: list[Artist] = []
    for number, index in enumerate(places):
        style = look(axis, number, len(places))
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
    """Estimates with their bars: over places ``at``, joined, if ``upright``, else beside them."""
    bounds = np.array(intervals, float).reshape(-1, 3)
    value, bars = bounds[:, 0], bars_of(bounds)
    kind = {**style, "ms": 4, "lw": 1.0, "elinewidth": 0.8, "capsize": 2}
    if upright:
        axes.errorbar(at, value, yerr=bars, **kind)
    else:
        axes.errorbar(value, at, xerr=bars, **{**kind, "ls": ""})


def bars_of(bounds: Floats) -> Floats:
    """(2, C) how far bars reach down and up from values, for rows (C, 3) of value, low, high."""
    value, low, high = bounds.T
    return np.maximum([value - low, high - value], 0.0)


def scaled(axis: Axis) -> Floats:
    """Levels of a numeric axis in the unit in which they are shown, ascending."""
    return np.array([axis.shown_values[index] * axis.scale for index in ordered(axis)])


def is_log(values: Floats) -> bool:
    """Whether levels are spread so widely that a linear scale would heap them."""
    return bool(values.min() > 0.0 and values.max() / values.min() >= LOG_SPAN_MIN)


def colour_scale(axis: Axis) -> Normalize:
    """The scale of a numeric axis as colours."""
    values = scaled(axis)
    return (LogNorm if is_log(values) else Normalize)(values.min(), values.max())


def beside(values: Floats, number: int, count: int) -> Floats:
    """Places for line ``number`` of ``count``, beside each other so that bars hide none."""
    places = np.log(values) if is_log(values) else values
    gaps = np.diff(places)
    gaps = gaps[gaps > 0.0]  # levels may come out alike
    step = min(0.6 / count * gaps.min(), BESIDE * np.ptp(places)) if gaps.size else 0.1
    moved = places + step * (number - (count - 1) / 2)
    return np.asarray(np.exp(moved) if is_log(values) else moved)


def set_scale(axes: Axes, values: Floats) -> None:
    """Scale and marks along x for levels: whole numbers for whole ones, logs for a wide span."""
    if is_log(values):
        axes.set_xscale("log")
        decades = np.arange(int(np.floor(log10(values.min()))), ceil(log10(values.max())) + 1)
        axes.xaxis.set_major_locator(FixedLocator(list(10.0**decades)))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _place: f"{value:g}"))
        axes.xaxis.set_minor_formatter(NullFormatter())
        return
    whole = bool((values == values.round()).all())
    axes.xaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 2.5, 5, 10], integer=whole))


def save_both(drawn: DrawnFigure, directory: Path) -> None:
    """Write a figure as PNG and PDF; the same figure gives the same bytes."""
    FigureCanvasAgg(drawn.figure)
    drawn.figure.savefig(directory / f"{drawn.name}.png", format="png")
    drawn.figure.savefig(
        directory / f"{drawn.name}.pdf", format="pdf", metadata={"CreationDate": None}
    )
