"""Figures of runs, in the manner of the paper's: trajectories, snapshots, execution times.

Bodies are drawn to scale. Colours are those of Okabe and Ito, which colour-blind readers can tell
apart; robots differ in line style, marker and number too, so that nothing is lost in greyscale.
Legends stand outside the axes, where they cannot cover data, and name at most ``NAMED_MAX`` robots.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch

from encircle.replaying import Recording, read_recording
from encircle.tracks import Floats, Tracks, commands_at, ring_centre, tracks_of
from protocol.parameters import Parameters

NAMED_MAX = 8
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
DASHES: tuple[tuple[float, ...], ...] = ((), (6, 2), (6, 2, 1.5, 2), (1.5, 1.5), (9, 3), (4, 1, 1, 1, 1, 1))  # fmt: skip
MARKERS = ("o", "s", "^", "D", "v", "P")
TARGET_COLOUR = "#000000"
TARGET_MARKER = "*"
OBSTACLE_COLOUR = "#999999"
RING_COLOUR = "#555555"
DOTS_MAX = 20
WIDTH_IN = 6.4
HEIGHT_IN_MIN, HEIGHT_IN_MAX = 3.2, 8.0
DOTS_PER_INCH = 200
STYLE = {"font.size": 9.0, "axes.titlesize": 9.0, "legend.fontsize": 8.0, "axes.linewidth": 0.6}


@dataclass(frozen=True, slots=True)
class TimeCurve:
    """Execution times of one policy, in ticks, over R3's starting x.

    ``typical``: (X, 3) mean and its interval over the seeds at which every policy captured;
    ``bounded``: (X, 3) the same over all seeds, each run without capture counted as the longest;
    ``escaped``: runs without capture at each x.
    """

    label: str
    x_m: tuple[float, ...]
    typical: Floats
    bounded: Floats
    escaped: tuple[int, ...]


def draw_run(directory: Path, path: Path) -> Path:
    """Draw the trajectories of a recorded run, finished or not, as a PNG; returns its path."""
    recording = read_recording(directory)
    tracks = tracks_of(recording)
    title = "\n".join(part for part in (tracks.scenario.title, tracks.outcome) if part)
    return _draw_trajectories(tracks, path, title, start_labels=False)


def draw_trajectories(recording: Recording, path: Path) -> Path:
    """Trajectories in the manner of the paper's Figs. 4 and 6, starts labelled S1.. and ST."""
    return _draw_trajectories(tracks_of(recording), path, "", start_labels=True)


def draw_snapshots(recording: Recording, ticks: Sequence[int], path: Path) -> Path:
    """Four snapshots in the manner of the paper's Figs. 3 and 5, trails up to each tick."""
    assert len(ticks) == 4, f"four ticks fill the panels, not {len(ticks)}"
    tracks = tracks_of(recording)
    parameters = Parameters.from_mapping(tracks.scenario.parameters)
    low, high = _limits(tracks, tracks.row(max(ticks)))
    with matplotlib.rc_context(STYLE):
        figure, panels = _figure(low, high, 2)
        for letter, tick, axes in zip("abcd", ticks, panels, strict=True):
            row = tracks.row(tick)
            _frame(axes, low, high)
            _sensing(axes, tracks, row)
            _obstacles(axes, tracks)
            _trails(axes, tracks, row)
            _bodies(axes, tracks, row)
            centre = ring_centre(commands_at(recording, tick), parameters.ring_radius_m)
            if centre is not None:
                _ring(axes, centre, parameters.ring_radius_m)
            if tracks.captured and tick == tracks.last_tick:
                _stop_circle(axes, tracks, row)
            axes.set_title(f"({letter}) tick {tick}")
            axes.label_outer()
        handles = [
            *_robot_handles(tracks),
            Line2D([], [], color=RING_COLOUR, ls=(0, (1, 1.5)), lw=1.2, label="ring of encirclement"),
            Patch(color=COLOURS[0], alpha=0.14, lw=0, label="robots' sensing range"),
            Line2D([], [], color=TARGET_COLOUR, ls=(0, (4, 3)), lw=0.6, label="target's sensing range"),
            *_other_handles(tracks),
        ]
        return _save(figure, path, handles)


def draw_execution_times(table: Sequence[TimeCurve], path: Path) -> Path:
    """Execution time against R3's starting x for each policy, in the manner of Fig. 7.

    Above, the mean over the seeds at which every policy captured; below, over all seeds, with runs
    without capture counted as the longest run, which bounds the mean from below. Numbers beside
    points count those runs. Bars are the intervals in the table.
    """
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH_IN, 5.6), dpi=DOTS_PER_INCH, layout="constrained")
        above, below = figure.subplots(2, 1, sharex=True)
        step = np.diff(table[0].x_m).min() if len(table[0].x_m) > 1 else 1.0
        for place, curve in enumerate(table):
            # Side by side within a step of x, so that bars do not hide one another.
            x = np.array(curve.x_m) + step * 0.12 * (place - (len(table) - 1) / 2)
            for axes, rows in ((above, curve.typical), (below, curve.bounded)):
                mean, low, high = rows.T
                axes.errorbar(
                    x, mean, np.abs([mean - low, high - mean]), color=COLOURS[place],
                    dashes=DASHES[place] or (None, None), marker=MARKERS[place], ms=4, lw=1.0,
                    capsize=2, elinewidth=0.8, label=curve.label,
                )  # fmt: skip
            for at, high, escaped in zip(x, curve.bounded[:, 2], curve.escaped, strict=True):
                if escaped:
                    below.annotate(
                        str(escaped), (at, high), (0, 2), textcoords="offset points",
                        ha="center", va="bottom", color=COLOURS[place], fontsize=7,
                    )  # fmt: skip
        above.set_title("(a) seeds at which all four policies captured")
        below.set_title("(b) all seeds; runs without capture (counted beside) as the longest run")
        below.set_xlabel("initial $x$ of R3 (m)")
        for axes in (above, below):
            axes.set_ylabel("execution time (ticks)")
            axes.grid(alpha=0.25, lw=0.5)
        return _save(figure, path, [], above.get_legend_handles_labels()[0])


def _draw_trajectories(tracks: Tracks, path: Path, title: str, start_labels: bool) -> Path:
    row = len(tracks.ticks) - 1
    low, high = _limits(tracks, row)
    with matplotlib.rc_context(STYLE):
        figure, (axes,) = _figure(low, high, 1)
        _frame(axes, low, high)
        _obstacles(axes, tracks)
        _trails(axes, tracks, row)
        every = _tick_dots(axes, tracks)
        _bodies(axes, tracks, row)
        _stop_circle(axes, tracks, row)
        if start_labels:
            _start_labels(axes, tracks)
        axes.set_title(title)
        handles = [
            *_robot_handles(tracks),
            Line2D([], [], color=TARGET_COLOUR, ls=(0, (1, 1)), lw=0.9, label="$D_{stop}$ about target"),
            Line2D([], [], color="0.3", ls="", marker=".", ms=3, label=f"every {every} ticks"),
            *_other_handles(tracks),
        ]
        return _save(figure, path, handles)
