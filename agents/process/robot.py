"""The robot as a process: asyncio supervises, one thread answers the world round by round.

The supervisor joins the run, watches the world's liveliness token and the signals, and bounds every
wait. The rounds themselves are run in a thread that waits for messages inside Zenoh, because waking
an asyncio loop from there costs half as much again as all the rest (``docs/architecture.md``).

A world that is gone leaves its robots standing: in lock-step nothing moves that was not commanded
in the round. They wait a bounded time for a world of that run, which tells them all they need.
"""

import asyncio
import gc
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from encircle.agents.brain.robot_core import RobotCore
from encircle.agents.process import real_time
from encircle.agents.process.status_lines import StatusLog
from encircle.protocol.connections import Connection
from encircle.protocol.endings import is_failure
from encircle.protocol.errors import ConnectionClosed
from encircle.protocol.keys import robot_key, world_key
from encircle.protocol.plugins import PluginFailed, PluginLoadError
from encircle.protocol.process.interrupts import signals_to
from encircle.protocol.process.log import bounded_log, say_error
from encircle.protocol.process.tracebacks import failure_line
from encircle.protocol.zenoh.connection import ConnectionFailed, ZenohConnection
from encircle.protocol.zenoh.endpoints import Endpoints
from encircle.protocol.zenoh.unique_names import check_name_free

JOIN_S_MAX = 30.0
WORLD_S_MAX = 10.0
SUSPICION_S = 0.2
"""How long, after its token, a world's messages may still be under way; then how long it may be
silent before it counts as gone."""
CONNECT_NOTICE_S = 2.0
LOOK_PERIOD_S = 0.2
OTHER_VERSION = "this program speaks"


class _RobotRuns:
    """The runs that one robot process takes part in: one, or one after the other if it stays."""

    def __init__(
        self,
        robot: str,
        run: str,
        tell: Callable[[str], None],
        rejoins: bool,
        tracebacks: Path | None = None,
    ) -> None:
        self._new = partial(RobotCore, robot, run, self._refused, self._failed)
        self._log = bounded_log()
        self._tell = tell
        self._tracebacks = tracebacks
        self.rejoins = rejoins
        self.core = self._new()
        self.completed = 0
        self.other_version = ""

    def _refused(self, line: str) -> None:
        if OTHER_VERSION in line:
            self.other_version = line
        self._log(line)

    def _failed(self, failed: PluginFailed) -> None:
        _say(f"robot {failed.who}", failure_line(failed, self._tracebacks))

    def answer(self, connection: Connection) -> None:
        """Answer round by round until there is no further run or the link is closed."""
        # What was imported stays for good: collecting garbage need not look at it again and again.
        gc.freeze()
        while True:
            self._answer_rounds(connection)
            if self.core.ended is None or is_failure(self.core.ended) or not self.rejoins:
                return
            self.completed += 1
            self._tell(f"run {self.core.run} ended: {self.core.ended}; staying for the next")
            self.core = self._new()

    def _answer_rounds(self, connection: Connection) -> None:
        core, timed = self.core, None
        try:
            while core.ended is None:
                key, payload = connection.receive()
                if timed is None:
                    timed = real_time.is_timed(core, key, payload)
                if timed:
                    real_time.answer(core, connection, (key, payload))
                    return
                for message in core.receive(key, payload):
                    connection.send(*message)
        except ConnectionClosed:
            pass

    @property
    def messages_taken(self) -> tuple[int, int]:
        """How much the world has said so far: it changes with every message that is taken in."""
        return self.completed, self.core.accepted

    @property
    def idle(self) -> bool:
        """Whether it waits for a further run."""
        return self.completed > 0 and self.core.config is None


