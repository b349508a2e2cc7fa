"""The status lines of a robot that was started by hand: each change, and a tick a second."""

import time
from collections.abc import Callable

from encircle.agents.brain.robot_core import RobotCore

PERIOD_S = 1.0


class StatusLog:
    """Reports what has changed about a robot since the last update; ``say`` takes a line.

    ``ticks``: whether to report a tick a second.
    """

    def __init__(
        self,
        say: Callable[[str], None],
        clock_s: Callable[[], float] = time.monotonic,
        ticks: bool = True,
    ) -> None:
        self._say = say
        self._ticks = ticks
        self._clock_s = clock_s
        self._reported_s = clock_s()
        self._tick = -1
        self._setups = 0

    def update(self, core: RobotCore) -> None:
        """Look at a run's core, which may be another one from run to run."""
        setup, tick = core.setup, core.tick
        if setup is None:
            self._setups = 0
        elif core.setups != self._setups:
            again = f" again at tick {setup.first_tick}" if setup.first_tick else ""
            self._setups = core.setups
            self._say(f"joined run {core.run}{again}, one of {len(setup.team)} robots")
        elif self._ticks and tick > self._tick and self._clock_s() - self._reported_s >= PERIOD_S:
            self._reported_s = self._clock_s()
            self._say(f"tick {tick}, {core.mode}")
        self._tick = tick
