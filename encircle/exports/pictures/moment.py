"""A run between two of its ticks: where bodies are, if they go straight from one to the next."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from encircle.scene.frame import Frame
from encircle.scene.stage import Stage

Place = tuple[float, float]
Floats = NDArray[np.float64]
MOVED = "moved"
"""The kind of event at a tick at which the target was put elsewhere."""


class Moment(NamedTuple):
    """``ticks``: tick and the share of one that has passed; ``frame``: that tick's.

    ``row``: index of the frame. ``decided``: the frame of the newest decisions, which the last one
    of a run has none of. ``robots``, ``target``: places in m now.
    """

    ticks: float
    row: int
    frame: Frame
    decided: Frame
    robots: tuple[Place, ...]
    target: Place


def positions_of(frames: Sequence[Frame]) -> NDArray[np.float64]:
    """(T, N + 1, 2) places in m of robots, then the target."""
    return np.array([[*frame.robots, frame.target] for frame in frames], dtype=float)


def moment_at(frames: Sequence[Frame], ticks: float) -> Moment:
    """The run at a tick and a share of one; at its end after its end."""
    first, last = frames[0].tick, frames[-1].tick
    ticks = min(max(ticks, first), last)
    row = min(int(ticks - first), len(frames) - 1)
    now, then = frames[row], frames[min(row + 1, len(frames) - 1)]
    share = ticks - now.tick
    robots = tuple(_between(a, b, share) for a, b in zip(now.robots, then.robots, strict=True))
    jumps = any(event.kind == MOVED for event in then.events)
    target = now.target if jumps else _between(now.target, then.target, share)
    decided = frames[max(0, min(row, len(frames) - 2))]
    return Moment(ticks, row, now, decided, robots, target)


def clock_text(stage: Stage, tick: int) -> str:
    """The time of a tick in s, with as many decimals as a tick has, one to three."""
    decimals = next((n for n in (1, 2) if round(stage.tick_s, n) == stage.tick_s), 3)
    return f"{tick * stage.tick_s:.{decimals}f} s"


def _between(a: Place, b: Place, share: float) -> Place:
    return a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])
