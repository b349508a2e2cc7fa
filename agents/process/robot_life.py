"""One robot's time in its process: what it waits for, why it ends, and what it says of that."""

import asyncio
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from encircle.agents.brain.robot_core import RobotCore
from encircle.agents.process.robot_runs import RobotRuns
from encircle.agents.process.status_lines import StatusLog
from encircle.agents.process.world_watch import RobotEnd, WorldWatch
from encircle.protocol.endings import is_failure
from encircle.protocol.plugins import PluginLoadError
from encircle.protocol.process.log import say_error

JOIN_S_MAX = 30.0
WORLD_S_MAX = 10.0


@dataclass(frozen=True, slots=True)
class RobotOptions:
    """What a robot does in whatever run.

    ``join_s_max``, ``world_s_max``: how long it waits, in s, to be admitted, and for a world that
    is gone. ``rejoins``: take part in run after run under the same name, until the world is gone.
    ``quiet``: report only what goes wrong. ``tracebacks``: the directory for that of a policy that
    fails, a temporary file if None. ``make_core``: as of ``RobotRuns``.
    """

    join_s_max: float = JOIN_S_MAX
    world_s_max: float = WORLD_S_MAX
    rejoins: bool = False
    quiet: bool = False
    tracebacks: Path | None = None
    make_core: Callable[..., RobotCore] = RobotCore


class Ending(NamedTuple):
    """How a robot has ended: its exit status and a line on it, which may be empty.

    ``is_problem``: whether the line is to be said in any case.
    """

    robot: str
    status: int
    line: str
    is_problem: bool


class RobotLife:
    """One robot of a process. ``world``: how to call its world; ``alone``: no other is there."""

    def __init__(
        self, robot: str, run: str, world: str, options: RobotOptions, alone: bool
    ) -> None:
        self.robot = robot
        self.end = RobotEnd()
        self._alone = alone
        self._quiet = options.quiet
        self.runs = RobotRuns(
            robot, run, self._report, options.rejoins, options.tracebacks, options.make_core
        )
        self._status_log = StatusLog(self._report, ticks=alone)
        self.watch = WorldWatch(
            self.runs,
            self.end,
            self._report_in_order,
            world,
            options.join_s_max,
            options.world_s_max,
        )
        self._finished: asyncio.Future[None] = asyncio.get_running_loop().create_future()

    async def over(self) -> None:
        """Wait until it answers no more or has a reason to end."""
        either: list[asyncio.Future[Any]] = [self._finished, self.end.reason]
        await asyncio.wait(either, return_when=asyncio.FIRST_COMPLETED)
        self.watch.cancel()

    def finished(self, error: BaseException | None) -> None:
        """It answers no more; ``error``: of ours, that has kept it from answering."""
        if self._finished.done():
            return
        if error is None:
            self._finished.set_result(None)
        else:
            self._finished.set_exception(error)

    def give_up_decision(self) -> None:
        """Its policy does not answer, and nobody waits for that any longer."""
        self.end.stop(f"still deciding at tick {self.runs.core.tick}: given up")

    def update_status(self) -> None:
        """Report what has changed."""
        self._status_log.update(self.runs.core)

    def conclude(self) -> Ending:
        """How it has ended; raises an error of ours that has ended a robot that was alone."""
        core = self.runs.core
        if core.failed is not None:
            # That has been said.
            status = 2 if isinstance(core.failed.error, PluginLoadError) else 1
            return Ending(self.robot, status, "", False)
        if self._finished.done() and (error := self._finished.exception()) is not None:
            if self._alone:
                raise error
            say_error(*"".join(traceback.format_exception(error)).splitlines())
            return Ending(self.robot, 1, f"an error of this program: {error!r}", True)
        if core.ended is not None:
            failed = is_failure(core.ended)
            line = f"run {core.run} ended: {core.ended}"
            return Ending(self.robot, int(failed), line, failed and not self.runs.rejoins)
        reason = self.end.reason
        line = reason.result() if reason.done() else "the link was closed"
        completed = self.runs.idle and not self.end.interrupted
        return Ending(self.robot, int(not completed), line, not completed)

    def _report_in_order(self, line: str) -> None:
        self.update_status()
        self._report(line)

    def _report(self, line: str) -> None:
        if not self._quiet:
            say_error(f"robot {self.robot}: {line}")
