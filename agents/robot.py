"""The robot as a process: asyncio supervises, one thread answers the world round by round.

The supervisor joins the run, watches the world's liveliness token and the signals, and bounds every
wait. The rounds themselves are run in a thread that waits for messages inside Zenoh, because waking
an asyncio loop from there costs half as much again as all the rest (``docs/architecture.md``).

A world that is gone leaves its robots standing: in lock-step nothing moves that was not commanded
in the round. They wait a bounded time for a world of that run, which tells them all they need.
"""

import asyncio
import gc
import signal
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from agents import real_time
from agents.core import RobotCore
from protocol.access import Access
from protocol.errors import LinkClosed
from protocol.keys import robot_key, world_key
from protocol.links import Link
from protocol.log import bounded_log
from protocol.one_of_a_name import check_free
from protocol.plugins import PluginBroken, PluginFailed
from protocol.tracebacks import line_of
from protocol.zenoh_link import LinkError, ZenohLink

JOIN_S_MAX = 30.0
WORLD_S_MAX = 10.0
DOUBT_S = 0.2
"""How long, after its token, a world's messages may still be under way; then how long it may be
silent before it counts as gone."""
OTHER_VERSION = "this program speaks"


class _Life:
    """The runs that one robot process takes part in: one, or one after the other if it stays."""

    def __init__(
        self,
        robot: str,
        run: str,
        log: Callable[[str], None],
        stays: bool,
        tracebacks: Path | None = None,
    ) -> None:
        self._new = partial(RobotCore, robot, run, self._refused, self._failed)
        self._log = log
        self._tracebacks = tracebacks
        self.stays = stays
        self.core = self._new()
        self.completed = 0
        self.other_version = ""

    def _refused(self, line: str) -> None:
        if OTHER_VERSION in line:
            self.other_version = line
        self._log(line)

    def _failed(self, failed: PluginFailed) -> None:
        self._log(f"robot {failed.who}: {line_of(failed, self._tracebacks)}")

    def answer(self, link: Link) -> None:
        """Answer round by round until there is no further run or the link is closed."""
        # What was imported stays for good: collecting garbage need not look at it again and again.
        gc.freeze()
        while True:
            self._answer_rounds(link)
            if self.core.ended is None or self.core.ended.startswith("failed") or not self.stays:
                return
            self.completed += 1
            self.core = self._new()

    def _answer_rounds(self, link: Link) -> None:
        core, timed = self.core, None
        try:
            while core.ended is None:
                key, payload = link.receive()
                if timed is None:
                    timed = real_time.is_timed(core, key, payload)
                if timed:
                    real_time.answer(core, link, (key, payload))
                    return
                for said in core.receive(key, payload):
                    link.send(*said)
        except LinkClosed:
            pass

    @property
    def heard(self) -> tuple[int, int]:
        """How much the world has said so far: it changes with every message that is taken in."""
        return self.completed, self.core.taken

    @property
    def idle(self) -> bool:
        """Whether it waits for a further run."""
        return self.completed > 0 and self.core.role is None


