"""The robot as a process: asyncio supervises, one thread answers the world round by round.

asyncio's thread joins the run, watches the world's liveliness token and the signals, and bounds
every wait. The rounds themselves are run in a thread that waits for messages inside Zenoh, because
waking an asyncio loop from there costs half as much again as all the rest
(``docs/architecture.md``).
"""

import asyncio
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from encircle.agents.brain.robot_core import RobotCore
from encircle.agents.process.robot_runs import RobotRuns
from encircle.agents.process.status_lines import StatusLog
from encircle.agents.process.world_watch import RobotEnd, WorldWatch
from encircle.protocol.endings import is_failure
from encircle.protocol.keys import robot_key, world_key
from encircle.protocol.plugins import PluginLoadError
from encircle.protocol.process.interrupts import end_is_known, expect_library_threads, signals_to
from encircle.protocol.process.log import say_error
from encircle.protocol.zenoh.connection import ConnectionFailed, ZenohConnection
from encircle.protocol.zenoh.endpoints import Endpoints
from encircle.protocol.zenoh.unique_names import check_name_free

JOIN_S_MAX = 30.0
WORLD_S_MAX = 10.0
CONNECT_NOTICE_S = 2.0
STATUS_PERIOD_S = 0.2
DECISION_S_MAX = 2.0
"""How long a robot that is to end waits for the decision that is under way, in s."""


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


async def run_robot(robot: str, run: str, endpoints: Endpoints, options: RobotOptions) -> int:
    """One robot's life in a run; returns the exit status: 0 if the run was completed.

    1 if not, whatever the reason; but 2 if its policy cannot be loaded, which is no run's fault.
    """
    report_problem = partial(_report, f"robot {robot}")
    report = _discard if options.quiet else report_problem
    own_token = robot_key(run, robot, "alive")
    check = partial(check_name_free, token=own_token, who=f"robot {robot} in run {run}")
    loop = asyncio.get_running_loop()
    notice = loop.call_later(CONNECT_NOTICE_S, report, f"connecting to {endpoints}")
    try:
        connection = await asyncio.to_thread(
            ZenohConnection, endpoints, robot_key(run, robot, "*"), check
        )
    except ConnectionFailed as error:
        report_problem(str(error))
        return 1
    finally:
        notice.cancel()
    runs = RobotRuns(robot, run, report, options.rejoins, options.tracebacks, options.make_core)
    status_log = StatusLog(report)

    def report_in_order(line: str) -> None:
        status_log.update(runs.core)
        report(line)

    world, end = f"the world of run {run} at {endpoints}", RobotEnd()
    world_watch = WorldWatch(
        runs, end, report_in_order, world, options.join_s_max, options.world_s_max
    )
    with signals_to(end.interrupt):
        report(f"waiting for {world}")
        connection.watch(world_key(run, "alive"), world_watch.token_changed)
        connection.answer_info_queries(robot_key(run, robot, "about"), robot)
        connection.declare_alive(own_token)
        await _take_part(runs, connection, world_watch, end, status_log)
        status = _conclude(runs, end, report_problem, report)
        end_is_known()
    return status


async def _take_part(
    runs: RobotRuns,
    connection: ZenohConnection,
    world_watch: WorldWatch,
    end: RobotEnd,
    status_log: StatusLog,
) -> None:
    """Answer until the run is over or there is a reason to end early; close the connection."""
    world_watch.await_admission()
    rounds = _in_thread(partial(runs.answer, connection))
    status = asyncio.create_task(_report_status(runs, status_log))
    try:
        await _first_of(rounds, end.reason, status)
    finally:
        status.cancel()
        world_watch.cancel()
        await asyncio.to_thread(connection.close)
        answered, _ = await asyncio.wait([rounds], timeout=DECISION_S_MAX)
    if answered:
        rounds.result()
    else:
        # A policy that never answers must not keep its process.
        end.stop(f"still deciding at tick {runs.core.tick}: given up")
        expect_library_threads()
    status_log.update(runs.core)


def _in_thread(work: Callable[[], None]) -> "asyncio.Future[None]":
    """Do this in a thread that need not come to its end for the process to end."""
    loop = asyncio.get_running_loop()
    done: asyncio.Future[None] = loop.create_future()

    def run() -> None:
        try:
            work()
        except BaseException as error:
            finish = partial(done.set_exception, error)
        else:
            finish = partial(done.set_result, None)
        with suppress(RuntimeError):  # the loop is closed: nobody waits any more
            loop.call_soon_threadsafe(finish)

    threading.Thread(target=run, name="rounds", daemon=True).start()
    return done


async def _report_status(runs: RobotRuns, status_log: StatusLog) -> None:
    while True:
        status_log.update(runs.core)
        await asyncio.sleep(STATUS_PERIOD_S)


def _conclude(
    runs: RobotRuns,
    end: RobotEnd,
    report_problem: Callable[[str], None],
    report: Callable[[str], None],
) -> int:
    """Report how it ended; returns the exit status."""
    if runs.core.failed is not None:
        return 2 if isinstance(runs.core.failed.error, PluginLoadError) else 1
    ended = runs.core.ended
    if ended is not None:
        failed = is_failure(ended)
        report_end = report_problem if failed and not runs.rejoins else report
        report_end(f"run {runs.core.run} ended: {ended}")
        return int(failed)
    reason = end.reason.result() if end.reason.done() else "the link was closed"
    if runs.idle and not end.interrupted:
        report(reason)
        return 0
    report_problem(reason)
    return 1


async def _first_of(*futures: "asyncio.Future[Any]") -> None:
    await asyncio.wait(futures, return_when=asyncio.FIRST_COMPLETED)


def _report(who: str, line: str) -> None:
    say_error(f"{who}: {line}")


def _discard(_line: str) -> None:
    """Report it to nobody."""
