"""The figure of a whole hunt: every trail from its start, with times, radio outages and the end.

The axes show little more than the area in which something happened, with equal scales, and the
figure takes their shape. Numbers beside the trails give times in ticks. All trails are marked at
the same ticks, so that a reader can match positions of one time. A trail is underlaid where the
robot's radio was off or the robot was lost.
"""

from collections.abc import Iterator
from textwrap import fill

import matplotlib
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from encircle.figures.drawing import (
    BASE_STYLE,
    CAPTOR_FILL,
    COLOURS,
    DOTS_PER_INCH,
    LOST_LINE,
    SILENT_LINE,
    STOP_DISTANCE_LINE,
    TIME_MARK,
    body_handles,
    draw_bodies,
    draw_start_labels,
    draw_trails,
    set_map_axes,
)
from encircle.figures.labels import Label, add_labels, add_legend
from encircle.runlog.ground_truth import Floats, GroundTruth, spans

AXES_IN_MAX = (5.6, 6.4)
"""The largest width and height of the axes."""
ASPECT_MAX = 5.0
LEFT_IN, RIGHT_IN, BOTTOM_IN, TOP_IN, LINE_IN = 0.62, 0.12, 0.5, 0.1, 0.16
WIDTH_IN_MIN = 4.0
LETTERS_PER_IN = 13.0
MARGIN_SHARE = 0.04
TIME_MARKS_MAX, TIMES_MAX = 6, 60
"""How many times are marked on each trail, and in the whole figure."""
ROUND_FACTORS = (1, 2, 5)


def trajectories_figure(ground_truth: GroundTruth, title: str, labelled: bool) -> Figure:
    """A figure of all trails, starts and final bodies; ``labelled``: starts named S1.. and ST."""
    row, period_ticks = (
        len(ground_truth.ticks) - 1,
        time_mark_period_ticks(ground_truth.last_tick, len(ground_truth.arena.ids)),
    )
    marked = (ground_truth.ticks > 0) & (ground_truth.ticks % period_ticks == 0)
    captors = (
        ground_truth.captors if len(ground_truth.captors) < len(ground_truth.arena.ids) else ()
    )
    with matplotlib.rc_context(BASE_STYLE):
        figure, axes = _map_figure(ground_truth, title)
        for flags, style in ((ground_truth.silent, SILENT_LINE), (ground_truth.lost, LOST_LINE)):
            for robot, first, after in _flagged_spans(flags):
                part = ground_truth.robots[first : after + 1, robot]
                axes.plot(*part.T, **style, markevery=len(part), zorder=1.8)
        draw_trails(axes, ground_truth, row, marked)
        draw_bodies(axes, ground_truth, row, captors)
        if labelled:
            draw_start_labels(axes, ground_truth)
        add_legend(
            figure,
            axes,
            _legend_handles(ground_truth, period_ticks if marked.any() else 0, captors),
        )
        add_labels(axes, [*_absence_labels(ground_truth), *_time_labels(ground_truth, marked)])
    return figure


