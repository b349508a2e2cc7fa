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
from encircle.protocol.connections import Connection
from encircle.protocol.errors import ConnectionClosed, ProtocolError
from encircle.protocol.keys import parse_key, robot_key, world_key
from encircle.protocol.process.log import say_error
from encircle.protocol.zenoh.connection import ZenohConnection
from encircle.world.coordinator.deadlines import DeadlineStatistics
from encircle.world.coordinator.failure_detector import (
    NO_ANSWER,
    FailureDetector,
    RunCannotContinue,
)
from encircle.world.coordinator.real_time_core import RealTimeWorldCore
from encircle.world.coordinator.result import GO_ON
from encircle.world.coordinator.world_core import Outgoing, WorldCore
from encircle.world.process.real_time import run_real_time
from encircle.world.process.reports import Reporter
from encircle.world.process.sending import send, send_in_batches
from encircle.world.recording.recorder import Recorder, RecordingStopped
from encircle.world.recording.resuming import Resumed

JOIN_S_MAX = 30.0
ANSWER_S_MAX = 3.0
RESEND_PERIOD_S = 1.0
WATCH_PERIOD_S = 0.1
EARLY_PERIOD_S, EARLY_MAX = 0.02, 4096
LOOK_GAP_S_MAX = 0.5
"""How much of the time between two looks counts as waiting, for this world may have been frozen."""
FLUSH_S_MAX = 10.0
"""So long Zenoh keeps a connection of which nothing comes."""


@dataclass(frozen=True, slots=True)
class WorldOptions:
    """What a world puts up with. ``join_s_max``, ``answer_s_max``: how long it waits, in s.

    ``when_lost``: whether the run goes on without a lost robot, or ends. ``parent``: end when
    standard input does, so that no world outlives the program that started it.
    """

    join_s_max: float = JOIN_S_MAX
    answer_s_max: float = ANSWER_S_MAX
    when_lost: str = GO_ON
    parent: bool = False


def run_rounds(core: WorldCore, connection: Connection) -> None:
    """Run the hunt until it ends or the link is closed."""
    try:
        send(connection, core.begin())
        send(connection, core.commit())
        while core.ended is None:
            outgoing = core.receive(*connection.receive())
            if outgoing:
                send(connection, outgoing)
                send(connection, core.commit())
    except ConnectionClosed:
        pass


