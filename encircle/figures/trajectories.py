"""The picture of a whole hunt: every trail from its start, with times, silences and the end.

The axes hold what happened and little more, to one scale, and the picture takes their shape. Times
stand beside the trails as numbers of ticks, at the same ticks for all, so that places of one time
can be matched. Where a radio was off or a robot lost, its trail is underlaid.
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
    CAPTOR_FILL,
    COLOURS,
    DOTS_PER_INCH,
    LOST_LINE,
    SILENT_LINE,
    STOP_LINE,
    STYLE,
    TIME_MARK,
    body_handles,
    draw_bodies,
    draw_start_labels,
    draw_trails,
    set_ground,
)
from encircle.figures.labels import Label, add_labels, add_legend
from encircle.runlog.ground_truth import Floats, GroundTruth, spans

AXES_IN = (5.6, 6.4)
"""Width and height that the axes have at most."""
ASPECT_MAX = 5.0
LEFT_IN, RIGHT_IN, BOTTOM_IN, TOP_IN, LINE_IN = 0.62, 0.12, 0.5, 0.1, 0.16
WIDTH_IN_MIN = 4.0
LETTERS_PER_IN = 13.0
MARGIN_SHARE = 0.04
TIME_MARKS_MAX, TIMES_MAX = 6, 60
"""On each trail, and in the whole picture."""
ROUND = (1, 2, 5)


def paths_figure(ground_truth: GroundTruth, title: str, labelled: bool) -> Figure:
    """All trails with starts and final bodies; starts ``labelled`` S1.. and ST or not."""
    row, every = (
        len(ground_truth.ticks) - 1,
        time_step(ground_truth.last_tick, len(ground_truth.arena.ids)),
    )
    marked = (ground_truth.ticks > 0) & (ground_truth.ticks % every == 0)
    captors = (
        ground_truth.captors if len(ground_truth.captors) < len(ground_truth.arena.ids) else ()
    )
    with matplotlib.rc_context(STYLE):
        figure, axes = _ground(ground_truth, title)
        for flags, look in ((ground_truth.silent, SILENT_LINE), (ground_truth.lost, LOST_LINE)):
            for robot, first, after in _stretches(flags):
                part = ground_truth.robots[first : after + 1, robot]
                axes.plot(*part.T, **look, markevery=len(part), zorder=1.8)
        draw_trails(axes, ground_truth, row, marked)
        draw_bodies(axes, ground_truth, row, captors)
        if labelled:
            draw_start_labels(axes, ground_truth)
        add_legend(figure, axes, _handles(ground_truth, every if marked.any() else 0, captors))
        add_labels(axes, [*_absences(ground_truth), *_times(ground_truth, marked)])
    return figure


def time_step(last_tick: int, robots: int) -> int:
    """How many ticks apart times are marked: a round number, and few marks in all."""
    most = max(1, min(TIME_MARKS_MAX, TIMES_MAX // (robots + 1)))
    steps = (factor * int(10**power) for power in range(10) for factor in ROUND)
    return next(step for step in steps if last_tick // step <= most)


def _ground(ground_truth: GroundTruth, title: str) -> tuple[Figure, Axes]:
    """A figure with axes that are as large as what happened, and the title over them."""
    low, high = _extent(ground_truth)
    width, height = ((high - low) * min(AXES_IN / (high - low))).tolist()
    across = max(LEFT_IN + width + RIGHT_IN, WIDTH_IN_MIN)
    letters = int(LETTERS_PER_IN * (across - LEFT_IN))
    lines = [fill(line, letters) for line in title.splitlines()]
    text = "\n".join(lines)
    up = BOTTOM_IN + height + TOP_IN + LINE_IN * len(text.splitlines())
    figure = Figure(figsize=(across, up), dpi=DOTS_PER_INCH)
    axes = figure.add_axes((LEFT_IN / across, BOTTOM_IN / up, width / across, height / up))
    set_ground(axes, ground_truth, low, high)
    axes.set_title(text, loc="left", parse_math=False)
    return figure, axes


def _extent(ground_truth: GroundTruth) -> tuple[Floats, Floats]:
    """The corners of what is to be seen, in m: trails, bodies at the end, obstacles; (2,) each."""
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


def _handles(ground_truth: GroundTruth, every: int, captors: tuple[str, ...]) -> list[Artist]:
    """The legend's entries: bodies, and of the rest what there is; ``every``: 0 without times."""
    handles = body_handles(ground_truth)
    handles.append(Line2D([], [], **STOP_LINE, label="$D_{stop}$ about the target"))
    if captors:
        handles.append(Patch(**CAPTOR_FILL, label="captured it"))
    if every:
        text = f"every {every} ticks" if every > 1 else "every tick"
        handles.append(Line2D([], [], **TIME_MARK, label=f"{text}, numbered"))
    for flags, look, label in (
        (ground_truth.silent, SILENT_LINE, "radio off"),
        (ground_truth.lost, LOST_LINE, "lost"),
    ):
        if flags.any():
            handles.append(Line2D([], [], **look, label=label))
    return handles


def _stretches(flags: NDArray[np.bool_]) -> Iterator[tuple[int, int, int]]:
    """Robot, first row and the row after the last of each stretch where (T, N) flags are set."""
    for robot in range(flags.shape[1]):
        for first, after in spans(flags[:, robot]):
            yield robot, first, after


def _absences(ground_truth: GroundTruth) -> Iterator[Label]:
    """When silences and losses began and ended, by tick."""
    for flags, begun, ended in (
        (ground_truth.silent, "off", "on"),
        (ground_truth.lost, "lost", "back"),
    ):
        for robot, first, after in _stretches(flags):
            ends = [(begun, first), *([(ended, after)] if after < len(ground_truth.ticks) else [])]
            for word, row in ends:
                position = ground_truth.robots[row, robot]
                yield Label(
                    f"{word} {ground_truth.ticks[row]}", position, COLOURS[robot % len(COLOURS)]
                )


def _times(ground_truth: GroundTruth, marked: NDArray[np.bool_]) -> Iterator[Label]:
    """The ticks of the marks, the target's first."""
    count = len(ground_truth.arena.ids)
    for body in (count, *range(count)):
        colour = COLOURS[body % len(COLOURS)] if body < count else "black"
        for row in np.flatnonzero(marked):
            yield Label(f"{ground_truth.ticks[row]}", ground_truth.positions[row, body], colour)
