"""Drawing functions and line styles that the figures of runs share: trails, bodies, legends.

Bodies are drawn to scale. The colours are those of Okabe and Ito, which readers with a colour
vision deficiency can tell apart. Robots also differ in line style, marker and number, so that a
figure in greyscale shows the same. Legends stand below the axes, where they cover no data, and name
at most ``NAMED_ROBOTS_MAX`` robots.
"""

from collections.abc import Sequence
from io import BytesIO
from math import ceil
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from encircle.protocol.messages import Point
from encircle.runlog.ground_truth import Floats, GroundTruth

NAMED_ROBOTS_MAX = 8
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
LINE_STYLES: tuple[Any, ...] = (
    "-",
    (0, (6, 2)),
    (0, (6, 2, 1, 2)),
    (0, (1.5, 1)),
    (0, (9, 3)),
    "--",
)
MARKERS = ("o", "s", "^", "D", "v", "P")
TARGET_LINE: dict[str, Any] = {"color": "black", "ls": "-", "lw": 1.6}
RING_LINE: dict[str, Any] = {"color": "0.35", "ls": (0, (1, 1.5)), "lw": 1.2}
STOP_DISTANCE_LINE: dict[str, Any] = {"color": "black", "ls": "-", "lw": 0.6}
TARGET_SENSING_LINE: dict[str, Any] = {"color": "black", "ls": (0, (8, 4)), "lw": 0.5}
ROBOT_SENSING_FILL: dict[str, Any] = {"facecolor": "#56B4E91C", "edgecolor": COLOURS[5], "lw": 0.5}
TIME_MARK: dict[str, Any] = {"color": "black", "ls": "", "marker": ".", "ms": 4}
SILENT_LINE: dict[str, Any] = {"color": "0.78", "ls": "-", "lw": 6.0, "solid_capstyle": "butt"}
LOST_LINE: dict[str, Any] = {
    "color": "0.45",
    "ls": (0, (0.3, 0.3)),
    "lw": 5.0,
    "marker": "x",
    "ms": 8,
    "mec": "black",
    "mew": 1.8,
}
CAPTOR_FILL: dict[str, Any] = {"facecolor": "0.85", "edgecolor": "black", "lw": 1.2}
MOVED_BY_HAND_LINE: dict[str, Any] = {"color": "black", "ls": (0, (2, 2)), "lw": 0.9}
OBSTACLE_FILL: dict[str, Any] = {
    "facecolor": "0.75",
    "edgecolor": "0.4",
    "hatch": "////",
    "lw": 0.6,
}
MARGIN_M = 2.0
WIDTH_IN, HEIGHT_IN_MIN, HEIGHT_IN_MAX = 6.4, 3.2, 8.0
LEGEND_ROW_IN = 0.2
DOTS_PER_INCH = 200
LABEL_TICKS, LABEL_PT = 5, 11.0
NUMBER_PT_MIN = 5.0
BASE_STYLE: dict[Any, Any] = {
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "legend.fontsize": 8.0,
    "hatch.linewidth": 0.4,
    "figure.constrained_layout.h_pad": 0.07,
}


def snapshots_figure(
    ground_truth: GroundTruth, row: int, across: int, handles: Sequence[Artist]
) -> tuple[Figure, list[Axes]]:
    """A figure of ``across`` x ``across`` panels, with the legend below.

    All panels have the same limits: they show everything from the start up to the given row of
    the ground truth, and the obstacles.
    """
    shown = ground_truth.positions[: row + 1].reshape(-1, 2)
    fixed = [(*o.position, o.radius_m) for o in ground_truth.scenario.obstacles]
    corners = [(x + side * r, y + side * r) for x, y, r in fixed for side in (-1.0, 1.0)]
    everything = np.vstack([shown, *corners])
    low, high = everything.min(axis=0) - MARGIN_M, everything.max(axis=0) + MARGIN_M
    width, height = (high - low).tolist()
    # A legend with few entries has long ones, so fewer columns fit.
    columns = 5 if len(handles) > 8 else 4 if len(handles) > 6 else 3
    legend_in = LEGEND_ROW_IN * ceil(len(handles) / columns)
    tall = min(max(WIDTH_IN * height / width, HEIGHT_IN_MIN), HEIGHT_IN_MAX) + legend_in
    figure = Figure(figsize=(WIDTH_IN, tall), dpi=DOTS_PER_INCH, layout="constrained")
    panels = figure.subplots(across, across, sharex=True, sharey=True, squeeze=False)
    for axes in panels.flat:
        set_map_axes(axes, ground_truth, low, high)
    figure.legend(handles=handles, loc="outside lower center", ncols=columns)
    return figure, list(panels.flat)


