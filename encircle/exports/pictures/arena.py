"""The arena at a moment: ground, obstacles, trails, ring, goals, bodies and packets."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, cos, floor, hypot, sin

import numpy as np
from numpy.typing import NDArray

from encircle.exports.pictures.camera import Camera
from encircle.exports.pictures.canvas import XY
from encircle.exports.pictures.flights import Flight
from encircle.exports.pictures.marks import draw_flying, draw_lost
from encircle.exports.pictures.moment import Moment
from encircle.exports.pictures.sheet import Sheet
from encircle.scene.palette import robot_colour

Floats = NDArray[np.float64]
TRAIL_S = 4.0
"""How much of a trail is drawn strongly."""
LINKS_MAX = 30
"""Up to so many links each has a thin line."""
RADIUS_PX_MIN = 5.0
"""No robot is drawn smaller."""
GRID_PX_MIN = 60.0
RING_MISFIT_M_MAX = 0.3
PACKET_PX, SMALL_PACKET_PX, SMALL_TEAM = 4.6, 3.6, 8
"""Radii of packets, the smaller one in teams of more robots than that."""
LANE_PX = 3.5
"""How far packets fly to the right of the line between two robots, so that both ways differ."""


@dataclass(frozen=True)
class ArenaPainter:
    """Draws the arena, seen through a camera.

    ``faint``: how strong the truth is drawn, 1 or less.
    """

    sheet: Sheet
    camera: Camera
    faint: float = 1.0

    @property
    def radius(self) -> float:
        """A robot's radius in pixels."""
        return max(
            self.sheet.stage.radius_m * self.camera.pixels_per_m, RADIUS_PX_MIN * self.sheet.unit
        )

    def ground(self) -> None:
        """Grid lines at round distances, a bar that says how far apart, and the obstacles."""
        canvas, camera = self.sheet.canvas, self.camera
        step_m = camera.round_length_m(GRID_PX_MIN * self.sheet.unit)
        x_low, y_low, x_high, y_high = camera.span_m()
        for k in range(ceil(x_low / step_m), floor(x_high / step_m) + 1):
            ends = [camera.at((k * step_m, y)) for y in (y_low, y_high)]
            canvas.line(_sharp(ends), self.sheet.colours["grid"])
        for k in range(ceil(y_low / step_m), floor(y_high / step_m) + 1):
            ends = [camera.at((x, k * step_m)) for x in (x_low, x_high)]
            canvas.line(_sharp(ends), self.sheet.colours["grid"])
        for x, y, radius_m in self.sheet.stage.obstacles:
            at, radius = camera.at((x, y)), radius_m * camera.pixels_per_m
            canvas.disc(
                at,
                radius,
                self.sheet.colours["obstacle"],
                self.sheet.colours["line"],
                self.sheet.unit,
            )

    def scale_bar(self) -> None:
        """A bar as long as a round number of metres."""
        length_m = self.camera.round_length_m(GRID_PX_MIN * self.sheet.unit)
        left, _, _, bottom = self.camera.box
        x, y = left + self.sheet.letters, bottom - self.sheet.letters
        end, colour = x + length_m * self.camera.pixels_per_m, self.sheet.colours["muted"]
        self.sheet.canvas.line([(x, y), (end, y)], colour, 2.0 * self.sheet.unit)
        for at in (x, end):
            self.sheet.canvas.line(
                [(at, y - 4 * self.sheet.unit), (at, y + 4 * self.sheet.unit)],
                colour,
                2 * self.sheet.unit,
            )
        text_at = (end + 0.5 * self.sheet.letters, y)
        self.sheet.canvas.text(f"{length_m:g} m", text_at, self.sheet.letters, colour, halo=True)

    def trails(self, positions: Floats, moment: Moment, cuts: Sequence[int]) -> None:
        """Where bodies have been. ``positions``: (T, N + 1, 2) in m.

        ``cuts``: rows at which the target was put elsewhere.
        """
        since = max(0, moment.row - round(TRAIL_S / self.sheet.stage.tick_s))
        count = positions.shape[1] - 1
        for body in range(count + 1):
            colour = robot_colour(body) if body < count else self.sheet.colours["target"]
            now = moment.robots[body] if body < count else moment.target
            whole = np.vstack([positions[: moment.row + 1, body], [now]])
            pixels = self.camera.all_at(whole)
            for part, alpha, width in (
                (slice(0, since + 1), 0.30, 1.2),
                (slice(since, None), 0.75, 2.0),
            ):
                rows = np.arange(len(whole))[part]
                at = np.searchsorted(rows, cuts) if body == count else np.array([], int)
                for piece in np.split(pixels[part], at):
                    self.sheet.canvas.line(
                        piece, colour, width * self.sheet.unit, alpha * self.faint
                    )

    def links(self, moment: Moment) -> None:
        """A thin line between each two robots, in a team that is small enough."""
        count = len(moment.robots)
        if count * (count - 1) > LINKS_MAX:
            return
        for k, one in enumerate(moment.robots):
            for other in moment.robots[k + 1 :]:
                ends = [self.camera.at(one), self.camera.at(other)]
                self.sheet.canvas.line(
                    ends, self.sheet.colours["line"], self.sheet.unit, 0.45 * self.faint
                )

    def plans(self, moment: Moment) -> None:
        """The ring, each robot's goal, and a line from robot to goal."""
        frame, width = moment.decided, self.sheet.unit
        ring = common_circle(
            [
                goal
                for goal, point in zip(frame.goals, frame.points, strict=True)
                if goal is not None and point is not None
            ]
        )
        if ring is not None:
            centre, radius_m = ring
            radius = radius_m * self.camera.pixels_per_m
            self.sheet.canvas.disc(
                self.camera.at(centre),
                radius,
                "",
                self.sheet.colours["ring"],
                1.4 * width,
                0.9 * self.faint,
                (2 * width, 4 * width),
            )
        for k, goal in enumerate(frame.goals):
            if goal is None or frame.lost[k]:
                continue
            colour, at = robot_colour(k), self.camera.at(goal)
            self.sheet.canvas.line(
                [self.camera.at(moment.robots[k]), at],
                colour,
                1.6 * width,
                0.8 * self.faint,
                (6 * width, 4 * width),
            )
            self.sheet.canvas.disc(
                at, 5 * width, self.sheet.colours["background"], colour, 2 * width, self.faint
            )

    def target(self, moment: Moment) -> None:
        """The target's body, the stop distance around it, and its name."""
        at, scale = self.camera.at(moment.target), self.camera.pixels_per_m
        ink = self.sheet.colours["target"]
        self.sheet.canvas.disc(
            at, self.sheet.stage.stop_distance_m * scale, "", ink, self.sheet.unit, 0.6 * self.faint
        )
        radius = max(self.sheet.stage.target_radius_m * scale, 5 * self.sheet.unit)
        self.sheet.canvas.disc(
            at, radius, ink, self.sheet.colours["background"], self.sheet.unit, self.faint
        )
        self.sheet.canvas.polygon(
            _star(at, 0.62 * radius), self.sheet.colours["background"], alpha=self.faint
        )

    def robots(self, moment: Moment) -> None:
        """Bodies; a lost robot is crossed out, a silent one has a broken rim."""
        frame, unit = moment.frame, self.sheet.unit
        radius = self.radius
        for k, place in enumerate(moment.robots):
            at, colour = self.camera.at(place), robot_colour(k)
            is_off = frame.lost[k] or frame.silent[k]
            fill = self.sheet.colours["background" if is_off else "panel"]
            dashes = (3 * unit, 3 * unit) if is_off else ()
            self.sheet.canvas.disc(at, radius, fill, colour, 2.4 * unit, self.faint, dashes)
            heading = frame.headings_rad[k]
            nose = [
                (at[0] + share * radius * cos(heading), at[1] - share * radius * sin(heading))
                for share in (0.62, 1.25)
            ]
            self.sheet.canvas.line(nose, colour, 2.4 * unit, self.faint)
            if frame.lost[k]:
                for side in (1, -1):
                    away = 0.9 * radius
                    ends = [
                        (at[0] - away, at[1] - side * away),
                        (at[0] + away, at[1] + side * away),
                    ]
                    self.sheet.canvas.line(ends, self.sheet.colours["ink"], 2.0 * unit)

    def names(self, moment: Moment) -> None:
        """The robots' names, over everything."""
        for name, place in zip(self.sheet.stage.robots, moment.robots, strict=True):
            self._name(name, self.camera.at(place), self.radius, moment)

    def _name(self, name: str, at: XY, radius: float, moment: Moment) -> None:
        """A robot's name in its disc, or on the side away from the target if that is small."""
        size, ink = self.sheet.letters, self.sheet.colours["ink"]
        if radius >= 0.95 * size:
            self.sheet.canvas.text(name, at, min(size, 0.9 * radius), ink, "centre", True, True)
            return
        target = self.camera.at(moment.target)
        x, y = at[0] - target[0], at[1] - target[1]
        far = max(hypot(x, y), 1e-6)
        away = radius + 0.95 * size
        place = (at[0] + away * x / far, at[1] + away * y / far)
        self.sheet.canvas.text(name, place, 0.9 * size, ink, "centre", True, True)

    def packets(self, flights: Sequence[Flight]) -> None:
        """Packets on their links, and crosses where some were lost; what arrives is drawn last."""
        is_large = len(self.sheet.stage.robots) > SMALL_TEAM
        radius = (SMALL_PACKET_PX if is_large else PACKET_PX) * self.sheet.unit
        lost = [flight for flight in flights if flight.fading >= 0.0]
        flying = [flight for flight in flights if flight.fading < 0.0]
        for flight in lost:
            at = self._on_lane(flight)
            colour, alpha = self.sheet.colours[flight.style.role], 1.0 - 0.85 * flight.fading
            draw_lost(self.sheet.canvas, flight.style, colour, at, 1.25 * radius, alpha)
        for flight in flying:
            colour = self.sheet.colours[flight.style.role]
            draw_flying(self.sheet.canvas, flight.style, colour, self._on_lane(flight), radius)

    def _on_lane(self, flight: Flight) -> XY:
        """Where a packet is, from rim to rim, and a little to the right of the straight way."""
        start, goal = self.camera.at(flight.start), self.camera.at(flight.goal)
        x, y = goal[0] - start[0], goal[1] - start[1]
        far = max(hypot(x, y), 1e-6)
        rim = min(self.radius, 0.4 * far)
        along, aside = rim + flight.share * (far - 2.0 * rim), LANE_PX * self.sheet.unit
        return (
            start[0] + (along * x - aside * y) / far,
            start[1] + (along * y + aside * x) / far,
        )


