"""The command line: ``encircle COMMAND``. A command is imported when it is asked for.

What a command was asked for goes to standard output, everything else to standard error. Exit
status: 0 done, captured or not; 1 the run failed; 2 bad usage or configuration.
"""

import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from typing import NamedTuple

from encircle import laboratory
from encircle.protocol.errors import did_you_mean
from encircle.protocol.process.log import say, say_error


class Command(NamedTuple):
    """A function ``(arguments, program name) -> exit status``, and what it is for."""

    summary: str
    module: str
    function: str = "main"


COMMANDS = {
    "run": Command("Run one hunt, record it and draw it.", "encircle.cli.run"),
    "watch": Command("Show a hunt on a page: recorded or going on.", "encircle.cli.watch"),
    "scenarios": Command("List the shipped scenarios.", "encircle.cli.scenarios"),
    "replay": Command(
        "Read a recording back, and check it.", "encircle.cli.recordings", "replay_main"
    ),
    "export": Command("Write a recording in another format.", "encircle.cli.exporting"),
    "foxglove": Command("Serve a hunt that is going on to Foxglove.", "encircle.cli.foxglove_live"),
    "transport": Command(
        "Show what the network did to each link.", "encircle.cli.recordings", "transport_main"
    ),
    "trace": Command(
        "Write what the network did as a trace.", "encircle.cli.recordings", "trace_main"
    ),
    "reproduce": Command(
        "Run the paper's five simulations.", "encircle.cli.experiments", "reproduce_main"
    ),
    "study": Command("Run a study, or go on with one.", "encircle.cli.experiments", "study_main"),
    "benchmark": Command("Score a policy beside those shipped.", "encircle.benchmark.command"),
    "bundle": Command(
        "Pack a study into a file to verify.", "encircle.bundles.commands", "bundle_main"
    ),
    "verify": Command("Verify a study's bundle.", "encircle.bundles.commands", "verify_main"),
    "check-policy": Command("Examine a policy of one's own.", "encircle.conformance.check_policy"),
    "robot": Command("Run one robot as this process.", "encircle.agents.__main__"),
    "world": Command("Run the world as this process.", "encircle.world.__main__"),
    "router": Command(
        "Route between world and robots on many hosts.", "encircle.protocol.programs.router"
    ),
    "certificates": Command("Make certificates for a lab.", "encircle.cli.certificates"),
    "ros2": Command("Show a run to ROS 2, or let it steer a robot.", "encircle.cli.ros2"),
    "alive": Command("Say whether a node of a run is there.", "encircle.protocol.programs.alive"),
    "doctor": Command("Examine this machine and a run's network.", "encircle.doctor.doctor"),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; one clear line for whatever goes wrong. Returns the exit status.

    ``arguments``: by default those of this process.
    """
    name, *rest = (sys.argv[1:] if arguments is None else list(arguments)) or [""]
    if not name:
        say_error(*usage().split("\n"))
        return 2
    if name in ("-h", "--help"):
        say(*usage().split("\n"))
        return 0
    if name not in COMMANDS:
        kind = "option" if name.startswith("-") else "command"
        say_error(f"encircle: error: no such {kind}: {name}{did_you_mean(name, COMMANDS)}")
        return 2
    command = COMMANDS[name]
    try:
        run = getattr(import_module(command.module), command.function)
        return _status(run, rest, f"encircle {name}")
    except SystemExit as ended:
        return int(ended.code or 0)


def usage() -> str:
    """The help of ``encircle`` itself."""
    width = max(map(len, COMMANDS))
    return "\n".join(
        [
            "usage: encircle [-h] COMMAND ...",
            "",
            "Hunt a moving target with robots that share nothing but messages.",
            "",
            "options:",
            "  -h, --help  show this help message and exit",
            "",
            "commands, each with a --help of its own:",
            *(f"  {name:{width}}  {command.summary}" for name, command in COMMANDS.items()),
        ]
    )


def _status(run: Callable[[Sequence[str], str], int], rest: Sequence[str], program: str) -> int:
    """The exit status of a command, also of one that raises."""
    try:
        return run(rest, program)
    except (Exception, KeyboardInterrupt) as error:
        failure = _failure(error)
        if failure is None:
            raise
        status, text = failure
        say_error(*f"encircle: {text}".split("\n"))
        return status


def _failure(error: BaseException) -> tuple[int, str] | None:
    """Exit status and text for an error that a user can do something about, else None."""
    # Imported late: a robot that does well needs nothing of the world.
    from concurrent.futures.process import BrokenProcessPool

    from encircle.extras import MissingExtra, missing_line
    from encircle.protocol.plugins import PluginFailed
    from encircle.protocol.process.interrupts import Interrupted
    from encircle.protocol.process.tracebacks import failure_line
    from encircle.runner.testimony import RunFailed
    from encircle.viewer.addresses import ServerFailed
    from encircle.world.recording.run_directory import RunDirectoryError
    from encircle.world.scenario.errors import ScenarioError

    match error:
        case ScenarioError() | RunDirectoryError() | MissingExtra():
            return 2, str(error)
        case Interrupted() | ServerFailed():
            return 1, str(error)
        case BrokenProcessPool():
            return 1, f"a process for the work is gone: {error}"
        case RunFailed():
            return 1, f"the run failed: {error}"
        case ModuleNotFoundError(name=str(name)) if name.partition(".")[0] in laboratory.PACKAGES:
            return 2, (
                f"this command needs {name}, which an image for nodes leaves out:"
                " take the image of the laboratory, docker build --target laboratory"
            )
        case ModuleNotFoundError():
            line = missing_line(error)
            return None if line is None else (2, line)
        case PluginFailed():
            # What only reads a run leaves nothing in its directory.
            return 1, failure_line(error, None)
    return None
