"""Reports on robots that are lost or back, and why a silent robot may never answer.

A robot of another version refuses all that this world sends, so it looks as if it did not answer. A
world asks such a robot for its version (its node information), and says so if it differs.
"""

import asyncio
from typing import Any

from encircle.protocol import VERSION
from encircle.protocol.keys import robot_key
from encircle.protocol.process.log import LineKind, say_error
from encircle.protocol.zenoh.connection import ZenohConnection
from encircle.world.coordinator.failure_detector import policies_of
from encircle.world.coordinator.membership import DepartureCause
from encircle.world.coordinator.round_engine import RoundEngine
from encircle.world.process.reports import Reporter


class DepartureReports:
    """Reports each departure of a run once; those of a resumed run's past were reported before.

    ``query_s_max``: how long a silent robot has to answer a query for its version.
    """

    def __init__(
        self,
        rounds: RoundEngine,
        connection: ZenohConnection,
        report: Reporter,
        query_s_max: float,
    ) -> None:
        self._run = rounds.run
        self._scenario = rounds.arena.scenario
        self._departures = rounds.departures
        self._connection = connection
        self._report = report
        self._query_s_max = query_s_max
        self._reported = len(self._departures)
        self._version_checks: dict[str, asyncio.Task[None]] = {}

    def update(self) -> None:
        """Report what has become of robots since the last time."""
        while self._reported < len(self._departures):
            departure = self._departures[self._reported]
            self._reported += 1
            tick, robot, text = departure.row
            report: dict[str, Any] = {"departure": [tick, robot, text]}
            line = f"world: tick {tick}: robot {robot} is {text}"
            is_silent = departure.cause is DepartureCause.NO_ANSWER
            if is_silent:
                report["policy"] = policies_of(self._scenario, (robot,))
                line += f" ({report['policy']})"
            self._report(report)
            say_error(line, kind=LineKind.EVENT)
            if is_silent:
                self._version_checks[robot] = asyncio.create_task(
                    asyncio.to_thread(self._check_version, robot)
                )

    def _check_version(self, robot: str) -> None:
        key = robot_key(self._run, robot, "about")
        info = self._connection.query_info(key, self._query_s_max)
        if info is not None and info.wire != VERSION:
            say_error(
                f"world: robot {robot} speaks version {info.wire} of the wire, this is {VERSION}:"
                " install the same Encircle on every host"
            )