class Server:
    """One run of one arena, over Zenoh."""

    def __init__(
        self,
        core: WorldCore,
        connection: ZenohConnection,
        options: WorldOptions,
        report_to: Reporter,
        resumed: Resumed | None = None,
    ) -> None:
        self.connection = connection
        self.core = core
        self.options = options
        self.report = report_to
        self.joined_s: float | None = None
        self.rounds_s = 0.0
        self.begun_unix_s: float | None = None
        self.punctuality: DeadlineStatistics | None = None
        self._failure_detector = FailureDetector(
            core, options.when_lost, resumed.histories if resumed else None
        )
        # Who takes up a run has all of it to remember before the first answer.
        self._resumed_tick = core.state.tick if resumed else None
        self._departures_reported = len(core.departures)
        self._version_checks: dict[str, asyncio.Task[None]] = {}
        self._lock = threading.Lock()
        self._loop = asyncio.get_running_loop()
        self._failure: asyncio.Future[str] = self._loop.create_future()
        self._all_joined = asyncio.Event()
        self._ended = asyncio.Event()

    async def serve(self) -> str:
        """Take the robots in and run the hunt; returns how it ended."""
        if self.core.ended is not None:
            return self.core.ended
        started = time.perf_counter()
        run = self.core.run
        self.connection.watch(robot_key(run, "*", "alive"), self._alive_changed)
        self.connection.answer_info_queries(world_key(run, "about"), "world")
        self.connection.declare_alive(world_key(run, "alive"))
        late = self._loop.call_later(self.options.join_s_max, self._give_up_joining)
        everyone = asyncio.create_task(self._all_joined.wait())
        early = asyncio.create_task(self._refuse_early_messages())
        await _first_of(everyone, self._failure, early)
        late.cancel()
        if early.done():
            early.result()
        early.cancel()
        if not self._failure.done():
            self.joined_s = time.perf_counter() - started
            await self._hunt()
        everyone.cancel()
        if self.core.ended is None:
            self._send_failure()
            await self._flush_end()
        return self.core.ended or ""

    @property
    def has_begun(self) -> bool:
        """Whether there is anything of the run: of one that was taken up there was before."""
        return self.joined_s is not None or self._resumed_tick is not None

    def interrupt(self, name: str) -> None:
        """End the run because of a signal; called as a signal handler is."""
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self.stop, f"stopped by {name}")

    def stop(self, reason: str) -> None:
        """End the run as failed. Later reasons are ignored."""
        if not self._failure.done():
            self._failure.set_result(reason)

    def record_with(self, recorder: Recorder) -> None:
        """Record from now on; a recording that cannot go on ends the run."""

        def record(tick: int, key: str, payload: bytes, at_us: int | None = None) -> None:
            try:
                recorder.record(tick, key, payload, at_us)
            except RecordingStopped as error:
                self._loop.call_soon_threadsafe(self.stop, str(error))

        self.core.record = record

    async def _refuse_early_messages(self) -> None:
        """An inbox that is full would keep tokens out as well.

        Who takes up a run has asked already, and what comes may be answers.
        """
        while True:
            if self._resumed_tick is None:
                for key, payload in itertools.islice(self.connection.waiting(), EARLY_MAX):
                    self.core.receive(key, payload)
            await asyncio.sleep(EARLY_PERIOD_S)

    def _send_failure(self) -> None:
        with contextlib.suppress(ConnectionClosed), self._lock:
            send(self.connection, self.core.fail(self._failure.result()))

    async def _flush_end(self) -> None:
        """See to it that the robots learn of the end before the link is closed.

        One that is frozen never will; whoever waits for this world has the same patience, and is
        not to lose it first.
        """
        info = robot_key(self.core.run, "*", "about")
        s_max = min(self.options.answer_s_max / 2.0, FLUSH_S_MAX)
        await asyncio.to_thread(self.connection.flush, info, s_max)

    async def _hunt(self) -> None:
        # What was imported stays for good: collecting garbage need not look at it again and again.
        gc.freeze()
        begun = time.perf_counter()
        self.begun_unix_s = time.time()
        rounds = asyncio.create_task(asyncio.to_thread(self._run_rounds))
        watch = asyncio.create_task(self._watch_progress())
        over = asyncio.create_task(self._ended.wait())
        await _first_of(rounds, over, watch, self._failure)
        # It ends by itself only by an error of ours, which must not go unheard.
        broken = watch.done()
        watch.cancel()
        over.cancel()
        if self._failure.done() and self.core.ended is None:
            self._send_failure()
        await self._flush_end()
        if not rounds.done():
            await asyncio.to_thread(self.connection.close)
        await rounds
        if broken:
            watch.result()
        self._report_departures()
        self.rounds_s = time.perf_counter() - begun

    def _run_rounds(self) -> None:
        if isinstance(self.core, RealTimeWorldCore):
            self.punctuality = run_real_time(
                self.core,
                self._failure_detector,
                self.connection,
                self._act,
                self.options.answer_s_max,
            )
            return
        self._act(self._failure_detector.begin)
        with contextlib.suppress(ConnectionClosed):
            while self.core.ended is None:
                key, payload = self.connection.receive()
                with self._lock:
                    self._send(self.core.receive(key, payload))
                    self._send(self._failure_detector.sign_of_life(key, payload))

    def _act(self, change: Callable[[], Outgoing], key: str = "") -> None:
        """Do something with the core, from whatever thread, and send what comes of it."""
        try:
            with self._lock:
                self._send(change())
        except ProtocolError as error:
            self.core.refuse(key, error)
        except RunCannotContinue as error:
            self._loop.call_soon_threadsafe(self.stop, str(error))
        except ConnectionClosed:
            pass
        if self.core.ended is not None:
            self._loop.call_soon_threadsafe(self._ended.set)

    def _send(self, outgoing: Outgoing) -> None:
        if outgoing:
            send_in_batches(self.connection, outgoing)
            send(self.connection, self.core.commit())

    async def _watch_progress(self) -> None:
        """Report progress, and see to it that nobody is waited for too long."""
        tick, waited_s, again_s, looked_s = -1, 0.0, RESEND_PERIOD_S, time.monotonic()
        reminded_s = looked_s
        while True:
            state, now_s = self.core.state, time.monotonic()
            waited_s += min(now_s - looked_s, LOOK_GAP_S_MAX)
            looked_s = now_s
            self._report_departures()
            if now_s - reminded_s > RESEND_PERIOD_S:
                reminded_s = now_s
                self._act(self._failure_detector.reminders)
            if state.tick != tick:
                tick, waited_s, again_s = state.tick, 0.0, RESEND_PERIOD_S
                distances_m = state.geometry.distances[:-1, -1 - self._fixed].tolist()
                lost = list(self.core.lost)
                self.report({"tick": tick, "distances_m": distances_m, "lost": lost})
            elif isinstance(self.core, RealTimeWorldCore):
                # The clock ends ticks, however long; silence would tell the starter of a hang.
                if again_s < waited_s < self.core.arena.scenario.tick_s + RESEND_PERIOD_S:
                    again_s += RESEND_PERIOD_S
                    self.report({"waiting": []})
            elif waited_s > self._patience_s(tick):
                waited_s, again_s = 0.0, RESEND_PERIOD_S
                self._act(
                    partial(self._failure_detector.answer_overdue, tick, self._patience_s(tick))
                )
            elif waited_s > again_s:
                # A router that was restarted has lost what was under way.
                again_s += RESEND_PERIOD_S
                self.report({"waiting": self.core.table.waiting()})
                if tick != self._resumed_tick:
                    self._act(self.core.unanswered)
            await asyncio.sleep(WATCH_PERIOD_S)

    def _patience_s(self, tick: int) -> float:
        """How long to wait, in s, for the answers to the observations of a tick."""
        longest = max(self.options.answer_s_max, self.options.join_s_max)
        return longest if tick == self._resumed_tick else self.options.answer_s_max

    def _report_departures(self) -> None:
        """Say what has become of robots since the last time."""
        departures = self.core.departures
        while self._departures_reported < len(departures):
            tick, robot, what = departures[self._departures_reported]
            self._departures_reported += 1
            self.report({"departure": [tick, robot, what]})
            say_error(f"world: tick {tick}: robot {robot} is {what}")
            if NO_ANSWER in what:
                self._version_checks[robot] = asyncio.create_task(
                    asyncio.to_thread(self._explain_silence, robot)
                )

    def _explain_silence(self, robot: str) -> None:
        """Say so if a robot that does not answer speaks another version."""
        key = robot_key(self.core.run, robot, "about")
        info = self.connection.query_info(key, self.options.answer_s_max)
        if info is not None and info.wire != VERSION:
            say_error(
                f"world: robot {robot} speaks version {info.wire} of the wire, this is {VERSION}:"
                " install the same Encircle on every host"
            )

    @property
    def _fixed(self) -> int:
        return len(self.core.arena.scenario.obstacles)

    def _alive_changed(self, key: str, alive: bool) -> None:
        self._loop.call_soon_threadsafe(self._robot_changed, key, alive)

    def _robot_changed(self, key: str, alive: bool) -> None:
        change = (
            self._failure_detector.token_appeared
            if alive
            else self._failure_detector.token_vanished
        )
        expected = self._failure_detector.expected
        self._act(lambda: change(parse_key(key).robot or ""), key)
        if self._failure_detector.expected != expected and not self._failure_detector.begun:
            self.report({"expected": list(self._failure_detector.expected)})
        if not self._failure_detector.expected:
            self._all_joined.set()

    def _give_up_joining(self) -> None:
        if self._failure_detector.may_begin:
            self._all_joined.set()
            return
        absent = ", ".join(self._failure_detector.expected)
        self.stop(f"{absent} did not join within {self.options.join_s_max:g} s")


async def _first_of(*futures: "asyncio.Future[Any]") -> None:
    await asyncio.wait(futures, return_when=asyncio.FIRST_COMPLETED)
