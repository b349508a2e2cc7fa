"""The life of a world's process: connection, recording and summary around one served run.

Whatever goes wrong is one line on standard error. No existing file is overwritten, and the
recording of a run that broke off is kept beside that of its resumption.
"""

import asyncio
import contextlib
import sys
from collections.abc import Callable
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

from encircle.protocol.endings import failure_of, failure_reason, is_failure
from encircle.protocol.keys import robot_key, world_key
from encircle.protocol.process.interrupts import signals_to
from encircle.protocol.process.log import LineKind, say_error
from encircle.protocol.process.tracebacks import failure_line
from encircle.protocol.zenoh.connection import ConnectionFailed, ZenohConnection
from encircle.protocol.zenoh.endpoints import Endpoints
from encircle.protocol.zenoh.liveliness import check_name_free
from encircle.world.arena.engine import Arena
from encircle.world.coordinator.real_time_core import RealTimeWorldCore
from encircle.world.coordinator.world_core import WorldCore
from encircle.world.network.transport import report
from encircle.world.process.reports import Reporter
from encircle.world.process.server import Server, WorldOptions
from encircle.world.recording.recorder import Recorder, RecordingStopped
from encircle.world.recording.resuming import Resumed
from encircle.world.recording.run_directory import (
    RunDirectoryError,
    create,
    discard,
    start_recording,
    write_summary,
)


async def run_world(
    arena: Arena,
    run: str,
    endpoints: Endpoints,
    out: Path | None,
    log: Callable[[str], None],
    options: WorldOptions,
    report_to: Reporter,
    resumed: Resumed | None = None,
) -> int:
    """The world's life; returns the exit status. ``out``: directory for the recording, if any.

    ``report_to`` gets every report. ``resumed``: a run to go on with, whose directory ``out``
    is.
    """
    # Built first: a team that cannot be placed leaves nothing behind.
    new_core = RealTimeWorldCore if arena.scenario.clock == "wall" else WorldCore
    core = resumed.core if resumed else new_core(arena, run, log)
    check = partial(check_name_free, token=world_key(run, "alive"), who=f"world of run {run}")
    try:
        if out is not None and resumed is None:
            create(out)
        connection = await asyncio.to_thread(
            ZenohConnection, endpoints, robot_key(run, "*", "*"), check
        )
    except (RunDirectoryError, ConnectionFailed) as error:
        say_error(f"world: {error}")
        return 2 if isinstance(error, RunDirectoryError) else 1
    server = Server(core, connection, options, report_to, resumed)
    with signals_to(server.interrupt):
        try:
            recorder = _recorder(out, arena, run, resumed)
            ended = await _served(server, endpoints, out, recorder)
        except (RunDirectoryError, RecordingStopped) as error:
            say_error(f"world: {error}")
            return 1
        finally:
            await asyncio.to_thread(connection.close)
        return _finish(server, ended, out, recorder)


async def _served(
    server: Server, endpoints: Endpoints, out: Path | None, recorder: Recorder | None
) -> str:
    """Report the world's endpoint and run the hunt; returns how it ended."""
    core, options = server.core, server.options
    if recorder is not None:
        server.record_with(recorder)
    core.rounds.journal.publishes = True
    if options.parent:
        _follow_starter(server)
    server.report({"listening" if endpoints.listen else "connected": str(endpoints)})
    if not options.parent:
        kept = f"recording into {out}" if out else "recording nothing: --runs DIR would"
        names = ", ".join(core.arena.ids)
        say_error(f"world: run {core.run} at {endpoints}, {kept}; waiting for {names}")
    return await server.serve()


def _follow_starter(server: Server) -> None:
    """Watch standard input: it closes when the program that started this world is gone."""
    loop, descriptor = asyncio.get_running_loop(), sys.stdin.fileno()

    def readable() -> None:
        if not (server.options.control and server.control.readable(descriptor)):
            loop.remove_reader(descriptor)
            server.stop("its starter is gone")

    loop.add_reader(descriptor, readable)


def _recorder(out: Path | None, arena: Arena, run: str, resumed: Resumed | None) -> Recorder | None:
    if out is None:
        return None
    return start_recording(out, arena.scenario, run, resumed.messages if resumed else None)


def _finish(server: Server, ended: str, out: Path | None, recorder: Recorder | None) -> int:
    """Finish the recording, write the summary, and report the result; returns the exit status."""
    core = server.core
    if core.rounds.plugin_failure is not None:
        ended = failure_reason(failure_line(core.rounds.plugin_failure, out))
    result = replace(core.rounds.result(), ended=ended)
    times = server.times
    extra: dict[str, Any] = {
        "rounds_s": times.rounds_s,
        "joined_s": times.joined_s,
        "begun_unix_s": times.begun_unix_s,
    }
    transport = {}
    if isinstance(core, RealTimeWorldCore) and server.punctuality is not None:
        extra["real_time"] = {**server.punctuality.as_dict(), "robots": core.answers.summary()}
        transport = {"transport": report(core.ledger)}
    if recorder is not None and out is not None and not server.has_begun:
        discard(recorder, out)
    elif recorder is not None and out is not None:
        try:
            with contextlib.closing(recorder):
                write_summary(out, core.rounds.written, result, core.run, extra | transport)
        except RecordingStopped as error:
            if not is_failure(ended):
                result = replace(result, ended=failure_reason(str(error)))
    server.report({"result": asdict(result) | extra})
    if (failure := failure_of(result.ended)) is not None:
        by_plugin = core.rounds.plugin_failure is not None
        say_error(f"world: {failure}", kind=LineKind.PLUGIN if by_plugin else LineKind.PROBLEM)
        return 1
    if not server.options.parent:
        how = "captured" if result.captured else "not captured"
        kept = f", recorded in {out}" if out else ""
        say_error(f"world: {how} at tick {result.ticks}, digest {result.digest}{kept}")
    return 0
