"""The world as a process: it takes robots in, runs the rounds, records, and tells how it goes.

As with the robot, asyncio supervises (joins, liveliness, signals, deadlines) and a thread runs the
rounds. Progress goes to standard output, one JSON object per line, for whoever started the process.
"""

import asyncio
import contextlib
import gc
import json
import signal
import sys
import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from protocol.access import Access
from protocol.errors import LinkClosed, ProtocolError
from protocol.keys import parse_key, robot_key, world_key
from protocol.links import Link
from protocol.lockstep import Phase
from protocol.zenoh_link import LinkError, ZenohLink
from world.core import WorldCore
from world.engine import Arena
from world.run_directory import RunDirectoryError, create, start_recording, write_summary

JOIN_S_MAX = 30.0
ANSWER_S_MAX = 3.0
ASK_AGAIN_S = 1.0
WATCH_PERIOD_S = 0.1


def run_rounds(core: WorldCore, link: Link) -> None:
    """Run the hunt until it ends or the link is closed."""
    try:
        send(link, core.begin())
        send(link, core.settle())
        while core.ended is None:
            outgoing = core.receive(*link.receive())
            if outgoing:
                send(link, outgoing)
                send(link, core.settle())
    except LinkClosed:
        pass


def send(link: Link, messages: list[tuple[str, bytes]]) -> None:
    """Hand messages over to a link, in their order."""
    for key, payload in messages:
        link.send(key, payload)


class Server:
    """One run of one arena, over Zenoh."""

    def __init__(
        self,
        arena: Arena,
        run: str,
        link: ZenohLink,
        core: WorldCore,
        join_s_max: float,
        answer_s_max: float,
    ) -> None:
        self.arena = arena
        self.run = run
        self.link = link
        self.core = core
        self.join_s_max = join_s_max
        self.answer_s_max = answer_s_max
        self.joined_s: float | None = None
        self.rounds_s = 0.0
        self.begun_unix_s: float | None = None
        self._loop = asyncio.get_running_loop()
        self._trouble: asyncio.Future[str] = self._loop.create_future()
        self._everyone = asyncio.Event()

    async def serve(self) -> str:
        """Take the robots in and run the hunt; returns how it ended."""
        started = time.perf_counter()
        for number in (signal.SIGINT, signal.SIGTERM):
            self._loop.add_signal_handler(number, self.stop, f"stopped by {number.name}")
        self.link.watch(robot_key(self.run, "*", "alive"), self._alive_changed)
        self.link.announce(world_key(self.run, "alive"))
        late = self._loop.call_later(self.join_s_max, self._give_up_joining)
        everyone = asyncio.create_task(self._everyone.wait())
        await _first_of(everyone, self._trouble)
        late.cancel()
        if not self._trouble.done():
            self.joined_s = time.perf_counter() - started
            await self._hunt()
        everyone.cancel()
        if self.core.ended is None:
            self._tell_failure()
        return self.core.ended or ""

    def _tell_failure(self) -> None:
        with contextlib.suppress(LinkClosed):
            send(self.link, self.core.fail(self._trouble.result()))

    async def _hunt(self) -> None:
        # What was imported stays for good: collecting garbage need not look at it again and again.
        gc.freeze()
        begun = time.perf_counter()
        self.begun_unix_s = time.time()
        rounds = asyncio.create_task(asyncio.to_thread(run_rounds, self.core, self.link))
        watch = asyncio.create_task(self._watch_progress())
        await _first_of(rounds, self._trouble)
        watch.cancel()
        if self._trouble.done():
            self._tell_failure()
            await asyncio.to_thread(self.link.close)
        await rounds
        self.rounds_s = time.perf_counter() - begun

    async def _watch_progress(self) -> None:
        """Report progress, and end the run if nothing moves for too long."""
        tick, since = -1, time.monotonic()
        again = 0.0
        while True:
            state = self.core.state
            if state.tick != tick:
                tick, since = state.tick, time.monotonic()
                again = since + ASK_AGAIN_S
                say(
                    {
                        "tick": tick,
                        "distances_m": state.geometry.distances[:-1, -1 - self._fixed].tolist(),
                    }
                )
            elif time.monotonic() - since > self.answer_s_max:
                names = ", ".join(self.core.table.waiting())
                self.stop(f"no answer from {names} for {self.answer_s_max:g} s at tick {tick}")
                return
            elif time.monotonic() > again:
                # A router that was restarted has lost what was under way.
                again += ASK_AGAIN_S
                with contextlib.suppress(LinkClosed):
                    send(self.link, self.core.unanswered())
            await asyncio.sleep(WATCH_PERIOD_S)

    @property
    def _fixed(self) -> int:
        return len(self.arena.scenario.obstacles)

    def stop(self, reason: str) -> None:
        """End the run as failed. Later reasons are ignored."""
        if not self._trouble.done():
            self._trouble.set_result(reason)

    def _alive_changed(self, key: str, alive: bool) -> None:
        self._loop.call_soon_threadsafe(self._robot_changed, key, alive)

    def _robot_changed(self, key: str, alive: bool) -> None:
        try:
            robot = parse_key(key).robot or ""
            if alive:
                send(self.link, self.core.join(robot))
            elif robot in self.arena.ids and self.core.ended is None:
                self.stop(f"robot {robot} is gone at tick {self.core.state.tick}")
        except ProtocolError as error:
            self.core.refuse(key, error)
        if self.core.everyone_joined:
            self._everyone.set()

    def _give_up_joining(self) -> None:
        absent = ", ".join(self.core.table.in_phase(Phase.ABSENT))
        self.stop(f"{absent} did not join within {self.join_s_max:g} s")


