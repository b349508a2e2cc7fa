"""Checks of a node's endpoints: can it listen there, and does something answer there.

Endpoints with host and port are tried as plain sockets first, because the network's own errors (no
such name, refused, no answer) are clearer than that of a Zenoh session. Then
``encircle.doctor.run`` tries a Zenoh session, which alone shows whether certificates are accepted.
"""

import errno
import os
import socket
from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path

from encircle.check_results import CheckResult
from encircle.protocol.zenoh.configuration import warning
from encircle.protocol.zenoh.endpoints import (
    NETWORK_PROTOCOLS,
    ConfigurationError,
    Endpoints,
    host_and_port,
)

DATAGRAMS = ("udp", "quic")
PRIVILEGED_PORT_MAX = 1023
PROCESSES_MAX = 65_536
COMMAND_CHARACTERS_MAX = 120
PACKAGES = ("agents", "encircle", "protocol", "world")
PROGRAM_WORDS = 2
"""A script's path is the second word of its command, after the interpreter."""
_TCP_LISTEN_STATE = "0A"
UNTESTABLE = "not of a kind that can be tried"


def check_exposure(endpoints: Endpoints) -> list[CheckResult]:
    """Whether other hosts can reach a listening endpoint without authentication."""
    advice = "use certificates (docs/security.md), or let a firewall say who reaches the port"
    try:
        message = warning(endpoints)
    except ConfigurationError as error:
        return [CheckResult("access", "wrong", str(error), advice)]
    return [CheckResult("access", "note", message, advice)] if message is not None else []


def check_listening(endpoint: str) -> list[CheckResult]:
    """Whether a node could listen on an endpoint now."""
    protocol = endpoint.partition("/")[0]
    if protocol not in NETWORK_PROTOCOLS:
        return [
            CheckResult(
                "ports", "note", f"{endpoint}: {UNTESTABLE}", "try a session by encircle alive"
            )
        ]
    host, port = host_and_port(endpoint)
    datagrams = protocol in DATAGRAMS
    error = can_bind(socket.SOCK_DGRAM if datagrams else socket.SOCK_STREAM, host, port)
    if error is None:
        return [CheckResult("ports", "ok", f"{endpoint} is free to listen on")]
    if error.errno == errno.EADDRINUSE:
        process = None if datagrams else listener_on(port)
        message = f"{endpoint} is in use by {process or 'a process that does not show'}"
        advice = "this is well if it is the node that you mean; any other node needs another port"
        is_ours = process is not None and is_encircle_command(process.partition(": ")[2].split())
        return [CheckResult("ports", "note" if is_ours else "wrong", message, advice)]
    advice = "see which addresses this host has: ip address"
    if isinstance(error, socket.gaierror):
        advice = "use an address, or put the name into DNS or /etc/hosts"
    elif error.errno == errno.EADDRNOTAVAIL:
        advice = "this host has no such address; tcp/0.0.0.0:PORT is all that it has"
    elif error.errno == errno.EACCES and port <= PRIVILEGED_PORT_MAX:
        advice = f"ports up to {PRIVILEGED_PORT_MAX} are for root: take a higher one"
    return [
        CheckResult(
            "ports", "wrong", f"{endpoint} cannot be listened on: {_error_text(error)}", advice
        )
    ]


def check_connecting(endpoint: str, s_max: float) -> list[CheckResult]:
    """Whether something answers on an endpoint."""
    protocol, _, rest = endpoint.partition("/")
    if protocol == "unixsock-stream":
        there = Path(rest).is_socket()
        if there:
            return [CheckResult("endpoints", "ok", f"{endpoint} is there")]
        message = f"{endpoint}: there is no such socket"
        return [
            CheckResult("endpoints", "wrong", message, "start the node that should listen there")
        ]
    if protocol not in NETWORK_PROTOCOLS:
        return [
            CheckResult(
                "endpoints", "note", f"{endpoint}: {UNTESTABLE}", "try a session by encircle alive"
            )
        ]
    host, port = host_and_port(endpoint)
    try:
        address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][4]
        if protocol in DATAGRAMS:
            return [CheckResult("endpoints", "ok", f"{endpoint}: {host} is {address[0]}")]
        socket.create_connection((host, port), timeout=s_max).close()
    except OSError as error:
        message = f"{endpoint} cannot be reached: {_error_text(error)}"
        return [CheckResult("endpoints", "wrong", message, _advice(error, host))]
    return [CheckResult("endpoints", "ok", f"{endpoint} answers")]