def common_circle(goals: Sequence[tuple[float, float]]) -> tuple[tuple[float, float], float] | None:
    """Centre and radius in m of the circle through three or more goals; None if there is none.

    Robots with different views plan different rings, whose points lie on no common circle. Least
    squares of the circle's equation x^2 + y^2 = 2 a x + 2 b y + c.
    """
    if len(goals) < 3:
        return None
    points = np.array(goals)
    middle = points.mean(axis=0)
    away = points - middle
    rows = np.column_stack([2.0 * away, np.ones(len(points))])
    solution, _, rank, _ = np.linalg.lstsq(rows, (away**2).sum(axis=1), rcond=None)
    if rank < 3:
        return None
    radius_m = float(np.sqrt(solution[2] + solution[0] ** 2 + solution[1] ** 2))
    misfit = np.abs(np.hypot(*(away - solution[:2]).T) - radius_m).max()
    x, y = (middle + solution[:2]).tolist()
    return ((x, y), radius_m) if misfit <= RING_MISFIT_M_MAX else None


def _star(at: XY, radius: float) -> list[XY]:
    """Corners of a star with five points."""
    turns = [np.pi * (k / 5 - 0.5) for k in range(10)]
    radii = [radius if k % 2 == 0 else 0.45 * radius for k in range(10)]
    return [(at[0] + r * cos(t), at[1] + r * sin(t)) for r, t in zip(radii, turns, strict=True)]


def _sharp(ends: Sequence[XY]) -> list[XY]:
    """The ends of a level or upright line of one pixel, at the middle of pixels."""
    return [(floor(x) + 0.5, floor(y) + 0.5) for x, y in ends]