def set_map_axes(axes: Axes, ground_truth: GroundTruth, low: Floats, high: Floats) -> None:
    """Show the plane from ``low`` (2,) to ``high`` (2,) in m, equal scales, with obstacles."""
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    axes.set(xlabel="x (m)", ylabel="y (m)")
    axes.locator_params(nbins=6, steps=[1, 2, 5, 10])
    axes.minorticks_on()
    for obstacle in ground_truth.scenario.obstacles:
        axes.add_patch(Circle(obstacle.position, obstacle.radius_m, **OBSTACLE_FILL))


def body_handles(ground_truth: GroundTruth) -> list[Artist]:
    """Legend entries of robots, target and obstacles; a large team has one entry for all robots."""
    count = len(ground_truth.arena.ids)
    target = Line2D([], [], **TARGET_LINE, marker="*", ms=8, mfc="white", label="target")
    handles: list[Artist] = [
        Line2D([], [], **_line_style(k, count), marker=_marker(k), mfc="white", ms=5, label=robot)
        for k, robot in enumerate(
            ground_truth.arena.ids[: count if count <= NAMED_ROBOTS_MAX else 1]
        )
    ]
    if count > NAMED_ROBOTS_MAX:
        handles[0].set_label(f"{count} robots")
    if ground_truth.scenario.obstacles:
        handles.append(Patch(**OBSTACLE_FILL, label="obstacle"))
    handles.append(target)
    if ground_truth.moved_by_hand:
        handles.append(
            Line2D(
                [],
                [],
                **MOVED_BY_HAND_LINE,
                marker=">",
                ms=4,
                markevery=(1, 1),
                label="moved by hand",
            )
        )
    return handles


def _line_style(robot: int, count: int) -> dict[str, Any]:
    """Colour, dashes and width of a robot's line; thin and plain in a team too large to name."""
    colour = COLOURS[robot % len(COLOURS)]
    if count > NAMED_ROBOTS_MAX:
        return {"color": colour, "ls": "-", "lw": 0.6}
    return {"color": colour, "ls": LINE_STYLES[_style_index(robot)], "lw": 1.2}


def _marker(robot: int) -> str:
    return MARKERS[_style_index(robot)]


