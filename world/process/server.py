"""The world as a process: it takes robots in, runs the rounds, records, and reports.

As with the robot, asyncio supervises (joins, liveliness, signals, deadlines) and a thread runs the
rounds; both change the core by ``CoreAccess``. Progress goes to a reporter
(``encircle.world.process.reports``); what happens to robots goes to standard error as well.
"""

import asyncio
import contextlib
import gc
import time
from dataclasses import dataclass
from functools import partial
from typing import Any

from encircle.protocol.connections import Connection
from encircle.protocol.envelopes import ANSWERS
from encircle.protocol.errors import ConnectionClosed
from encircle.protocol.keys import robot_key, world_key
from encircle.protocol.zenoh.connection import ZenohConnection
from encircle.world.coordinator.deadlines import DeadlineStatistics
from encircle.world.coordinator.failure_detector import FailureDetector
from encircle.world.coordinator.real_time_core import RealTimeWorldCore
from encircle.world.coordinator.result import GO_ON
from encircle.world.coordinator.world_core import WorldCore
from encircle.world.process.control_input import ControlInput
from encircle.world.process.core_access import CoreAccess
from encircle.world.process.departure_reports import DepartureReports
from encircle.world.process.description import description_answer
from encircle.world.process.joining import Joining
from encircle.world.process.pace import Pace
from encircle.world.process.progress import LockStepWatch, RealTimeWatch
from encircle.world.process.real_time import run_real_time
from encircle.world.process.reports import Reporter
from encircle.world.process.run_watch import RunWatch
from encircle.world.process.sending import send
from encircle.world.recording.recorder import Recorder, RecordingStopped
from encircle.world.recording.resuming import Resumed

JOIN_S_MAX = 30.0
ANSWER_S_MAX = 3.0
FLUSH_S_MAX = 10.0
"""How long Zenoh keeps a connection on which nothing arrives."""


@dataclass(frozen=True, slots=True)
class WorldOptions:
    """Limits of a world: ``join_s_max`` and ``answer_s_max``, how long it waits for robots, in s.

    ``when_lost``: whether the run goes on without a lost robot, or ends. ``parent``: end when
    standard input does, so that no world outlives the program that started it. ``control``: take
    interventions from there. ``pace``: how many times faster than real time ticks in lock-step may
    go by, None for as fast as they can.
    """

    join_s_max: float = JOIN_S_MAX
    answer_s_max: float = ANSWER_S_MAX
    when_lost: str = GO_ON
    parent: bool = False
    control: bool = False
    pace: float | None = None


def run_rounds(core: WorldCore, connection: Connection) -> None:
    """Run a hunt in lock-step until it ends or the connection is closed."""
    try:
        outgoing = core.begin()
        while True:
            if outgoing:
                send(connection, outgoing)
                send(connection, core.rounds.commit())
                core.rounds.foresee()
            if core.ended is not None:
                break
            outgoing = core.receive(*connection.receive())
    except ConnectionClosed:
        pass


@dataclass
class RunTimes:
    """When a run has begun and how long its parts took, as far as it came; for summaries."""

    joined_s: float | None = None
    rounds_s: float = 0.0
    begun_unix_s: float | None = None


