"""A pace for lock-step: how long each tick takes at least, so that a hunt can be seen.

Nothing is decided by it. The answers to a tick are taken in when its time is over, and what they
say is the same then; so the digest is the same at any pace.
"""

import threading
import time
from collections.abc import Callable


class Pace:
    """Holds ticks back until their time is over. ``factor``: times real time.

    A tick that has taken longer delays those after it, and is not made up for.
    """

    def __init__(
        self,
        factor: float,
        tick_s: float,
        clock_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._period_s = tick_s / factor
        self._clock_s = clock_s
        self._tick = -1
        self._due_s = 0.0
        self._released = threading.Event()
        self.holds = False

    def left_s(self, tick: int) -> float:
        """How long a tick is still to be held back, in s; it begins when it is first asked for."""
        now_s = self._clock_s()
        if tick != self._tick:
            began_s = now_s if self._tick < 0 else self._due_s
            self._tick, self._due_s = tick, max(began_s + self._period_s, now_s)
        return self._due_s - now_s

    def hold(self, tick: int) -> None:
        """Wait until a tick's time is over, or ``release``."""
        if self._released.is_set() or (left_s := self.left_s(tick)) <= 0.0:
            return
        self.holds = True
        self._released.wait(left_s)
        self.holds = False

    def release(self) -> None:
        """Hold nothing back from now on."""
        self._released.set()
