"""``python -m encircle.world SCENARIO --listen ENDPOINT --run RUN``: the world, as a process.

``python -m encircle.world --resume DIR --listen ENDPOINT`` goes on with the run that is recorded
there.
"""

import sys

if __name__ == "__main__":
    if not sys.flags.safe_path:
        # The working directory may hold a person's own modules.
        del sys.path[0]
    # Before all that takes time to import.
    from encircle.protocol.process.interrupts import exit_on_signal

    exit_on_signal("world")

import argparse
import asyncio
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from encircle.protocol.process.deferred_imports import UNUSED, lazy
from encircle.protocol.process.interrupts import exit_process
from encircle.protocol.process.log import say_error
from encircle.protocol.programs.option_values import name_of, one_of, pace, seconds, whole_number
from encircle.protocol.programs.options import Options, endpoints_of
from encircle.protocol.zenoh.access_control import WORLD
from encircle.protocol.zenoh.endpoints import CONNECT_S_MAX, ConfigurationError

if TYPE_CHECKING:
    from encircle.world.process.reports import Reporter

TAKEN_BYTES_MAX = 64 * 1024
"""Poses and commands are shorter; what is longer than this does not even come in."""


def main(arguments: Sequence[str] | None = None, program: str = "python -m encircle.world") -> int:
    """Parse the command line and run the world; returns the exit status."""
    options = _options(program)
    settings = options.parse(arguments)
    _check(options, settings)
    # Imported late: a mistyped command need not wait for them.
    from encircle.protocol.zenoh.refusals import report_refusals
    from encircle.world.process.reports import ConsoleReporter, json_reports

    # Refusals are read where standard output leads, so reports must know where it is meanwhile.
    with (
        report_refusals("world", settings.count_refusals),
        json_reports() if settings.json else nullcontext(ConsoleReporter()) as report,
    ):
        return _run(options, settings, report)


def _run(options: Options, settings: argparse.Namespace, report: "Reporter") -> int:
    # Imported late, as scipy takes long.
    with lazy(*UNUSED):
        from encircle.protocol.process.log import bounded_log
        from encircle.protocol.zenoh.configuration import warning
        from encircle.world.arena.engine import build
        from encircle.world.loading.load import load
        from encircle.world.loading.remarks import remarks_on
        from encircle.world.process.running import run_world
        from encircle.world.process.server import ANSWER_S_MAX, JOIN_S_MAX, WorldOptions
        from encircle.world.recording.resuming import read_last, rebuild
        from encircle.world.recording.run_directory import RunDirectoryError, new_directory
        from encircle.world.scenario.errors import ScenarioError

    try:
        where = endpoints_of(settings, CONNECT_S_MAX, name=WORLD)
        notice = warning(where)
        overrides = settings.set + ([f"seed={settings.seed}"] if settings.seed is not None else [])
        log, resumed = bounded_log(), None
        if settings.resume is None:
            scenario = load(settings.scenario, overrides)
        else:
            recording = read_last(settings.resume)
            if settings.run not in (None, recording.run):
                options.error(
                    f"--run {settings.run}: the run in {settings.resume} is {recording.run}"
                )
            resumed = rebuild(recording, log)
            scenario, settings.run, settings.out = (
                recording.scenario_as_written,
                recording.run,
                settings.resume,
            )
        where = replace(where, direct_radio=scenario.is_direct, message_bytes_max=TAKEN_BYTES_MAX)
        if settings.pace is not None and scenario.clock == "wall":
            options.error(f"--pace {settings.pace:g}: clock = 'wall' has a pace of its own")
        arena = build(scenario, scenario.seed)
        if resumed is None and settings.runs is not None:
            settings.out = new_directory(settings.runs, settings.scenario, scenario.seed)
        world_options = WorldOptions(
            settings.join_timeout or JOIN_S_MAX,
            settings.answer_timeout or ANSWER_S_MAX,
            settings.when_lost,
            settings.parent,
            settings.control,
            settings.pace,
        )
        # A program that starts this world has shown them to its user already.
        remarks = [] if settings.parent else remarks_on(scenario)
        for line in [*([notice] if notice is not None else []), *remarks]:
            say_error(f"world: {line}")
        life = run_world(
            arena, settings.run, where, settings.out, log, world_options, report, resumed
        )
        return asyncio.run(life)
    except ConfigurationError as error:
        options.error(str(error))
    except (ScenarioError, RunDirectoryError) as error:
        say_error(*f"world: {error}".split("\n"))
        return 2


def _check(options: Options, settings: argparse.Namespace) -> None:
    """See to it that one run is asked for."""
    if settings.control and not settings.parent:
        options.error("--control: goes with --parent")
    if settings.resume is not None:
        return
    for name in ("scenario", "run"):
        if getattr(settings, name) is None:
            option = name if name == "scenario" else f"--{name}"
            options.error(f"{option} is missing: give it, or set ENCIRCLE_{name.upper()}")
    if settings.out is not None and settings.runs is not None:
        options.error(f"--out {settings.out} and --runs {settings.runs}: give one of them")


def _when_lost(value: str) -> str:
    # Imported late: who does not give the option need not wait for it.
    from encircle.world.coordinator.result import WHEN_LOST

    return one_of(WHEN_LOST)(value)


def _options(program: str) -> Options:
    options = Options(program, "Run the world, and wait for its robots.")
    options.add("scenario", "a shipped scenario's name or a TOML file")
    options.add("--run", "name of the run", read=name_of("run"))
    options.add(
        "--resume",
        "go on with the run recorded in this directory; scenario, --seed, --set, --out and --runs"
        " do not count then",
        read=Path,
        metavar="DIR",
    )
    options.add_endpoints()
    options.add("--seed", "a seed instead of the scenario's own", read=whole_number, metavar="N")
    options.add_list(
        "--set",
        "change a key of the scenario; may be repeated",
        metavar="KEY=VALUE",
        separators=r";\n",
        joins=True,
    )
    options.add("--out", "record into this directory, new or empty", read=Path, metavar="DIR")
    options.add(
        "--runs", "record into a new directory of its own in this one", read=Path, metavar="DIR"
    )
    options.add(
        "--join-timeout",
        "wait this long for the robots, in s",
        read=seconds,
        metavar="S",
    )
    options.add(
        "--answer-timeout",
        "wait this long for a robot's answer, in s; longer than the network may be cut off",
        read=seconds,
        metavar="S",
    )
    options.add(
        "--when-lost",
        "when a robot is lost: go-on without it until it is back, or end; go-on if left out",
        read=_when_lost,
        default="go-on",
        metavar="WHAT",
    )
    options.add(
        "--pace",
        "in lock-step: let ticks go by this many times faster than real time at most",
        read=pace,
        metavar="X",
    )
    options.add_flag(
        "--count-refusals", "if it listens: say at the end what certificates kept out; costs time"
    )
    options.add_flag("--json", "print what happens as JSON, one object a line, on standard output")
    options.add_flag("--parent", "end when standard input is closed")
    options.add_flag(
        "--control", "with --parent: take events from standard input, JSON objects, one a line"
    )
    return options


if __name__ == "__main__":
    exit_process(main())
