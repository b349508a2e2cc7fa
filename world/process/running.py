"""The world's life: link, recording and summary around one run that is served.

Whatever goes wrong is one line on standard error. Nothing that exists is overwritten, and what was
recorded of a run that broke off is kept beside what becomes of it.
"""

import asyncio
import contextlib
import sys
from collections.abc import Callable
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

from encircle.protocol.keys import robot_key, world_key
from encircle.protocol.messages import FAILED_FOR
from encircle.protocol.process.interrupts import told_to
from encircle.protocol.process.log import say_error
from encircle.protocol.process.tracebacks import line_of
from encircle.protocol.zenoh.connection import LinkError, ZenohLink
from encircle.protocol.zenoh.endpoints import Access
from encircle.protocol.zenoh.unique_names import check_free
from encircle.world.arena.engine import Arena
from encircle.world.coordinator.paced_core import PacedCore
from encircle.world.coordinator.world_core import WorldCore
from encircle.world.network.transport import report
from encircle.world.process.reports import Reporter
from encircle.world.process.server import Server, Terms
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
    access: Access,
    out: Path | None,
    log: Callable[[str], None],
    terms: Terms,
    report_to: Reporter,
    resumed: Resumed | None = None,
) -> int:
    """The world's life; returns the exit status. ``out``: directory for the recording, if any.

    ``report_to`` gets all that happens. ``resumed``: a run to go on with, whose directory ``out``
    is.
    """
    # Built first: a team that cannot be placed leaves nothing behind.
    kind = PacedCore if arena.scenario.clock == "wall" else WorldCore
    core = resumed.core if resumed else kind(arena, run, log)
    check = partial(check_free, token=world_key(run, "alive"), who=f"world of run {run}")
    try:
        if out is not None and resumed is None:
            create(out)
        link = await asyncio.to_thread(ZenohLink, access, robot_key(run, "*", "*"), check)
    except (RunDirectoryError, LinkError) as error:
        say_error(f"world: {error}")
        return 2 if isinstance(error, RunDirectoryError) else 1
    server = Server(core, link, terms, report_to, resumed)
    with told_to(server.interrupt):
        try:
            recorder = _recorder(out, arena, run, resumed)
            ended = await _served(server, access, out, recorder)
        except (RunDirectoryError, RecordingStopped) as error:
            say_error(f"world: {error}")
            return 1
        finally:
            await asyncio.to_thread(link.close)
        return _conclude(server, ended, out, recorder)


async def _served(
    server: Server, access: Access, out: Path | None, recorder: Recorder | None
) -> str:
    """Say where the world is and run the hunt; returns how it ended."""
    core, terms = server.core, server.terms
    if recorder is not None:
        server.record_with(recorder)
    core.shows = True
    if terms.parent:
        reader = asyncio.get_running_loop().add_reader
        reader(sys.stdin.fileno(), server.stop, "its starter is gone")
    server.report({"listening" if access.listen else "connected": str(access)})
    if not terms.parent:
        kept = f"recording into {out}" if out else "recording nothing: --runs DIR would"
        names = ", ".join(core.arena.ids)
        say_error(f"world: run {core.run} at {access}, {kept}; waiting for {names}")
    return await server.serve()


def _recorder(out: Path | None, arena: Arena, run: str, resumed: Resumed | None) -> Recorder | None:
    if out is None:
        return None
    return start_recording(out, arena.scenario, run, resumed.messages if resumed else None)


def _conclude(server: Server, ended: str, out: Path | None, recorder: Recorder | None) -> int:
    """Finish the recording, write the summary, and tell what came of the run; the exit status."""
    core = server.core
    if core.broken is not None:
        ended = f"{FAILED_FOR}{line_of(core.broken, out)}"
    result = replace(core.result(), ended=ended)
    extra: dict[str, Any] = {
        "rounds_s": server.rounds_s,
        "joined_s": server.joined_s,
        "begun_unix_s": server.begun_unix_s,
    }
    transport = {}
    if isinstance(core, PacedCore) and server.punctuality is not None:
        extra["real_time"] = {**server.punctuality.as_dict(), "robots": core.summary()}
        transport = {"transport": report(core.traffic)}
    if recorder is not None and out is not None and not server.has_begun:
        discard(recorder, out)
    elif recorder is not None and out is not None:
        try:
            with contextlib.closing(recorder):
                write_summary(out, core.arena.scenario, result, core.run, extra | transport)
        except RecordingStopped as error:
            if not ended.startswith(FAILED_FOR):
                result = replace(result, ended=f"{FAILED_FOR}{error}")
    server.report({"result": asdict(result) | extra})
    if result.ended.startswith(FAILED_FOR):
        say_error(f"world: {result.ended.removeprefix(FAILED_FOR)}")
        return 1
    if not server.terms.parent:
        how = "captured" if result.captured else "not captured"
        kept = f", recorded in {out}" if out else ""
        say_error(f"world: {how} at tick {result.ticks}, digest {result.digest}{kept}")
    return 0
