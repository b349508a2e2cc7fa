"""The whole picture of a hunt at a moment: title, arena, side panel and caption."""

from dataclasses import dataclass

import numpy as np

from encircle.exports.pictures.arena import SMALL_TEAM, ArenaPainter
from encircle.exports.pictures.belief import draw_belief
from encircle.exports.pictures.camera import camera_path
from encircle.exports.pictures.canvas import Canvas, Pixels
from encircle.exports.pictures.flights import ON_TIME, TOO_LATE, Flights
from encircle.exports.pictures.layout import layout_of
from encircle.exports.pictures.moment import MOVED, Moment, moment_at, positions_of
from encircle.exports.pictures.panel import PanelPainter
from encircle.exports.pictures.sheet import Sheet
from encircle.exports.pictures.words import draw_frame_words, draw_news
from encircle.scene.builder import Scene
from encircle.scene.frame import Belief
from encircle.scene.palette import LOST, ROBOTS, THEMES

LINGERING_S, LINGERING_TICKS_MIN = 0.35, 1.0
"""How long the cross of a lost packet stays: in s of the video, and at least in ticks."""
PALE = 0.45
"""How strong the truth is drawn where a belief is."""


@dataclass(frozen=True, slots=True)
class PictureStyle:
    """How a hunt is drawn. ``size``: width and height in pixels; ``theme``: light or dark.

    ``believer``: index of the robot whose belief is drawn, None for the truth alone; ``packets``:
    whether they are drawn; ``speed``: seconds of the run in a second of the video.
    """

    size: tuple[int, int]
    theme: str = "light"
    believer: int | None = None
    packets: bool = True
    speed: float = 1.0

    @property
    def colours(self) -> list[str]:
        """Every colour that is drawn, but for those between two."""
        return [*THEMES[self.theme].values(), *ROBOTS]


class Picture:
    """Draws a scene at any moment. Equal arguments give equal pixels."""

    def __init__(self, scene: Scene, style: PictureStyle) -> None:
        self._stage, self._frames, self._style = scene.stage, scene.frames, style
        self._layout = layout_of(*style.size)
        self._positions = positions_of(scene.frames)
        self._flights = Flights(scene.frames, self._stage.causes, self._lingering_ticks())
        around_m = max(self._stage.stop_distance_m, self._stage.radius_m)
        self._path = camera_path(
            *(self._positions, self._stage.radius_m, around_m, self._stage.tick_s),
            *(self._layout.arena, self._layout.unit),
        )
        self._cuts = [
            row for row, f in enumerate(scene.frames) if any(e.kind == MOVED for e in f.events)
        ]
        self._fates = self._all_fates()
        away = self._positions[:, :-1] - self._positions[:, -1:]
        self._distances_m = np.hypot(away[..., 0], away[..., 1])

    def at(self, ticks: float) -> Pixels:
        """(height, width, 3) the picture at a tick and a share of one."""
        moment, colours = moment_at(self._frames, ticks), THEMES[self._style.theme]
        canvas = Canvas(*self._style.size, colours["background"])
        sheet = Sheet(canvas, self._stage, self._layout, colours)
        believer = self._style.believer
        belief = None if believer is None else moment.decided.beliefs[believer]
        canvas.clip(self._layout.arena)
        self._arena(sheet, moment, belief)
        canvas.clip(None)
        canvas.rectangle(self._layout.arena, "", colours["line"])
        draw_frame_words(sheet)
        draw_news(sheet, self._frames, moment, believer, belief is not None)
        panel = PanelPainter(sheet, self._fates, self._distances_m)
        panel.draw(moment, self._flights.counts(moment.frame.tick))
        return canvas.pixels()

    def _lingering_ticks(self) -> float:
        """How long crosses stay; in a large team there would be too many at a time."""
        if len(self._stage.robots) > SMALL_TEAM:
            return LINGERING_TICKS_MIN
        return max(LINGERING_TICKS_MIN, LINGERING_S * self._style.speed / self._stage.tick_s)

    def _all_fates(self) -> list[str]:
        """The fates that occur, in the palette's order; none of a run without packets."""
        counts = self._flights.counts(self._frames[-1].tick)
        order = {fate: k for k, fate in enumerate((TOO_LATE, *LOST))}
        others = sorted(counts.keys() - {ON_TIME}, key=lambda f: (order.get(f, len(order)), f))
        return [ON_TIME, *others] if counts else []

    def _arena(self, sheet: Sheet, moment: Moment, belief: Belief | None) -> None:
        camera = self._path.at(moment.ticks - self._frames[0].tick)
        painter = ArenaPainter(sheet, camera, 1.0 if belief is None else PALE)
        painter.ground()
        painter.links(moment)
        painter.trails(self._positions, moment, self._cuts)
        painter.plans(moment)
        painter.target(moment)
        painter.robots(moment)
        believer = self._style.believer
        if belief is not None and believer is not None:
            draw_belief(painter, moment, believer, belief)
        if self._style.packets:
            flights = self._flights.at(moment.ticks, moment.robots)
            painter.packets([f for f in flights if believer in (None, f.receiver)])
        if belief is None:
            painter.names(moment)
        painter.scale_bar()
