"""What Rerun shows when it opens an exported hunt: the views, where they stand, what is in them.

On the left the arena, and below it the worlds as single robots believe them, a tab each; on the
right ages as a heat map, events, numbers over time and modes.
"""

from collections.abc import Sequence
from typing import Any

import rerun as rr
import rerun.blueprint as rrb

from encircle.exports.rerun_columns import TICK, TIME
from encircle.scene.frame import Frame
from encircle.scene.palette import DARK, robot_colour
from encircle.scene.stage import Stage

TRAIL_TICKS = 60
BELIEF_TABS_MAX = 16
MARGIN_M = 2.0
EYE_HEIGHT_PER_M = 0.98
"""How high above the arena the eye has to be, per metre of the longer side, to see all of it."""


def blueprint(stage: Stage, frames: Sequence[Frame]) -> rrb.Blueprint:
    """The views of a hunt."""
    beliefs = rrb.Tabs(
        *(
            _arena(f"What {robot} believes", "/", _believed(robot), stage, frames)
            for robot in stage.robots[:BELIEF_TABS_MAX]
        ),
        active_tab=min(1, len(stage.robots) - 1),
    )
    arena = _arena("Arena", "/", ["/scene/**", "/trails/**"], stage, frames)
    ages = rrb.TensorView(
        origin="/ages",
        name="Age of information in ticks",
        scalar_mapping=rrb.TensorScalarMapping(colormap="viridis", mag_filter="nearest"),
    )
    told = rrb.Tabs(_events(), _document(), name="Events and run")
    aside = rrb.Vertical(
        rrb.Horizontal(ages, told),
        _plot("Distance from the target in m", ["/distances_m/**"], stage),
        rrb.Horizontal(
            _plot("Largest gap and slack in rad", ["/values/gap_rad", "/values/slack_rad"]),
            _plot("Mean age in ticks", ["/values/age_ticks_mean"]),
        ),
        rrb.Horizontal(
            _plot("Share delivered", ["/values/delivery_share"]),
            _plot("Conflicts in pairs", ["/values/conflicts"]),
        ),
        rrb.StateTimelineView(origin="/modes", name="Modes"),
        row_shares=[1.6, 1.0, 1.0, 1.0, 1.3],
    )
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(arena, beliefs, row_shares=[1.2, 1.0]), aside, column_shares=[1.1, 1.0]
        ),
        rrb.TimePanel(timeline=TIME, state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_views=False,
    )


def _believed(robot: str) -> list[str]:
    return [f"/beliefs/{robot}/**", "/scene/arena/**", f"/scene/bodies/{robot}", "/outlines/**"]


def _arena(
    name: str, origin: str, contents: list[str], stage: Stage, frames: Sequence[Frame]
) -> rrb.Spatial3DView:
    # A target that escapes would make everything else small.
    points = [frames[0].target, *(point for frame in frames for point in frame.robots)]
    xs, ys = [x for x, _ in points], [y for _, y in points]
    centre = ((min(xs) + max(xs)) / 2.0, (min(ys) + max(ys)) / 2.0)
    side_m = max(max(xs) - min(xs), max(ys) - min(ys)) + 2.0 * MARGIN_M
    trails: dict[Any, Any] = {
        f"/trails/{body}": rrb.VisibleTimeRanges(_lately()) for body in (*stage.robots, "target")
    }
    return rrb.Spatial3DView(
        origin=origin,
        contents=contents,
        name=name,
        background=_colour(DARK["background"]),
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=(*centre, EYE_HEIGHT_PER_M * side_m),
            look_target=(*centre, 0.0),
            eye_up=(0.0, 1.0, 0.0),
        ),
        line_grid=rrb.LineGrid3D(visible=True, spacing=5.0, color=_colour(DARK["grid"])),
        overrides=trails,
    )


def _lately() -> list[rrb.VisibleTimeRange]:
    start = rrb.TimeRangeBoundary.cursor_relative(seq=-TRAIL_TICKS)
    end = rrb.TimeRangeBoundary.cursor_relative()
    return [rrb.VisibleTimeRange(TICK, start=start, end=end)]


def _plot(name: str, contents: list[str], stage: Stage | None = None) -> rrb.TimeSeriesView:
    """A plot over time; with a stage of numbers by robot, in the robots' colours."""
    robots = () if stage is None else stage.robots
    overrides: dict[Any, Any] = {
        f"/distances_m/{robot}": rr.SeriesLines(colors=[_colour(robot_colour(k))], names=[robot])
        for k, robot in enumerate(robots)
    }
    return rrb.TimeSeriesView(origin="/", contents=contents, name=name, overrides=overrides)


def _document() -> rrb.TextDocumentView:
    return rrb.TextDocumentView(origin="/run", name="Run")


def _events() -> rrb.TextLogView:
    columns = rrb.TextLogColumns(text_log_columns=["loglevel", "body"])
    return rrb.TextLogView(origin="/events", name="Events", columns=columns)


def _colour(code: str) -> list[int]:
    return [int(code[k : k + 2], 16) for k in (1, 3, 5)]
