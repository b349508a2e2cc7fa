"""Runs of a study through real robot processes, kept from run to run.

This process is the world; the robots are processes of their own, as in any hunt over Zenoh,
started once for the largest team of the study. A run's log is made from its messages, by feeding
the observations to new brains, since no message holds what robots believe. Whatever happens, the
robots are ended: they end by themselves when the world is gone, and are killed if they do not.
"""

import contextlib
import json
import os
import secrets
import threading
import time
import traceback
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import ExitStack

from encircle.protocol.endings import failure_of
from encircle.protocol.errors import ConnectionClosed
from encircle.protocol.keys import robot_key, world_key
from encircle.protocol.plugins import PluginFailed
from encircle.protocol.process.interrupts import check, is_signal_held
from encircle.protocol.process.log import bounded_log
from encircle.protocol.programs.options import without_settings
from encircle.protocol.zenoh.connection import ConnectionFailed, ZenohConnection
from encircle.protocol.zenoh.endpoints import Endpoints
from encircle.runlog.recorded_log import log_of_messages
from encircle.runlog.runlog import RunLog
from encircle.runner import launch
from encircle.runner.launch import STOP_S_MAX, Timeouts, free_endpoint
from encircle.runner.nodes import Node, NodesLost, abandon, fork_server
from encircle.studies.plan import Plan
from encircle.studies.running import failed_row, result_row, run_seed
from encircle.studies.sources import versions
from encircle.studies.tasks import FAILED, Row, Task
from encircle.studies.workers import StudyFailed
from encircle.world.arena.engine import Arena, build
from encircle.world.coordinator.failure_detector import policies_of
from encircle.world.coordinator.round_engine import RoundEngine
from encircle.world.coordinator.world_core import WorldCore
from encircle.world.loading.load import load
from encircle.world.process.progress import LockStepWatch, Overdue, Progress, StillWaiting
from encircle.world.process.sending import send
from encircle.world.process.server import run_rounds
from encircle.world.scenario.errors import ScenarioError
from encircle.world.scenario.model import Scenario

WATCH_PERIOD_S = 0.1
STANDARD_ERROR = 2
Messages = list[tuple[int, str, bytes]]


def over_zenoh(plan: Plan, tasks: Iterator[Task], code: str) -> Generator[list[Row]]:
    """Run tasks one after the other with the same robot processes, a row at a time.

    ``code``: the digest of the sources that the robots, started here, import.
    """
    code_identity = code, json.dumps(versions(plan.plugins))
    team = max((plan.scenario_of(cell).ids for cell in range(len(plan.cells))), key=len)
    with ExitStack() as stack:
        session = None
        for task in tasks:
            scenario = load(json.loads(task.scenario))
            for seed in task.seeds:
                check()
                session = session or stack.enter_context(Session(team))
                finished = _run(session, task, scenario, seed, code_identity)
                yield [finished]
                if finished[FAILED]:
                    # Messages of that run that are still under way must not reach the next one.
                    stack.close()
                    session = None


def _run(
    session: "Session", task: Task, scenario: Scenario, seed: int, code: tuple[str, str]
) -> Row:
    begun_s = time.perf_counter()
    try:
        log, digest = session.hunt(build(scenario, seed))
        return result_row(task, log, digest, begun_s, code)
    except HuntFailed as error:
        # Its traceback is in another process; the same run fails in memory with one of its own.
        again = run_seed(task, scenario, seed, code)
        if again[FAILED]:
            return again
        return failed_row(task, seed, str(error), f"{error}\n", begun_s, code)
    except (PluginFailed, ScenarioError) as error:
        trace = "".join(traceback.format_exception(error))
        return failed_row(task, seed, str(error), trace, begun_s, code)


class HuntFailed(Exception):
    """A run that ended as failed; the message is the reason."""


