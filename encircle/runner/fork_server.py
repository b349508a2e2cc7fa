"""The process that nodes are forked from: it imports what they need once, and waits for requests.

A fresh interpreter takes some tenths of a second to import numpy, scipy, filterpy and Zenoh; a
forked one takes none, and shares the memory of what was imported. Each node is a process of its
own all the same, in its own session, with the streams, environment and command line that it would
have had if it had been started by hand. No thread runs here: Zenoh starts its threads when a
session is opened, which happens in the nodes.

``multiprocessing``'s fork server is not used. It imports the starter's ``__main__`` into every
child, so that a script without ``if __name__ == "__main__"`` would start itself again, and it
knows neither streams nor sessions.

A request is eight bytes of length, which carry the node's three file descriptors, and a JSON
object: ``{"start": number, "program": ..., "arguments": [...], "environment": {...}, "folder":
...}`` or ``{"signal": number, "pid": ...}``. Answers are JSON lines: ``{"start": number, "pid":
...}``, with ``"error"`` in place of the pid if there can be no process, and ``{"pid": ...,
"status": ...}``, the status as ``subprocess`` counts it. When the starter is gone the connection is
closed, and this process ends.
"""

import gc
import json
import os
import selectors
import signal
import socket
import struct
import sys
import tempfile
import traceback
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

from encircle.protocol.process.deferred_imports import UNUSED, lazy
from encircle.protocol.process.interrupts import NUMBERS, exit_on_signal, exit_process

HEADER = struct.Struct("!Q")
STREAMS = 3
MODULE = "encircle.runner.fork_server"
READ_BYTES = 4096


class _Program(NamedTuple):
    """A node's program: the module that ``python -m`` would run, and who it says that it is."""

    module: str
    who: str


PROGRAMS = {
    "encircle.agents": _Program("encircle.agents.__main__", "robot"),
    "encircle.world": _Program("encircle.world.__main__", "world"),
    "encircle.protocol.programs.router": _Program("encircle.protocol.programs.router", "router"),
}


def preload() -> None:
    """Import what robots, world and router need when they run."""
    with lazy(*UNUSED):
        for name in (
            "encircle.agents.process.robot",
            "encircle.protocol.zenoh.configuration",
            "encircle.protocol.zenoh.liveliness",
            "encircle.protocol.zenoh.refusals",
            "encircle.world.loading.load",
            "encircle.world.loading.remarks",
            "encircle.world.process.running",
            "encircle.world.recording.resuming",
            *(program.module for program in PROGRAMS.values()),
        ):
            import_module(name)


def main() -> None:
    """Serve the starter at the other end of the socket on standard input."""
    set_command_line([sys.executable, "-m", MODULE])
    starter = socket.socket(fileno=os.dup(0))
    nothing = os.open(os.devnull, os.O_RDWR)
    os.dup2(nothing, 0)
    os.close(nothing)
    preload()
    # What is there now stays for good: collecting garbage in the nodes need not look at it again,
    # and so leaves its memory shared.
    gc.collect()
    gc.freeze()
    _Server(starter).serve()


