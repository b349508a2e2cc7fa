"""The robot as a process: asyncio supervises, one thread answers the world round by round.

asyncio's thread joins the run, watches the world's liveliness token and the signals, and bounds
every wait. The rounds themselves are run in a thread that waits for messages inside Zenoh, because
waking an asyncio loop from there costs half as much again as all the rest
(``docs/architecture.md``).
"""

import asyncio
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from typing import Any

from encircle.agents.process.robot_host import RobotHost
from encircle.agents.process.robot_life import Ending, RobotLife, RobotOptions
from encircle.protocol.envelopes import ANSWERS
from encircle.protocol.keys import robot_key, world_key
from encircle.protocol.process.interrupts import end_is_known, expect_library_threads, signals_to
from encircle.protocol.process.log import say_error
from encircle.protocol.zenoh.connection import ConnectionFailed, ZenohConnection
from encircle.protocol.zenoh.endpoints import Endpoints
from encircle.protocol.zenoh.liveliness import check_name_free

CONNECT_NOTICE_S = 2.0
STATUS_PERIOD_S = 0.2
QUERY_S_MAX = 5.0
DECISION_S_MAX = 2.0
"""How long a robot that is to end waits for the decision that is under way, in s."""


async def run_robot(robot: str, run: str, endpoints: Endpoints, options: RobotOptions) -> int:
    """As ``run_robots``, of one."""
    return await run_robots((robot,), run, endpoints, options)


async def run_robots(
    robots: Sequence[str], run: str, endpoints: Endpoints, options: RobotOptions
) -> int:
    """The life of some robots in a run, over one connection; returns the exit status.

    0 if the run was completed, 1 if not, whatever the reason; but 2 if a policy cannot be loaded,
    which is no run's fault. Of several robots the highest.
    """
    who = _names(robots)
    report = _discard if options.quiet else partial(_report, who)
    loop = asyncio.get_running_loop()
    notice = loop.call_later(CONNECT_NOTICE_S, report, f"connecting to {endpoints}")
    expressions = [robot_key(run, robot, "*") for robot in robots]
    try:
        connection = await asyncio.to_thread(
            ZenohConnection, endpoints, expressions, partial(_check_names_free, robots, run)
        )
    except ConnectionFailed as error:
        _report(who, str(error))
        return 1
    finally:
        notice.cancel()
    world = f"the world of run {run} at {endpoints}"
    lives = {robot: RobotLife(robot, run, world, options, len(robots) == 1) for robot in robots}

    def interrupt(name: str) -> None:
        for life in lives.values():
            life.end.interrupt(name)

    host = _host_of(lives, connection)

    def world_changed(key: str, alive: bool) -> None:
        for life in lives.values():
            life.watch.token_changed(key, alive)
        host.encloses = False
        if alive and connection.is_open:
            threading.Thread(target=_ask_world, args=(host, run, connection), daemon=True).start()

    with signals_to(interrupt):
        report(f"waiting for {world}")
        connection.watch(world_key(run, "alive"), world_changed)
        for robot in robots:
            connection.answer_info_queries(robot_key(run, robot, "about"), robot)
            connection.declare_alive(robot_key(run, robot, "alive"))
        await _take_part(lives, host, run, connection)
        endings = [life.conclude() for life in lives.values()]
        _report_endings(endings, options.quiet)
        end_is_known()
    return max(ending.status for ending in endings)


def _check_names_free(robots: Sequence[str], run: str, session: Any) -> None:
    for robot in robots:
        check_name_free(session, robot_key(run, robot, "alive"), f"robot {robot} in run {run}")


def _host_of(lives: Mapping[str, RobotLife], connection: ZenohConnection) -> RobotHost:
    loop = asyncio.get_running_loop()
    runs = {robot: life.runs for robot, life in lives.items()}
    finish = {robot: partial(_call_in_loop, loop, life.finished) for robot, life in lives.items()}
    return RobotHost(runs, connection, finish)


def _ask_world(host: RobotHost, run: str, connection: ZenohConnection) -> None:
    """Ask the world whether it opens envelopes; one that does not say so gets none."""
    info = connection.query_info(world_key(run, "about"), QUERY_S_MAX)
    host.encloses = info is not None and ANSWERS in info.takes


async def _take_part(
    lives: Mapping[str, RobotLife], host: RobotHost, run: str, connection: ZenohConnection
) -> None:
    """Answer until each robot's run is over or it has a reason to end; close the connection."""
    for life in lives.values():
        life.watch.await_admission()
    rounds = _in_thread(host.answer)
    status = asyncio.create_task(_report_status(lives.values()))
    living = {asyncio.create_task(life.over()): robot for robot, life in lives.items()}
    try:
        while living:
            done, _ = await asyncio.wait([*living, status], return_when=asyncio.FIRST_COMPLETED)
            if status in done:
                break
            ended = [living.pop(task) for task in done if task in living]
            for robot in ended if living else ():
                # The others go on, and this one is there no more.
                host.drop(robot)
                channels = ("alive", "about", "*")
                connection.withdraw(*(robot_key(run, robot, name) for name in channels))
    finally:
        status.cancel()
        for life in lives.values():
            life.watch.cancel()
        await asyncio.to_thread(connection.close)
        answered, _ = await asyncio.wait([rounds], timeout=DECISION_S_MAX)
    if answered:
        rounds.result()
    else:
        # A policy that never answers must not keep its process.
        lives[host.deciding or next(iter(lives))].give_up_decision()
        expect_library_threads()
    for life in lives.values():
        life.update_status()


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


async def _report_status(lives: Iterable[RobotLife]) -> None:
    while True:
        for life in lives:
            life.update_status()
        await asyncio.sleep(STATUS_PERIOD_S)


def _call_in_loop(
    loop: asyncio.AbstractEventLoop,
    finished: Callable[[BaseException | None], None],
    error: BaseException | None,
) -> None:
    with suppress(RuntimeError):  # the loop is closed: nobody waits any more
        loop.call_soon_threadsafe(finished, error)


def _report_endings(endings: Iterable[Ending], quiet: bool) -> None:
    """A line for each way in which robots have ended."""
    robots: dict[tuple[str, bool], list[str]] = {}
    for ending in endings:
        robots.setdefault((ending.line, ending.is_problem), []).append(ending.robot)
    for (line, is_problem), names in robots.items():
        if line and (is_problem or not quiet):
            _report(_names(names), line)


def _names(robots: Sequence[str]) -> str:
    return f"robot {', '.join(robots)}"


def _report(who: str, line: str) -> None:
    say_error(f"{who}: {line}")


def _discard(_line: str) -> None:
    """Report it to nobody."""
