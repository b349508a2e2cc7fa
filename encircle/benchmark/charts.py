"""The benchmark's figures: scores with intervals, capture by task and policy, ranks.

Maps are printed with their numbers and use the studies' colours (viridis, light is good), which
readers with a colour vision deficiency and greyscale prints keep in order. A submission's name is
bold. Policies stand in the order of their scores.
"""

from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from encircle.benchmark.outcomes import Floats, Outcomes
from encircle.benchmark.score import Scores
from encircle.benchmark.tasks import task_named
from encircle.figures.drawing import COLOURS, DOTS_PER_INCH, WIDTH_IN
from encircle.studies.charts.charts import FIGURES, Chart
from encircle.studies.charts.frames import COLOUR_MAP, STUDY_STYLE, DrawnFigure, save_png_and_pdf
from encircle.studies.charts.layout import wrapped

ROW_IN, AROUND_IN = 0.215, 1.35
NUMBER_PT = 7.5
NAME_LETTERS = 22
LIGHT_MIN = 0.18
"""The luminance above which black is easier to read than white (WCAG 2, relative luminance)."""


def write_figures(
    outcomes: Outcomes, scores: Scores, directory: Path, own: Collection[str] = ()
) -> tuple[Chart, ...]:
    """Draw all figures into the directory ``figures`` in a directory; ``own``: names in bold.

    Of a single seed there is none of ranks.
    """
    folder = directory / FIGURES
    folder.mkdir(parents=True, exist_ok=True)
    charts = []
    with matplotlib.rc_context(STUDY_STYLE):
        for drawn in _figures(outcomes, scores, own):
            save_png_and_pdf(drawn, folder)
            path = folder / f"{drawn.name}.png"
            charts.append(Chart(path, drawn.caption, drawn.alt, True))
    return tuple(charts)


def _figures(outcomes: Outcomes, scores: Scores, own: Collection[str]) -> Iterator[DrawnFigure]:
    yield draw_scores(scores, own)
    yield draw_tasks(outcomes, scores, own)
    if scores.of[0].is_bounded:
        yield draw_ranks(scores, own)


def draw_scores(scores: Scores, own: Collection[str] = ()) -> DrawnFigure:
    """Every score as a point, with its interval over seeds and the wider one over tasks too."""
    names = [score.policy for score in scores.of]
    figure = Figure((WIDTH_IN, ROW_IN * 1.25 * len(names) + 0.95), DOTS_PER_INCH)
    figure.set_layout_engine("constrained")
    axes = figure.subplots()
    for row, score in enumerate(scores.of):
        colour = COLOURS[1] if score.policy in own else COLOURS[0]
        wide, narrow = (
            100.0 * np.array(bounds[1:]) for bounds in (score.over_all, score.over_seeds)
        )
        axes.plot(wide, (row, row), color=colour, lw=1.0, marker="|", ms=6)
        axes.plot(narrow, (row, row), color=colour, lw=3.5, solid_capstyle="butt")
        axes.plot(100.0 * score.over_all.value, row, "o", color="white", mec=colour, mew=1.4, ms=5)
    axes.set_xlim(0.0, 100.0)
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.grid(axis="x", color="0.88", lw=0.6)
    axes.set_axisbelow(True)
    axes.set_xlabel("score: share of hunts with capture, mean over tasks (%)")
    _name_rows(axes, names, own, at=0.0)
    caption = (
        "Scores. Thick: 95 % interval over seeds, on these tasks. Thin: 95 % interval over seeds"
        " and tasks, for other tasks of this kind. Comparisons within seeds are sharper than these"
        " intervals, which are of each policy for itself."
        if scores.of[0].is_bounded
        else "Scores of a single seed, which has no intervals."
    )
    alt = "; ".join(f"{s.policy} {100.0 * s.over_all.value:.0f} %" for s in scores.of)
    return DrawnFigure("scores", figure, caption, f"Scores: {alt}.")


