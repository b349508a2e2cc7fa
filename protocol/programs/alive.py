"""``python -m encircle.protocol.programs.alive WHAT``: is it there.

The health check of containers and services. It asks over Zenoh, as the parties of a run find each
other, not whether a process exists: a router
by connecting to it, the world or a robot of a run by its liveliness token. The settings are those
of the party itself, so that inside its container the check needs no arguments.
"""

if __name__ == "__main__":
    # Before all that takes time to import.
    from encircle.protocol.process.interrupts import end_at_once

    end_at_once("alive")

import argparse
from collections.abc import Sequence

from encircle.protocol.keys import robot_key, world_key
from encircle.protocol.process.interrupts import leave
from encircle.protocol.process.log import say
from encircle.protocol.programs.options import Options, identity, name_of, seconds
from encircle.protocol.zenoh.connection import closing, has_neighbours, is_alive, open_session
from encircle.protocol.zenoh.endpoints import Access, AccessError, Identity, LinkError, here

PARTIES = ("router", "world", "robot")
CHECK_S_MAX = 3.0


def main(
    arguments: Sequence[str] | None = None,
    program: str = "python -m encircle.protocol.programs.alive",
) -> int:
    """Look once; returns 0 if it is there, 1 if not, with a line that says so."""
    options = Options(program, "Say whether a router, the world or a robot of a run is there.")
    options.add("what", f"one of {', '.join(PARTIES)}", read=_party, metavar="WHAT", required=True)
    options.add_access()
    options.add("--run", "name of the run", read=name_of("run"))
    options.add("--robot", "the robot's id", read=name_of("robot"), metavar="ID")
    options.add(
        "--check-timeout",
        f"wait this long, in s; {CHECK_S_MAX:g} if left out",
        read=seconds,
        default=CHECK_S_MAX,
        metavar="S",
    )
    found = options.parse(arguments)
    if found.what != "router" and found.run is None:
        options.error("--run is missing: give it, or set ENCIRCLE_RUN")
    if found.what == "robot" and found.robot is None:
        options.error("--robot is missing: give it, or set ENCIRCLE_ROBOT")
    connect = found.connect or [here(endpoint) for endpoint in found.listen]
    try:
        where = Access(
            (),
            tuple(connect),
            "client",
            found.zenoh_config,
            connect_s_max=found.check_timeout,
            identity=_identity(found),
        )
        there = look(where, found)
    except AccessError as error:
        options.error(str(error))
    except LinkError as error:
        say(f"alive: {error}")
        return 1
    name = {
        "robot": f"robot {found.robot} of run {found.run}",
        "world": f"world of run {found.run}",
    }
    say(f"alive: {name.get(found.what, 'router')} at {where}: {'there' if there else 'not there'}")
    return 0 if there else 1


def look(where: Access, found: argparse.Namespace) -> bool:
    """Whether the party that is asked for can be seen from a session there."""
    with closing(open_session(where)) as session:
        if found.what == "router":
            return has_neighbours(session)
        world = found.what == "world"
        key = world_key(found.run, "alive") if world else robot_key(found.run, found.robot, "alive")
        return is_alive(session, key, found.check_timeout)


def _identity(found: argparse.Namespace) -> Identity | None:
    """Inside a party's container it is the party itself that asks, elsewhere an onlooker."""
    party = found.robot if found.what == "robot" else found.what
    own = found.certificates is not None and (found.certificates / f"{party}.key").exists()
    return identity(found.certificates, party if own else None)


def _party(value: str) -> str:
    if value not in PARTIES:
        raise argparse.ArgumentTypeError(f"{value!r} is not one of {', '.join(PARTIES)}")
    return value


if __name__ == "__main__":
    leave(main())
