"""Lines on decisions that take too long: the first one of a run, and in its end how many they were.

By the clock a decision is too long if it takes more than a tick: its command comes late, and the
world goes by the newest one before it. In lock-step it is too long if it takes more than a world
waits for an answer, unless that was told otherwise. It is measured here, since what decides knows
no clock; processor time beside it tells a slow policy from a machine that was busy or frozen.
"""

import time
from collections.abc import Callable
from typing import TypeVar

from encircle.agents.brain.robot_core import RobotCore

ANSWER_S_MAX = 3.0
"""How long a world waits in lock-step unless it is told otherwise (docs/protocol.md, Deadlines)."""

T = TypeVar("T")


class SlowDecisions:
    """Watches over the decisions of one robot in one run; ``say`` gets the lines."""

    def __init__(
        self,
        core: RobotCore,
        say: Callable[[str], None],
        clock_s: Callable[[], float] = time.monotonic,
        processor_s: Callable[[], float] = time.thread_time,
    ) -> None:
        self._core = core
        self._say = say
        self._clock_s = clock_s
        self._processor_s = processor_s
        self._decisions = self._slow = 0
        self._longest_s = 0.0
        self._limit = ""

    def timed(self, decide: Callable[[], T], tick_s: float | None = None) -> T:
        """What ``decide`` returns. ``tick_s``: length of a tick if the run goes by the clock."""
        core, before = self._core, (self._core.setups, self._core.tick)
        began_s, began_processor_s = self._clock_s(), self._processor_s()
        answer = decide()
        took_s = self._clock_s() - began_s
        # A setup, or the same answer once more, is no decision.
        if core.setups == before[0] and core.tick != before[1] and core.failed is None:
            self._decisions += 1
            if took_s > (ANSWER_S_MAX if tick_s is None else tick_s):
                self._note(took_s, self._processor_s() - began_processor_s, tick_s)
        return answer

    def _note(self, took_s: float, processor_s: float, tick_s: float | None) -> None:
        self._slow += 1
        self._longest_s = max(self._longest_s, took_s)
        self._limit = (
            f"the {ANSWER_S_MAX:g} s that a world waits by default"
            if tick_s is None
            else f"a tick of {tick_s:g} s"
        )
        if self._slow == 1:
            self._say(
                f"{self._policy} took {took_s:.3g} s at tick {self._core.tick}"
                f" ({processor_s:.3g} s of processor time), more than {self._limit}:"
                " its answer came late"
            )

    def conclude(self) -> None:
        """The run is over for this robot: say how many there were, if more than the first."""
        if self._slow > 1:
            self._say(
                f"{self._policy} took more than {self._limit} for {self._slow} of"
                f" {self._decisions} decisions, {self._longest_s:.3g} s at most"
            )

    @property
    def _policy(self) -> str:
        setup = self._core.setup
        return f"policy {setup.strategy!r}" if setup is not None else "its policy"