class Session:
    """Robot processes that wait for runs. Use as a context manager, which ends them."""

    def __init__(self, robots: Sequence[str], timeouts: Timeouts | None = None) -> None:
        self._patience = timeouts or launch.TIMEOUTS
        self._robots = tuple(robots)
        self._run = f"study-{secrets.token_hex(6)}"
        self._endpoint = free_endpoint()
        self._processes: dict[str, Node] = {}
        self._alive: set[str] = set()
        self._failure = ""
        self._all_joined = threading.Event()
        self._closed = threading.Event()
        self._core: WorldCore | None = None

    def __enter__(self) -> "Session":
        try:
            self._connection = ZenohConnection(
                Endpoints(listen=(self._endpoint,)), robot_key(self._run, "*", "*")
            )
        except ConnectionFailed as error:
            raise StudyFailed(str(error)) from None
        try:
            self._start()
        except BaseException:
            self.__exit__()
            raise
        return self

    def _start(self) -> None:
        self._connection.watch(robot_key(self._run, "*", "alive"), self._alive_changed)
        self._connection.declare_alive(world_key(self._run, "alive"))
        s_max = self._patience.join_s_max
        options = ("--run", self._run, "--stay", "--quiet", "--join-timeout", f"{s_max}")
        environment = without_settings(os.environ)
        server = fork_server(environment)
        deadline_s = time.monotonic() + s_max
        starts: dict[str, Future[Node]] = {}
        try:
            with open(os.devnull, "r+b", buffering=0) as nothing:
                streams = (nothing.fileno(), nothing.fileno(), STANDARD_ERROR)
                for robot in self._robots:
                    arguments = [robot, "--connect", self._endpoint, *options]
                    starts[robot] = server.start("encircle.agents", arguments, streams, environment)
            while starts:
                check()
                self._take_started(starts)
                if starts and time.monotonic() >= deadline_s:
                    raise StudyFailed(f"{', '.join(starts)}: no process within {s_max:g} s")
        except NodesLost as error:
            raise StudyFailed(str(error)) from None
        finally:
            for start in starts.values():
                abandon(start)
        while not self._all_joined.wait(WATCH_PERIOD_S):
            check()
            ended = [robot for robot, p in self._processes.items() if p.poll() is not None]
            if ended:
                raise StudyFailed(f"robot {ended[0]} ended before the first run")
            if time.monotonic() >= deadline_s:
                absent = ", ".join(sorted(set(self._robots) - self._alive))
                raise StudyFailed(f"{absent} did not join within {s_max:g} s")
        threading.Thread(target=self._watch, daemon=True).start()

    def _take_started(self, starts: dict[str, Future[Node]]) -> None:
        """Move the nodes that are there from ``starts`` to the processes."""
        wait(starts.values(), WATCH_PERIOD_S, FIRST_COMPLETED)
        for robot in [robot for robot, start in starts.items() if start.done()]:
            self._processes[robot] = starts.pop(robot).result()

    def __exit__(self, *_error: object) -> None:
        self._closed.set()
        self._connection.close()
        ends: tuple[Callable[[Node], None], ...] = (lambda _p: None, Node.terminate, Node.kill)
        for end in ends:
            for process in self._processes.values():
                end(process)
            deadline_s = time.monotonic() + STOP_S_MAX
            while time.monotonic() < deadline_s:
                if all(p.poll() is not None for p in self._processes.values()):
                    return
                time.sleep(0.02)

    def hunt(self, arena: Arena) -> tuple[RunLog, str]:
        """One run: its log and digest.

        ``HuntFailed`` if it ends as failed, ``StudyFailed`` if it does not come to any end.
        """
        messages: Messages = []
        core = WorldCore(
            arena,
            self._run,
            bounded_log(),
            record=lambda tick, key, payload: messages.append((tick, key, payload)),
        )
        for robot in arena.ids:
            send(self._connection, core.join(robot))
        self._core = core
        run_rounds(core, self._connection)
        if core.ended is None:
            check()
            raise StudyFailed(self._failure or "the link was closed")
        self._core = None
        if (failure := failure_of(core.ended)) is not None:
            raise HuntFailed(failure)
        digest = core.rounds.result().digest
        return log_of_messages(arena.scenario, arena.seed, self._run, messages), digest

    def _alive_changed(self, key: str, alive: bool) -> None:
        robot = next((r for r in self._robots if key == robot_key(self._run, r, "alive")), None)
        if robot is None:
            return
        if alive:
            self._alive.add(robot)
            if self._alive.issuperset(self._robots):
                self._all_joined.set()
        elif not self._closed.is_set():
            self._failure = self._failure or f"robot {robot} is gone"

    def _watch(self) -> None:
        """Close the connection, and so end the run, when a robot is gone or does not answer.

        An unanswered observation is sent again before: it may have been dropped for want of room.
        """
        watched, s_max = None, self._patience.answer_s_max
        watch = LockStepWatch(s_max, time.monotonic())
        while not self._closed.wait(WATCH_PERIOD_S):
            core, now_s = self._core, time.monotonic()
            if core is not watched:
                watched, watch = core, LockStepWatch(s_max, now_s)
            if core is not None:
                self._act_on(watch.look(core.state.tick, now_s), core.rounds)
            if self._failure or is_signal_held():
                self._connection.close()
                return

    def _act_on(self, progress: Progress, rounds: RoundEngine) -> None:
        match progress:
            case Overdue(answer_s_max):
                silent, tick = rounds.table.waiting(), rounds.state.tick
                policies = policies_of(rounds.arena.scenario, silent)
                self._failure = (
                    f"no answer from {', '.join(silent)} for {answer_s_max:g} s at tick {tick}"
                    f" ({policies})"
                )
            case StillWaiting():
                with contextlib.suppress(ConnectionClosed):
                    send(self._connection, rounds.unanswered())
