"""The robot as a process: asyncio supervises, one thread answers the world round by round.

The supervisor joins the run, watches the world's liveliness token and the signals, and bounds every
wait. The rounds themselves are run in a thread that waits for messages inside Zenoh, because waking
an asyncio loop from there costs half as much again as all the rest (``docs/architecture.md``).
"""

import asyncio
import gc
import signal
from collections.abc import Callable
from functools import partial
from typing import Any

from agents.core import RobotCore
from protocol.access import Access
from protocol.errors import LinkClosed
from protocol.keys import robot_key, world_key
from protocol.links import Link
from protocol.log import bounded_log
from protocol.zenoh_link import LinkError, ZenohLink

JOIN_S_MAX = 30.0


def answer_rounds(core: RobotCore, link: Link) -> None:
    """Answer whatever comes until the run ends or the link is closed."""
    try:
        while core.ended is None:
            for key, payload in core.receive(*link.receive()):
                link.send(key, payload)
    except LinkClosed:
        pass


class _Life:
    """The runs that one robot process takes part in: one, or one after the other if it stays."""

    def __init__(self, robot: str, run: str, log: Callable[[str], None], stays: bool) -> None:
        self._new = partial(RobotCore, robot, run, log)
        self._stays = stays
        self.core = self._new()
        self.completed = 0

    def answer(self, link: Link) -> None:
        """Answer round by round until there is no further run or the link is closed."""
        # What was imported stays for good: collecting garbage need not look at it again and again.
        gc.freeze()
        while True:
            answer_rounds(self.core, link)
            if self.core.ended is None or self.core.ended.startswith("failed") or not self._stays:
                return
            self.completed += 1
            self.core = self._new()

    @property
    def idle(self) -> bool:
        """Whether it waits for a further run."""
        return self.completed > 0 and self.core.role is None


async def run_robot(
    robot: str, run: str, access: Access, join_s_max: float = JOIN_S_MAX, stays: bool = False
) -> int:
    """One robot's life in a run; returns the exit status: 0 if the run was completed.

    ``stays``: take part in run after run under the same name, until the world is gone.
    """
    log = bounded_log()
    try:
        link = await asyncio.to_thread(ZenohLink, access, robot_key(run, robot, "*"))
    except LinkError as error:
        log(f"robot {robot}: {error}")
        return 1
    life = _Life(robot, run, log, stays)
    loop = asyncio.get_running_loop()
    trouble: asyncio.Future[str] = loop.create_future()

    def stop(reason: str) -> None:
        if not trouble.done():
            trouble.set_result(reason)

    def world_changed(_key: str, alive: bool) -> None:
        if not alive:
            loop.call_soon_threadsafe(stop, f"the world of run {run} is gone")

    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop, f"stopped by {number.name}")
    link.watch(world_key(run, "alive"), world_changed)
    link.announce(robot_key(run, robot, "alive"))
    rounds = asyncio.create_task(asyncio.to_thread(life.answer, link))
    joining = loop.call_later(join_s_max, _give_up_joining, life, stop, run, access, join_s_max)
    try:
        await _first_of(rounds, trouble)
    finally:
        joining.cancel()
        await asyncio.to_thread(link.close)
        await rounds
    if life.idle:
        return 0
    ended = life.core.ended
    if ended is not None:
        return 1 if ended.startswith("failed") else 0
    log(f"robot {robot}: {trouble.result() if trouble.done() else 'the link was closed'}")
    return 1


async def _first_of(*futures: "asyncio.Future[Any]") -> None:
    await asyncio.wait(futures, return_when=asyncio.FIRST_COMPLETED)


def _give_up_joining(
    life: _Life, stop: Callable[[str], None], run: str, access: Access, join_s: float
) -> None:
    if life.core.role is None and not life.completed:
        stop(f"no world took this robot into run {run} at {access} within {join_s:g} s")