def _style_index(robot: int) -> int:
    """Index of a robot's line style and marker; robots of one colour get different ones."""
    return (robot + robot // len(COLOURS)) % len(MARKERS)


def draw_trails(
    axes: Axes, ground_truth: GroundTruth, row: int, marked: NDArray[np.bool_] | None = None
) -> None:
    """Draw the trails of all bodies up to a row, with hollow markers at their starts.

    ``marked``: (T,) whether a row gets a dot.
    """
    count = len(ground_truth.arena.ids)
    start: dict[str, Any] = {
        "mfc": "white",
        "ms": 5.0 if count <= NAMED_ROBOTS_MAX else 3.0,
        "ls": "",
        "zorder": 3,
    }
    for k in range(count):
        style, positions = _line_style(k, count), ground_truth.positions[: row + 1, k]
        axes.plot(*positions.T, **style, zorder=2)
        if row > 0:
            axes.plot(*positions[0], marker=_marker(k), color=style["color"], **start)
    cuts = [c for c in (ground_truth.row(t) for t in ground_truth.moved_by_hand) if c <= row]
    for part in np.split(ground_truth.target[: row + 1], cuts):
        axes.plot(*part.T, **TARGET_LINE, zorder=2)
    for cut in cuts:
        arrow = {**MOVED_BY_HAND_LINE, "arrowstyle": "->", "shrinkA": 0, "shrinkB": 4}
        axes.annotate(
            "", ground_truth.target[cut], ground_truth.target[cut - 1], arrowprops=arrow, zorder=4
        )
    if row > 0:
        axes.plot(*ground_truth.target[0], marker="*", color="black", **{**start, "ms": 8.0})
    if marked is not None:
        axes.plot(*ground_truth.positions[marked].reshape(-1, 2).T, **TIME_MARK, zorder=3)


def draw_bodies(
    axes: Axes, ground_truth: GroundTruth, row: int, filled: Sequence[str] = ()
) -> None:
    """Draw bodies at a row as discs to scale, under the trails, and D_stop around the target.

    ``filled``: ids of the robots whose discs are filled.
    """
    scenario, target = ground_truth.scenario, ground_truth.target[row]
    for k, (robot, position) in enumerate(
        zip(ground_truth.arena.ids, ground_truth.robots[row], strict=True)
    ):
        fill = CAPTOR_FILL["facecolor"] if robot in filled else "white"
        style = {"fc": fill, "ec": COLOURS[k % len(COLOURS)], "lw": 1.2, "zorder": 1.5}
        axes.add_patch(Circle(position, scenario.team.radius_m, **style))
        inside = scenario.team.radius_m * points_per_m(axes) >= NUMBER_PT_MIN
        if inside or len(ground_truth.arena.ids) <= NAMED_ROBOTS_MAX:
            _draw_number(axes, position, k + 1, position - target, scenario.team.radius_m)
    axes.add_patch(Circle(target, scenario.target.radius_m, fc="0.6", ec="black", zorder=1.5))
    axes.add_patch(
        Circle(target, scenario.capture.stop_distance_m, fill=False, **STOP_DISTANCE_LINE)
    )


def _draw_number(
    axes: Axes, position: Floats, number: int, outward: Floats, radius_m: float
) -> None:
    """Draw a robot's number in its disc; beside a small disc, on the side away from the target."""
    radius_pt = radius_m * points_per_m(axes)
    inside = radius_pt >= NUMBER_PT_MIN
    aside = (radius_pt + 5.0) * outward / max(float(np.hypot(*outward)), 1e-9)
    at = (0.0, 0.0) if inside else aside.tolist()
    draw_text(axes, f"{number}", position.tolist(), at, 7.5 if inside else 7.0)


def points_per_m(axes: Axes) -> float:
    """How many typographic points a metre has; approximate before the final layout."""
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    pixels = min(axes.bbox.width / (right - left), axes.bbox.height / (high - low))
    return float(72.0 * pixels / axes.figure.dpi)


def draw_start_labels(axes: Axes, ground_truth: GroundTruth) -> None:
    """Label starts S1.. and ST, on the side opposite to the trail."""
    names = [*(f"{k + 1}" for k in range(len(ground_truth.arena.ids))), "T"]
    left = ground_truth.positions[ground_truth.row(LABEL_TICKS)] - ground_truth.positions[0]
    for name, position, (dx, dy) in zip(
        names, ground_truth.positions[0].tolist(), left, strict=True
    ):
        far = max(float(np.hypot(dx, dy)), 1e-9)
        offset = (-LABEL_PT * float(dx) / far, -LABEL_PT * float(dy) / far)
        draw_text(axes, f"$S_{{{name}}}$", position, offset, 9.0)


def draw_text(
    axes: Axes,
    text: str,
    position: Point,
    offset_pt: tuple[float, float],
    size_pt: float,
    colour: str = "black",
) -> None:
    """Draw a short text with a white outline, at an offset from a position in data units."""
    axes.annotate(
        text,
        position,
        offset_pt,
        textcoords="offset points",
        ha="center",
        va="center",
        fontsize=size_pt,
        color=colour,
        zorder=7,
        path_effects=[withStroke(linewidth=1.5, foreground="white")],
    )


def png_of(figure: Figure) -> bytes:
    """A figure as a PNG."""
    FigureCanvasAgg(figure)
    made = BytesIO()
    figure.savefig(made, format="png")
    return made.getvalue()


def save_png(figure: Figure, path: Path) -> Path:
    """Write a figure as a PNG and return its path."""
    # One write of the whole file, so that Ctrl-C cannot leave half a figure.
    path.write_bytes(png_of(figure))
    return path


def warm_up() -> None:
    """Load fonts and formula parser of matplotlib, which would delay the first figure."""
    with matplotlib.rc_context(BASE_STYLE):
        figure = Figure()
        figure.text(0.5, 0.5, "words and $S_1$")
        png_of(figure)


def draw_sensing(axes: Axes, ground_truth: GroundTruth, row: int) -> None:
    """Draw the sensing ranges at a row: of robots as discs, of the target as an outline."""
    ranges_m = ground_truth.arena.ranges[:-1].tolist()
    for position, range_m in zip(ground_truth.robots[row].tolist(), ranges_m, strict=True):
        axes.add_patch(Circle(position, range_m, **ROBOT_SENSING_FILL, zorder=0))
    reach_m = ground_truth.scenario.target.sensing_range_m
    axes.add_patch(
        Circle(ground_truth.target[row], reach_m, fill=False, **TARGET_SENSING_LINE, zorder=1)
    )
