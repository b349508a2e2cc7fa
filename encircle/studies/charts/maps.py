"""Heat maps over two numeric axes: the capture rate, and beside it the time to capture.

A map with the same value in all cells is left out, because a sentence says the same. Cells have one
size whatever the steps between levels, and their numbers are printed if they fit. All maps of a
study share their scales. Light colours are good: often captured, or early.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Colormap, Normalize
from matplotlib.figure import Figure

from encircle.figures.drawing import DOTS_PER_INCH, WIDTH_IN
from encircle.studies.charts.frames import (
    COLOUR_MAP,
    COLUMN_IN,
    LETTER_IN,
    DrawnFigure,
    Floats,
    fitted_title,
)
from encircle.studies.charts.layout import (
    LevelIndices,
    axis_label,
    cell_at,
    drawing_order,
    evenly_spaced,
    level_text,
    setting_text,
    settings_of,
)
from encircle.studies.charts.lines import (
    RATE,
    TIME,
    Quantity,
    limit_text,
    runs_text,
    value_range_text,
)
from encircle.studies.plan import Axis
from encircle.studies.summary import Cell, Summary

LEVELS_MIN = 3
MAPS_MAX = 6
BESIDE_MAX = 8
ROW_IN, MAP_IN_MIN, MAP_IN_MAX, AROUND_IN, LEFT_IN = 0.32, 1.1, 6.0, 1.15, 0.7
NUMBER_PT, NUMBER_PT_MIN, LINE_PT = 7.5, 5.0, 12.0
LETTER_EM = 0.62
LIGHT_MIN = 0.18
"""The luminance above which black is easier to read than white (WCAG 2, relative luminance)."""


class _Grid(NamedTuple):
    """A pair of maps for one setting.

    ``along``, ``up``: numeric axes. ``setting``: levels of the other axes. ``cells``: by row
    (y) and column (x).
    """

    along: Axis
    up: Axis
    setting: LevelIndices
    cells: Sequence[Sequence[Cell]]

    def values(self, quantity: Quantity) -> Floats:
        """The quantity in each cell: (Y, X)."""
        return np.array([[quantity.interval(cell).value for cell in row] for row in self.cells])


def draw_maps(summary: Summary) -> Iterator[DrawnFigure]:
    """Maps over the first two numeric axes with enough levels, for each setting of the others."""
    axes = summary.plan.all_axes
    pair = [axis for axis in axes if axis.numeric and len(axis.levels) >= LEVELS_MIN][:2]
    if len(pair) < 2:
        return
    settings = settings_of([axis for axis in axes if axis not in pair])
    grids = [_grid(summary, pair[0], pair[1], setting) for setting in settings]
    shown = [(grid, varying) for grid in grids if (varying := _not_uniform(grid))]
    chosen = evenly_spaced(len(shown), MAPS_MAX)
    remark = f" {len(chosen)} of {len(settings)} settings are shown."
    for number, index in enumerate(chosen, start=1):
        name = "map" if len(chosen) == 1 else f"map-{number}"
        drawn = _draw(summary, *shown[index], name)
        left_out = remark if len(chosen) < len(settings) else ""
        yield drawn._replace(caption=drawn.caption + left_out)


def _grid(summary: Summary, along: Axis, up: Axis, setting: LevelIndices) -> _Grid:
    cells = [
        [
            summary.cells[cell_at(summary.plan, {**setting, along.name: x, up.name: y})]
            for x in drawing_order(along)
        ]
        for y in drawing_order(up)
    ]
    return _Grid(along, up, setting, cells)


def _not_uniform(grid: _Grid) -> list[Quantity]:
    """The quantities that are not the same in all cells."""
    return [quantity for quantity in (RATE, TIME) if np.ptp(grid.values(quantity)) > 0.0]


def _draw(summary: Summary, grid: _Grid, quantities: Sequence[Quantity], name: str) -> DrawnFigure:
    along, up = grid.along, grid.up
    stacked = len(along.levels) > BESIDE_MAX
    map_in = min(max(ROW_IN * len(up.levels), MAP_IN_MIN), MAP_IN_MAX)
    many = len(quantities)
    width_in = COLUMN_IN if many == 1 and not stacked else WIDTH_IN
    size = (width_in, (map_in + AROUND_IN) * (many if stacked else 1))
    figure = Figure(size, DOTS_PER_INCH, layout="constrained")
    panels = figure.subplots(many if stacked else 1, 1 if stacked else many, squeeze=False)
    across = width_in / (1 if stacked else many)
    room_pt = 72.0 * (across - LEFT_IN) / len(along.levels)
    printed = []
    for axes, quantity in zip(panels.flat, quantities, strict=True):
        values = grid.values(quantity)
        _draw_map(figure, axes, summary, values, quantity)
        _name_levels(axes, along, up, room_pt, 72.0 * map_in)
        axes.set_xlabel(fitted_title(along, room_pt * len(along.levels) / 72.0))
        axes.set_ylabel(fitted_title(up, map_in))
        texts = _number_texts(summary, values, quantity)
        letters = LETTER_EM * max(len(text) for row in texts for text in row) + 0.5
        size_pt = min(NUMBER_PT, room_pt / letters, 0.75 * 72.0 * map_in / len(values))
        printed.append(size_pt >= NUMBER_PT_MIN)
        if printed[-1]:
            _print_numbers(axes, texts, values, _colour_scale(summary, quantity), size_pt)
    caption = _caption(summary, grid, quantities) + (
        "" if all(printed) else " The numbers are in the table of cells."
    )
    return DrawnFigure(name, figure, caption, _alt(summary, grid, quantities))


def _axes_text(summary: Summary, grid: _Grid, names: Callable[[Axis], str]) -> str:
    at = f" at {setting}" if (setting := setting_text(summary.plan, grid.setting)) else ""
    return f"over {names(grid.along)} and {names(grid.up)}{at}"


def _caption(summary: Summary, grid: _Grid, quantities: Sequence[Quantity]) -> str:
    drawn = " and ".join(quantity.name for quantity in quantities)
    parts = [
        f"{drawn[0].upper()}{drawn[1:]} {_axes_text(summary, grid, axis_label)};"
        f" {runs_text(summary)} per cell."
    ]
    if TIME in quantities:
        parts.append(f"Runs without capture count as the limit, {limit_text(summary)}.")
    parts.append("Light is good: often captured, or early.")
    if RATE not in quantities:
        parts.append(f"The capture rate is {grid.values(RATE)[0, 0]:.0f} % in all of these cells.")
    return " ".join(parts)


def _alt(summary: Summary, grid: _Grid, quantities: Sequence[Quantity]) -> str:
    units = {RATE.file_stem: "%", TIME.file_stem: "s"}
    spans = [
        f"{quantity.name} {value_range_text(grid.values(quantity).ravel().tolist())}"
        f" {units[quantity.file_stem]}"
        for quantity in quantities
    ]
    title = _axes_text(summary, grid, lambda axis: axis.title)
    return f"Heat maps {title}: {', and '.join(spans)}."


def _colour_scale(summary: Summary, quantity: Quantity) -> tuple[Normalize, Colormap]:
    if quantity is RATE:
        return Normalize(0.0, 100.0), matplotlib.colormaps[COLOUR_MAP]
    times = [cell.time_s.value for cell in summary.cells]
    low, high = min(times), max(times)
    # A scale needs a width, also if all values are equal.
    return Normalize(low, high if high > low else low + 1.0), matplotlib.colormaps[
        f"{COLOUR_MAP}_r"
    ]


def _draw_map(
    figure: Figure, axes: Axes, summary: Summary, values: Floats, quantity: Quantity
) -> None:
    norm, colours = _colour_scale(summary, quantity)
    axes.pcolormesh(values, norm=norm, cmap=colours, edgecolors="white", linewidth=0.4)
    bar = figure.colorbar(ScalarMappable(norm, colours), ax=axes, location="top", aspect=28)
    bar.set_label(quantity.axis)


def _number_texts(summary: Summary, values: Floats, quantity: Quantity) -> list[list[str]]:
    longest_s = max(cell.time_s.value for cell in summary.cells)
    digits = 0 if quantity is RATE or longest_s >= 100.0 else 1
    return [[f"{value:.{digits}f}" for value in row] for row in values]


def _print_numbers(
    axes: Axes,
    texts: Sequence[Sequence[str]],
    values: Floats,
    scale: tuple[Normalize, Colormap],
    size_pt: float,
) -> None:
    norm, colours = scale
    coded = colours(norm(values))[..., :3]
    linear = np.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4)
    light = linear @ (0.2126, 0.7152, 0.0722) > LIGHT_MIN
    for (y, x), on_light in np.ndenumerate(light):
        colour = "black" if on_light else "white"
        position = (x + 0.5, y + 0.5)
        axes.text(*position, texts[y][x], ha="center", va="center", fontsize=size_pt, color=colour)


def _name_levels(axes: Axes, along: Axis, up: Axis, room_pt: float, high_pt: float) -> None:
    """Label the levels, or as many as fit.

    ``room_pt``: width for each level along x. ``high_pt``: height for all levels along y.
    """
    names = [level_text(along, index) for index in drawing_order(along)]
    crowded = max(map(len, names)) * 72.0 * LETTER_IN > room_pt
    named = evenly_spaced(
        len(names), int(room_pt * len(names) / LINE_PT) if crowded else len(names)
    )
    shown = [names[k] for k in named]
    axes.set_xticks(np.array(named) + 0.5, shown, rotation=90 if crowded else 0)
    names = [level_text(up, index) for index in drawing_order(up)]
    named = evenly_spaced(len(names), int(high_pt / LINE_PT))
    axes.set_yticks(np.array(named) + 0.5, [names[k] for k in named])
    axes.tick_params(length=0)
