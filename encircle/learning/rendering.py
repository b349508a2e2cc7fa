"""The picture of an episode so far: the house's figure of a hunt, as an array."""

from collections.abc import Sequence
from io import BytesIO

import matplotlib.image
import numpy as np
from numpy.typing import NDArray

from encircle.figures.drawing import png_of
from encircle.figures.trajectories import trajectories_figure
from encircle.runlog.ground_truth import GroundTruth
from encircle.world.coordinator.world_core import WorldCore


def picture(world: WorldCore, trail: Sequence[NDArray[np.float64]]) -> NDArray[np.uint8]:
    """The hunt so far, (H, W, 3); ``trail``: the bodies' positions (N + 1, 2) in m by tick."""
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
    return (image[:, :, :3] * 255.0).round().astype(np.uint8)
