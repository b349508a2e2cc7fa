"""Which part of the plane a picture shows: all bodies, as large as that allows.

The camera moves along with the hunt: at each tick it shows the bodies of the ticks around it, and
its centre and scale are smoothed over as many, so that it neither jumps nor shakes. It comes no
nearer than where bodies are large. Where it would not come much nearer than all of the run is, it
stands still, which is calmest.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import floor, log10

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, maximum_filter1d, minimum_filter1d

from encircle.exports.pictures.canvas import XY, Box

RADIUS_PX_MAX = 30.0
"""Largest radius in pixels of a robot, in a picture of 720 rows."""
NEARER_MIN = 1.25
"""How many times larger bodies must become for the camera to move."""
WINDOW_S, WINDOW_TICKS_MIN, WINDOW_TICKS_MAX = 0.8, 8, 200
"""How far before and after a tick bodies count, for the camera of that tick."""
MARGIN_SHARE = 0.09
STEPS = (1, 2, 5)

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Camera:
    """What is seen in a box: the place in m at its centre, and how many pixels a metre has."""

    box: Box
    centre: tuple[float, float]
    pixels_per_m: float

    def at(self, place: tuple[float, float]) -> XY:
        """Where a place of the plane is in the picture."""
        left, top, right, bottom = self.box
        x = (left + right) / 2.0 + (place[0] - self.centre[0]) * self.pixels_per_m
        y = (top + bottom) / 2.0 - (place[1] - self.centre[1]) * self.pixels_per_m
        return x, y

    def all_at(self, places: Sequence[tuple[float, float]] | Floats) -> Floats:
        """(M, 2) where places (M, 2) of the plane are in the picture."""
        left, top, right, bottom = self.box
        middle = np.array([(left + right) / 2.0, (top + bottom) / 2.0])
        away = np.asarray(places, dtype=float).reshape(-1, 2) - self.centre
        return np.asarray(middle + away * (self.pixels_per_m, -self.pixels_per_m))

    def span_m(self) -> tuple[float, float, float, float]:
        """Lowest x and y, highest x and y that are seen, in m."""
        left, top, right, bottom = self.box
        wide, tall = (right - left) / self.pixels_per_m, (bottom - top) / self.pixels_per_m
        x, y = self.centre
        return x - wide / 2.0, y - tall / 2.0, x + wide / 2.0, y + tall / 2.0

    def round_length_m(self, pixels_min: float) -> float:
        """The shortest of 1, 2, 5, 10, ... m (or of 0.1, 0.2, ...) that has so many pixels."""
        least_m = pixels_min / self.pixels_per_m
        decade = 10.0 ** floor(log10(least_m))
        return next(step * decade for step in (*STEPS, 10, 20) if step * decade >= least_m)


@dataclass(frozen=True)
class CameraPath:
    """The camera of every row of a run. ``centres``: (T, 2) in m; ``scales``: (T,) pixels per m."""

    box: Box
    centres: Floats
    scales: Floats

    def at(self, row: float) -> Camera:
        """The camera at a row, between two rows too."""
        rows = np.arange(len(self.scales))
        x, y = (float(np.interp(row, rows, self.centres[:, axis])) for axis in (0, 1))
        return Camera(self.box, (x, y), float(np.interp(row, rows, self.scales)))


def camera_path(
    positions: Floats, radius_m: float, around_m: float, tick_s: float, box: Box, unit: float
) -> CameraPath:
    """The camera of a run.

    ``positions``: (T, N + 1, 2) of robots and target in m; ``radius_m``: of robots;
    ``around_m``: how far around a body is to be seen; ``unit``: pixels that count as one.
    """
    window = min(max(round(WINDOW_S / tick_s), WINDOW_TICKS_MIN), WINDOW_TICKS_MAX)
    nearest = RADIUS_PX_MAX * unit / radius_m
    low, high = positions.min(axis=1) - around_m, positions.max(axis=1) + around_m
    still = min(_scale(low.min(axis=0), high.max(axis=0), box), nearest)
    near_low = minimum_filter1d(low, 2 * window + 1, axis=0, mode="nearest")
    near_high = maximum_filter1d(high, 2 * window + 1, axis=0, mode="nearest")
    scales = np.array([_scale(*ends, box) for ends in zip(near_low, near_high, strict=True)])
    scales = np.minimum(scales, nearest)
    if scales.max() < NEARER_MIN * still:
        middle = (low.min(axis=0) + high.max(axis=0)) / 2.0
        return CameraPath(box, np.tile(middle, (len(low), 1)), np.full(len(low), still))
    middles, sigma = (near_low + near_high) / 2.0, 0.75 * window
    return CameraPath(
        box,
        gaussian_filter1d(middles, sigma, axis=0, mode="nearest"),
        gaussian_filter1d(scales, sigma, mode="nearest"),
    )


def _scale(low: Floats, high: Floats, box: Box) -> float:
    """Pixels per m with which everything from ``low`` to ``high`` (2,) is in the box."""
    left, top, right, bottom = box
    room = np.array([right - left, bottom - top]) * (1.0 - 2.0 * MARGIN_SHARE)
    return float((room / np.maximum(high - low, 1e-3)).min())
