"""Robots that join, go and come back, by their liveliness tokens, and the wait for the first ones.

Before a run begins, robots of the team have ``join_s_max`` to join. What else comes then is refused
at once: an inbox that is full would keep tokens out as well.
"""

import asyncio
import itertools
from collections.abc import Callable

from encircle.protocol.keys import parse_key, robot_key
from encircle.protocol.zenoh.connection import ZenohConnection
from encircle.world.coordinator.failure_detector import FailureDetector
from encircle.world.process.core_access import CoreAccess
from encircle.world.process.reports import Reporter

EARLY_PERIOD_S, EARLY_MAX = 0.02, 4096


class Joining:
    """The tokens of one run. ``all_joined`` is set when the run can begin."""

    def __init__(
        self,
        failure_detector: FailureDetector,
        access: CoreAccess,
        connection: ZenohConnection,
        report: Reporter,
    ) -> None:
        self.all_joined = asyncio.Event()
        self._failure_detector = failure_detector
        self._access = access
        self._connection = connection
        self._report = report
        self._loop = asyncio.get_running_loop()

    def watch_tokens(self, run: str) -> None:
        """Take robots in from now on, and notice when they go."""
        self._connection.watch(robot_key(run, "*", "alive"), self._token_changed)

    def give_up(self, join_s_max: float, on_failure: Callable[[str], None]) -> None:
        """The robots' time to join is over: begin without the absent ones, or fail."""
        if self._failure_detector.may_begin:
            self.all_joined.set()
            return
        absent = ", ".join(self._failure_detector.expected)
        on_failure(f"{absent} did not join within {join_s_max:g} s")

    async def refuse_early_messages(self, receive: Callable[[str, bytes], object]) -> None:
        """Hand what comes before the run to ``receive``, which refuses it; until cancelled."""
        while True:
            for key, payload in itertools.islice(self._connection.waiting(), EARLY_MAX):
                receive(key, payload)
            await asyncio.sleep(EARLY_PERIOD_S)

    def _token_changed(self, key: str, alive: bool) -> None:
        """A token came or went; called in a thread of the connection."""
        self._loop.call_soon_threadsafe(self._robot_changed, key, alive)

    def _robot_changed(self, key: str, alive: bool) -> None:
        detector = self._failure_detector
        change = detector.token_appeared if alive else detector.token_vanished
        expected = detector.expected
        self._access.change(lambda: change(parse_key(key).robot or ""), key)
        if detector.expected != expected and not detector.begun:
            self._report({"expected": list(detector.expected)})
        if not detector.expected:
            self.all_joined.set()
