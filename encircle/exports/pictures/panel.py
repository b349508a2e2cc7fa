"""What stands beside the arena: the clock, packets by fate with counts, and distances over time."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from encircle.exports.pictures.canvas import Box, shortened, text_width
from encircle.exports.pictures.flights import ON_TIME, TOO_LATE, style_of
from encircle.exports.pictures.marks import draw_mark
from encircle.exports.pictures.moment import Moment, clock_text
from encircle.exports.pictures.sheet import Sheet
from encircle.scene.palette import robot_colour

LINE = 1.65
"""From line to line, in sizes of letters."""
CHART_LINES_MIN, CHART_LINES_MAX = 4.5, 15.0
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class PanelPainter:
    """Draws the side panel. ``fates``: those that occur in the run; ``distances_m``: (T, N)."""

    sheet: Sheet
    fates: Sequence[str]
    distances_m: Floats

    def draw(self, moment: Moment, counts: Counter[str]) -> None:
        """The whole panel at a moment; ``counts``: packets of each fate so far."""
        left, top, right, bottom = self.sheet.layout.panel
        self.sheet.canvas.rectangle(self.sheet.layout.panel, self.sheet.colours["panel"])
        pad = 0.9 * self.sheet.letters
        y = self._clock(left + pad, right - pad, top + 1.9 * self.sheet.letters, moment)
        y = self._fates(left + pad, right - pad, y + 0.4 * self.sheet.letters, counts)
        y = self._robots(
            left + pad, right - pad, y + 0.7 * self.sheet.letters, bottom - pad, moment
        )
        room = bottom - pad - y
        if room >= CHART_LINES_MIN * LINE * self.sheet.letters:
            chart_top = max(y, bottom - pad - CHART_LINES_MAX * LINE * self.sheet.letters)
            self._distances((left + pad, chart_top, right - pad, bottom - pad), moment)

    def _clock(self, left: float, right: float, y: float, moment: Moment) -> float:
        """Time and tick; returns where the next line is."""
        ink, muted, size = (
            self.sheet.colours["ink"],
            self.sheet.colours["muted"],
            self.sheet.letters,
        )
        self.sheet.canvas.text(
            clock_text(self.sheet.stage, moment.frame.tick), (left, y), 2.1 * size, ink, bold=True
        )
        text = f"tick {moment.frame.tick}"
        self.sheet.canvas.text(text, (right, y - 0.55 * size), size, ink, "right")
        text = f"of at most {self.sheet.stage.ticks_max}"
        self.sheet.canvas.text(text, (right, y + 0.75 * size), 0.85 * size, muted, "right")
        return y + 2.6 * size

    def _fates(self, left: float, right: float, y: float, counts: Counter[str]) -> float:
        ink, muted, size = (
            self.sheet.colours["ink"],
            self.sheet.colours["muted"],
            self.sheet.letters,
        )
        self.sheet.canvas.text("Packets", (left, y), size, ink, bold=True)
        total = sum(counts.values())
        self.sheet.canvas.text(f"{total:,}", (right - 3.9 * size, y), size, ink, "right", True)
        y += LINE * size
        if not self.fates:
            # As where robots hear each other directly.
            text = shortened("their fates are not recorded", right - left, size)
            self.sheet.canvas.text(text, (left, y), size, muted)
            y += LINE * size
        for fate in self.fates:
            style = style_of(fate)
            at = (left + 0.5 * size, y)
            draw_mark(
                self.sheet.canvas, style, self.sheet.colours[style.role], at, 5.0 * self.sheet.unit
            )
            name = fate_text(fate)
            room = right - left - 1.5 * size - 6.9 * size
            name = shortened(name, room, size)
            self.sheet.canvas.text(name, (left + 1.5 * size, y), size, ink)
            count = counts.get(fate, 0)
            self.sheet.canvas.text(f"{count:,}", (right - 3.9 * size, y), size, ink, "right")
            share = f"{100.0 * count / total:.0f} %" if total else ""
            self.sheet.canvas.text(share, (right, y), size, muted, "right")
            y += LINE * size
        return y

    def _robots(self, left: float, right: float, y: float, bottom: float, moment: Moment) -> float:
        """A row for each robot, if there is room: what it does, and the oldest news of a peer."""
        size, frame = self.sheet.letters, moment.frame
        chart = (CHART_LINES_MIN + 1.0) * LINE * size
        if y + (len(frame.robots) + 1) * LINE * size + chart > bottom:
            return y
        ink, muted = self.sheet.colours["ink"], self.sheet.colours["muted"]
        self.sheet.canvas.text("Robots", (left, y), size, ink, bold=True)
        self.sheet.canvas.text("oldest news", (right, y), 0.85 * size, muted, "right")
        for k, name in enumerate(self.sheet.stage.robots):
            y += LINE * size
            colour = robot_colour(k)
            self.sheet.canvas.disc(
                (left + 0.5 * size, y), 0.45 * size, "", colour, 2.4 * self.sheet.unit
            )
            self.sheet.canvas.text(name, (left + 1.5 * size, y), size, ink, bold=True)
            self.sheet.canvas.text(_doing(moment, k), (left + 4.6 * size, y), size, ink)
            ages = [age for j, age in enumerate(frame.ages[k]) if j != k]
            oldest = (
                f"{max(ages) * self.sheet.stage.tick_s:.1f} s"
                if ages and min(ages) >= 0
                else "none"
            )
            self.sheet.canvas.text(oldest, (right, y), size, ink, "right")
        return y + 1.2 * LINE * size

    def _distances(self, box: Box, moment: Moment) -> None:
        """Distances of the robots to the target, up to now, on the scales of the whole run."""
        ink, muted, size = (
            self.sheet.colours["ink"],
            self.sheet.colours["muted"],
            self.sheet.letters,
        )
        left, top, right, bottom = box
        self.sheet.canvas.text(
            "Distance to the target (m)", (left, top + 0.5 * size), size, ink, bold=True
        )
        high_m = _round_up(float(self.distances_m.max()))
        labels = (f"{high_m:g}", "0")
        edge = left + max(text_width(text, 0.85 * size) for text in labels) + 0.5 * size
        frame = (edge, top + 2.0 * size, right - 0.2 * size, bottom - 1.5 * size)
        x0, y0, x1, y1 = frame
        last = max(1, len(self.distances_m) - 1)

        def place(rows: Floats, values_m: Floats) -> Floats:
            return np.column_stack(
                [x0 + (x1 - x0) * rows / last, y1 - (y1 - y0) * values_m / high_m]
            )

        self.sheet.canvas.rectangle(frame, self.sheet.colours["background"])
        for value, y in zip(labels, (y0, y1), strict=True):
            self.sheet.canvas.line([(x0, y), (x1, y)], self.sheet.colours["line"], 1.0)
            self.sheet.canvas.text(value, (edge - 0.4 * size, y), 0.85 * size, muted, "right")
        stop = place(np.array([0.0, last]), np.full(2, self.sheet.stage.stop_distance_m))
        self.sheet.canvas.line(
            stop, ink, self.sheet.unit, 0.8, (4 * self.sheet.unit, 3 * self.sheet.unit)
        )
        rows = np.arange(moment.row + 1, dtype=float)
        for k in range(self.distances_m.shape[1]):
            curve = place(rows, self.distances_m[: moment.row + 1, k])
            self.sheet.canvas.line(curve, robot_colour(k), 1.8 * self.sheet.unit)
        now = x0 + (x1 - x0) * moment.row / last
        self.sheet.canvas.line([(now, y0), (now, y1)], muted, self.sheet.unit)
        end_s = last * self.sheet.stage.tick_s
        below = y1 + 0.95 * size
        self.sheet.canvas.text("0", (x0, below), 0.85 * size, muted)
        self.sheet.canvas.text(f"{end_s:.1f} s", (x1, below), 0.85 * size, muted, "right")
        self.sheet.canvas.text(
            "- - stop distance", ((x0 + x1) / 2, below), 0.85 * size, muted, "centre"
        )


def _doing(moment: Moment, robot: int) -> str:
    """What a robot does, in a word or two."""
    if moment.frame.lost[robot]:
        return "lost"
    mode = moment.decided.modes[robot] or ""
    return f"{mode}, radio off" if moment.frame.silent[robot] else mode


def fate_text(fate: str) -> str:
    """A fate in words for readers: ``lost: out of range``."""
    if fate == ON_TIME:
        return "arrived on time"
    if fate == TOO_LATE:
        return "arrived late"
    return "lost" if fate in ("lost", "loss") else f"lost: {fate.replace('-', ' ')}"


def _round_up(value: float) -> float:
    """The next round number at or above a value."""
    decade = 10.0 ** np.floor(np.log10(max(value, 1e-3)))
    factors = (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
    return float(next(f * decade for f in factors if f * decade >= value * (1.0 - 1e-9)))
