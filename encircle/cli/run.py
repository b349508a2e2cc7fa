"""The options of ``encircle run``."""

from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from encircle.cli.painter import Painter
from encircle.cli.watching import (
    add_show_options,
    add_start_option,
    given_show_options,
    show_options,
)
from encircle.protocol.process.deferred_imports import UNUSED, lazy
from encircle.protocol.programs.option_values import (
    one_of,
    pace,
    seconds,
    whole_number,
    whole_number_in,
)
from encircle.protocol.programs.options import Options, variable_of
from encircle.runner.links import LINKS
from encircle.world.coordinator.result import GO_ON, WHEN_LOST

if TYPE_CHECKING:
    from encircle.viewer.showing import ShowOptions


def main(arguments: Sequence[str], program: str) -> int:
    """Run one hunt, record it and draw it; returns the exit status."""
    options = _options(program)
    settings = options.parse(arguments)
    own = (settings.scenario, settings.seed, settings.set, settings.out)
    if settings.resume is None and settings.scenario is None:
        options.error("give a scenario, or --resume RUN")
    if settings.resume is not None and own != (None, None, [], None):
        options.error(
            "--resume goes with neither a scenario nor --seed, --set or --out: the run has its own"
        )
    if not settings.watch and (given := given_show_options(settings)):
        options.error(f"{given[0]} goes with --watch")
    show = None
    if settings.watch:
        # Before anything is started: what is missing is told at once.
        show = show_options(settings, "run --watch")
    painter = None
    if settings.link == "zenoh":
        from encircle.runner.nodes import fork_server

        # What the nodes need is imported there while this process imports what it needs itself.
        fork_server()
    else:
        painter = Painter()
    try:
        _hunt(settings, painter, show)
    finally:
        if painter is not None:
            painter.close()
    return 0


def _hunt(settings: Namespace, painter: Painter | None, show: "ShowOptions | None") -> None:
    # Imported late: a mistyped command need not wait for the display.
    with lazy(*UNUSED):
        from encircle.cli.hunting import HuntRequest, hunt_and_draw
    from encircle.runner.launch import TIMEOUTS, Timeouts

    seed = [] if settings.seed is None else [f"seed={settings.seed}"]
    timeouts = Timeouts(
        settings.join_timeout or TIMEOUTS.join_s_max,
        settings.answer_timeout or TIMEOUTS.answer_s_max,
    )
    request = HuntRequest(
        settings.scenario or "",
        [*settings.set, *seed],
        settings.out,
        settings.resume,
        settings.link,
        settings.when_lost,
        timeouts,
        settings.pace,
        show,
        settings.robots_per_process,
    )
    if painter is None:
        hunt_and_draw(request, settings.json)
    else:
        hunt_and_draw(request, settings.json, painter.draw)


def _options(program: str) -> Options:
    options = Options(program, "Run one hunt, record it and draw it.", environment=False)
    options.add("scenario", "a shipped scenario's name or a TOML file", metavar="SCENARIO")
    options.add("--seed", "a seed instead of the scenario's own", read=whole_number, metavar="N")
    options.add(
        "--link",
        "zenoh (a process per robot) or memory; zenoh if left out",
        read=one_of(LINKS),
        default="zenoh",
    )
    options.add_list("--set", "change a key of the scenario; may be repeated", metavar="KEY=VALUE")
    options.add("--out", "directory to record to, new or empty", read=Path, metavar="DIR")
    options.add(
        "--when-lost",
        "what a lost robot process means: go-on without it, or end; go-on if left out",
        read=one_of(WHEN_LOST),
        default=GO_ON,
        metavar="WHAT",
    )
    for name, text in (
        ("--join-timeout", "wait this long for the processes to start, in s"),
        ("--answer-timeout", "wait this long for a robot's answer, in s"),
    ):
        # By the same name and variable as of single nodes.
        options.add(name, text, read=seconds, variable=variable_of(name), metavar="S")
    options.add("--resume", "go on with a run that broke off", read=Path, metavar="RUN")
    options.add(
        "--robots-per-process",
        "over Zenoh, so many robots share a process; 1 if left out",
        read=whole_number_in(1),
        default=1,
        metavar="K",
    )
    options.add_flag("--json", "print one JSON object")
    options.add(
        "--pace",
        "let ticks go by this many times faster than real time at most; 1 with --watch, as fast as"
        " they can without",
        read=pace,
        metavar="X",
    )
    options.add_flag("--watch", "show the hunt on a page in the browser while it goes on")
    add_show_options(options)
    add_start_option(options)
    return options
