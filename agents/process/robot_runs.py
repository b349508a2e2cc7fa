"""The runs that one robot process takes part in, and the thread that answers in them.

A robot takes part in one run, or in one after the other under the same name. In each it learns from
the first observation whether the world waits for answers or goes by the clock.
"""

import gc
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

    ``completed``: how many have ended. ``rejoins``: whether it stays for a further run after one.
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
        self._report = report
        self._tracebacks = tracebacks
        self._new_core = partial(make_core, robot, run, bounded_log(), self._report_failure)
        self.core = self._new_core()

    def answer(self, connection: Connection) -> None:
        """Answer round by round until there is no further run or the connection is closed."""
        # What was imported stays for good: collecting garbage need not look at it again and again.
        gc.freeze()
        while True:
            self._answer_in_run(connection)
            if self.core.ended is None or is_failure(self.core.ended) or not self.rejoins:
                return
            self.completed += 1
            self._report(f"run {self.core.run} ended: {self.core.ended}; staying for the next")
            self.core = self._new_core()

    def _answer_in_run(self, connection: Connection) -> None:
        core, by_clock = self.core, None
        slow = SlowDecisions(core, self._report_slow)
        try:
            while core.ended is None:
                key, payload = connection.receive()
                if by_clock is None:
                    by_clock = real_time.is_timed(core, key, payload)
                if by_clock:
                    real_time.answer(core, connection, (key, payload), slow)
                    return
                for message in slow.timed(partial(core.receive, key, payload)):
                    connection.send(*message)
        except ConnectionClosed:
            pass
        finally:
            slow.conclude()

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
