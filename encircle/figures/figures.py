"""Figures of runs, in the manner of the paper's: trajectories, snapshots, execution times.

What they are drawn with is in ``encircle.figures.drawing``, what they show in
``encircle.runlog.ground_truth``.
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
    COLOURS,
    DOTS_PER_INCH,
    LINES,
    MARKERS,
    RING_LINE,
    SIGHT_FILL,
    SIGHT_LINE,
    STOP_LINE,
    STYLE,
    WIDTH_IN,
    body_handles,
    draw_bodies,
    draw_sensing,
    draw_trails,
    note,
    panels_figure,
    png_of,
    save,
)
from encircle.figures.trajectories import paths_figure
from encircle.protocol.parameters import Parameters
from encircle.protocol.process.log import printable
from encircle.runlog.ground_truth import Floats, commands_at, ground_truth_of, ring_centre
from encircle.world.recording.recording import Recording, read_recording


@dataclass(frozen=True, slots=True)
class TimeCurve:
    """Execution times of one policy, in ticks, over R3's starting x.

    ``typical``: (X, 3) mean of the middle half of the runs, and its interval; ``mean``: (X, 3)
    mean with runs without capture counted as the longest, a lower bound, and its interval;
    ``missed``: runs without capture at each x.
    """

    label: str
    x_m: tuple[float, ...]
    typical: Floats
    mean: Floats
    missed: tuple[int, ...]


def draw_run(directory: Path, path: Path) -> Path:
    """Draw the trajectories of a recorded run, finished or not, as a PNG; returns its path."""
    return save(_run_figure(directory), path)


def picture_of_run(directory: Path) -> bytes:
    """As ``draw_run``, the PNG itself."""
    return png_of(_run_figure(directory))


def _run_figure(directory: Path) -> Figure:
    ground_truth = ground_truth_of(read_recording(directory))
    title = "\n".join(
        map(printable, filter(None, (ground_truth.scenario.title, ground_truth.outcome)))
    )
    return paths_figure(ground_truth, title, labelled=False)


def draw_trajectories(recording: Recording, path: Path) -> Path:
    """Trajectories in the manner of the paper's Figs. 4 and 6, starts labelled S1.. and ST."""
    return save(paths_figure(ground_truth_of(recording), "", labelled=True), path)


def draw_snapshots(
    recording: Recording, ticks: Sequence[int], path: Path, captions: Sequence[str] = ("",) * 4
) -> Path:
    """Four snapshots in the manner of the paper's Figs. 3 and 5, trails up to each tick."""
    assert len(ticks) == 4, f"four ticks fill the panels, not {len(ticks)}"
    ground_truth = ground_truth_of(recording)
    rho = Parameters.from_mapping(ground_truth.scenario.parameters).ring_radius_m
    handles = [
        *body_handles(ground_truth),
        Line2D([], [], **RING_LINE, label="ring of encirclement"),
        Line2D([], [], **STOP_LINE, label="$D_{stop}$ about the target"),
        Patch(**SIGHT_FILL, label="robots' sensing range"),
        Line2D([], [], **SIGHT_LINE, label="target's sensing range"),
    ]
    with matplotlib.rc_context(STYLE):
        figure, panels = panels_figure(ground_truth, ground_truth.row(max(ticks)), 2, handles)
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
        return save(figure, path)


def draw_execution_times(table: Sequence[TimeCurve], path: Path) -> Path:
    """Execution time against R3's starting x for each policy, in the manner of Fig. 7.

    Above, typical times with their intervals; below, means, with the number of runs without capture
    where there are any. What more of these could make of the means is told and not drawn: bars so
    long would hide the rest.
    """
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH_IN, 5.4), dpi=DOTS_PER_INCH, layout="constrained")
        above, below = figure.subplots(2, 1, sharex=True)
        spacing = float(np.diff(table[0].x_m).min()) if len(table[0].x_m) > 1 else 1.0
        for index, curve in enumerate(table):
            # Side by side around each x, so that bars do not hide one another.
            x = np.array(curve.x_m) + 0.12 * spacing * (index - (len(table) - 1) / 2)
            look: dict[str, Any] = {
                "color": COLOURS[index],
                "ls": LINES[index],
                "marker": MARKERS[index],
                "label": curve.label,
            }
            typical, low, high = curve.typical.T
            bars = [typical - low, high - typical]
            above.errorbar(x, typical, bars, **look, ms=4, lw=0.9, elinewidth=0.8, capsize=2)
            below.plot(x, curve.mean[:, 0], **look, ms=4, lw=0.9)
            for at, mean, missed in zip(x, curve.mean[:, 0], curve.missed, strict=True):
                if missed:
                    note(below, f"{missed}", (at, mean), (0.0, 5.0), 7.0, COLOURS[index])
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
        return save(figure, path)
