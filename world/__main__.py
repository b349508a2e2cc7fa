"""``python -m world SCENARIO --listen ENDPOINT --run RUN``: the world, as a process."""

import argparse
import asyncio
import sys
from collections.abc import Sequence
from pathlib import Path

from protocol.keys import check_name


def main(arguments: Sequence[str] | None = None) -> int:
    """Parse the command line and run the world; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m world", description="Run the world.")
    parser.add_argument("scenario", help="a shipped scenario's name or a TOML file")
    parser.add_argument("--listen", required=True, metavar="ENDPOINT", help="tcp/127.0.0.1:7447")
    parser.add_argument("--run", required=True, help="name of the run")
    parser.add_argument("--seed", type=int, help="instead of the scenario's own")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument("--out", type=Path, help="directory for recording and summary")
    parser.add_argument("--join-timeout", type=float, default=30.0, metavar="S")
    parser.add_argument("--parent", action="store_true", help="end when standard input is closed")
    options = parser.parse_args(arguments)
    try:
        check_name("run", options.run)
    except ValueError as error:
        parser.error(str(error))
    # Imported late: a mistyped command need not wait for scipy.
    from protocol.log import bounded_log
    from world.engine import build
    from world.scenario import ScenarioError, load
    from world.server import run_world

    try:
        overrides = options.set + ([f"seed={options.seed}"] if options.seed is not None else [])
        scenario = load(options.scenario, overrides)
        arena = build(scenario, scenario.seed)
        return asyncio.run(
            run_world(
                arena,
                options.run,
                options.listen,
                options.out,
                bounded_log(),
                options.join_timeout,
                options.parent,
            )
        )
    except ScenarioError as error:
        print(error, file=sys.stderr)
        return 2


if __name__ == "__main__":
    sys.exit(main())
