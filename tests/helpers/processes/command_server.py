"""The program of a fork server whose processes are commands: ``encircle ...`` with all imported.

It is this package's own fork server with one more program (``helpers_commands``).
"""

import atexit
import pkgutil
from collections.abc import Sequence
from importlib import import_module

import encircle
from encircle.cli.main import main as command_line
from encircle.protocol.process.interrupts import _State
from encircle.runner import fork_server


def main(arguments: Sequence[str]) -> int:
    """Run a command as ``encircle.__main__`` does, with what Python does at its end."""
    status = command_line(arguments)
    if not _State.at_work:
        atexit._run_exitfuncs()
    return status


def serve() -> None:
    """Serve the starter, as ``encircle.runner.fork_server.main``."""
    fork_server.PROGRAMS["encircle"] = fork_server._Program(__name__, "encircle")
    for module in pkgutil.walk_packages(encircle.__path__, "encircle."):
        if not module.name.endswith("__main__"):
            import_module(module.name)
    fork_server.main()
