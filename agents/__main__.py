"""``python -m agents ID --connect ENDPOINT --run RUN``: one robot, as a process."""

import argparse
import asyncio
import sys
from collections.abc import Sequence

from agents.lean_start import postponed
from protocol.keys import check_name


def main(arguments: Sequence[str] | None = None) -> int:
    """Parse the command line and run the robot; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m agents", description="Run one robot.")
    parser.add_argument("id", help="the robot's id, as in r1")
    parser.add_argument("--connect", required=True, metavar="ENDPOINT", help="tcp/127.0.0.1:7447")
    parser.add_argument("--run", required=True, help="name of the run to join")
    parser.add_argument("--join-timeout", type=float, default=30.0, metavar="S")
    parser.add_argument("--stay", action="store_true", help="join run after run of that name")
    options = parser.parse_args(arguments)
    try:
        check_name("robot", options.id)
        check_name("run", options.run)
    except ValueError as error:
        parser.error(str(error))
    # Imported late: a mistyped command need not wait for scipy.
    with postponed("scipy.stats", "scipy.ndimage"):
        from agents.robot import run_robot

    life = run_robot(options.id, options.run, options.connect, options.join_timeout, options.stay)
    return asyncio.run(life)


if __name__ == "__main__":
    sys.exit(main())
