"""All figures of a study that its axes allow, each as a PNG for screens and a PDF for print.

These are rates and times along each axis, heat maps over two numeric axes, survival curves, outcome
against age of information, and differences on common seeds. A study of a single cell has its
survival curve only.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import matplotlib

from encircle.studies.charts.age import draw_age
from encircle.studies.charts.differences import draw_differences
from encircle.studies.charts.frames import COLUMN_IN, STUDY_STYLE, DrawnFigure, save_png_and_pdf
from encircle.studies.charts.layout import LINES_MAX, varied_axes
from encircle.studies.charts.lines import RATE, TIME, draw_along_axis
from encircle.studies.charts.maps import draw_maps
from encircle.studies.charts.survival import draw_survival
from encircle.studies.plan import Axis, Plan
from encircle.studies.summary import Summary

FIGURES = "figures"


class Chart(NamedTuple):
    """A figure on disk.

    ``path``: its PNG; the PDF is beside it. ``wide``: wider than a column of the page.
    """

    path: Path
    caption: str
    alt: str
    wide: bool


def write_charts(summary: Summary, directory: Path) -> tuple[Chart, ...]:
    """Draw all figures into the directory ``figures`` in a directory."""
    folder = directory / FIGURES
    folder.mkdir(parents=True, exist_ok=True)
    charts = []
    with matplotlib.rc_context(STUDY_STYLE):
        for drawn in charts_of(summary):
            save_png_and_pdf(drawn, folder)
            wide = bool(drawn.figure.get_size_inches()[0] > COLUMN_IN)
            charts.append(Chart(folder / f"{drawn.name}.png", drawn.caption, drawn.alt, wide))
    return tuple(charts)


def charts_of(summary: Summary) -> Iterator[DrawnFigure]:
    """The figures, drawn one at a time in their order."""
    plan = summary.plan
    for axis in axes_to_draw(plan):
        for quantity in (RATE, TIME):
            yield draw_along_axis(summary, axis, quantity)
    yield from draw_maps(summary)
    yield draw_survival(summary)
    for draw in (draw_age, draw_differences):
        if (drawn := draw(summary)) is not None:
            yield drawn


def axes_to_draw(plan: Plan) -> list[Axis]:
    """The axes to draw along: all numeric ones, and named ones with too many levels for lines."""
    axes = varied_axes(plan)
    numeric = [axis for axis in axes if axis.numeric]
    named = [axis for axis in axes if not axis.numeric]
    if not numeric:
        return named[:1]
    return [*numeric, *(axis for axis in named if len(axis.levels) > LINES_MAX)]
