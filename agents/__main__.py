"""``python -m encircle.agents ID ... --connect ENDPOINT --run RUN``: robots, as one process."""

import sys

if __name__ == "__main__":
    if not sys.flags.safe_path:
        # The working directory may hold a person's own modules.
        del sys.path[0]
    # Before all that takes time to import.
    from encircle.protocol.process.interrupts import exit_on_signal

    exit_on_signal("robot")

import asyncio
from collections.abc import Sequence
from pathlib import Path

from encircle.protocol.process.deferred_imports import UNUSED, lazy
from encircle.protocol.process.interrupts import exit_process
from encircle.protocol.process.log import say_error
from encircle.protocol.programs.option_values import name_of, seconds
from encircle.protocol.programs.options import Options, endpoints_of
from encircle.protocol.zenoh.endpoints import ConfigurationError


def main(arguments: Sequence[str] | None = None, program: str = "python -m encircle.agents") -> int:
    """Parse the command line and run the robots; returns the exit status."""
    options = Options(program, "Run one robot, or several in one process.")
    options.add_names(
        "id",
        "the robot's id, as in r1; of several, each",
        read=name_of("robot"),
        variable="ENCIRCLE_ROBOT",
    )
    options.add("--run", "name of the run to join", read=name_of("run"), required=True)
    options.add_endpoints()
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
        "keep the traceback of a policy that fails in this directory; a temporary file if left out",
        read=Path,
        metavar="DIR",
    )
    options.add_flag("--stay", "join run after run of that name")
    options.add_flag("--quiet", "say only what goes wrong")
    settings = options.parse(arguments)
    # Imported late: a mistyped command need not wait for scipy.
    with lazy(*UNUSED):
        from encircle.agents.process.robot import run_robots
        from encircle.agents.process.robot_life import JOIN_S_MAX, WORLD_S_MAX, RobotOptions
        from encircle.protocol.zenoh.configuration import warning

    join_s_max = settings.join_timeout or JOIN_S_MAX
    robots = settings.id
    try:
        if len(robots) > 1 and settings.certificates:
            raise ConfigurationError(
                f"certificates = {settings.certificates}: a certificate is one robot's;"
                f" start {', '.join(robots)} each in a process of its own"
            )
        endpoints = endpoints_of(settings, join_s_max, name=robots[0])
        notice = warning(endpoints)
    except ConfigurationError as error:
        options.error(str(error))
    if notice is not None:
        say_error(f"robot {', '.join(robots)}: {notice}")
    world_s_max = settings.world_timeout or WORLD_S_MAX
    robot_options = RobotOptions(
        join_s_max, world_s_max, settings.stay, settings.quiet, settings.tracebacks
    )
    return asyncio.run(run_robots(robots, settings.run, endpoints, robot_options))


if __name__ == "__main__":
    exit_process(main())
