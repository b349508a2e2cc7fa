"""Nodes as processes of this machine, forked from one that has imported what they need.

A program that starts nodes has one fork server, from its first node on to its own end
(``encircle.runner.fork_server``). It runs the package that this program runs, wherever that lies,
and takes modules neither from the working directory nor from beside a script: a person's own
``types.py`` or ``random.py`` there is nobody's business. ``PYTHONPATH`` counts as ever.
"""

import atexit
import itertools
import json
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from contextlib import suppress
from pathlib import Path
from typing import Any

from encircle.protocol.programs.options import without_settings
from encircle.runner.fork_server import HEADER

ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
"""A robot's matrices are tiny; a pool of idle threads in every process only costs memory."""
BOOT = """\
import sys
from importlib.util import module_from_spec, spec_from_file_location
spec = spec_from_file_location("encircle", sys.argv[1])
sys.modules["encircle"] = package = module_from_spec(spec)
spec.loader.exec_module(package)
from encircle.runner.fork_server import main
main()
"""
"""Imports this program's own package, even if the path leads to another one."""
ROOM = "-" * 1000
"""Gives nodes room to show their own command lines."""
PACKAGE = Path(__file__).parents[1] / "__init__.py"
PATHS = ("PYTHONPATH", "PYTHONHOME")
"""Variables that decide which modules an interpreter finds, once and for all."""
END_S_MAX = 5.0


class NodesLost(Exception):
    """The fork server has ended, and all its nodes with it, or it cannot make a node."""


class Node:
    """A process that the fork server has made; in its use like ``subprocess.Popen``.

    ``ended``: the exit status to come, minus the number of the signal that killed it.
    """

    def __init__(self, server: "ForkServer", pid: int) -> None:
        self._server = server
        self.pid = pid
        self.ended: Future[int] = Future()
        # Who waits for it and is cancelled does not cancel it.
        self.ended.set_running_or_notify_cancel()

    @property
    def returncode(self) -> int | None:
        """The exit status, None as long as it runs."""
        return self.ended.result() if self.ended.done() else None

    def poll(self) -> int | None:
        """As ``returncode``."""
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        """Wait for its end, at most so many seconds (``TimeoutError``); the exit status."""
        return self.ended.result(timeout)

    def send_signal(self, number: int) -> None:
        """Send it a signal, unless it has ended."""
        if not self.ended.done():
            self._server.send_signal(self.pid, number)

    def terminate(self) -> None:
        """Ask it to end."""
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        """End it."""
        self.send_signal(signal.SIGKILL)


