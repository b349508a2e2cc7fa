"""The world as a process: it takes robots in, runs the rounds, records, and tells how it goes.

As with the robot, asyncio supervises (joins, liveliness, signals, deadlines) and a thread runs the
rounds; whoever of the two has something to do with the core holds its lock, until what comes of it
was sent. How it goes is told to whoever wants to know (``encircle.world.process.reports``); what
happens to robots goes to standard error as well.
"""

import asyncio
import contextlib
import gc
import itertools
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from encircle.protocol import VERSION
from encircle.protocol.connections import Link
from encircle.protocol.errors import LinkClosed, ProtocolError
from encircle.protocol.keys import parse_key, robot_key, world_key
from encircle.protocol.process.log import say_error
from encircle.protocol.zenoh.connection import ZenohLink
from encircle.world.coordinator.deadlines import Punctuality
from encircle.world.coordinator.failure_detector import NO_ANSWER, Attendance, RunEnded
from encircle.world.coordinator.paced_core import PacedCore
from encircle.world.coordinator.result import GO_ON
from encircle.world.coordinator.world_core import Outgoing, WorldCore
from encircle.world.process.paced import run_by_clock
from encircle.world.process.reports import Reporter
from encircle.world.process.sending import send, tell
from encircle.world.recording.recorder import Recorder, RecordingStopped
from encircle.world.recording.resuming import Resumed

JOIN_S_MAX = 30.0
ANSWER_S_MAX = 3.0
ASK_AGAIN_S = 1.0
WATCH_PERIOD_S = 0.1
EARLY_PERIOD_S, EARLY_MAX = 0.02, 4096
WATCHED_S_MAX = 0.5
"""How much of the time between two looks counts as waiting, for this world may have been frozen."""
TOLD_S_MAX = 10.0
"""So long Zenoh keeps a connection of which nothing comes."""


@dataclass(frozen=True, slots=True)
class Terms:
    """What a world puts up with. ``join_s_max``, ``answer_s_max``: how long it waits, in s.

    ``when_lost``: whether the run goes on without a lost robot, or ends. ``parent``: end when
    standard input does, so that no world outlives the program that started it.
    """

    join_s_max: float = JOIN_S_MAX
    answer_s_max: float = ANSWER_S_MAX
    when_lost: str = GO_ON
    parent: bool = False


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


