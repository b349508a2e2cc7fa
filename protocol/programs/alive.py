"""``python -m encircle.protocol.programs.alive WHAT``: is it there.

The health check of containers and services. It asks over Zenoh, as the nodes of a run find each
other, not whether a process exists: a router
by connecting to it, the world or a robot of a run by its liveliness token. The settings are those
of the node itself, so that inside its container the check needs no arguments.
"""

import sys

if __name__ == "__main__":
    if not sys.flags.safe_path:
        # The working directory may hold a person's own modules.
        del sys.path[0]
    # Before all that takes time to import.
    from encircle.protocol.process.interrupts import exit_on_signal

    exit_on_signal("alive")

import argparse
from collections.abc import Sequence

from encircle.protocol.keys import robot_key, world_key
from encircle.protocol.process.interrupts import exit_process
from encircle.protocol.process.log import say
from encircle.protocol.programs.option_values import name_of, one_of, seconds
from encircle.protocol.programs.options import Options, identity
from encircle.protocol.zenoh.endpoints import (
    ConfigurationError,
    ConnectionFailed,
    Endpoints,
    Identity,
    loopback_endpoint,
)
from encircle.protocol.zenoh.liveliness import is_alive
from encircle.protocol.zenoh.session import closing, has_neighbours, open_session

NODE_KINDS = ("router", "world", "robot")
CHECK_S_MAX = 3.0


def main(
    arguments: Sequence[str] | None = None,
    program: str = "python -m encircle.protocol.programs.alive",
) -> int:
    """Look once; returns 0 if it is there, 1 if not, with a line that says so."""
    options = Options(program, "Say whether a router, the world or a robot of a run is there.")
    options.add(
        "what",
        f"one of {', '.join(NODE_KINDS)}",
        read=one_of(NODE_KINDS),
        metavar="WHAT",
        required=True,
    )
    options.add_endpoints()
    options.add("--run", "name of the run", read=name_of("run"))
    options.add("--robot", "the robot's id", read=name_of("robot"), metavar="ID")
    options.add(
        "--check-timeout",
        f"wait this long, in s; {CHECK_S_MAX:g} if left out",
        read=seconds,
        default=CHECK_S_MAX,
        metavar="S",
    )
    settings = options.parse(arguments)
    if settings.what != "router" and settings.run is None:
        options.error("--run is missing: give it, or set ENCIRCLE_RUN")
    if settings.what == "robot" and settings.robot is None:
        options.error("--robot is missing: give it, or set ENCIRCLE_ROBOT")
    connect = settings.connect or [loopback_endpoint(endpoint) for endpoint in settings.listen]
    try:
        endpoints = Endpoints(
            (),
            tuple(connect),
            "client",
            settings.zenoh_config,
            connect_s_max=settings.check_timeout,
            identity=_identity(settings),
        )
        there = is_visible(endpoints, settings)
    except ConfigurationError as error:
        options.error(str(error))
    except ConnectionFailed as error:
        say(f"alive: {error}")
        return 1
    name = {
        "robot": f"robot {settings.robot} of run {settings.run}",
        "world": f"world of run {settings.run}",
    }
    verdict = "there" if there else "not there"
    say(f"alive: {name.get(settings.what, 'router')} at {endpoints}: {verdict}")
    return 0 if there else 1


def is_visible(endpoints: Endpoints, settings: argparse.Namespace) -> bool:
    """Whether the node that is asked for can be seen from a session there."""
    with closing(open_session(endpoints)) as session:
        if settings.what == "router":
            return has_neighbours(session)
        world = settings.what == "world"
        key = (
            world_key(settings.run, "alive")
            if world
            else robot_key(settings.run, settings.robot, "alive")
        )
        return is_alive(session, key, settings.check_timeout)


def _identity(settings: argparse.Namespace) -> Identity | None:
    """Inside a node's container it is the node itself that asks, elsewhere a viewer."""
    node = settings.robot if settings.what == "robot" else settings.what
    own = settings.certificates is not None and (settings.certificates / f"{node}.key").exists()
    return identity(settings.certificates, node if own else None)


if __name__ == "__main__":
    exit_process(main())
