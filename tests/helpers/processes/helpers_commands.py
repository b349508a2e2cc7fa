"""Our programs as commands, and the cheap way to run one: as a fork of what has imported it all.

A fresh interpreter takes half a second of processor time and more until a command begins. Where its
start is not what a test is about, ``command`` and ``process_of`` fork it. Real interpreters run in
``test_interrupts.py``, ``test_foreign_names.py``, ``test_wheel.py``, ``test_terminal.py`` and
wherever a test starts one by itself.
"""

import functools
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO, Any

from helpers_paths import ROOT
from helpers_waiting import ended

from encircle.protocol.programs.options import without_settings
from encircle.runner.fork_server import PROGRAMS
from encircle.runner.nodes import BOOT, PATHS, ForkServer, fork_server

PACKAGES = ("agents", "world")
COMMAND = "encircle"
OWN_BOOT = BOOT[: BOOT.index("from encircle.runner")] + (
    f"sys.path.append({str(Path(__file__).parent)!r})\nfrom command_server import serve\nserve()\n"
)


def ours(program: str, *arguments: str) -> list[str]:
    """The command of a node, ``agents`` or ``world``, or ``python -m`` anything else."""
    module = f"encircle.{program}" if program in PACKAGES else program
    return [sys.executable, "-m", module, *map(str, arguments)]


def _paths(environment: Mapping[str, str]) -> list[str | None]:
    return [environment.get(name) for name in PATHS]


USUAL_PATHS = _paths(os.environ)


@functools.cache
def _command_server() -> ForkServer:
    """The server of this test process that forks commands."""
    return ForkServer(without_settings(os.environ), OWN_BOOT)


def process_of(
    command: Sequence[str],
    streams: Sequence[IO[bytes]],
    environment: Mapping[str, str],
    folder: Path = ROOT,
) -> Any:
    """A command as a process; a node of ours or ``python -m encircle`` is forked.

    What it is then can do what ``subprocess.Popen`` can. A command that takes modules from where
    other commands take none, such as plug-ins, is a fresh interpreter.
    """
    words = [str(word) for word in command]
    is_module = words[:2] == [sys.executable, "-m"]
    if is_module and words[2] in PROGRAMS:
        server = fork_server(environment)
    elif is_module and words[2] == COMMAND and _paths(environment) == USUAL_PATHS:
        server = _command_server()
    else:
        stdin, stdout, stderr = streams
        return subprocess.Popen(
            words, cwd=folder, env=environment, stdin=stdin, stdout=stdout, stderr=stderr
        )
    numbers = tuple(stream.fileno() for stream in streams)
    node = server.start(words[2], words[3:], numbers, environment, folder).result()
    node.args = words
    return node


def started_unheard(words: Sequence[str]) -> Any:
    """``process_of`` where nobody hears what it says."""
    with open(os.devnull, "r+b") as nothing:
        return process_of(words, (nothing,) * 3, os.environ)


def command(*arguments: str, folder: Path = ROOT) -> "subprocess.CompletedProcess[str]":
    """``encircle`` with these arguments, run to its end in a folder; what it said, as text."""
    return run_forked(ours(COMMAND, *arguments), folder)


def run_forked(
    words: Sequence[str], folder: Path = ROOT, environment: Mapping[str, str] | None = None
) -> "subprocess.CompletedProcess[str]":
    """``helpers_waiting.completed`` of a command of ours, by ``process_of``."""
    with (
        open(os.devnull, "rb") as nothing,
        tempfile.TemporaryFile() as out,
        tempfile.TemporaryFile() as err,
    ):
        settings = os.environ if environment is None else environment
        process = process_of(words, (nothing, out, err), settings, folder)
        try:
            status = ended(process)
        finally:
            process.kill()
        printed, said = (_text(stream) for stream in (out, err))
    return subprocess.CompletedProcess(words, status, printed, said)


def _text(stream: IO[bytes]) -> str:
    stream.seek(0)
    return stream.read().decode()
