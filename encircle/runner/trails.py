"""Where everybody was, of a hunt in memory, for who looks at it afterwards."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from encircle.agents.brain.robot_core import RobotCore
from encircle.runner.memory import RobotAnswer
from encircle.world.coordinator.world_core import WorldCore


class Trails:
    """Looks on at a hunt in memory, as its observer, and keeps the positions of each tick."""

    def __init__(self) -> None:
        self._positions: list[NDArray[np.float64]] = []

    def decided(
        self,
        world: WorldCore,
        _robots: Sequence[RobotCore],
        _answers: Sequence[RobotAnswer | None],
    ) -> None:
        """All robots have answered at the world's tick."""
        self._positions.append(world.state.positions)

    def ended(self, world: WorldCore) -> None:
        """The run is over."""
        self._positions.append(world.state.positions)
        self._bodies = len(world.arena.ids) + 1

    def positions(self) -> NDArray[np.float64]:
        """(T, N + 1, 2) positions in m of robots, then the target; the hunt must be over."""
        return np.array(self._positions)[:, : self._bodies]
