"""How a node reaches the others: where it listens, where it connects, and as what.

Everything goes through explicit endpoints, of the form ``protocol/address`` as in
``tcp/127.0.0.1:7447``. A node that listens nowhere is a client: of the world itself, or of a
router. One that listens is a peer, and a full mesh is peers that list each other. A Zenoh
configuration file may say all this instead, and more. Certificates say who a node is
(``encircle.protocol.zenoh.access_control``).

A listener is reachable from this machine alone unless something authenticates who connects, or the
user gives up authentication by name.
"""

import ipaddress
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from encircle.protocol.codec import BYTES_MAX

Mode = Literal["client", "peer", "router"]

CONNECT_S_MAX = 30.0
MESSAGE_BYTES_MAX = max(BYTES_MAX.values()) + 1024
"""The longest message of the protocol, and some more, so that one that is too long is counted."""
NETWORK_PROTOCOLS = ("tcp", "udp", "tls", "quic", "ws")
LOCAL_PROTOCOLS = ("unixsock-stream", "unixpipe")
OTHER_PROTOCOLS = ("serial", "vsock")
ENDPOINT = "PROTOCOL/HOST:PORT, as in tcp/127.0.0.1:7447"
_HOST_AND_PORT = re.compile(r"(\[[0-9A-Fa-f:.%\w]+\]|[^\s:\[\]/]+):(\d{1,5})")


class ConnectionFailed(Exception):
    """A link cannot be opened; the message says where and why."""


class ConfigurationError(ConnectionFailed):
    """What was asked for is wrong in itself; the message names it and what would be right."""


@dataclass(frozen=True, slots=True)
class Identity:
    """Who a node is: its certificate, the key to it, and the authority whose word it takes.

    Paths of PEM files. Only the node itself should be able to read ``key``.
    """

    authority: Path
    certificate: Path
    key: Path


@dataclass(frozen=True, slots=True)
class Endpoints:
    """Where to listen and where to connect; raises ``ConfigurationError`` for what cannot be meant.

    ``mode``: None is what the configuration file says, else peer if it listens, else client.
    ``config``: a Zenoh configuration file (JSON5), which the other fields overrule.
    ``connect_s_max``: how long to go on trying, in s. ``identity``: with one, connections are made
    with certificates alone, and who listens is a gate (``encircle.protocol.zenoh.access_control``),
    with ``direct_radio`` one at which robots hear each other's poses. ``message_bytes_max``: Zenoh
    drops longer messages as they come in, and keeps the session.
    """

    listen: tuple[str, ...] = ()
    connect: tuple[str, ...] = ()
    mode: Mode | None = None
    config: Path | None = None
    without_authentication: bool = False
    connect_s_max: float = CONNECT_S_MAX
    identity: Identity | None = None
    direct_radio: bool = False
    message_bytes_max: int = MESSAGE_BYTES_MAX

    def __post_init__(self) -> None:
        if not (self.listen or self.connect or self.config):
            raise ConfigurationError(
                "neither an endpoint to listen on nor one to connect to: give one"
            )
        for endpoint in self.listen:
            check_endpoint("listen", endpoint, port_min=0)
        for endpoint in self.connect:
            check_endpoint("connect", endpoint, port_min=1)
        if self.mode == "client" and self.listen:
            raise ConfigurationError(f"listen = {self.listen[0]}: a client only connects")

    def __str__(self) -> str:
        return ", ".join((*self.listen, *self.connect)) or str(self.config)


def check_endpoint(kind: str, endpoint: str, port_min: int = 1) -> None:
    """``ConfigurationError`` if it is no endpoint; ``kind`` names the setting in the message."""
    wrong = ConfigurationError(f"{kind} = {endpoint!r}: must be {ENDPOINT}")
    protocol, separator, rest = endpoint.partition("/")
    if not separator or not rest:
        raise wrong
    if protocol in NETWORK_PROTOCOLS:
        match = _HOST_AND_PORT.fullmatch(_address(endpoint))
        if match is None or not port_min <= int(match[2]) <= 65535:
            raise wrong
    elif protocol not in (*LOCAL_PROTOCOLS, *OTHER_PROTOCOLS):
        known = ", ".join(NETWORK_PROTOCOLS)
        raise ConfigurationError(
            f"{kind} = {endpoint!r}: protocol {protocol!r} is not one of {known}"
        )


def host_and_port(endpoint: str) -> tuple[str, int]:
    """Host and port of an endpoint that has them and has been checked."""
    match = _HOST_AND_PORT.fullmatch(_address(endpoint))
    assert match is not None, endpoint
    return match[1].strip("[]"), int(match[2])


def reachable_from_elsewhere(endpoints: Iterable[str]) -> tuple[str, ...]:
    """Those of some listening endpoints that another machine may be able to connect to."""
    return tuple(endpoint for endpoint in endpoints if not _is_local(endpoint))


def _is_local(endpoint: str) -> bool:
    protocol = endpoint.partition("/")[0]
    if protocol not in NETWORK_PROTOCOLS:
        return protocol in LOCAL_PROTOCOLS
    host = _address(endpoint).rpartition(":")[0].strip("[]")
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def _address(endpoint: str) -> str:
    """The address alone, without Zenoh's metadata (``?``) and settings (``#``) of an endpoint."""
    return re.split(r"[?#]", endpoint.partition("/")[2])[0]


def loopback_endpoint(endpoint: str) -> str:
    """The endpoint by which this machine itself reaches what listens on ``endpoint``."""
    protocol, _, rest = endpoint.partition("/")
    for everywhere, loopback in (("0.0.0.0:", "127.0.0.1:"), ("[::]:", "[::1]:")):
        if rest.startswith(everywhere):
            return f"{protocol}/{loopback}{rest.removeprefix(everywhere)}"
    return endpoint