async def run_world(
    arena: Arena,
    run: str,
    access: Access,
    out: Path | None,
    log: Callable[[str], None],
    join_s_max: float = JOIN_S_MAX,
    parent: bool = False,
    answer_s_max: float = ANSWER_S_MAX,
) -> int:
    """The world's life; returns the exit status. ``out``: directory for the recording, if any.

    ``parent``: end when standard input does, so that no world outlives the program that started it.
    """
    # Built first: a team that cannot be placed leaves nothing behind.
    core = WorldCore(arena, run, log)
    try:
        directory = create(out) if out else None
        link = await asyncio.to_thread(ZenohLink, access, robot_key(run, "*", "*"))
    except (RunDirectoryError, LinkError) as error:
        say_error(f"world: {error}")
        return 1
    recorder = start_recording(directory, arena.scenario, run) if directory else None
    core.record = recorder.record if recorder else None
    core.shows = True
    server = Server(arena, run, link, core, join_s_max, answer_s_max)
    if parent:
        asyncio.get_running_loop().add_reader(
            sys.stdin.fileno(), server.stop, "its starter is gone"
        )
    say({"listening": str(access)})
    try:
        ended = await server.serve()
    finally:
        await asyncio.to_thread(link.close)
        result = core.result()
        if recorder is not None:
            recorder.close()
    extra = {
        "rounds_s": server.rounds_s,
        "joined_s": server.joined_s,
        "begun_unix_s": server.begun_unix_s,
    }
    if directory is not None:
        write_summary(directory, arena.scenario, result, run, extra)
    say({"result": asdict(result) | extra})
    if ended.startswith("failed"):
        say_error(f"world: {ended.removeprefix('failed: ')}")
        return 1
    return 0


async def _first_of(*futures: "asyncio.Future[Any]") -> None:
    await asyncio.wait(futures, return_when=asyncio.FIRST_COMPLETED)


def say(event: dict[str, Any]) -> None:
    """Tell the starter something; a starter that no longer listens is no reason to fail."""
    try:
        print(json.dumps(event), flush=True)
    except BrokenPipeError:
        sys.stdout = None


def say_error(line: str) -> None:
    """One line to standard error."""
    print(line, file=sys.stderr, flush=True)