class _Supervisor:
    """Watches over a robot's life: the world's token, the signals, and how long a wait lasts."""

    def __init__(
        self, life: _Life, say: Callable[[str], None], world: str, waits_s_max: tuple[float, float]
    ) -> None:
        self._life = life
        self._say = say
        self._world = world
        self._join_s_max, self._world_s_max = waits_s_max
        self._loop = asyncio.get_running_loop()
        self._wait: asyncio.TimerHandle | None = None
        self._doubt: asyncio.TimerHandle | None = None
        self._gone = False
        self.trouble: asyncio.Future[str] = self._loop.create_future()

    def stop(self, reason: str) -> None:
        """End the robot's life. Later reasons are ignored."""
        if not self.trouble.done():
            self.trouble.set_result(reason)

    def await_word(self) -> None:
        """Give up unless the world says something in time."""
        self._begin_wait(self._join_s_max, partial(self._not_taken_in, self._life.heard))

    def world_changed(self, alive: bool) -> None:
        """The world's token came or went."""
        _cancel(self._doubt)
        if alive and self._gone:
            self._is_back()
            self.await_word()
        elif not alive and self._life.idle:
            self._is_gone()
        elif not alive:
            self._doubt = self._loop.call_later(DOUBT_S, self._look, None)

    def end_waits(self) -> None:
        """Wait for nothing any more."""
        _cancel(self._wait)
        _cancel(self._doubt)

    def _look(self, before: tuple[int, int] | None) -> None:
        """Without its token a world is there as long as it is heard, and gone when it is not.

        ``before``: what had been heard at the last look; None at the first one.
        """
        if self._life.core.ended is not None:
            return
        heard = self._life.heard
        speaks = before is not None and heard != before
        if speaks and self._gone:
            self._is_back()
        elif before is not None and not speaks and not self._gone:
            self._is_gone()
        self._doubt = self._loop.call_later(DOUBT_S, self._look, heard)

    def _is_back(self) -> None:
        self._gone = False
        _cancel(self._wait)
        self._say(f"{self._world} is back")

    def _is_gone(self) -> None:
        if self._life.idle or self._life.stays:
            self.stop(f"{self._world} is gone")
            return
        self._gone = True
        self._say(
            f"{self._world} is gone: standing still, waiting up to {self._world_s_max:g} s for it"
        )
        self._begin_wait(self._world_s_max, self._not_back)

    def _begin_wait(self, s_max: float, then: Callable[[], None]) -> None:
        _cancel(self._wait)
        self._wait = self._loop.call_later(s_max, then)

    def _not_back(self) -> None:
        if not self._was_not_understood():
            self.stop(f"{self._world} is gone, and was not back within {self._world_s_max:g} s")

    def _was_not_understood(self) -> bool:
        """Whether nothing came of this life for the world's version; ends it if so."""
        life = self._life
        if life.core.role is None and life.other_version:
            self.stop(f"{self._world} speaks another version: {life.other_version}")
            return True
        return False

    def _not_taken_in(self, heard: tuple[int, int]) -> None:
        life = self._life
        if self._was_not_understood():
            return
        if life.heard == heard and not life.idle:
            self.stop(
                f"{self._world} did not take this robot in within {self._join_s_max:g} s:"
                " is there one, and does it say why?"
            )


async def run_robot(
    robot: str,
    run: str,
    access: Access,
    join_s_max: float = JOIN_S_MAX,
    stays: bool = False,
    world_s_max: float = WORLD_S_MAX,
    tracebacks: Path | None = None,
) -> int:
    """One robot's life in a run; returns the exit status: 0 if the run was completed.

    1 if not, whatever the reason; but 2 if its strategy cannot be loaded, which is no run's fault.
    ``tracebacks``: the directory for that of a strategy that fails, a temporary file if None.

    ``stays``: take part in run after run under the same name, until the world is gone.
    ``world_s_max``: how long to wait, in s, for a world that is gone.
    """
    log = bounded_log()
    own = robot_key(run, robot, "alive")
    check = partial(check_free, token=own, who=f"robot {robot} in run {run}")
    try:
        link = await asyncio.to_thread(ZenohLink, access, robot_key(run, robot, "*"), check)
    except LinkError as error:
        log(f"robot {robot}: {error}")
        return 1
    life = _Life(robot, run, log, stays, tracebacks)
    world = f"the world of run {run} at {access}"
    waits = (join_s_max, world_s_max)
    supervisor = _Supervisor(life, lambda said: log(f"robot {robot}: {said}"), world, waits)
    trouble, loop = supervisor.trouble, asyncio.get_running_loop()

    def world_changed(_key: str, alive: bool) -> None:
        loop.call_soon_threadsafe(supervisor.world_changed, alive)

    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, supervisor.stop, f"stopped by {number.name}")
    supervisor.await_word()
    if not stays:
        log(f"robot {robot}: waiting for {world}")
    link.watch(world_key(run, "alive"), world_changed)
    link.tell_about(robot_key(run, robot, "about"), robot)
    link.announce(own)
    rounds = asyncio.create_task(asyncio.to_thread(life.answer, link))
    try:
        await _first_of(rounds, trouble)
    finally:
        supervisor.end_waits()
        await asyncio.to_thread(link.close)
        await rounds
    if life.idle:
        return 0
    ended, failed = life.core.ended, life.core.failed
    if failed is not None:
        return 2 if isinstance(failed.error, PluginBroken) else 1
    if ended is not None:
        if not stays:
            log(f"robot {robot}: run {run} ended: {ended}")
        return 1 if ended.startswith("failed") else 0
    log(f"robot {robot}: {trouble.result() if trouble.done() else 'the link was closed'}")
    return 1


def _cancel(timer: asyncio.TimerHandle | None) -> None:
    if timer is not None:
        timer.cancel()


async def _first_of(*futures: "asyncio.Future[Any]") -> None:
    await asyncio.wait(futures, return_when=asyncio.FIRST_COMPLETED)
