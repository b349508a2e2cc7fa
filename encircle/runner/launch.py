"""A hunt as operating-system processes: one world, one robot each, over Zenoh on loopback.

The launcher has them forked (``encircle.runner.nodes``), follows the world's reports, and sees to
it that none is left behind: it ends what it started by process, whatever happened. The world ends
by itself when the launcher is gone (its standard input closes), the robots when the world is, and
the fork server with the launcher. A robot that dies in mid-run is the world's affair; nothing is
started anew.
"""

import asyncio
import json
import os
import socket
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from encircle.protocol.endings import is_failure
from encircle.protocol.process.interrupts import signals_to
from encircle.protocol.process.log import KINDS_VARIABLE, LineKind, kind_and_text, printable
from encircle.protocol.programs.options import without_settings
from encircle.runner.interventions import Interventions
from encircle.runner.nodes import Node, NodesLost, abandon, fork_server
from encircle.runner.onlooking import HuntOnlooker
from encircle.runner.testimony import RunFailed, Testimony
from encircle.world.coordinator.result import Result

STOP_S_MAX = 3.0
SILENCE_S_MAX = 6.0
FAILURE_GRACE_S = 1.0
OUTPUT_LINE_BYTES_MAX = 1024 * 1024


@dataclass(frozen=True, slots=True)
class Timeouts:
    """How long to wait, in s, for processes at the start and for whoever has to answer.

    A machine that is busy with other things needs more of it than others. It is for hangs alone:
    a process that ends is noticed at once.
    """

    join_s_max: float = 30.0
    answer_s_max: float = STOP_S_MAX

    @property
    def silence_s_max(self) -> float:
        """How long the world may say nothing: it speaks up each second that it waits."""
        return max(SILENCE_S_MAX, 2.0 * self.answer_s_max)


TIMEOUTS = Timeouts()


