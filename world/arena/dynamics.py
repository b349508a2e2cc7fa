"""What a commanded step becomes: holonomic as in the paper, or a unicycle that turns slowly.

A body that nobody commands any more rolls on and comes to a stop: its last step shrinks linearly,
so that it makes (COAST_TICKS - 1) / 2 of its last steps more.
"""

import numpy as np
from numpy.typing import NDArray

from encircle.protocol.messages import QUANTA_PER_M

FULL_TURN_RAD = 2.0 * np.pi
COAST_TICKS = 5


def quantised(positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Positions in m, of any shape, rounded to whole multiples of ``QUANTUM_M``."""
    return np.rint(positions * QUANTA_PER_M) / QUANTA_PER_M


def limited(steps: NDArray[np.float64], step_m_max: NDArray[np.float64]) -> NDArray[np.float64]:
    """Steps (B, 2) in m, each shortened to its body's longest (B,)."""
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    over = lengths > step_m_max
    if not over.any():
        return steps
    scale = np.ones(len(steps))
    scale[over] = step_m_max[over] / lengths[over]
    return steps * scale[:, None]


def coasting(last_steps: NDArray[np.float64], away: NDArray[np.int64]) -> NDArray[np.float64]:
    """Steps (B, 2) in m of bodies that have gone ``away`` (B,) steps without a command.

    The one in the making included: 1 for the first, none from ``COAST_TICKS`` on.
    """
    left = np.maximum(0.0, 1.0 - away / COAST_TICKS)
    return last_steps * left[:, None]


def unicycle(
    headings: NDArray[np.float64], steps: NDArray[np.float64], turn_rad_max: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Headings (N,) after turning towards the commanded steps (N, 2), and the steps then made.

    A body turns by at most ``turn_rad_max`` and rolls forward by what of its commanded step lies
    along its new heading; it never rolls backward. Without a command it keeps its heading.
    """
    lengths = np.sqrt((steps * steps).sum(axis=1))
    wanted = np.where(lengths > 0.0, np.arctan2(steps[:, 1], steps[:, 0]), headings)
    error = np.remainder(wanted - headings + np.pi, FULL_TURN_RAD) - np.pi
    turned = headings + np.clip(error, -turn_rad_max, turn_rad_max)
    turned = np.remainder(turned + np.pi, FULL_TURN_RAD) - np.pi
    forward = np.maximum(0.0, lengths * np.cos(wanted - turned))
    return turned, forward[:, None] * np.stack([np.cos(turned), np.sin(turned)], axis=1)


def holonomic_headings(
    headings: NDArray[np.float64], steps: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Headings (N,) of bodies that move in any direction: the direction of their last step."""
    moving = (steps != 0.0).any(axis=1)
    return np.where(moving, np.arctan2(steps[:, 1], steps[:, 0]), headings)
