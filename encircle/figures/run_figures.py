"""Figures of recorded runs in the style of the paper: trajectories, snapshots, execution times.

A figure is drawn from the ground truth of a recording (``encircle.runlog.ground_truth``), with the
drawing functions of ``encircle.figures.drawing`` and ``encircle.figures.trajectories``, and written
as a PNG. The figures of studies are in ``encircle.studies.charts``.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch

from encircle.figures.drawing import (
    BASE_STYLE,
    COLOURS,
    DOTS_PER_INCH,
    LINE_STYLES,
    MARKERS,
    RING_LINE,
    ROBOT_SENSING_FILL,
    STOP_DISTANCE_LINE,
    TARGET_SENSING_LINE,
    WIDTH_IN,
    body_handles,
    draw_bodies,
    draw_sensing,
    draw_text,
    draw_trails,
    png_of,
    save_png,
    snapshots_figure,
)
from encircle.figures.trajectories import trajectories_figure
from encircle.protocol.parameters import Parameters
from encircle.protocol.process.log import printable
from encircle.runlog.ground_truth import Floats, commands_at, ground_truth_of, ring_centre
from encircle.world.recording.recording import Recording, read_recording


@dataclass(frozen=True, slots=True)
class TimeCurve:
    """Execution times of one policy, in ticks, over the starting x of R3.

    ``x_m``: (X,) starts in m. ``typical``: (X, 3) mean of the middle half of the runs, and its
    interval. ``mean``: (X, 3) mean of all runs, and its interval; a run without capture counts
    as the longest time, so that this mean is a lower bound. ``missed``: (X,) number of runs
    without capture.
    """

    label: str
    x_m: tuple[float, ...]
    typical: Floats
    mean: Floats
    missed: tuple[int, ...]


def draw_run(directory: Path, path: Path) -> Path:
    """Draw the trajectories of a recorded run, finished or not, as a PNG; returns its path."""
    return save_png(_run_figure(directory), path)


def picture_of_run(directory: Path) -> bytes:
    """The PNG that ``draw_run`` writes, as bytes."""
    return png_of(_run_figure(directory))


def _run_figure(directory: Path) -> Figure:
    ground_truth = ground_truth_of(read_recording(directory))
    title = "\n".join(
        map(printable, filter(None, (ground_truth.scenario.title, ground_truth.outcome)))
    )
    return trajectories_figure(ground_truth, title, labelled=False)


def draw_trajectories(recording: Recording, path: Path) -> Path:
    """Draw trajectories as in the paper's Figs. 4 and 6, with starts labelled S1.. and ST."""
    return save_png(trajectories_figure(ground_truth_of(recording), "", labelled=True), path)


def draw_snapshots(
    recording: Recording, ticks: Sequence[int], path: Path, captions: Sequence[str] = ("",) * 4
) -> Path:
    """Draw four snapshots as in the paper's Figs. 3 and 5, with trails up to each tick.

    ``ticks`` and ``captions``: four each.
    """
    assert len(ticks) == 4, f"four ticks fill the panels, not {len(ticks)}"
    ground_truth = ground_truth_of(recording)
    rho = Parameters.from_mapping(ground_truth.scenario.parameters).ring_radius_m
    handles = [
        *body_handles(ground_truth),
        Line2D([], [], **RING_LINE, label="ring of encirclement"),
        Line2D([], [], **STOP_DISTANCE_LINE, label="$D_{stop}$ about the target"),
        Patch(**ROBOT_SENSING_FILL, label="robots' sensing range"),
        Line2D([], [], **TARGET_SENSING_LINE, label="target's sensing range"),
    ]
    with matplotlib.rc_context(BASE_STYLE):
        figure, panels = snapshots_figure(ground_truth, ground_truth.row(max(ticks)), 2, handles)
        for letter, tick, caption, axes in zip("abcd", ticks, captions, panels, strict=True):
            row = ground_truth.row(tick)
            draw_sensing(axes, ground_truth, row)
            draw_trails(axes, ground_truth, row)
            draw_bodies(axes, ground_truth, row)
            centre = ring_centre(commands_at(recording, tick), rho)
            if centre is not None:
                axes.add_patch(Circle(centre, rho, fill=False, **RING_LINE))
            axes.set_title(f"({letter}) tick {tick}" + (f": {caption}" if caption else ""))
            axes.label_outer()
        return save_png(figure, path)


def draw_execution_times(table: Sequence[TimeCurve], path: Path) -> Path:
    """Draw execution time against the starting x of R3 for each policy, as in the paper's Fig. 7.

    The upper panel shows typical times with their intervals. The lower panel shows means, with
    the number of runs without capture where there are any. The intervals of the means are too
    long to draw without hiding the rest, so the title of the panel gives their highest bound.
    """
    with matplotlib.rc_context(BASE_STYLE):
        figure = Figure(figsize=(WIDTH_IN, 5.4), dpi=DOTS_PER_INCH, layout="constrained")
        above, below = figure.subplots(2, 1, sharex=True)
        spacing = float(np.diff(table[0].x_m).min()) if len(table[0].x_m) > 1 else 1.0
        for index, curve in enumerate(table):
            # Curves are moved sideways around each x, so that bars do not hide each other.
            x = np.array(curve.x_m) + 0.12 * spacing * (index - (len(table) - 1) / 2)
            style: dict[str, Any] = {
                "color": COLOURS[index],
                "ls": LINE_STYLES[index],
                "marker": MARKERS[index],
                "label": curve.label,
            }
            typical, low, high = curve.typical.T
            bars = [typical - low, high - typical]
            above.errorbar(x, typical, bars, **style, ms=4, lw=0.9, elinewidth=0.8, capsize=2)
            below.plot(x, curve.mean[:, 0], **style, ms=4, lw=0.9)
            for at, mean, missed in zip(x, curve.mean[:, 0], curve.missed, strict=True):
                if missed:
                    draw_text(below, f"{missed}", (at, mean), (0.0, 5.0), 7.0, COLOURS[index])
        above.set_title("(a) mean of the middle half of the runs, with 95 % intervals")
        highest = max(float(curve.mean[:, 2].max()) for curve in table)
        below.set_title(
            "(b) mean of all runs, those without capture (numbers) counted as the longest;\n"
            f"with more of these than were seen, 95 % intervals reach up to {highest:.0f} ticks"
        )
        below.set_xlabel("initial x of R3 (m)")
        for axes in (above, below):
            axes.set_ylabel("execution time (ticks)")
            axes.margins(y=0.12)
            axes.grid(alpha=0.25, lw=0.5)
        figure.legend(
            handles=above.get_legend_handles_labels()[0], loc="outside lower center", ncols=4
        )
        return save_png(figure, path)