class _Server:
    def __init__(self, starter: socket.socket) -> None:
        self._starter = starter
        self._living: set[int] = set()
        self._selector = selectors.DefaultSelector()
        self._wake, self._woken = os.pipe()
        for end in (self._wake, self._woken):
            os.set_blocking(end, False)

    def serve(self) -> None:
        """Fork, signal and wait for nodes until the starter is gone."""
        signal.set_wakeup_fd(self._woken)
        signal.signal(signal.SIGCHLD, lambda _number, _frame: None)
        self._selector.register(self._starter, selectors.EVENT_READ)
        self._selector.register(self._wake, selectors.EVENT_READ)
        while True:
            ready = {key.fileobj for key, _ in self._selector.select()}
            try:
                if self._wake in ready:
                    os.read(self._wake, READ_BYTES)
                    self._report_ended()
                if self._starter in ready:
                    self._take_request()
            except (EOFError, ConnectionError):
                # Nodes end when the world does, and the world when its standard input is closed.
                return

    def _take_request(self) -> None:
        header, streams, _, _ = socket.recv_fds(self._starter, HEADER.size, STREAMS)
        request = json.loads(self._received(HEADER.unpack(self._whole(header))[0]))
        if "signal" in request:
            # Only a node that was not waited for yet is sure to be the one that is meant.
            if request["pid"] in self._living:
                os.kill(request["pid"], request["signal"])
            return
        try:
            pid = self._fork(request, streams)
        except OSError as error:
            self._answer({"start": request["start"], "error": error.strerror or str(error)})
            return
        finally:
            for stream in streams:
                os.close(stream)
        self._living.add(pid)
        self._answer({"start": request["start"], "pid": pid})

    def _whole(self, header: bytes) -> bytes:
        if not header:
            raise EOFError
        return header + self._received(HEADER.size - len(header))

    def _received(self, length: int) -> bytes:
        parts = []
        while length:
            part = self._starter.recv(length)
            if not part:
                raise EOFError
            parts.append(part)
            length -= len(part)
        return b"".join(parts)

    def _answer(self, answer: dict[str, int | str]) -> None:
        self._starter.sendall(json.dumps(answer).encode() + b"\n")

    def _report_ended(self) -> None:
        while self._living:
            pid, status = os.waitpid(-1, os.WNOHANG)
            if pid == 0:
                return
            self._living.discard(pid)
            self._answer({"pid": pid, "status": os.waitstatus_to_exitcode(status)})

    def _fork(self, request: dict[str, Any], streams: Sequence[int]) -> int:
        # A signal to a node that has just been born waits until the node can say so.
        signal.pthread_sigmask(signal.SIG_BLOCK, NUMBERS)
        try:
            pid = os.fork()
            if pid == 0:
                self._become(request, streams)
            return pid
        finally:
            signal.pthread_sigmask(signal.SIG_UNBLOCK, NUMBERS)

    def _become(self, request: dict[str, Any], streams: Sequence[int]) -> NoReturn:
        """In the new process: be the node, to its end."""
        status = 1
        try:
            os.setsid()
            signal.set_wakeup_fd(-1)
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            for number, stream in enumerate(streams):
                os.dup2(stream, number)
            self._selector.close()
            for end in (self._starter.detach(), self._wake, self._woken, *streams):
                os.close(end)
            run_program(request)
        except SystemExit as ended:
            status = ended.code if isinstance(ended.code, int) else int(ended.code is not None)
        except BaseException:
            traceback.print_exc()
        finally:
            for output in (sys.stdout, sys.stderr):
                with suppress(OSError, ValueError):
                    output.flush()
            # Without what the fork server's own interpreter would do at its end.
            os._exit(status)


def run_program(request: dict[str, Any]) -> NoReturn:
    """Run a node's program as ``python -m`` would; the process ends with it."""
    name, arguments = request["program"], request["arguments"]
    program = PROGRAMS[name]
    exit_on_signal(program.who)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, NUMBERS)
    if os.environ != request["environment"]:
        os.environ.clear()
        os.environ.update(request["environment"])
    # It was chosen by the environment of the fork server, if at all.
    tempfile.tempdir = None
    if request["folder"] is not None:
        os.chdir(request["folder"])
    module = import_module(program.module)
    sys.argv = [str(module.__file__), *arguments]
    set_command_line([sys.executable, "-m", name, *arguments])
    exit_process(module.main(arguments))


def set_command_line(words: Sequence[str], proc: Path = Path("/proc/self")) -> None:
    """Have this process show under another command line, as far as the old one left room.

    Linux keeps the words in the process's own memory. Elsewhere nothing happens.
    """
    with suppress(OSError, ValueError, IndexError):
        fields = (proc / "stat").read_bytes().rpartition(b")")[2].split()
        # Fields 48 and 49 of proc(5), and the first one here is the third.
        begin, end = int(fields[45]), int(fields[46])
        text = b"\0".join(os.fsencode(word) for word in words)[: max(0, end - begin - 1)]
        with open(proc / "mem", "r+b", buffering=0) as memory:
            memory.seek(begin)
            if memory.read(end - begin) == (proc / "cmdline").read_bytes():
                memory.seek(begin)
                memory.write(text.ljust(end - begin, b"\0"))