class Server:
    """One run of one arena, over Zenoh."""

    def __init__(
        self,
        core: WorldCore,
        link: ZenohLink,
        terms: Terms,
        report_to: Reporter,
        resumed: Resumed | None = None,
    ) -> None:
        self.link = link
        self.core = core
        self.terms = terms
        self.report = report_to
        self.joined_s: float | None = None
        self.rounds_s = 0.0
        self.begun_unix_s: float | None = None
        self.punctuality: Punctuality | None = None
        self._attendance = Attendance(core, terms.when_lost, resumed.briefings if resumed else None)
        # Who takes up a run has all of it to remember before the first answer.
        self._taken_up_tick = core.state.tick if resumed else None
        self._told = len(core.departures)
        self._asking: dict[str, asyncio.Task[None]] = {}
        self._lock = threading.Lock()
        self._loop = asyncio.get_running_loop()
        self._trouble: asyncio.Future[str] = self._loop.create_future()
        self._everyone = asyncio.Event()
        self._over = asyncio.Event()

    async def serve(self) -> str:
        """Take the robots in and run the hunt; returns how it ended."""
        if self.core.ended is not None:
            return self.core.ended
        started = time.perf_counter()
        run = self.core.run
        self.link.watch(robot_key(run, "*", "alive"), self._alive_changed)
        self.link.tell_about(world_key(run, "about"), "world")
        self.link.announce(world_key(run, "alive"))
        late = self._loop.call_later(self.terms.join_s_max, self._give_up_joining)
        everyone = asyncio.create_task(self._everyone.wait())
        early = asyncio.create_task(self._refuse_what_is_early())
        await _first_of(everyone, self._trouble, early)
        late.cancel()
        if early.done():
            early.result()
        early.cancel()
        if not self._trouble.done():
            self.joined_s = time.perf_counter() - started
            await self._hunt()
        everyone.cancel()
        if self.core.ended is None:
            self._tell_failure()
            await self._until_told()
        return self.core.ended or ""

    @property
    def has_begun(self) -> bool:
        """Whether there is anything of the run: of one that was taken up there was before."""
        return self.joined_s is not None or self._taken_up_tick is not None

    def interrupt(self, name: str) -> None:
        """End the run because of a signal; called as a signal handler is."""
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self.stop, f"stopped by {name}")

    def stop(self, reason: str) -> None:
        """End the run as failed. Later reasons are ignored."""
        if not self._trouble.done():
            self._trouble.set_result(reason)

    def record_with(self, recorder: Recorder) -> None:
        """Record from now on; a recording that cannot go on ends the run."""

        def record(tick: int, key: str, payload: bytes, at_us: int | None = None) -> None:
            try:
                recorder.record(tick, key, payload, at_us)
            except RecordingStopped as error:
                self._loop.call_soon_threadsafe(self.stop, str(error))

        self.core.record = record

    async def _refuse_what_is_early(self) -> None:
        """An inbox that is full would keep tokens out as well.

        Who takes up a run has asked already, and what comes may be answers.
        """
        while True:
            if self._taken_up_tick is None:
                for key, payload in itertools.islice(self.link.waiting(), EARLY_MAX):
                    self.core.receive(key, payload)
            await asyncio.sleep(EARLY_PERIOD_S)

    def _tell_failure(self) -> None:
        with contextlib.suppress(LinkClosed), self._lock:
            send(self.link, self.core.fail(self._trouble.result()))

    async def _until_told(self) -> None:
        """See to it that the robots learn of the end before the link is closed.

        One that is frozen never will; whoever waits for this world has the same patience, and is
        not to lose it first.
        """
        about = robot_key(self.core.run, "*", "about")
        s_max = min(self.terms.answer_s_max / 2.0, TOLD_S_MAX)
        await asyncio.to_thread(self.link.flush, about, s_max)

    async def _hunt(self) -> None:
        # What was imported stays for good: collecting garbage need not look at it again and again.
        gc.freeze()
        begun = time.perf_counter()
        self.begun_unix_s = time.time()
        rounds = asyncio.create_task(asyncio.to_thread(self._run_rounds))
        watch = asyncio.create_task(self._watch_progress())
        over = asyncio.create_task(self._over.wait())
        await _first_of(rounds, over, watch, self._trouble)
        # It ends by itself only by an error of ours, which must not go unheard.
        broken = watch.done()
        watch.cancel()
        over.cancel()
        if self._trouble.done() and self.core.ended is None:
            self._tell_failure()
        await self._until_told()
        if not rounds.done():
            await asyncio.to_thread(self.link.close)
        await rounds
        if broken:
            watch.result()
        self._tell_departures()
        self.rounds_s = time.perf_counter() - begun

    def _run_rounds(self) -> None:
        if isinstance(self.core, PacedCore):
            self.punctuality = run_by_clock(
                self.core, self._attendance, self.link, self._act, self.terms.answer_s_max
            )
            return
        self._act(self._attendance.begin)
        with contextlib.suppress(LinkClosed):
            while self.core.ended is None:
                key, payload = self.link.receive()
                with self._lock:
                    self._send(self.core.receive(key, payload))
                    self._send(self._attendance.heard(key, payload))

    def _act(self, change: Callable[[], Outgoing], key: str = "") -> None:
        """Do something with the core, from whatever thread, and send what comes of it."""
        try:
            with self._lock:
                self._send(change())
        except ProtocolError as error:
            self.core.refuse(key, error)
        except RunEnded as error:
            self._loop.call_soon_threadsafe(self.stop, str(error))
        except LinkClosed:
            pass
        if self.core.ended is not None:
            self._loop.call_soon_threadsafe(self._over.set)

    def _send(self, outgoing: Outgoing) -> None:
        if outgoing:
            tell(self.link, outgoing)
            send(self.link, self.core.settle())

    async def _watch_progress(self) -> None:
        """Report progress, and see to it that nobody is waited for too long."""
        tick, waited_s, again_s, looked_s = -1, 0.0, ASK_AGAIN_S, time.monotonic()
        reminded_s = looked_s
        while True:
            state, now_s = self.core.state, time.monotonic()
            waited_s += min(now_s - looked_s, WATCHED_S_MAX)
            looked_s = now_s
            self._tell_departures()
            if now_s - reminded_s > ASK_AGAIN_S:
                reminded_s = now_s
                self._act(self._attendance.reminders)
            if state.tick != tick:
                tick, waited_s, again_s = state.tick, 0.0, ASK_AGAIN_S
                distances_m = state.geometry.distances[:-1, -1 - self._fixed].tolist()
                lost = list(self.core.lost)
                self.report({"tick": tick, "distances_m": distances_m, "lost": lost})
            elif isinstance(self.core, PacedCore):
                # The clock ends ticks, however long; silence would tell the starter of a hang.
                if again_s < waited_s < self.core.arena.scenario.tick_s + ASK_AGAIN_S:
                    again_s += ASK_AGAIN_S
                    self.report({"waiting": []})
            elif waited_s > self._patience_s(tick):
                waited_s, again_s = 0.0, ASK_AGAIN_S
                self._act(partial(self._attendance.silent, tick, self._patience_s(tick)))
            elif waited_s > again_s:
                # A router that was restarted has lost what was under way.
                again_s += ASK_AGAIN_S
                self.report({"waiting": self.core.table.waiting()})
                if tick != self._taken_up_tick:
                    self._act(self.core.unanswered)
            await asyncio.sleep(WATCH_PERIOD_S)

    def _patience_s(self, tick: int) -> float:
        """How long to wait, in s, for the answers to the observations of a tick."""
        longest = max(self.terms.answer_s_max, self.terms.join_s_max)
        return longest if tick == self._taken_up_tick else self.terms.answer_s_max

    def _tell_departures(self) -> None:
        """Say what has become of robots since the last time."""
        departures = self.core.departures
        while self._told < len(departures):
            tick, robot, what = departures[self._told]
            self._told += 1
            self.report({"departure": [tick, robot, what]})
            say_error(f"world: tick {tick}: robot {robot} is {what}")
            if NO_ANSWER in what:
                self._asking[robot] = asyncio.create_task(asyncio.to_thread(self._explain, robot))

    def _explain(self, robot: str) -> None:
        """Say so if a robot that does not answer speaks another version."""
        key = robot_key(self.core.run, robot, "about")
        about = self.link.ask_about(key, self.terms.answer_s_max)
        if about is not None and about.wire != VERSION:
            say_error(
                f"world: robot {robot} speaks version {about.wire} of the wire, this is {VERSION}:"
                " install the same Encircle on every host"
            )

    @property
    def _fixed(self) -> int:
        return len(self.core.arena.scenario.obstacles)

    def _alive_changed(self, key: str, alive: bool) -> None:
        self._loop.call_soon_threadsafe(self._robot_changed, key, alive)

    def _robot_changed(self, key: str, alive: bool) -> None:
        change = self._attendance.came if alive else self._attendance.went
        expected = self._attendance.expected
        self._act(lambda: change(parse_key(key).robot or ""), key)
        if self._attendance.expected != expected and not self._attendance.begun:
            self.report({"expected": list(self._attendance.expected)})
        if not self._attendance.expected:
            self._everyone.set()

    def _give_up_joining(self) -> None:
        if self._attendance.may_begin:
            self._everyone.set()
            return
        absent = ", ".join(self._attendance.expected)
        self.stop(f"{absent} did not join within {self.terms.join_s_max:g} s")


async def _first_of(*futures: "asyncio.Future[Any]") -> None:
    await asyncio.wait(futures, return_when=asyncio.FIRST_COMPLETED)
