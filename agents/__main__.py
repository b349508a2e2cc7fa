"""``python -m encircle.agents ID --connect ENDPOINT --run RUN``: one robot, as a process."""

if __name__ == "__main__":
    # Before all that takes time to import.
    from encircle.protocol.process.interrupts import end_at_once

    end_at_once("robot")

import asyncio
from collections.abc import Sequence
from pathlib import Path

from encircle.agents.process.deferred_imports import postponed
from encircle.protocol.process.interrupts import leave
from encircle.protocol.process.log import say_error
from encircle.protocol.programs.options import Options, access, name_of, seconds
from encircle.protocol.zenoh.endpoints import AccessError


def main(arguments: Sequence[str] | None = None, program: str = "python -m encircle.agents") -> int:
    """Parse the command line and run the robot; returns the exit status."""
    options = Options(program, "Run one robot.")
    options.add(
        "id",
        "the robot's id, as in r1",
        read=name_of("robot"),
        variable="ENCIRCLE_ROBOT",
        required=True,
    )
    options.add("--run", "name of the run to join", read=name_of("run"), required=True)
    options.add_access()
    options.add(
        "--join-timeout",
        "wait this long for router and world, in s",
        read=seconds,
        metavar="S",
    )
    options.add(
        "--world-timeout",
        "wait this long for a world that is gone to come back, in s",
        read=seconds,
        metavar="S",
    )
    options.add(
        "--tracebacks",
        "keep the traceback of a strategy that fails in this directory; a temporary file if left"
        " out",
        read=Path,
        metavar="DIR",
    )
    options.add_flag("--stay", "join run after run of that name")
    options.add_flag("--quiet", "say only what goes wrong")
    found = options.parse(arguments)
    # Imported late: a mistyped command need not wait for scipy.
    with postponed("scipy.stats", "scipy.ndimage"):
        from encircle.agents.process.robot import JOIN_S_MAX, WORLD_S_MAX, Habits, run_robot
    from encircle.protocol.zenoh.configuration import warning

    join_s_max = found.join_timeout or JOIN_S_MAX
    try:
        where = access(found, join_s_max, name=found.id)
        said = warning(where)
    except AccessError as error:
        options.error(str(error))
    if said is not None:
        say_error(f"robot {found.id}: {said}")
    world_s_max = found.world_timeout or WORLD_S_MAX
    habits = Habits(join_s_max, world_s_max, found.stay, found.quiet, found.tracebacks)
    return asyncio.run(run_robot(found.id, found.run, where, habits))


if __name__ == "__main__":
    leave(main())
