"""The runs that one robot takes part in, and how it answers in them.

A robot takes part in one run, or in one after the other under the same name. In each it learns from
the first observation whether the world waits for answers or goes by the clock.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path

from encircle.agents.brain.robot_core import RobotCore
from encircle.agents.process import real_time
from encircle.agents.process.slow_decisions import SlowDecisions
from encircle.protocol.connections import Connection
from encircle.protocol.endings import is_failure
from encircle.protocol.errors import ConnectionClosed
from encircle.protocol.plugins import PluginFailed
from encircle.protocol.process.log import LineKind, bounded_log, say_error
from encircle.protocol.process.tracebacks import failure_line


class RobotRuns:
    """One robot's runs. ``core``: that of the run that it takes part in or waits for.

    ``completed``: how many it has come to the end of and stayed. ``rejoins``: whether it stays for
    a further run after one. ``over``: whether there is no further run.
    ``report`` gets a line on each; ``tracebacks`` is the directory for that of a policy that fails.
    ``make_core``: what makes the core of each run, from what a ``RobotCore`` is made of.
    """

    def __init__(
        self,
        robot: str,
        run: str,
        report: Callable[[str], None],
        rejoins: bool,
        tracebacks: Path | None = None,
        make_core: Callable[..., RobotCore] = RobotCore,
    ) -> None:
        self.rejoins = rejoins
        self.completed = 0
        self.over = False
        self._left = False
        self._report = report
        self._tracebacks = tracebacks
        self._new_core = partial(make_core, robot, run, bounded_log(), self._report_failure)
        self._begin()

    def _begin(self) -> None:
        self.core = self._new_core()
        self._slow = SlowDecisions(self.core, self._report_slow)
        self._by_clock: bool | None = None

    def answer(self, connection: Connection) -> None:
        """Answer round by round until there is no further run or the connection is closed."""
        try:
            while not self.over:
                key, payload = connection.receive()
                if self.goes_by_clock(key, payload):
                    self.answer_by_clock(connection, (key, payload))
                    continue
                for message in self.take(key, payload):
                    connection.send(*message)
        except ConnectionClosed:
            pass
        finally:
            self.leave()

    def leave(self) -> None:
        """The robot takes part no more: say what is left to be said of its run."""
        if not self._left:
            self._left = True
            self._slow.conclude()

    def take(self, key: str, payload: bytes) -> list[tuple[str, bytes]]:
        """Take one message in, in lock-step; returns the messages to send."""
        messages = self._slow.timed(partial(self.core.receive, key, payload))
        if self.core.ended is not None:
            self._conclude()
        return messages

    def goes_by_clock(self, key: str, payload: bytes) -> bool:
        """Whether the run's world is known to go by the clock; a message may be what tells."""
        if self._by_clock is None:
            self._by_clock = real_time.is_timed(self.core, key, payload)
        return bool(self._by_clock)

    def answer_by_clock(self, connection: Connection, first: tuple[str, bytes]) -> None:
        """Answer by the clock to the end of the run. ``first``: the first observation."""
        real_time.answer(self.core, connection, first, self._slow)
        if self.core.ended is not None:
            self._conclude()

    def _conclude(self) -> None:
        """The run is over; wait for the next one if there may be one."""
        if is_failure(self.core.ended or "") or not self.rejoins:
            self.over = True
            self.leave()
            return
        self._slow.conclude()
        self.completed += 1
        self._report(f"run {self.core.run} ended: {self.core.ended}; staying for the next")
        self._begin()

    def _report_slow(self, line: str) -> None:
        say_error(f"robot {self.core.robot}: {line}", kind=LineKind.EVENT)

    def _report_failure(self, failed: PluginFailed) -> None:
        line = f"robot {failed.who}: {failure_line(failed, self._tracebacks)}"
        say_error(line, kind=LineKind.PLUGIN)

    @property
    def accepted(self) -> tuple[int, int]:
        """The number of completed runs and of messages accepted in this one.

        It changes with every message of a world that the robot accepts.
        """
        return self.completed, self.core.accepted

    @property
    def idle(self) -> bool:
        """Whether the robot waits for a further run."""
        return self.completed > 0 and self.core.config is None
