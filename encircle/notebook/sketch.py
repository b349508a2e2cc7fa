"""Arena and trails as a drawing (SVG) in a notebook's output.

Colours are those of the figures. What is black on paper has the colour of the notebook's text, and
grey lines are seen on light and dark ground. Robots have their names, so that colours that come
again, or are not told apart, do no harm.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import floor, hypot, log10

import numpy as np
from numpy.typing import NDArray

from encircle.notebook.html import text
from encircle.scene.palette import robot_colour

Floats = NDArray[np.float64]
WIDTH_PX, HEIGHT_PX_MAX = 440.0, 400.0
MARGIN_SHARE = 0.06
BAR_PX_MIN = 50.0
GREY = "rgba(128,128,128,0.55)"
POINTS_MAX = 400
"""A longer trail is drawn through every so many of its points."""


@dataclass
class Sketch:
    """A drawing of the part of the plane from ``low`` to ``high`` (2,) in m, under way.

    ``label``: what it shows, for readers who do not see it.
    """

    low: Floats
    high: Floats
    label: str
    _parts: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Room around what is shown, and the scale."""
        spread = np.maximum(self.high - self.low, 1.0)
        margin = MARGIN_SHARE * spread.max()
        self.low, self.high = self.low - margin, self.high + margin
        spread = self.high - self.low
        self.pixels_per_m = float(min(WIDTH_PX / spread[0], HEIGHT_PX_MAX / spread[1]))
        self.width, self.height = (spread * self.pixels_per_m).tolist()

    def circle(
        self,
        at: Sequence[float],
        radius_m: float,
        line: str = "none",
        fill: str = "none",
        more: str = "",
    ) -> None:
        """A circle to scale."""
        x, y = self._place(at)
        radius = radius_m * self.pixels_per_m
        self._parts.append(
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:.1f}" stroke="{line}" fill="{fill}"'
            f"{' ' if more else ''}{more}/>"
        )

    def trail(self, places: Floats, colour: str, width: float = 1.6) -> None:
        """A line through places (M, 2) in m, with a small ring where it begins."""
        step = max(1, -(-len(places) // POINTS_MAX))
        shown = np.vstack([places[:-1:step], places[-1:]])
        points = " ".join(f"{x:.1f},{y:.1f}" for x, y in map(self._place, shown.tolist()))
        x, y = self._place(places[0].tolist())
        self._parts.append(
            f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="{width}"'
            f' stroke-linejoin="round"/><circle cx="{x:.1f}" cy="{y:.1f}" r="3" fill="none"'
            f' stroke="{colour}"/>'
        )

    def name(self, at: Sequence[float], words: str, away_m: Sequence[float], gap_px: float) -> None:
        """A name beside a place, on the side to which ``away_m`` points."""
        x, y = self._place(at)
        far = max(hypot(away_m[0], away_m[1]), 1e-9)
        gap = gap_px + 9.0
        x, y = x + gap * away_m[0] / far, y - gap * away_m[1] / far
        # Kept within the drawing: what is cut off cannot be read.
        x, y = min(max(x, 9.0), self.width - 9.0), min(max(y, 8.0), self.height - 8.0)
        self._parts.append(
            f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="middle" dominant-baseline="central"'
            f' font-size="12" fill="currentColor">{text(words)}</text>'
        )

    def svg(self) -> str:
        """The drawing, with a bar that says how long a metre is."""
        length_m = _round_length(BAR_PX_MIN / self.pixels_per_m)
        end, y = 8.0 + length_m * self.pixels_per_m, self.height + 14.0
        bar = (
            f'<path d="M8 {y - 4:.1f}v8M8 {y:.1f}H{end:.1f}m0 -4v8" stroke="currentColor"'
            f' fill="none"/><text x="{end + 6:.1f}" y="{y:.1f}" dominant-baseline="central"'
            f' font-size="12" fill="currentColor">{length_m:g} m</text>'
        )
        width, height = round(self.width), round(self.height + 24.0)
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}"'
            f' viewBox="0 0 {width} {height}" role="img" aria-label="{text(self.label)}"'
            f' style="max-width:100%;height:auto;font-family:sans-serif">'
            # What goes beyond the frame is cut off there.
            f'<svg width="{self.width:.1f}" height="{self.height:.1f}" overflow="hidden">'
            f'{"".join(self._parts)}</svg><rect x="0.5" y="0.5" width="{self.width - 1:.1f}"'
            f' height="{self.height - 1:.1f}" fill="none" stroke="{GREY}"/>{bar}</svg>'
        )

    def _place(self, at: Sequence[float]) -> tuple[float, float]:
        x, y = (float(c) for c in at)
        return (x - float(self.low[0])) * self.pixels_per_m, (
            float(self.high[1]) - y
        ) * self.pixels_per_m


def draw_bodies(
    sketch: Sketch, robots: Floats, target: Floats, radius_m: float, target_radius_m: float
) -> None:
    """Robots (N, 2) and target (2,) as discs with names, each on the side away from the middle."""
    middle = np.vstack([robots, [target]]).mean(axis=0)
    for k, place in enumerate(robots):
        more = 'stroke-width="2" fill-opacity="0.25"'
        sketch.circle(place.tolist(), radius_m, robot_colour(k), robot_colour(k), more)
        away = place - target if len(robots) > 1 else place - middle
        sketch.name(place.tolist(), f"r{k + 1}", away.tolist(), radius_m * sketch.pixels_per_m)
    sketch.circle(target.tolist(), target_radius_m, "currentColor", "currentColor")


def _round_length(least_m: float) -> float:
    """The shortest of 1, 2, 5, 10, ... and 0.1, 0.2, ... m that is long enough."""
    decade = 10.0 ** floor(log10(least_m))
    return next(k * decade for k in (1, 2, 5, 10, 20) if k * decade >= least_m)
