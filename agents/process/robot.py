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
from encircle.agents.process.status_lines import Telling
from encircle.protocol.connections import Link
from encircle.protocol.errors import LinkClosed
from encircle.protocol.keys import robot_key, world_key
from encircle.protocol.plugins import PluginBroken, PluginFailed
from encircle.protocol.process.interrupts import told_to
from encircle.protocol.process.log import bounded_log, say_error
from encircle.protocol.process.tracebacks import line_of
from encircle.protocol.zenoh.connection import LinkError, ZenohLink
from encircle.protocol.zenoh.endpoints import Access
from encircle.protocol.zenoh.unique_names import check_free

JOIN_S_MAX = 30.0
WORLD_S_MAX = 10.0
DOUBT_S = 0.2
"""How long, after its token, a world's messages may still be under way; then how long it may be
silent before it counts as gone."""
SOON_S = 2.0
LOOK_S = 0.2
OTHER_VERSION = "this program speaks"


class _Life:
    """The runs that one robot process takes part in: one, or one after the other if it stays."""

    def __init__(
        self,
        robot: str,
        run: str,
        tell: Callable[[str], None],
        stays: bool,
        tracebacks: Path | None = None,
    ) -> None:
        self._new = partial(RobotCore, robot, run, self._refused, self._failed)
        self._log = bounded_log()
        self._tell = tell
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
        _say(f"robot {failed.who}", line_of(failed, self._tracebacks))

    def answer(self, link: Link) -> None:
        """Answer round by round until there is no further run or the link is closed."""
        # What was imported stays for good: collecting garbage need not look at it again and again.
        gc.freeze()
        while True:
            self._answer_rounds(link)
            if self.core.ended is None or self.core.ended.startswith("failed") or not self.stays:
                return
            self.completed += 1
            self._tell(f"run {self.core.run} ended: {self.core.ended}; staying for the next")
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
        self.interrupted = False
        self.trouble: asyncio.Future[str] = self._loop.create_future()

    def interrupt(self, name: str) -> None:
        """End the robot's life because of a signal; called as a signal handler is."""
        self.interrupted = True
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self.stop, f"stopped by {name}")

    def stop(self, reason: str) -> None:
        """End the robot's life. Later reasons are ignored."""
        if not self.trouble.done():
            self.trouble.set_result(reason)

    def await_word(self) -> None:
        """Give up unless the world says something in time."""
        self._begin_wait(self._join_s_max, partial(self._not_taken_in, self._life.heard))

    def token_changed(self, _key: str, alive: bool) -> None:
        """The world's token came or went; may be called from another thread."""
        self._loop.call_soon_threadsafe(self.world_changed, alive)

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


@dataclass(frozen=True, slots=True)
class Habits:
    """What a robot does in whatever run.

    ``join_s_max``, ``world_s_max``: how long it waits, in s, to be taken in, and for a world that
    is gone. ``stays``: take part in run after run under the same name, until the world is gone.
    ``quiet``: say only what goes wrong. ``tracebacks``: the directory for that of a strategy that
    fails, a temporary file if None.
    """

    join_s_max: float = JOIN_S_MAX
    world_s_max: float = WORLD_S_MAX
    stays: bool = False
    quiet: bool = False
    tracebacks: Path | None = None


async def run_robot(robot: str, run: str, access: Access, habits: Habits) -> int:
    """One robot's life in a run; returns the exit status: 0 if the run was completed.

    1 if not, whatever the reason; but 2 if its strategy cannot be loaded, which is no run's fault.
    """
    say = partial(_say, f"robot {robot}")
    tell = _say_nothing if habits.quiet else say
    own = robot_key(run, robot, "alive")
    check = partial(check_free, token=own, who=f"robot {robot} in run {run}")
    loop = asyncio.get_running_loop()
    soon = loop.call_later(SOON_S, tell, f"connecting to {access}")
    try:
        link = await asyncio.to_thread(ZenohLink, access, robot_key(run, robot, "*"), check)
    except LinkError as error:
        say(str(error))
        return 1
    finally:
        soon.cancel()
    life = _Life(robot, run, tell, habits.stays, habits.tracebacks)
    telling = Telling(tell)

    def tell_in_order(line: str) -> None:
        telling.look(life.core)
        tell(line)

    world = f"the world of run {run} at {access}"
    supervisor = _Supervisor(life, tell_in_order, world, (habits.join_s_max, habits.world_s_max))
    with told_to(supervisor.interrupt):
        tell(f"waiting for {world}")
        link.watch(world_key(run, "alive"), supervisor.token_changed)
        link.tell_about(robot_key(run, robot, "about"), robot)
        link.announce(own)
        await _live(life, link, supervisor, telling)
    return _conclude(life, supervisor, say, tell)


async def _live(life: _Life, link: ZenohLink, supervisor: _Supervisor, telling: Telling) -> None:
    """Answer until the run is over or something is the matter, and close the link."""
    supervisor.await_word()
    rounds = asyncio.create_task(asyncio.to_thread(life.answer, link))
    looking = asyncio.create_task(_look(life, telling))
    try:
        await _first_of(rounds, supervisor.trouble, looking)
    finally:
        looking.cancel()
        supervisor.end_waits()
        await asyncio.to_thread(link.close)
        await rounds
    telling.look(life.core)


async def _look(life: _Life, telling: Telling) -> None:
    while True:
        telling.look(life.core)
        await asyncio.sleep(LOOK_S)


def _conclude(
    life: _Life,
    supervisor: _Supervisor,
    say: Callable[[str], None],
    tell: Callable[[str], None],
) -> int:
    """Say how it ended; returns the exit status."""
    if life.core.failed is not None:
        return 2 if isinstance(life.core.failed.error, PluginBroken) else 1
    ended, trouble = life.core.ended, supervisor.trouble
    reason = trouble.result() if trouble.done() else "the link was closed"
    if ended is not None:
        failed = ended.startswith("failed")
        (say if failed and not life.stays else tell)(f"run {life.core.run} ended: {ended}")
        return int(failed)
    if life.idle and not supervisor.interrupted:
        tell(reason)
        return 0
    say(reason)
    return 1


def _cancel(timer: asyncio.TimerHandle | None) -> None:
    if timer is not None:
        timer.cancel()


async def _first_of(*futures: "asyncio.Future[Any]") -> None:
    await asyncio.wait(futures, return_when=asyncio.FIRST_COMPLETED)


def _say(who: str, line: str) -> None:
    say_error(f"{who}: {line}")


def _say_nothing(_line: str) -> None:
    """Say it to nobody."""
