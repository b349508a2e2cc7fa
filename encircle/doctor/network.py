"""What a party's endpoints need: addresses to listen on, and somebody there to connect to.

Endpoints by host and port are tried as plain sockets first, because the network's own answers
(no such name, refused, no answer) tell more than a session that could not be opened. Then a Zenoh
session is tried by ``encircle.doctor.run``, which alone shows certificates that are refused.
"""

import errno
import os
import socket
from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path

from encircle.doctor.machine import CheckResult
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
"""A script is the second word, behind its interpreter."""
_LISTENING = "0A"
KIND = "not of a kind that can be tried"


def exposure(where: Endpoints) -> list[CheckResult]:
    """Whether others can reach what listens, and nothing says who they are."""
    advice = "use certificates (docs/security.md), or let a firewall say who reaches the port"
    try:
        message = warning(where)
    except ConfigurationError as error:
        return [CheckResult("access", "wrong", str(error), advice)]
    return [CheckResult("access", "note", message, advice)] if message is not None else []


def listening_on(endpoint: str) -> list[CheckResult]:
    """Whether a party could listen there now."""
    protocol = endpoint.partition("/")[0]
    if protocol not in NETWORK_PROTOCOLS:
        return [
            CheckResult("ports", "note", f"{endpoint}: {KIND}", "try a session by encircle alive")
        ]
    host, port = host_and_port(endpoint)
    datagrams = protocol in DATAGRAMS
    error = can_bind(socket.SOCK_DGRAM if datagrams else socket.SOCK_STREAM, host, port)
    if error is None:
        return [CheckResult("ports", "ok", f"{endpoint} is free to listen on")]
    if error.errno == errno.EADDRINUSE:
        who = None if datagrams else listener_on(port)
        message = f"{endpoint} is in use by {who or 'a process that does not show'}"
        advice = "well if that is the party in question; another needs another port"
        ours = who is not None and is_ours(who.partition(": ")[2].split())
        return [CheckResult("ports", "note" if ours else "wrong", message, advice)]
    advice = "see which addresses this host has: ip address"
    if isinstance(error, socket.gaierror):
        advice = "use an address, or put the name into DNS or /etc/hosts"
    elif error.errno == errno.EADDRNOTAVAIL:
        advice = "this host has no such address; tcp/0.0.0.0:PORT is all that it has"
    elif error.errno == errno.EACCES and port <= PRIVILEGED_PORT_MAX:
        advice = f"ports up to {PRIVILEGED_PORT_MAX} are for root: take a higher one"
    return [
        CheckResult("ports", "wrong", f"{endpoint} cannot be listened on: {_words(error)}", advice)
    ]


def connecting_to(endpoint: str, s_max: float) -> list[CheckResult]:
    """Whether something answers there."""
    protocol, _, rest = endpoint.partition("/")
    if protocol == "unixsock-stream":
        there = Path(rest).is_socket()
        if there:
            return [CheckResult("endpoints", "ok", f"{endpoint} is there")]
        message = f"{endpoint}: there is no such socket"
        return [
            CheckResult("endpoints", "wrong", message, "start the party that is to listen there")
        ]
    if protocol not in NETWORK_PROTOCOLS:
        return [
            CheckResult(
                "endpoints", "note", f"{endpoint}: {KIND}", "try a session by encircle alive"
            )
        ]
    host, port = host_and_port(endpoint)
    try:
        address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][4]
        if protocol in DATAGRAMS:
            return [CheckResult("endpoints", "ok", f"{endpoint}: {host} is {address[0]}")]
        socket.create_connection((host, port), timeout=s_max).close()
    except OSError as error:
        message = f"{endpoint} cannot be reached: {_words(error)}"
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


def is_ours(command: Sequence[str]) -> bool:
    """Whether a command, by its words, is one of this project's."""
    modules = [module for flag, module in pairwise(command) if flag == "-m"]
    own = any(module.partition(".")[0] in PACKAGES for module in modules)
    return own or any(Path(word).name == "encircle" for word in command[:PROGRAM_WORDS])


def _words(error: OSError) -> str:
    if isinstance(error, TimeoutError):
        return "no answer"
    if isinstance(error, socket.gaierror):
        return error.strerror or "unknown name"
    return os.strerror(error.errno) if error.errno else str(error)


def can_bind(kind: socket.SocketKind, host: str, port: int) -> OSError | None:
    """Why this process cannot listen there; None if it can."""
    try:
        family, _, _, _, address = socket.getaddrinfo(
            host, port, type=kind, flags=socket.AI_NUMERICSERV
        )[0]
        with socket.socket(family, kind) as probe:
            # As Zenoh does: connections that have just been closed do not keep the port.
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
            if kind == socket.SOCK_STREAM:
                probe.listen(1)
    except OSError as error:
        return error
    return None


def listener_on(port: int, proc: Path = Path("/proc")) -> str | None:
    """The process that listens on a TCP port, as ``PID 12: COMMAND``; None if it cannot be known.

    Other users' processes and those outside a container do not show.
    """
    inodes = {f"socket:[{inode}]" for inode in _listening_inodes(port, proc)}
    numbers = sorted(int(path.name) for path in proc.iterdir() if path.name.isdigit())
    for number in numbers[:PROCESSES_MAX] if inodes else ():
        if any(link in inodes for link in _links_in(proc / str(number) / "fd")):
            try:
                words = (proc / str(number) / "cmdline").read_bytes().split(b"\0")
            except OSError:
                words = []
            command = b" ".join(words).decode(errors="replace").strip()
            return f"PID {number}: {command[:COMMAND_CHARACTERS_MAX]}"
    return None


def _links_in(folder: Path) -> Iterable[str]:
    try:
        for path in folder.iterdir():
            yield str(path.readlink())
    except OSError:
        return  # another user's, or gone meanwhile


def _listening_inodes(port: int, proc: Path) -> list[str]:
    found = []
    for table in ("tcp", "tcp6"):
        try:
            lines: Sequence[str] = (proc / "net" / table).read_text().splitlines()[1:]
        except OSError:
            continue
        for line in lines:
            fields = line.split()
            if fields[3] == _LISTENING and int(fields[1].rpartition(":")[2], 16) == port:
                found.append(fields[9])
    return found
