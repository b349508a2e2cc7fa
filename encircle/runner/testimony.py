"""What the processes of a run said, how they ended, and what that means for the run.

Of all that goes wrong one line is told: what happened first, in the words of whom it happened to.
"""

import signal
from collections.abc import Mapping
from typing import Any

from encircle.protocol.endings import failure_of
from encircle.protocol.process.log import LineKind
from encircle.runner.nodes import Node
from encircle.world.coordinator.result import Result
from encircle.world.scenario.errors import ScenarioError

BAD_CONFIGURATION = 2
ERROR_LINES_MAX = 200
ENDING = (LineKind.PROBLEM, LineKind.PLUGIN)
"""Lines that may tell why a process has ended."""
TIMING = ("rounds_s", "joined_s", "begun_unix_s", "real_time")


class RunFailed(Exception):
    """A run that did not come to its end; the message says in one line what happened.

    ``resumable``: it broke off, so that what was recorded of it may be gone on with.
    """

    def __init__(self, reason: str, resumable: bool = False) -> None:
        super().__init__(reason)
        self.resumable = resumable


class Testimony:
    """What the processes of one run have said, and how they have ended, as far as they have.

    ``robots_in``: the robots of each process but the world's, by its name; ``processes``: those
    that were started. ``failed``: the names of those that ended badly, in that order.
    """

    def __init__(
        self, robots_in: Mapping[str, tuple[str, ...]], processes: Mapping[str, Node]
    ) -> None:
        self.failed: list[str] = []
        self._robots_in = robots_in
        self._processes = processes
        self._said: dict[str, list[tuple[LineKind, str]]] = {}

    def keep(self, name: str, kind: LineKind, text: str) -> bool:
        """Keep a line that a process has said, unless there are too many; whether it is kept."""
        lines = self._said.setdefault(name, [])
        if len(lines) >= ERROR_LINES_MAX:
            return False
        lines.append((kind, text))
        return True

    def outcome(
        self, result: dict[str, Any] | None, begun: bool, tick: int
    ) -> tuple[Result, dict[str, Any]]:
        """The run's result and timings, of what the world has reported; else ``RunFailed``.

        ``begun``: whether the run has begun; ``tick``: the last that the world has told of.
        ``ScenarioError`` if the world has refused its configuration.
        """
        if result is None:
            failure = self._first_failure(begun, tick)
            if self._processes["world"].returncode == BAD_CONFIGURATION:
                raise ScenarioError(failure.removeprefix("world: "))
            raise RunFailed(failure, resumable=begun)
        found, extra = _read(result)
        if (reason := failure_of(found.ended)) is None:
            return found, extra
        if of_plugins := self._failure_of_plugins():
            # Its world waits where it was, but the same would happen again.
            raise RunFailed(of_plugins)
        if not begun and self.failed and self.failed[0] != "world":
            # The world can only say that it was stopped, or who did not come.
            raise RunFailed(self._first_failure(begun, tick))
        how = [
            f" ({_ending(process.returncode)})"
            for name, process in self._processes.items()
            if process.returncode
            and any(reason.startswith(f"robot {r} ") for r in self._robots_in.get(name, ()))
        ]
        raise RunFailed(reason + "".join(how), resumable=begun)

    def robot_ending(self, name: str) -> str:
        """How a robot's process ended; if by itself, with the last that it said, as of an error."""
        own_lines = self._lines(name, *ENDING)
        status = self._processes[name].returncode
        last = (
            f": {own_lines[-1] if own_lines else 'it said nothing'}"
            if status and status > 0
            else ""
        )
        return f"robot {', '.join(self._robots_in[name])} {_ending(status)}{last}"

    def _failure_of_plugins(self) -> str:
        """The line that tells of a plug-in that failed, in the world or in robots, if one has."""
        if of_world := self._lines("world", LineKind.PLUGIN):
            return of_world[-1].removeprefix("world: ")
        of_robots = {
            robot: lines[-1].removeprefix(f"robot {robot}: ")
            for name, robots in self._robots_in.items()
            for robot in robots
            if (lines := self._lines_of(robot, name))
        }
        first, *others = of_robots or [""]
        # As a rule robots with the same policy fail at the same tick.
        return of_robots.get(first, "") + (f"; likewise {', '.join(others)}" if others else "")

    def _lines_of(self, robot: str, name: str) -> list[str]:
        """The lines of plug-ins that failed in one of the robots of a process."""
        lines = self._lines(name, LineKind.PLUGIN)
        if self._robots_in[name] == (robot,):
            return lines
        return [line for line in lines if line.startswith(f"robot {robot}: ")]

    def _lines(self, name: str, *kinds: LineKind) -> list[str]:
        return [text for kind, text in self._said.get(name, ()) if kind in kinds]

    def _first_failure(self, begun: bool, tick: int) -> str:
        """Why there is no result at all: what the first process to fail said, or how it ended."""
        name = "world" if begun or not self.failed else self.failed[0]
        if name != "world":
            return self.robot_ending(name)
        status = self._processes["world"].returncode
        how = f"the world {_ending(status)} at tick {tick}"
        if status is not None and status < 0:
            return how
        # A configuration error has several lines, each of which helps.
        return "\n".join(self._lines("world", *ENDING)) or how


def _read(result: Mapping[str, Any]) -> tuple[Result, dict[str, Any]]:
    """The result and the timings that the world has reported as JSON."""
    told = dict(result)
    extra = {key: told.pop(key) for key in TIMING if key in told}
    for name in ("distances_m", "interventions"):
        told[name] = tuple(told[name])
    told["departures"] = tuple([(t, robot, what) for t, robot, what in told["departures"]])
    return Result(**told), extra


def _ending(status: int | None) -> str:
    if status is not None and status < 0:
        return f"was killed by {signal.Signals(-status).name}"
    return f"ended with status {status}"
