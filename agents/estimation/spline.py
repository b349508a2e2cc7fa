"""Where the target will be in xi steps: the cubic spline through its latest K positions, prolonged.

Extrapolating an interpolating spline is a fixed linear map of the samples, so scipy's
``CubicSpline`` is fitted once to each unit vector and a prediction is one small matrix product.
With too few samples the filter's velocity is used instead, and with a single detection the position
is held; which of the three it was is reported. See Sec. II of the paper and ``docs/paper.md``.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from encircle.agents.estimation.kalman import Track
from encircle.protocol.parameters import Parameters


@lru_cache(maxsize=256)
def extrapolation_matrix(
    samples: int, spacing_ticks: int, ends: str, xi_grid: tuple[float, ...]
) -> NDArray[np.float64]:
    """(len(xi_grid), samples) matrix from samples, oldest first, to values at each xi ahead."""
    times = (np.arange(samples) - (samples - 1)) * float(spacing_ticks)
    spline = CubicSpline(times, np.eye(samples), bc_type=ends)  # type: ignore[call-overload]  # one of two strings
    matrix: NDArray[np.float64] = np.ascontiguousarray(spline(np.array(xi_grid)))
    matrix.flags.writeable = False
    return matrix


@lru_cache(maxsize=64)
def _column(xi_grid: tuple[float, ...]) -> NDArray[np.float64]:
    return np.array(xi_grid)[:, None]


def extrapolate(
    track: Track, tick_s: float, parameters: Parameters, xi_grid: tuple[float, ...]
) -> tuple[NDArray[np.float64], str]:
    """Predicted positions, (len(xi_grid), 2) in m, and how: ``spline``, ``velocity`` or ``hold``.

    The track must have an estimate.
    """
    estimate = track.estimate
    assert estimate is not None, "nothing is known of the target yet"
    count, spacing = parameters.spline_samples, parameters.spline_spacing_ticks
    entries = track.entries
    oldest = len(entries) - 1 - (count - 1) * spacing
    if oldest >= 0 and entries[oldest].estimate is not None:
        samples = [(e.estimate.x, e.estimate.y) for e in entries[oldest::spacing] if e.estimate]
        matrix = extrapolation_matrix(count, spacing, parameters.spline_ends, xi_grid)
        return matrix @ np.array(samples), "spline"
    here = np.array((estimate.x, estimate.y))
    if sum(1 for entry in entries if entry.detections) < 2:
        return here + _column(xi_grid) * 0.0, "hold"
    return here + _column(xi_grid) * (tick_s * np.array((estimate.vx, estimate.vy))), "velocity"
