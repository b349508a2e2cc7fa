"""A layout for Foxglove that shows the topics of an exported or live hunt, for its robots.

On the left the arena, and below it the world as one robot believes it; on the right numbers over
time, modes and events. It is made from a recording, but fits every hunt with these robots.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from foxglove import layouts as fl

from encircle.exports.drawing.shapes import FRAME_ID
from encircle.scene.palette import DARK, robot_colour
from encircle.scene.stage import Stage, stage_of
from encircle.world.recording.recording import Recording

LAYERS = ("arena", "bodies", "plan", "packets")
VIEW_M = 40.0
"""How far from the arena the camera is."""


def export(recording: Recording, out: Path) -> None:
    """Write a layout for a recording's robots to a new file, as JSON."""
    stage = stage_of(recording.scenario, recording.seed, recording.run)
    with open(out, "x", encoding="utf-8") as file:
        file.write(layout(stage).to_json() + "\n")


def layout(stage: Stage) -> fl.Layout:
    """The panels for a hunt's robots."""
    robots = stage.robots
    believer = robots[min(1, len(robots) - 1)]
    arena = _view("Arena", stage, [f"/scene/{layer}" for layer in LAYERS])
    belief = [f"/scene/beliefs/{believer}", "/scene/arena"]
    believed = _view(f"What {believer} believes", stage, belief)
    distances = {f"/distances_m.{r}": (r, robot_colour(k)) for k, r in enumerate(robots)}
    aside = [
        _plot("Distance from the target in m", distances),
        _plot("Largest gap and slack in rad", _values("gap_rad", "slack_rad")),
        _plot("Mean age in ticks", _values("age_ticks_mean")),
        _plot("Share delivered, and conflicts in pairs", _values("delivery_share", "conflicts")),
        fl.StateTransitionsPanel(
            title="Modes",
            config=fl.StateTransitionsConfig(
                paths=[fl.StateTransitionsSeries(value=f"/decisions/{r}.mode") for r in robots]
            ),
        ),
        fl.LogPanel(title="Events", config=fl.LogConfig(topic_to_render="/events")),
    ]
    views = _split("column", [(1.2, arena), (1.0, believed)])
    panels = _split("column", [(1.0, panel) for panel in aside])
    return fl.Layout(content=_split("row", [(1.2, views), (1.0, panels)]))


def _view(title: str, stage: Stage, shown: Iterable[str]) -> fl.ThreeDeePanel:
    """A view from above, with some of the topics of the scene."""
    topics = [f"/scene/{layer}" for layer in LAYERS]
    topics += [f"/scene/beliefs/{robot}" for robot in stage.robots]
    visible = set(shown)
    return fl.ThreeDeePanel(
        title=title,
        config=fl.ThreeDeeConfig(
            follow_tf=FRAME_ID,
            fixed_frame=FRAME_ID,
            follow_mode="follow-none",
            scene=fl.BaseRendererSceneSettings(background_color=DARK["background"]),
            camera_state=fl.ThreeDeeCameraState(perspective=False, distance=VIEW_M, phi=0.0),
            layers={"grid": fl.BaseRendererGridLayerSettings(visible=True, size=100.0)},
            topics={
                topic: fl.BaseRendererSceneUpdateTopicSettings(visible=topic in visible)
                for topic in topics
            },
        ),
    )


def _values(*names: str) -> dict[str, tuple[str, str | None]]:
    return {f"/values.{name}": (name, None) for name in names}


def _plot(title: str, series: Mapping[str, tuple[str, str | None]]) -> fl.PlotPanel:
    """A plot over time of series by path, each with its label and colour."""
    paths = [
        fl.PlotSeries(value=path, label=label, color=colour)
        for path, (label, colour) in series.items()
    ]
    return fl.PlotPanel(title=title, config=fl.PlotConfig(paths=paths, show_legend=True))


def _split(direction: Any, parts: Iterable[tuple[float, Any]]) -> fl.SplitContainer:
    items = [fl.SplitItem(proportion=share, content=content) for share, content in parts]
    return fl.SplitContainer(direction=direction, items=items)
