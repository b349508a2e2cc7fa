"""``encircle foxglove``: a hunt that is going on, for Foxglove to look on at."""

import threading
from argparse import Namespace
from collections.abc import Sequence
from typing import TYPE_CHECKING

from encircle.cli.watching import PORT_MAX, host_name
from encircle.extras import needing
from encircle.protocol.process.interrupts import signals_to
from encircle.protocol.process.log import say_error
from encircle.protocol.programs.option_values import name_of, seconds, whole_number_in
from encircle.protocol.programs.options import Options, endpoints_of

if TYPE_CHECKING:
    from encircle.exports.foxglove_server import FoxgloveServer
    from encircle.live.updates import Feed, Status

TAKE_S = 0.1
LAST_S = 1.0
"""So long the server goes on after the hunt, for what is on its way to clients."""


def main(arguments: Sequence[str], program: str) -> int:
    """Serve a running hunt until it is over, or until Ctrl-C; returns the exit status."""
    options = _options(program)
    settings = options.parse(arguments)
    if settings.listen:
        options.error(f"--listen {settings.listen[0]}: who looks on connects")
    if not (settings.connect or settings.zenoh_config):
        options.error(f"--run {settings.run}: where? Give --connect ENDPOINT")
    with needing("foxglove", "export"):
        from encircle.exports.foxglove_server import ServerFailed
    from encircle.live.over_zenoh import WAIT_S_MAX, NothingToSee, ZenohFeed
    from encircle.protocol.zenoh.endpoints import ConfigurationError, ConnectionFailed

    wait_s_max = settings.join_timeout or WAIT_S_MAX
    try:
        feed = ZenohFeed(endpoints_of(settings, wait_s_max), settings.run, wait_s_max=wait_s_max)
    except ConfigurationError as error:
        options.error(str(error))
    except (ConnectionFailed, NothingToSee) as error:
        say_error(f"encircle: {error}")
        return 1
    try:
        return _serve(feed, settings)
    except ServerFailed as error:
        say_error(f"encircle: {error}")
        return 1
    finally:
        feed.close()


def _serve(feed: "Feed", settings: Namespace) -> int:
    from encircle.exports.foxglove_server import LOOPBACK, PORT, FoxgloveServer

    stop = threading.Event()

    def interrupt(name: str) -> None:
        say_error(f"encircle: stopped by {name}")
        stop.set()

    port = PORT if settings.port is None else settings.port
    server = FoxgloveServer(feed.stage, settings.host or LOOPBACK, port)
    try:
        with signals_to(interrupt):
            say_error(
                f"encircle: run {settings.run} is at {server.address}:"
                " in Foxglove, open connection, Foxglove WebSocket"
            )
            status = _follow(feed, server, stop)
    finally:
        server.stop()
    if not status.complete:
        say_error(f"encircle: run {settings.run}: {status.text}")
    return 0


def _follow(feed: "Feed", server: "FoxgloveServer", stop: threading.Event) -> "Status":
    from encircle.live.updates import RunState

    while True:
        update = feed.take(TAKE_S)
        server.take(update.frames)
        if update.status.state is RunState.ENDED or stop.is_set():
            if server.subscriptions:
                stop.wait(LAST_S)
            return update.status


def _options(program: str) -> Options:
    options = Options(
        program,
        "Serve a hunt that is going on to Foxglove and what speaks its WebSocket protocol.",
        environment=False,
    )
    options.add_endpoints()
    options.add(
        "--run", "name of the run to look on at", read=name_of("run"), metavar="NAME", required=True
    )
    options.add(
        "--join-timeout", "wait this long for the run's world, in s", read=seconds, metavar="S"
    )
    options.add(
        "--port",
        "serve at this port, 0 for any that is free; 8765 if left out",
        read=whole_number_in(0, PORT_MAX),
        metavar="N",
    )
    options.add(
        "--host",
        "serve at this address; 127.0.0.1, which only this machine reaches, if left out",
        read=host_name,
        metavar="ADDRESS",
    )
    return options
