"""Where a page can be served: addresses of this machine, and which of them others reach."""

import ipaddress
import socket
from urllib.parse import urlsplit

LOOPBACK = "127.0.0.1"
HTTP_PORT = 80
"""Which browsers leave out."""


class ServerFailed(Exception):
    """The page cannot be served; the message says why."""


def listening_socket(host: str, port: int) -> socket.socket:
    """A socket that listens there; ``OSError`` if that cannot be."""
    family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    made = socket.create_server(address[:2], family=family)
    made.setblocking(False)
    return made


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach what listens there."""
    if host == "localhost":
        return True
    return is_address(host) and ipaddress.ip_address(host).is_loopback


def is_meant_for(asked: str, host: str, port: int) -> bool:
    """Whether a request is meant for the server of a host and port, by its ``Host`` header."""
    try:
        parts = urlsplit(f"//{asked}")
        name, asked_port = parts.hostname or "", parts.port or HTTP_PORT
    except ValueError:
        return False
    if asked_port != port:
        return False
    return name in ("localhost", host.lower()) or is_address(name)


def is_address(name: str) -> bool:
    """Whether this is an IP address, and so no name that a website can have."""
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True
