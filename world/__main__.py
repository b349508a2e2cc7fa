"""``python -m world SCENARIO --listen ENDPOINT --run RUN``: the world, as a process."""

import asyncio
import sys
from collections.abc import Sequence
from pathlib import Path

from protocol.access import CONNECT_S_MAX, AccessError
from protocol.options import Options, access, name_of, seconds, whole_number


def main(arguments: Sequence[str] | None = None, program: str = "python -m world") -> int:
    """Parse the command line and run the world; returns the exit status."""
    options = _options(program)
    found = options.parse(arguments)
    if found.out is not None and found.runs is not None:
        options.error(f"--out {found.out} and --runs {found.runs}: give one of them")
    # Imported late: a mistyped command need not wait for scipy.
    from protocol.log import bounded_log
    from protocol.zenoh_link import warning
    from world.engine import build
    from world.run_directory import RunDirectoryError, new_directory
    from world.scenario import ScenarioError, load
    from world.server import ANSWER_S_MAX, JOIN_S_MAX, run_world

    try:
        where = access(found, CONNECT_S_MAX)
        said = warning(where)
        overrides = found.set + ([f"seed={found.seed}"] if found.seed is not None else [])
        scenario = load(found.scenario, overrides)
        arena = build(scenario, scenario.seed)
        if found.runs is not None:
            found.out = new_directory(found.runs, found.scenario, scenario.seed)
        if said is not None:
            print(f"world: {said}", file=sys.stderr, flush=True)
        return asyncio.run(
            run_world(
                arena,
                found.run,
                where,
                found.out,
                bounded_log(),
                found.join_timeout or JOIN_S_MAX,
                found.parent,
                found.answer_timeout or ANSWER_S_MAX,
            )
        )
    except AccessError as error:
        options.error(str(error))
    except (ScenarioError, RunDirectoryError) as error:
        print(error, file=sys.stderr)
        return 2


def _options(program: str) -> Options:
    options = Options(program, "Run the world, and wait for its robots.")
    options.add("scenario", "a shipped scenario's name or a TOML file", required=True)
    options.add("--run", "name of the run", read=name_of("run"), required=True)
    options.add_access()
    options.add("--seed", "a seed instead of the scenario's own", read=whole_number, metavar="N")
    options.add_list(
        "--set",
        "change a key of the scenario; may be repeated",
        metavar="KEY=VALUE",
        separators=r";\n",
        joins=True,
    )
    options.add("--out", "record into this directory, new or empty", read=Path, metavar="DIR")
    options.add(
        "--runs", "record into a new directory of its own in this one", read=Path, metavar="DIR"
    )
    options.add(
        "--join-timeout",
        "wait this long for the robots, in s",
        read=seconds,
        metavar="S",
    )
    options.add(
        "--answer-timeout",
        "wait this long for a robot's answer, in s; longer than the network may be cut off",
        read=seconds,
        metavar="S",
    )
    options.add_flag("--parent", "end when standard input is closed")
    return options


if __name__ == "__main__":
    sys.exit(main())