class ForkServer:
    """A fork server, and this program's end of the connection to it.

    ``environment``: its own; what decides which modules are found holds for its nodes, too.
    ``boot``: the code that it begins with.
    """

    def __init__(self, environment: Mapping[str, str], boot: str = BOOT) -> None:
        self.owner = os.getpid()
        self._connection, other = socket.socketpair()
        self._numbers = itertools.count()
        self._lock = threading.Lock()
        self._requested: dict[int, Future[Node]] = {}
        self._nodes: dict[int, Node] = {}
        self._was_asked = False
        self.lost = False
        """Whether it has ended."""
        with other:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-c", boot, str(PACKAGE), ROOM],
                stdin=other.fileno(),
                stdout=subprocess.DEVNULL,
                env={**environment, **ONE_THREAD},
                # Ctrl-C in a terminal is for its starter.
                start_new_session=True,
            )
        self._reader = threading.Thread(target=self._read_answers, name="nodes", daemon=True)
        self._reader.start()

    def start(
        self,
        program: str,
        arguments: Sequence[str],
        streams: tuple[int, int, int],
        environment: Mapping[str, str],
        folder: Path | None = None,
    ) -> Future[Node]:
        """Start a node, which is there when the fork server is; ``NodesLost`` if it cannot be.

        ``program``: a module, as for ``python -m``; ``streams``: file descriptors of its standard
        input, output and error, of which this process keeps its own; ``folder``: its working
        directory, this program's own if None.
        """
        number = next(self._numbers)
        request = {
            "start": number,
            "program": program,
            "arguments": list(arguments),
            "environment": {**environment, **ONE_THREAD},
            "folder": _directory(folder),
        }
        future: Future[Node] = Future()
        future.set_running_or_notify_cancel()
        with self._lock:
            self._was_asked = True
            self._requested[number] = future
        self._send(request, streams)
        return future

    def send_signal(self, pid: int, number: int) -> None:
        """Send a signal to a node, if it is still there."""
        with suppress(NodesLost):
            self._send({"signal": number, "pid": pid})

    def close(self) -> None:
        """End it, and every node of it that is still there."""
        with suppress(OSError):
            self._connection.shutdown(socket.SHUT_RDWR)
        if not self._was_asked:
            # It has no node, and may have long to go until it sees that its starter is gone.
            self._process.kill()
        try:
            self._process.wait(END_S_MAX)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        # It ends the nodes that are left.
        self._reader.join(END_S_MAX)

    def _send(self, request: Mapping[str, object], streams: Sequence[int] = ()) -> None:
        body = json.dumps(request).encode()
        try:
            with self._lock:
                socket.send_fds(self._connection, [HEADER.pack(len(body))], streams)
                self._connection.sendall(body)
        except OSError as error:
            raise NodesLost(f"the process that nodes are forked from is gone: {error}") from None

    def _read_answers(self) -> None:
        with suppress(OSError), self._connection.makefile("rb") as answers:
            for line in answers:
                self._take(json.loads(line))
        self._connection.close()
        self._lose_all()

    def _take(self, answer: Mapping[str, Any]) -> None:
        if "start" in answer:
            with self._lock:
                requested = self._requested.pop(answer["start"])
                if "pid" in answer:
                    node = self._nodes[answer["pid"]] = Node(self, answer["pid"])
            # Whoever waits for it may want to send it a signal.
            if "pid" in answer:
                requested.set_result(node)
            else:
                requested.set_exception(NodesLost(f"no process can be made: {answer['error']}"))
        else:
            with self._lock:
                node = self._nodes.pop(answer["pid"])
            node.ended.set_result(answer["status"])

    def _lose_all(self) -> None:
        """Nobody can tell any more how nodes end, so they are ended here."""
        self.lost = True
        with self._lock:
            requested, nodes = list(self._requested.values()), list(self._nodes.values())
            self._requested.clear()
            self._nodes.clear()
        for future in requested:
            future.set_exception(NodesLost("the process that nodes are forked from has ended"))
        for node in nodes:
            with suppress(OSError):
                os.kill(node.pid, signal.SIGKILL)
            node.ended.set_result(-signal.SIGKILL)


def abandon(start: "Future[Node]") -> None:
    """Have a node that is not wanted any more ended as soon as it is there."""

    def end(done: "Future[Node]") -> None:
        if done.exception() is None:
            done.result().kill()

    start.add_done_callback(end)


def _directory(folder: Path | None) -> str | None:
    """A node's working directory; None for this program's own if that is there no more."""
    try:
        return str(folder or Path.cwd())
    except FileNotFoundError:
        return None


_servers: dict[tuple[str | None, ...], ForkServer] = {}
_servers_lock = threading.Lock()


def fork_server(environment: Mapping[str, str] | None = None) -> ForkServer:
    """The fork server of this program, which is started if it is not there.

    It takes as long as some imports until it can fork, and this program may do something else
    meanwhile. ``environment``: that of the nodes to come, as far as known; this program's own if
    None. Where modules lie elsewhere there is another server.
    """
    environment = os.environ if environment is None else environment
    paths = tuple(environment.get(name) for name in PATHS)
    with _servers_lock:
        server = _servers.get(paths)
        if server is not None and server.lost and server.owner == os.getpid():
            server.close()
        # A process that was forked from this program has no business with its server.
        if server is None or server.lost or server.owner != os.getpid():
            server = _servers[paths] = ForkServer(without_settings(environment))
        return server


@atexit.register
def close_fork_servers() -> None:
    """End this program's fork servers; the next node gets a new one."""
    with _servers_lock:
        for server in _servers.values():
            if server.owner == os.getpid():
                server.close()
        _servers.clear()