def free_endpoint() -> str:
    """A loopback endpoint with a port that is free now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def run_processes(
    world_arguments: Sequence[str],
    robots: Sequence[str],
    run: str,
    report: Callable[[dict[str, Any]], None],
    start_order: Sequence[str] | None = None,
    directory: Path | None = None,
    timeouts: Timeouts | None = None,
    interventions: Interventions | None = None,
    onlooker: HuntOnlooker | None = None,
    robots_per_process: int = 1,
) -> tuple[Result, dict[str, Any]]:
    """Run a hunt as processes, one of the world and one per robot; its result and timings.

    ``world_arguments``: scenario and options for ``python -m encircle.world``. ``report`` gets the
    world's reports, and ``{"started": {name: pid}, "run": name, "endpoint": endpoint}`` first.
    ``start_order`` is for tests; ``directory``: that of the run, if any. ``interventions``: given
    to the world by its standard input; ``onlooker``: who is shown the hunt. ``robots_per_process``:
    so many robots, in robot order, share a process. Raises ``RunFailed``.
    """
    groups = robot_groups(robots, robots_per_process)
    launch = _Launch(run, groups, report, directory, timeouts or TIMEOUTS, interventions, onlooker)
    with signals_to(launch.interrupt):
        try:
            outcome = asyncio.run(launch.run(world_arguments, start_order or ["world", *robots]))
        except NodesLost as error:
            raise RunFailed(str(error)) from None
    if launch.interrupted or outcome is None:
        raise launch.stopped()
    return outcome


def robot_groups(robots: Sequence[str], robots_per_process: int) -> list[tuple[str, ...]]:
    """The robots of each process, in robot order.

    >>> robot_groups(["r1", "r2", "r3"], 2)
    [('r1', 'r2'), ('r3',)]
    """
    firsts = range(0, len(robots), robots_per_process)
    return [tuple(robots[first : first + robots_per_process]) for first in firsts]


class _Launch:
    """One launch. ``groups``: the robots of each process, whose name is that of its first robot."""

    def __init__(
        self,
        run: str,
        groups: Sequence[tuple[str, ...]],
        report: Callable[[dict[str, Any]], None],
        directory: Path | None,
        timeouts: Timeouts,
        interventions: Interventions | None,
        onlooker: HuntOnlooker | None,
    ) -> None:
        self.name = run
        self._interventions = interventions
        self._onlooker = onlooker
        self._control: asyncio.WriteTransport | None = None
        self.robots_in = {group[0]: group for group in groups}
        self.robot_options = ["--tracebacks", str(directory)] if directory is not None else []
        self.report = report
        self.timeouts = timeouts
        self.endpoint = free_endpoint()
        self.processes: dict[str, Node] = {}
        self._environment = without_settings(os.environ) | {KINDS_VARIABLE: "yes"}
        self._server = fork_server(self._environment)
        self._pipes = ExitStack()
        self._errors: dict[str, asyncio.StreamReader] = {}
        self._reports: asyncio.StreamReader | None = None
        self.result: dict[str, Any] | None = None
        self.tick = 0
        self.testimony = Testimony(self.robots_in, self.processes)
        self.interrupted = ""
        self._interrupted = asyncio.Event()
        self._loop: asyncio.AbstractEventLoop | None = None
        self.failure_due_s: dict[str, float] = {}
        self.begun = False
        self.silent = False
        self.last_report_s = 0.0

    async def run(
        self, world_arguments: Sequence[str], order: Sequence[str]
    ) -> tuple[Result, dict[str, Any]] | None:
        self._loop = asyncio.get_running_loop()
        try:
            for name in order:
                if name != "world" and name not in self.robots_in:
                    continue
                if not self.interrupted:
                    await self._start(name, world_arguments)
                if name == "world" and not self.interrupted:
                    await self._show()
            if not self.interrupted:
                pids = {
                    member: process.pid
                    for name, process in self.processes.items()
                    for member in self.robots_in.get(name, (name,))
                }
                self.report({"started": pids, "run": self.name, "endpoint": self.endpoint})
                await self._follow()
        finally:
            if self._interventions is not None:
                self._interventions.on_given(None)
            await self._stop_all()
            self._pipes.close()
        return None if self.interrupted else self._outcome()

    async def _start(self, name: str, world_arguments: Sequence[str]) -> None:
        if name == "world":
            program = "encircle.world"
            options = [*world_arguments, "--listen", self.endpoint, "--parent", "--json"]
            options += ["--answer-timeout", f"{self.timeouts.answer_s_max}"]
            options += ["--control"] if self._interventions is not None else []
        else:
            program = "encircle.agents"
            options = [
                *self.robots_in[name],
                "--connect",
                self.endpoint,
                "--quiet",
                *self.robot_options,
            ]
        options += ["--run", self.name, "--join-timeout", f"{self.timeouts.join_s_max}"]
        with ExitStack() as theirs:
            nothing = theirs.enter_context(open(os.devnull, "r+b", buffering=0)).fileno()
            errors, self._errors[name] = await self._output(theirs)
            streams = (nothing, nothing, errors)
            if name == "world":
                output, self._reports = await self._output(theirs)
                streams = (await self._input(theirs), output, errors)
            start = self._server.start(program, options, streams, self._environment)
        # The fork server may be busy with its imports for some time.
        started = asyncio.wrap_future(start)
        interrupted = asyncio.ensure_future(self._interrupted.wait())
        either: set[asyncio.Future[Any]] = {started, interrupted}
        s_max = self.timeouts.join_s_max
        await asyncio.wait(either, timeout=s_max, return_when=asyncio.FIRST_COMPLETED)
        interrupted.cancel()
        if started.done():
            self.processes[name] = started.result()
            return
        abandon(start)
        if not self.interrupted:
            raise RunFailed(f"the process of {name} was not there within {s_max:g} s")

    async def _input(self, theirs: ExitStack) -> int:
        """A pipe's end for reading; the other one is this process's, as long as the run lasts."""
        read, write = os.pipe()
        theirs.callback(os.close, read)
        if self._interventions is None:
            self._pipes.callback(os.close, write)
            return read
        assert self._loop is not None
        file = open(write, "wb", buffering=0)  # noqa: SIM115  # the transport closes it
        self._control, _ = await self._loop.connect_write_pipe(asyncio.Protocol, file)
        self._pipes.callback(self._control.close)
        self._interventions.on_given(partial(self._loop.call_soon_threadsafe, self._hand_over))
        self._hand_over()
        return read

    def _hand_over(self) -> None:
        """Hand the interventions that wait to the world; those for a run that is over are lost."""
        if self._interventions is None or self._control is None or self._control.is_closing():
            return
        lines = "".join(f"{line}\n" for line in self._interventions.take())
        self._control.write(lines.encode())

    async def _show(self) -> None:
        """Wait until an onlooker, if there is one, sees the hunt; it must not miss the start."""
        if self._onlooker is None:
            return
        interrupted = asyncio.ensure_future(self._interrupted.wait())
        gone = asyncio.wrap_future(self.processes["world"].ended)
        looking = asyncio.wrap_future(self._onlooker.look_on(self.endpoint))
        either: set[asyncio.Future[Any]] = {looking, gone, interrupted}
        s_max = self.timeouts.join_s_max
        await asyncio.wait(either, timeout=s_max, return_when=asyncio.FIRST_COMPLETED)
        interrupted.cancel()

    async def _output(self, theirs: ExitStack) -> tuple[int, asyncio.StreamReader]:
        """A pipe's end for writing, and what is read at the other one."""
        read, write = os.pipe()
        theirs.callback(os.close, write)
        assert self._loop is not None
        reader = asyncio.StreamReader(limit=OUTPUT_LINE_BYTES_MAX)
        file = open(read, "rb", buffering=0)  # noqa: SIM115  # the transport closes it
        transport, _ = await self._loop.connect_read_pipe(
            lambda: asyncio.StreamReaderProtocol(reader), file
        )
        self._pipes.callback(transport.close)
        return write, reader

    async def _follow(self) -> None:
        """Read what the processes say until all have ended, or one has failed for a while."""
        readers = [asyncio.create_task(self._read_errors(name)) for name in self.processes]
        readers.append(asyncio.create_task(self._read_reports()))
        waiting = {asyncio.wrap_future(p.ended) for p in self.processes.values()}
        while waiting and not self.silent:
            # The robots end when the world has told them to; what has not ended some seconds
            # after it never will. Before the run has begun, it cannot do without any robot.
            ending = (
                self.interrupted
                or self._has_ended("world")
                or (not self.begun and any(map(self._has_ended, self.processes)))
            )
            silence_s = time.monotonic() - self.last_report_s if self.begun else 0.0
            s_max = max(0.0, self.timeouts.silence_s_max - silence_s)
            done, _ = await asyncio.wait(
                waiting | {reader for reader in readers if not reader.done()},
                timeout=STOP_S_MAX
                if ending
                else min(s_max, FAILURE_GRACE_S)
                if self.failure_due_s
                else s_max,
                return_when=asyncio.FIRST_COMPLETED,
            )
            waiting = {future for future in waiting if not future.done()}
            if (ending and not done) or any(map(_has_failed, readers)):
                break
            # The world speaks up when a robot does not answer; nobody does when the world hangs.
            silence_s = time.monotonic() - self.last_report_s
            self.silent = self.begun and silence_s >= self.timeouts.silence_s_max
            self._note_endings()
            if self.processes["world"].returncode not in (None, 0):
                # Robots would wait for it to come back.
                break
        await self._stop_all()
        # All have ended, and what they said last is there to be read.
        read, late = await asyncio.wait(readers, timeout=self.timeouts.answer_s_max)
        for reader in late:
            reader.cancel()
        for reader in read:
            # What cannot be understood, or fails in whoever is told of it, is no silence.
            reader.result()

    def _has_ended(self, name: str) -> bool:
        return self.processes[name].returncode is not None

    def _note_endings(self) -> None:
        """Note who failed first, and say how robots have ended in mid-run.

        Of one that was not killed, when the world is still there after a moment: it may have told
        it to.
        """
        now_s = time.monotonic()
        for name, process in self.processes.items():
            if process.returncode and name not in self.testimony.failed:
                self.testimony.failed.append(name)
                self.failure_due_s[name] = now_s + FAILURE_GRACE_S * (process.returncode > 0)
        if not self.begun or self._has_ended("world") or self.interrupted:
            self.failure_due_s.clear()
        for name in [name for name, due_s in self.failure_due_s.items() if now_s >= due_s]:
            del self.failure_due_s[name]
            self.report({"log": self.testimony.robot_ending(name)})

    async def _read_reports(self) -> None:
        assert self._reports is not None
        async for line in self._reports:
            report = json.loads(line)
            self.last_report_s = time.monotonic()
            self.result = report.get("result", self.result)
            # The run may have ended before its first report.
            joined = self.result is not None and self.result["joined_s"] is not None
            self.begun = self.begun or "tick" in report or joined
            self.tick = report.get("tick", self.tick)
            self.report(report)

    async def _read_errors(self, name: str) -> None:
        async for line in self._errors[name]:
            kind, text = kind_and_text(line.decode(errors="replace").rstrip())
            text = printable(text)
            # What happens to robots the world reports, but not what happens in them.
            told = kind is LineKind.REFUSAL or (kind is LineKind.EVENT and name != "world")
            if self.testimony.keep(name, kind, text) and told:
                self.report({"log": text})

    def stopped(self) -> RunFailed:
        """The error of a run that was interrupted."""
        is_over = self.result is not None and not is_failure(self.result["ended"])
        when = f"at tick {self.tick}" if self.begun else "before the run began"
        when += ", which was its end" if is_over else ""
        return RunFailed(f"stopped by {self.interrupted} {when}", self.begun and not is_over)

    def interrupt(self, name: str) -> None:
        """End the run in order because of a signal; called as a signal handler is."""
        if not self.interrupted:
            self.interrupted = name
            if self._loop is not None and not self._loop.is_closed():
                self._loop.call_soon_threadsafe(self._end_world)

    def _end_world(self) -> None:
        self._interrupted.set()
        world = self.processes.get("world")
        if world is not None and world.returncode is None:
            world.terminate()

    async def _stop_all(self) -> None:
        """End every process that is still there: asked first, then made to."""
        if self.silent and not self._has_ended("world"):
            # It would not do anything else that it is asked either.
            self.processes["world"].kill()
        # A world that was asked to end has a recording to complete.
        for end, s_max in (("terminate", self.timeouts.answer_s_max), ("kill", STOP_S_MAX)):
            living = [p for p in self.processes.values() if p.returncode is None]
            for process in living:
                getattr(process, end)()
            if living:
                await asyncio.wait([asyncio.wrap_future(p.ended) for p in living], timeout=s_max)

    def _outcome(self) -> tuple[Result, dict[str, Any]]:
        """The result, or ``RunFailed`` with the one line that says what happened first."""
        if self.result is None and self.silent:
            s_max = self.timeouts.silence_s_max
            silence = f"the world has said nothing for {s_max:g} s at tick {self.tick}"
            raise RunFailed(silence, resumable=self.begun)
        return self.testimony.outcome(self.result, self.begun, self.tick)


def _has_failed(task: "asyncio.Task[None]") -> bool:
    return task.done() and task.exception() is not None
