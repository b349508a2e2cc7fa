"""Zenoh sessions: opening one, with an error that says what failed, and closing it in bounded time.

A session is what Zenoh calls a node's way into the network. Opening one binds what is listened on
and connects to the others; closing one takes leave of each of them.
"""

import contextlib
import json
import re
import socket
import threading
from collections.abc import Iterator

import zenoh

from encircle.protocol.process.interrupts import expect_library_threads
from encircle.protocol.zenoh.configuration import configuration, in_one_line
from encircle.protocol.zenoh.endpoints import (
    NETWORK_PROTOCOLS,
    ConnectionFailed,
    Endpoints,
    host_and_port,
)

CLOSE_S_MAX = 1.0
"""How long to take leave of the others, in s: one that is frozen takes ten seconds each."""
_NOBODY = "Unable to connect to any of "
_ENDPOINT_TRIED = re.compile(r"Single\(([^()\s]+)\)")


def has_neighbours(session: zenoh.Session) -> bool:
    """Whether the session is connected to a router or a peer."""
    return bool(session.info.routers_zid() or session.info.peers_zid())


def open_session(endpoints: Endpoints) -> zenoh.Session:
    """A session that has bound and connected as asked; else ``ConnectionFailed`` says where."""
    zenoh.init_log_from_env_or("off")
    expect_library_threads()
    config = configuration(endpoints)
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        reason = in_one_line(error)
        connecting = "connect to" in reason
        doing = "connect to" if connecting else "listen on"
        where = ", ".join(endpoints.connect if connecting else endpoints.listen) or endpoints
        unknown = [e for e in endpoints.connect if connecting and not _has_address(e)]
        if unknown:
            reason = f"no address is known for the host of {', '.join(unknown)}"
        elif reason.startswith(_NOBODY):
            reason = _nobody(str(error), endpoints, config)
        raise ConnectionFailed(f"cannot {doing} {where}: {reason}") from None


def _nobody(said: str, endpoints: Endpoints, config: zenoh.Config) -> str:
    """That nobody has answered, in place of what Zenoh says of it."""
    # Those of a configuration file are named nowhere else.
    tried = [] if endpoints.connect else _ENDPOINT_TRIED.findall(said)
    timeout_ms = json.loads(config.get_json("connect/timeout_ms"))
    is_known = isinstance(timeout_ms, int) and timeout_ms >= 0
    return (
        f"nobody answers {'at ' + ', '.join(tried) if tried else 'there'}"
        f"{f' within {timeout_ms / 1000:g} s' if is_known else ''}, or nobody who lets this node"
        " in; is a router or a world started there?"
    )


@contextlib.contextmanager
def closing(session: zenoh.Session) -> Iterator[zenoh.Session]:
    """As ``contextlib.closing``, by ``close_session``."""
    try:
        yield session
    finally:
        close_session(session)


def close_session(session: zenoh.Session) -> None:
    """Close a session; takes ``CLOSE_S_MAX`` at most, and raises nothing.

    Zenoh waits for each node in turn to read what it was sent, and fails if one does not.
    """

    def close() -> None:
        with contextlib.suppress(zenoh.ZError):
            session.close()  # type: ignore[no-untyped-call]

    thread = threading.Thread(target=close, name="closing", daemon=True)
    thread.start()
    thread.join(CLOSE_S_MAX)


def _has_address(endpoint: str) -> bool:
    """Whether an endpoint's host, a name or an address already, can be turned into an address."""
    if endpoint.partition("/")[0] not in NETWORK_PROTOCOLS:
        return True
    with contextlib.suppress(OSError, UnicodeError):
        return bool(socket.getaddrinfo(*host_and_port(endpoint)))
    return False