class Server:
    """One run of one arena, over Zenoh."""

    def __init__(
        self,
        core: WorldCore | RealTimeWorldCore,
        connection: ZenohConnection,
        options: WorldOptions,
        report_to: Reporter,
        resumed: Resumed | None = None,
    ) -> None:
        self.connection = connection
        self.core = core
        self.options = options
        self.report = report_to
        self.times = RunTimes()
        self.punctuality: DeadlineStatistics | None = None
        self._resumed_tick = core.state.tick if resumed else None
        self._loop = asyncio.get_running_loop()
        self._failure: asyncio.Future[str] = self._loop.create_future()
        self._ended = asyncio.Event()
        self._failure_detector = FailureDetector(
            core, options.when_lost, resumed.histories if resumed else None
        )
        self._access = CoreAccess(
            core,
            connection,
            on_ended=lambda: self._loop.call_soon_threadsafe(self._ended.set),
            on_failure=lambda reason: self._loop.call_soon_threadsafe(self.stop, reason),
        )
        self.control = ControlInput(core, self._access, report_to)
        tick_s = core.arena.scenario.tick_s
        self._pace = None if options.pace is None else Pace(options.pace, tick_s)
        self._joining = Joining(self._failure_detector, self._access, connection, report_to)
        self._departures = DepartureReports(
            core.rounds, connection, report_to, options.answer_s_max
        )

    async def serve(self) -> str:
        """Take the robots in and run the hunt; returns how it ended."""
        if self.core.ended is None:
            if await self._wait_for_robots():
                await self._hunt()
            if self.core.ended is None:
                self._access.fail(self._failure.result())
                await self._flush_end()
        return self.core.ended or ""

    @property
    def has_begun(self) -> bool:
        """Whether anything of the run exists: of a resumed one something did before."""
        return self.times.joined_s is not None or self._resumed_tick is not None

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

        self.core.record_with(record)

    async def _wait_for_robots(self) -> bool:
        """Take robots in until the run can begin; False if it failed before."""
        started, run, s_max = time.perf_counter(), self.core.run, self.options.join_s_max
        self._joining.watch_tokens(run)
        opens = isinstance(self.core, WorldCore) and self.connection.is_open
        takes = (ANSWERS,) if opens else ()
        self.connection.answer_info_queries(world_key(run, "about"), "world", takes)
        self.connection.answer_queries(*description_answer(self.core.rounds))
        self.connection.declare_alive(world_key(run, "alive"))
        timeout = self._loop.call_later(s_max, self._joining.give_up, s_max, self.stop)
        all_joined = asyncio.create_task(self._joining.all_joined.wait())
        tasks: list[asyncio.Task[Any]] = [all_joined]
        # A robot of a resumed run has got its observation already: what comes may be its answer.
        if self._resumed_tick is None:
            tasks.append(asyncio.create_task(self._joining.refuse_early_messages(self._refuse)))
        await _first_of(*tasks, self._failure)
        timeout.cancel()
        for task in tasks:
            if task.done():
                task.result()
            task.cancel()
        if self._failure.done():
            return False
        self.times.joined_s = time.perf_counter() - started
        return True

    async def _hunt(self) -> None:
        # What was imported stays for good: collecting garbage need not look at it again and again.
        gc.freeze()
        begun = time.perf_counter()
        self.times.begun_unix_s = time.time()
        rounds = asyncio.create_task(asyncio.to_thread(self._run_rounds))
        watch = asyncio.create_task(self._run_watch().run())
        over = asyncio.create_task(self._ended.wait())
        await _first_of(rounds, over, watch, self._failure)
        # The watch ends by itself only by an error of ours, which is raised below.
        watch_failed = watch.done()
        watch.cancel()
        over.cancel()
        if self._failure.done() and self.core.ended is None:
            self._access.fail(self._failure.result())
        if self._pace is not None:
            self._pace.release()
        await self._flush_end()
        if not rounds.done():
            await asyncio.to_thread(self.connection.close)
        await rounds
        if watch_failed:
            watch.result()
        self._departures.update()
        self.times.rounds_s = time.perf_counter() - begun

    async def _flush_end(self) -> None:
        """Wait until the robots have received the end, before the connection is closed.

        A frozen robot never will. The program that waits for this world waits as long as this world
        for robots, so half of that is left for it.
        """
        info = robot_key(self.core.run, "*", "about")
        s_max = min(self.options.answer_s_max / 2.0, FLUSH_S_MAX)
        await asyncio.to_thread(self.connection.flush, info, s_max)

    def _run_rounds(self) -> None:
        """Run the rounds until the run ends or the connection is closed; in a thread of its own."""
        core, detector, access = self.core, self._failure_detector, self._access
        if isinstance(core, RealTimeWorldCore):
            self.punctuality = run_real_time(
                core,
                detector,
                self.connection,
                access.change,
                self.options.answer_s_max,
                self.control.begin,
            )
            return
        access.change(detector.begin)
        self.control.begin()
        with contextlib.suppress(ConnectionClosed):
            while core.ended is None:
                message = self.connection.receive()
                if self._pace is not None:
                    self._pace.hold(core.state.tick)
                access.change_in_thread(
                    partial(core.receive, *message), partial(detector.sign_of_life, *message)
                )

    def _run_watch(self) -> RunWatch:
        options, now_s = self.options, time.monotonic()
        watch = (
            RealTimeWatch(self.core.arena.scenario.tick_s, now_s)
            if isinstance(self.core, RealTimeWorldCore)
            else LockStepWatch(
                options.answer_s_max,
                now_s,
                self._resumed_tick,
                max(options.answer_s_max, options.join_s_max),
            )
        )
        return RunWatch(
            self.core.rounds,
            self._access,
            self._failure_detector,
            watch,
            self._departures,
            self.report,
            self._pace,
        )

    def _refuse(self, key: str, payload: bytes) -> None:
        """Take in a message from before the first round, when none is in turn."""
        if isinstance(self.core, RealTimeWorldCore):
            self.core.take(key, payload, self.core.now_us)
        else:
            self.core.receive(key, payload)


async def _first_of(*futures: "asyncio.Future[Any]") -> None:
    await asyncio.wait(futures, return_when=asyncio.FIRST_COMPLETED)
