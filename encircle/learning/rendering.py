"""The picture of an episode so far: the house's figure of a hunt, as an array of one size.

The figure takes the shape of what has happened, and grows with that. It is put on a canvas that has
room for the largest, so that the pictures of an episode make a video.
"""

from collections.abc import Sequence
from io import BytesIO

import matplotlib.image
import numpy as np
from numpy.typing import NDArray

from encircle.figures.drawing import png_of
from encircle.figures.trajectories import trajectories_figure
from encircle.runlog.ground_truth import GroundTruth
from encircle.world.coordinator.world_core import WorldCore

CANVAS = (1600, 1280)
"""Height and width in pixels; the picture has half of each."""


def picture(world: WorldCore, trail: Sequence[NDArray[np.float64]]) -> NDArray[np.uint8]:
    """The hunt so far, (800, 640, 3); ``trail``: the bodies' positions (N + 1, 2) in m by tick."""
    arena, state = world.arena, world.state
    away = np.zeros(len(arena.ids), bool) if state.away is None else state.away > 0
    lost = np.zeros((len(trail), len(arena.ids)), bool)
    lost[-1] = away
    last = state.tick
    shown = GroundTruth(
        arena.scenario,
        arena,
        np.arange(last - len(trail) + 1, last + 1),
        np.array(trail),
        ((),) * len(trail),
        state.captured,
        world.ended,
        lost,
    )
    title = f"tick {last}" if world.ended is None else shown.outcome
    with BytesIO(png_of(trajectories_figure(shown, title, labelled=False))) as file:
        image: NDArray[np.float32] = matplotlib.image.imread(file, format="png")
    canvas = np.ones((*CANVAS, 3), np.float32)
    part = image[: CANVAS[0], : CANVAS[1], :3]
    canvas[: part.shape[0], : part.shape[1]] = part
    halves = canvas.reshape(CANVAS[0] // 2, 2, CANVAS[1] // 2, 2, 3).mean(axis=(1, 3))
    pixels: NDArray[np.uint8] = (halves * 255.0).round().astype(np.uint8)
    return pixels
