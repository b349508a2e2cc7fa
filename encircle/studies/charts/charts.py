"""The figures of a study: those that its axes allow, each as PNG to look at and PDF to print.

Rates and times along each axis, heat maps over two numeric ones, survival curves, outcome against
age of information, differences on common seeds. A study of a single cell has its survival curve.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import matplotlib

from encircle.studies.charts.age import draw_age
from encircle.studies.charts.differences import draw_differences
from encircle.studies.charts.frames import COLUMN_IN, LOOK, DrawnFigure, save_both
from encircle.studies.charts.lines import RATE, TIME, draw_against
from encircle.studies.charts.maps import draw_maps
from encircle.studies.charts.survival import draw_survival
from encircle.studies.charts.views import LINES_MAX, varied
from encircle.studies.plan import Axis, Plan
from encircle.studies.summary import Summary

FIGURES = "figures"


class Chart(NamedTuple):
    """A figure on disk: ``path`` of its PNG, the PDF beside it; ``wide``: wider than a column."""

    path: Path
    caption: str
    alt: str
    wide: bool


def write_charts(summary: Summary, directory: Path) -> tuple[Chart, ...]:
    """Draw all figures into ``figures`` under a directory."""
    folder = directory / FIGURES
    folder.mkdir(parents=True, exist_ok=True)
    charts = []
    with matplotlib.rc_context(LOOK):
        for drawn in charts_of(summary):
            save_both(drawn, folder)
            wide = bool(drawn.figure.get_size_inches()[0] > COLUMN_IN)
            charts.append(Chart(folder / f"{drawn.name}.png", drawn.caption, drawn.alt, wide))
    return tuple(charts)


def charts_of(summary: Summary) -> Iterator[DrawnFigure]:
    """The figures, drawn one at a time in their order."""
    plan = summary.plan
    for axis in drawn_along(plan):
        for quantity in (RATE, TIME):
            yield draw_against(summary, axis, quantity)
    yield from draw_maps(summary)
    yield draw_survival(summary)
    for draw in (draw_age, draw_differences):
        if (drawn := draw(summary)) is not None:
            yield drawn


def drawn_along(plan: Plan) -> list[Axis]:
    """The axes to draw along: numeric ones, and named ones that these do not show wholly."""
    axes = varied(plan)
    numeric = [axis for axis in axes if axis.numeric]
    named = [axis for axis in axes if not axis.numeric]
    if not numeric:
        return named[:1]
    return [*numeric, *(axis for axis in named if len(axis.levels) > LINES_MAX)]