class _Supervisor:
    """Watches over a robot's life: the world's token, the signals, and how long a wait lasts."""

    def __init__(
        self,
        runs: _RobotRuns,
        say_always: Callable[[str], None],
        world: str,
        waits_s_max: tuple[float, float],
    ) -> None:
        self._life = runs
        self._say = say_always
        self._world = world
        self._join_s_max, self._world_s_max = waits_s_max
        self._loop = asyncio.get_running_loop()
        self._wait: asyncio.TimerHandle | None = None
        self._absence_check: asyncio.TimerHandle | None = None
        self._gone = False
        self.interrupted = False
        self.failure: asyncio.Future[str] = self._loop.create_future()

    def interrupt(self, name: str) -> None:
        """End the robot's life because of a signal; called as a signal handler is."""
        self.interrupted = True
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self.stop, f"stopped by {name}")

    def stop(self, reason: str) -> None:
        """End the robot's life. Later reasons are ignored."""
        if not self.failure.done():
            self.failure.set_result(reason)

    def await_world(self) -> None:
        """Give up unless the world says something in time."""
        self._begin_wait(self._join_s_max, partial(self._not_admitted, self._life.messages_taken))

    def token_changed(self, _key: str, alive: bool) -> None:
        """The world's token came or went; may be called from another thread."""
        self._loop.call_soon_threadsafe(self.world_changed, alive)

    def world_changed(self, alive: bool) -> None:
        """The world's token came or went."""
        _cancel(self._absence_check)
        if alive and self._gone:
            self._world_returned()
            self.await_world()
        elif not alive and self._life.idle:
            self._world_lost()
        elif not alive:
            self._absence_check = self._loop.call_later(SUSPICION_S, self._look, None)

    def end_waits(self) -> None:
        """Wait for nothing any more."""
        _cancel(self._wait)
        _cancel(self._absence_check)

    def _look(self, before: tuple[int, int] | None) -> None:
        """Without its token a world is there as long as it is heard, and gone when it is not.

        ``before``: what had been heard at the last look; None at the first one.
        """
        if self._life.core.ended is not None:
            return
        messages_taken = self._life.messages_taken
        speaks = before is not None and messages_taken != before
        if speaks and self._gone:
            self._world_returned()
        elif before is not None and not speaks and not self._gone:
            self._world_lost()
        self._absence_check = self._loop.call_later(SUSPICION_S, self._look, messages_taken)

    def _world_returned(self) -> None:
        self._gone = False
        _cancel(self._wait)
        self._say(f"{self._world} is back")

    def _world_lost(self) -> None:
        if self._life.idle or self._life.rejoins:
            self.stop(f"{self._world} is gone")
            return
        self._gone = True
        self._say(
            f"{self._world} is gone: standing still, waiting up to {self._world_s_max:g} s for it"
        )
        self._begin_wait(self._world_s_max, self._world_not_back)

    def _begin_wait(self, s_max: float, then: Callable[[], None]) -> None:
        _cancel(self._wait)
        self._wait = self._loop.call_later(s_max, then)

    def _world_not_back(self) -> None:
        if not self._is_other_version():
            self.stop(f"{self._world} is gone, and was not back within {self._world_s_max:g} s")

    def _is_other_version(self) -> bool:
        """Whether nothing came of this life for the world's version; ends it if so."""
        runs = self._life
        if runs.core.config is None and runs.other_version:
            self.stop(f"{self._world} speaks another version: {runs.other_version}")
            return True
        return False

    def _not_admitted(self, messages_taken: tuple[int, int]) -> None:
        runs = self._life
        if self._is_other_version():
            return
        if runs.messages_taken == messages_taken and not runs.idle:
            self.stop(
                f"{self._world} did not take this robot in within {self._join_s_max:g} s:"
                " is there one, and does it say why?"
            )


@dataclass(frozen=True, slots=True)
class RobotOptions:
    """What a robot does in whatever run.

    ``join_s_max``, ``world_s_max``: how long it waits, in s, to be taken in, and for a world that
    is gone. ``stays``: take part in run after run under the same name, until the world is gone.
    ``quiet``: say only what goes wrong. ``tracebacks``: the directory for that of a strategy that
    fails, a temporary file if None.
    """

    join_s_max: float = JOIN_S_MAX
    world_s_max: float = WORLD_S_MAX
    rejoins: bool = False
    quiet: bool = False
    tracebacks: Path | None = None


