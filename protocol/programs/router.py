"""``python -m encircle.protocol.programs.router --listen ENDPOINT``: a Zenoh router, as a process.

World and robots on many hosts need only reach the router, not each other. Any Zenoh router does;
this one is the library that is installed anyway, in router mode, without plugins.
"""

import sys

if __name__ == "__main__":
    if not sys.flags.safe_path:
        # The working directory may hold a person's own modules.
        del sys.path[0]
    # Before all that takes time to import.
    from encircle.protocol.process.interrupts import exit_on_signal

    exit_on_signal("router")

import contextlib
import queue
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from encircle.protocol.errors import UnknownKey
from encircle.protocol.keys import parse_key, robot_key, world_key
from encircle.protocol.mailbox import now_us
from encircle.protocol.process.interrupts import exit_process, signals_to
from encircle.protocol.process.log import say_error
from encircle.protocol.programs.option_values import name_of
from encircle.protocol.programs.options import Options, endpoints_of
from encircle.protocol.zenoh.access_control import ROUTER
from encircle.protocol.zenoh.configuration import warning
from encircle.protocol.zenoh.endpoints import CONNECT_S_MAX, ConfigurationError, ConnectionFailed
from encircle.protocol.zenoh.liveliness import subscribe_alive
from encircle.protocol.zenoh.node_info import ROUTER_KEY, info_replier
from encircle.protocol.zenoh.queries import serve_queries
from encircle.protocol.zenoh.refusals import report_refusals
from encircle.protocol.zenoh.session import closing, open_session

END_S_MAX = 5.0
STEP_S = 0.5

Changes = queue.SimpleQueue[tuple[str, bool] | str]
"""Tokens that come and go, and the name of a signal, which ends it."""


class Tokens:
    """What the liveliness tokens of a run say of it."""

    def __init__(self) -> None:
        self.alive: set[str] = set()
        self.world_gone_s: float | None = None

    def change(self, key: str, alive: bool, now_s: float) -> None:
        """A token has come or gone; ``UnknownKey`` for one that is not of the protocol."""
        robot = parse_key(key).robot
        (self.alive.add if alive else self.alive.discard)(key)
        if robot is None:
            self.world_gone_s = None if alive else now_s

    def over(self, now_s: float) -> bool:
        """Whether the world has come and gone, and its robots too, or ``END_S_MAX`` to do so."""
        gone = self.world_gone_s
        return gone is not None and (not self.alive or now_s - gone > END_S_MAX)


def main(
    arguments: Sequence[str] | None = None,
    program: str = "python -m encircle.protocol.programs.router",
) -> int:
    """Route until SIGTERM or SIGINT, or for one run; returns the exit status.

    That is how a router ends: with status 0, unless it was still opening its endpoints.
    """
    options = Options(program, "Route the messages of any number of runs.")
    options.add_endpoints()
    options.add_flag("--direct-radio", "with certificates: let robots hear each other's poses")
    options.add_flag("--count-refusals", "say at the end what certificates kept out; costs time")
    options.add("--for-run", "end by itself after this run", read=name_of("run"), metavar="RUN")
    settings = options.parse(arguments)
    changes: Changes = queue.SimpleQueue()
    try:
        where = endpoints_of(settings, CONNECT_S_MAX, "router", ROUTER)
        where = replace(where, direct_radio=settings.direct_radio)
        notice = warning(where)
        with (
            report_refusals("router", settings.count_refusals),
            closing(open_session(where)) as session,
            signals_to(changes.put),
        ):
            # A run may come and go as soon as there is a line that it waits for.
            _kept = _watch(session, settings.for_run, changes)
            _kept += [serve_queries(session, ROUTER_KEY, info_replier("router", now_us))]
            of = "" if where.listen else "the endpoints of "
            say_error(f"router: {notice or f'listening on {of}{where}'}")
            _route(changes)
    except ConfigurationError as error:
        options.error(str(error))
    except ConnectionFailed as error:
        say_error(f"router: {error}")
        return 1
    return 0


def _watch(session: Any, run: str | None, changes: Changes) -> list[Any]:
    """Have the tokens of a run told to ``changes`` as long as what is returned is kept."""
    expressions = (world_key(run, "alive"), robot_key(run, "*", "alive")) if run else ()
    return [
        subscribe_alive(session, expression, lambda key, alive: changes.put((key, alive)))
        for expression in expressions
    ]


def _route(changes: Changes) -> None:
    """Zenoh does the routing on threads of its own; this waits for the end."""
    tokens = Tokens()
    while not tokens.over(time.monotonic()):
        with contextlib.suppress(queue.Empty):
            change = changes.get(timeout=STEP_S)
            if isinstance(change, str):
                say_error(f"router: stopped by {change}")
                return
            with contextlib.suppress(UnknownKey):
                tokens.change(*change, time.monotonic())


if __name__ == "__main__":
    exit_process(main())