def draw_tasks(outcomes: Outcomes, scores: Scores, own: Collection[str] = ()) -> DrawnFigure:
    """A heat map of the share of seeds with capture, by task (down) and policy (across)."""
    names = [score.policy for score in scores.of]
    order = [outcomes.policies.index(name) for name in names]
    shares = 100.0 * outcomes.capture_shares[order].T
    figure, axes = _map_figure(shares, len(outcomes.tasks), "hunts with capture (%)", 100.0)
    labels = [_task_label(name) for name in outcomes.tasks]
    axes.set_yticks(np.arange(len(labels)) + 0.5, labels)
    _name_columns(axes, names, own)
    for row, (above, below) in enumerate(zip(outcomes.tasks, outcomes.tasks[1:], strict=False)):
        if task_named(above).scene != task_named(below).scene:
            axes.axhline(row + 1.0, color="white", lw=2.5)
    caption = (
        f"Share of {len(outcomes.seeds)} seeds with capture, in %, by task and policy. A task is a"
        " scene, a number of robots and a channel. Light is good. Policies stand in the order of"
        " their scores, the highest on the left."
    )
    alt = f"Heat map of {len(labels)} tasks by {len(names)} policies, {_span(shares)} %."
    return DrawnFigure("tasks", figure, caption, alt)


def draw_ranks(scores: Scores, own: Collection[str] = ()) -> DrawnFigure:
    """A heat map of how often each policy (down) held each rank (across) in the resamples."""
    names = [score.policy for score in scores.of]
    shares = 100.0 * np.stack([score.rank_shares for score in scores.of])
    figure, axes = _map_figure(shares, len(names), "resamples (%)", 100.0, blank=0.5)
    _name_rows(axes, names, own, at=0.5)
    axes.set_xticks(np.arange(len(names)) + 0.5, [str(k + 1) for k in range(len(names))])
    axes.set_xlabel("rank")
    axes.xaxis.set_label_position("bottom")
    caption = (
        "How often each policy holds each rank when seeds and tasks are drawn with replacement, in"
        " % of the resamples; cells below 0.5 % have no number. Policies with equal scores share"
        " their ranks in equal parts."
    )
    alt = "; ".join(f"{s.policy} mostly rank {1 + int(s.rank_shares.argmax())}" for s in scores.of)
    return DrawnFigure("ranks", figure, caption, f"Shares of ranks: {alt}.")


def _map_figure(
    values: Floats, rows: int, label: str, most: float, blank: float = -1.0
) -> tuple[Figure, Axes]:
    """A map of values with their numbers, but for those below ``blank``."""
    figure = Figure((WIDTH_IN, ROW_IN * rows + AROUND_IN), DOTS_PER_INCH)
    figure.set_layout_engine("constrained")
    axes = figure.subplots()
    norm, colours = Normalize(0.0, most), matplotlib.colormaps[COLOUR_MAP]
    axes.pcolormesh(values, norm=norm, cmap=colours, edgecolors="white", linewidth=0.4)
    axes.invert_yaxis()
    axes.tick_params(length=0)
    bar = figure.colorbar(ScalarMappable(norm, colours), ax=axes, location="bottom", aspect=45)
    bar.set_label(label)
    for (y, x), on_light in np.ndenumerate(_is_light(colours(norm(values)))):
        if values[y, x] >= blank:
            colour = "black" if on_light else "white"
            text = f"{values[y, x]:.0f}"
            axes.text(
                x + 0.5, y + 0.5, text, ha="center", va="center", fontsize=NUMBER_PT, color=colour
            )
    return figure, axes


def _is_light(coded: NDArray[Any]) -> NDArray[np.bool_]:
    linear = np.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4)
    return np.asarray(linear[..., :3] @ (0.2126, 0.7152, 0.0722) > LIGHT_MIN)


def _task_label(name: str) -> str:
    task = task_named(name)
    return f"{task.scene}, {task.robots}, {task.channel}"


def _name_rows(axes: Axes, names: Sequence[str], own: Collection[str], at: float) -> None:
    axes.set_yticks(np.arange(len(names)) + at, [wrapped(name, NAME_LETTERS) for name in names])
    axes.tick_params(axis="y", length=0)
    _embolden(axes.get_yticklabels(), names, own)


def _name_columns(axes: Axes, names: Sequence[str], own: Collection[str]) -> None:
    labels = [wrapped(name, NAME_LETTERS) for name in names]
    axes.set_xticks(np.arange(len(names)) + 0.5, labels, rotation=45, ha="left")
    axes.xaxis.tick_top()
    _embolden(axes.get_xticklabels(), names, own)


def _embolden(labels: Sequence[Any], names: Sequence[str], own: Collection[str]) -> None:
    for label, name in zip(labels, names, strict=True):
        if name in own:
            label.set_fontweight("bold")


def _span(values: Floats) -> str:
    return f"{values.min():.0f} to {values.max():.0f}"
