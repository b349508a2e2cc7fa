"""``encircle watch``: the page of a recording, or of a hunt that runs on any host."""

import threading
from argparse import Namespace
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from encircle.cli.reading import read_or_tell
from encircle.cli.watching import add_show_options, show_options
from encircle.protocol.process.interrupts import signals_to
from encircle.protocol.process.log import say_error
from encircle.protocol.programs.option_values import name_of, seconds
from encircle.protocol.programs.options import Options, endpoints_of

if TYPE_CHECKING:
    from encircle.viewer.showing import ShowOptions

Stopped = Callable[[], bool]


def main(arguments: Sequence[str], program: str) -> int:
    """Show a recording or a running hunt until Ctrl-C; returns the exit status.

    Ctrl-C is how it ends, with status 0, unless there was nothing to show yet.
    """
    options = _options(program)
    settings = options.parse(arguments)
    _check(settings, options)
    shown = show_options(settings, "watch")
    stop = threading.Event()

    def interrupt(name: str) -> None:
        if not stop.is_set():
            say_error(f"encircle: stopped by {name}")
        stop.set()

    if settings.run_directory is not None:
        return _watch_recording(settings.run_directory, shown, interrupt, stop.is_set)
    return _watch_run(settings, options, shown, interrupt, stop.is_set)


def _watch_recording(
    run: Path, shown: "ShowOptions", interrupt: Callable[[str], None], stopped: Stopped
) -> int:
    from encircle.scene.stage import stage_of
    from encircle.viewer.showing import Show

    recording = read_or_tell(run)
    show = Show(stage_of(recording.scenario, recording.seed, recording.run), shown)
    with signals_to(interrupt):
        try:
            show.start()
            show.recording(recording, stopped)
            show.stay(stopped, awaits_page=True)
        finally:
            show.stop()
    return 0


def _watch_run(
    settings: Namespace,
    options: Options,
    shown: "ShowOptions",
    interrupt: Callable[[str], None],
    stopped: Stopped,
) -> int:
    from encircle.live.over_zenoh import WAIT_S_MAX, NothingToSee, ZenohFeed
    from encircle.protocol.zenoh.endpoints import ConfigurationError, ConnectionFailed
    from encircle.viewer.showing import Show

    wait_s_max = settings.join_timeout or WAIT_S_MAX
    try:
        where = endpoints_of(settings, wait_s_max)
        feed = ZenohFeed(where, settings.run, wait_s_max=wait_s_max)
    except ConfigurationError as error:
        options.error(str(error))
    except (ConnectionFailed, NothingToSee) as error:
        say_error(f"encircle: {error}")
        return 1
    with signals_to(interrupt):
        try:
            show = Show(feed.stage, shown)
            try:
                show.start()
                status = show.feed(feed, stopped)
                if not status.complete:
                    say_error(f"encircle: run {settings.run}: {status.text}")
                show.stay(stopped)
            finally:
                show.stop()
        finally:
            feed.close()
    return 0


def _check(settings: Namespace, options: Options) -> None:
    """See to it that one hunt is asked for."""
    where = settings.connect or settings.zenoh_config
    if settings.run_directory is None:
        if not where:
            options.error("give a recorded RUN, or --connect ENDPOINT and --run NAME")
        if settings.run is None:
            options.error("--run is missing: the name of the run to look on at")
        if settings.listen:
            options.error(f"--listen {settings.listen[0]}: who looks on connects")
    elif where or settings.run or settings.listen:
        options.error(
            f"{settings.run_directory} is a recording: --connect, --listen and --run do not go"
            " with it"
        )
    elif not settings.run_directory.exists():
        # Imported late: whoever names a recording need not wait for scenarios.
        from encircle.world.loading.files import shipped

        if str(settings.run_directory) in shipped():
            options.error(
                f"{settings.run_directory} is a scenario, not a recording:"
                f" encircle run {settings.run_directory} --watch"
            )


def _options(program: str) -> Options:
    options = Options(
        program,
        "Show a hunt on a page in the browser: a recording, or a hunt that is going on.",
        environment=False,
    )
    options.add(
        "run_directory", "a recorded run's directory or recording", read=Path, metavar="RUN"
    )
    options.add_endpoints()
    options.add("--run", "name of the run to look on at", read=name_of("run"), metavar="NAME")
    options.add(
        "--join-timeout", "wait this long for the run's world, in s", read=seconds, metavar="S"
    )
    add_show_options(options)
    return options