def time_mark_period_ticks(last_tick: int, robots: int) -> int:
    """How many ticks lie between time marks: a round number, such that there are few marks."""
    most = max(1, min(TIME_MARKS_MAX, TIMES_MAX // (robots + 1)))
    steps = (factor * int(10**power) for power in range(10) for factor in ROUND_FACTORS)
    return next(step for step in steps if last_tick // step <= most)


def _map_figure(ground_truth: GroundTruth, title: str) -> tuple[Figure, Axes]:
    """A figure whose axes are as large as the area in which something happened, with a title."""
    low, high = _map_extent(ground_truth)
    width, height = ((high - low) * min(AXES_IN_MAX / (high - low))).tolist()
    across = max(LEFT_IN + width + RIGHT_IN, WIDTH_IN_MIN)
    letters = int(LETTERS_PER_IN * (across - LEFT_IN))
    lines = [fill(line, letters) for line in title.splitlines()]
    text = "\n".join(lines)
    up = BOTTOM_IN + height + TOP_IN + LINE_IN * len(text.splitlines())
    figure = Figure(figsize=(across, up), dpi=DOTS_PER_INCH)
    axes = figure.add_axes((LEFT_IN / across, BOTTOM_IN / up, width / across, height / up))
    set_map_axes(axes, ground_truth, low, high)
    axes.set_title(text, loc="left", parse_math=False)
    return figure, axes


def _map_extent(ground_truth: GroundTruth) -> tuple[Floats, Floats]:
    """Corners (2,) and (2,) in m of the area that holds trails, final bodies and obstacles."""
    team, target = ground_truth.scenario.team, ground_truth.scenario.target
    stop_m = max(ground_truth.scenario.capture.stop_distance_m, target.radius_m)
    discs = [(position, team.radius_m) for position in ground_truth.robots[-1].tolist()]
    discs += [(ground_truth.target[-1].tolist(), stop_m)]
    discs += [
        (obstacle.position, obstacle.radius_m) for obstacle in ground_truth.scenario.obstacles
    ]
    centres, radii = np.array([d[0] for d in discs]), np.array([[d[1]] for d in discs])
    shown = np.vstack([ground_truth.positions.reshape(-1, 2), centres - radii, centres + radii])
    low, high = shown.min(axis=0), shown.max(axis=0)
    spread = np.maximum(high - low, (high - low).max() / ASPECT_MAX)
    middle, half = (low + high) / 2.0, spread / 2.0 + MARGIN_SHARE * spread.max()
    return middle - half, middle + half


def _legend_handles(
    ground_truth: GroundTruth, period_ticks: int, captors: tuple[str, ...]
) -> list[Artist]:
    """The legend's entries. ``period_ticks``: ticks between time marks, 0 if there are none."""
    handles = body_handles(ground_truth)
    handles.append(Line2D([], [], **STOP_DISTANCE_LINE, label="$D_{stop}$ about the target"))
    if captors:
        handles.append(Patch(**CAPTOR_FILL, label="captured it"))
    if period_ticks:
        text = f"every {period_ticks} ticks" if period_ticks > 1 else "every tick"
        handles.append(Line2D([], [], **TIME_MARK, label=f"{text}, numbered"))
    for flags, style, label in (
        (ground_truth.silent, SILENT_LINE, "radio off"),
        (ground_truth.lost, LOST_LINE, "lost"),
    ):
        if flags.any():
            handles.append(Line2D([], [], **style, label=label))
    return handles


def _flagged_spans(flags: NDArray[np.bool_]) -> Iterator[tuple[int, int, int]]:
    """Robot, first row and row after the last of each span in which flags (T, N) are set."""
    for robot in range(flags.shape[1]):
        for first, after in spans(flags[:, robot]):
            yield robot, first, after


def _absence_labels(ground_truth: GroundTruth) -> Iterator[Label]:
    """Labels with the ticks at which radio outages and losses of robots began and ended."""
    for flags, start_text, end_text in (
        (ground_truth.silent, "off", "on"),
        (ground_truth.lost, "lost", "back"),
    ):
        for robot, first, after in _flagged_spans(flags):
            ends = [
                (start_text, first),
                *([(end_text, after)] if after < len(ground_truth.ticks) else []),
            ]
            for word, row in ends:
                position = ground_truth.robots[row, robot]
                yield Label(
                    f"{word} {ground_truth.ticks[row]}", position, COLOURS[robot % len(COLOURS)]
                )


def _time_labels(ground_truth: GroundTruth, marked: NDArray[np.bool_]) -> Iterator[Label]:
    """Labels with the ticks of the time marks, those of the target first."""
    count = len(ground_truth.arena.ids)
    for body in (count, *range(count)):
        colour = COLOURS[body % len(COLOURS)] if body < count else "black"
        for row in np.flatnonzero(marked):
            yield Label(f"{ground_truth.ticks[row]}", ground_truth.positions[row, body], colour)