def _advice(error: OSError, host: str) -> str:
    if isinstance(error, socket.gaierror):
        return f"no address is known for {host!r}: use an address, or put it into DNS or /etc/hosts"
    if isinstance(error, ConnectionRefusedError):
        return (
            "nothing listens there: start the router or the world, compare host and port, and see"
            " that it listens beyond its own 127.0.0.1; within a container, 127.0.0.1 is the"
            " container itself"
        )
    if isinstance(error, TimeoutError):
        return "no answer at all: a firewall, a wrong address, or a host that is down or cut off"
    if error.errno in (errno.ENETUNREACH, errno.EHOSTUNREACH):
        return "there is no way to that address from here: see ip route, and whether it is up"
    return "see that host and port are right"


def is_encircle_command(command: Sequence[str]) -> bool:
    """Whether a command line, given as words, is one of this project's programs."""
    modules = [module for flag, module in pairwise(command) if flag == "-m"]
    own = any(module.partition(".")[0] in PACKAGES for module in modules)
    return own or any(Path(word).name == "encircle" for word in command[:PROGRAM_WORDS])


def _error_text(error: OSError) -> str:
    if isinstance(error, TimeoutError):
        return "no answer"
    if isinstance(error, socket.gaierror):
        return error.strerror or "unknown name"
    return os.strerror(error.errno) if error.errno else str(error)


def can_bind(kind: socket.SocketKind, host: str, port: int) -> OSError | None:
    """The error if this process cannot listen on a port; None if it can."""
    try:
        family, _, _, _, address = socket.getaddrinfo(
            host, port, type=kind, flags=socket.AI_NUMERICSERV
        )[0]
        with socket.socket(family, kind) as probe:
            # Zenoh sets this option too. Without it recently closed connections block the port.
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
            if kind == socket.SOCK_STREAM:
                probe.listen(1)
    except OSError as error:
        return error
    return None


def listener_on(port: int, proc: Path = Path("/proc")) -> str | None:
    """The process that listens on a TCP port, as ``PID 12: COMMAND``; None if it is not known.

    Processes of other users and processes outside this container cannot be seen.
    """
    inodes = {f"socket:[{inode}]" for inode in _listening_inodes(port, proc)}
    numbers = sorted(int(path.name) for path in proc.iterdir() if path.name.isdigit())
    for number in numbers[:PROCESSES_MAX] if inodes else ():
        if any(link in inodes for link in _symlink_targets(proc / str(number) / "fd")):
            try:
                words = (proc / str(number) / "cmdline").read_bytes().split(b"\0")
            except OSError:
                words = []
            command = b" ".join(words).decode(errors="replace").strip()
            return f"PID {number}: {command[:COMMAND_CHARACTERS_MAX]}"
    return None


def _symlink_targets(folder: Path) -> Iterable[str]:
    try:
        for path in folder.iterdir():
            yield str(path.readlink())
    except OSError:
        return  # the process is another user's, or has ended


def _listening_inodes(port: int, proc: Path) -> list[str]:
    inodes = []
    for table in ("tcp", "tcp6"):
        try:
            lines: Sequence[str] = (proc / "net" / table).read_text().splitlines()[1:]
        except OSError:
            continue
        for line in lines:
            fields = line.split()
            if fields[3] == _TCP_LISTEN_STATE and int(fields[1].rpartition(":")[2], 16) == port:
                inodes.append(fields[9])
    return inodes