async def run_robot(robot: str, run: str, access: Endpoints, options: RobotOptions) -> int:
    """One robot's life in a run; returns the exit status: 0 if the run was completed.

    1 if not, whatever the reason; but 2 if its strategy cannot be loaded, which is no run's fault.
    """
    say_always = partial(_say, f"robot {robot}")
    tell = _discard if options.quiet else say_always
    own = robot_key(run, robot, "alive")
    check = partial(check_name_free, token=own, who=f"robot {robot} in run {run}")
    loop = asyncio.get_running_loop()
    soon = loop.call_later(CONNECT_NOTICE_S, tell, f"connecting to {access}")
    try:
        connection = await asyncio.to_thread(
            ZenohConnection, access, robot_key(run, robot, "*"), check
        )
    except ConnectionFailed as error:
        say_always(str(error))
        return 1
    finally:
        soon.cancel()
    runs = _RobotRuns(robot, run, tell, options.rejoins, options.tracebacks)
    status_log = StatusLog(tell)

    def tell_in_order(line: str) -> None:
        status_log.update(runs.core)
        tell(line)

    world = f"the world of run {run} at {access}"
    supervisor = _Supervisor(runs, tell_in_order, world, (options.join_s_max, options.world_s_max))
    with signals_to(supervisor.interrupt):
        tell(f"waiting for {world}")
        connection.watch(world_key(run, "alive"), supervisor.token_changed)
        connection.answer_info_queries(robot_key(run, robot, "about"), robot)
        connection.declare_alive(own)
        await _live(runs, connection, supervisor, status_log)
    return _conclude(runs, supervisor, say_always, tell)


async def _live(
    runs: _RobotRuns, connection: ZenohConnection, supervisor: _Supervisor, status_log: StatusLog
) -> None:
    """Answer until the run is over or something is the matter, and close the link."""
    supervisor.await_world()
    rounds = asyncio.create_task(asyncio.to_thread(runs.answer, connection))
    looking = asyncio.create_task(_look(runs, status_log))
    try:
        await _first_of(rounds, supervisor.failure, looking)
    finally:
        looking.cancel()
        supervisor.end_waits()
        await asyncio.to_thread(connection.close)
        await rounds
    status_log.update(runs.core)


async def _look(runs: _RobotRuns, status_log: StatusLog) -> None:
    while True:
        status_log.update(runs.core)
        await asyncio.sleep(LOOK_PERIOD_S)


def _conclude(
    runs: _RobotRuns,
    supervisor: _Supervisor,
    say_always: Callable[[str], None],
    tell: Callable[[str], None],
) -> int:
    """Say how it ended; returns the exit status."""
    if runs.core.failed is not None:
        return 2 if isinstance(runs.core.failed.error, PluginLoadError) else 1
    ended, failure = runs.core.ended, supervisor.failure
    reason = failure.result() if failure.done() else "the link was closed"
    if ended is not None:
        failed = is_failure(ended)
        (say_always if failed and not runs.rejoins else tell)(f"run {runs.core.run} ended: {ended}")
        return int(failed)
    if runs.idle and not supervisor.interrupted:
        tell(reason)
        return 0
    say_always(reason)
    return 1


def _cancel(timer: asyncio.TimerHandle | None) -> None:
    if timer is not None:
        timer.cancel()


async def _first_of(*futures: "asyncio.Future[Any]") -> None:
    await asyncio.wait(futures, return_when=asyncio.FIRST_COMPLETED)


def _say(who: str, line: str) -> None:
    say_error(f"{who}: {line}")


def _discard(_line: str) -> None:
    """Say it to nobody."""
