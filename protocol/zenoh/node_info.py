"""What a node says of itself when it is asked: who it is, its versions, what its clock shows.

World, robots and router answer a Zenoh query on a key of their own, with one msgpack map. It takes
no part in a run and in no digest; ``encircle doctor`` asks, and so can anybody else. A robot of
other make need not answer. The two times of the answer, together with those of asking and of
hearing it, are what an estimate of the offset between two clocks is made of.

Answers of any wire version are read, since to find out about it is what one asks for.
"""

import platform
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import msgpack

from encircle.protocol import VERSION
from encircle.protocol.errors import MalformedMessage
from encircle.protocol.zenoh.answers import unpacked_answer

ROUTER_KEY = "encircle/router/about"
"""No run's key looks like it: theirs go on with ``robots`` or ``world``."""
BYTES_MAX = 2048
TEXT_MAX = 64
VERSIONS_MAX = 16
TAKES_MAX = 16
TIME_US_MAX = 2**53 - 1
PACKAGES = ("encircle", "eclipse-zenoh")


@dataclass(frozen=True, slots=True)
class NodeInfo:
    """A node's answer. ``versions``: by package, and of Python; times: its clock, Unix time in us.

    ``wire``: the version of the wire format it speaks. ``received_us``: when it was asked;
    ``sent_us``: when it answered. ``takes``: the channels beyond those of every node of its wire
    version on which it takes messages.
    """

    node: str
    wire: int
    versions: Mapping[str, str]
    received_us: int
    sent_us: int
    takes: tuple[str, ...] = ()


@lru_cache(maxsize=1)
def versions_here() -> dict[str, str]:
    """Versions of this node's Python and packages."""
    versions_found = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            versions_found[name] = version(name)
        except PackageNotFoundError:  # run from a directory that nothing was installed from
            versions_found[name] = "not installed"
    return versions_found


def info_replier(
    node: str, clock_us: Callable[[], int], takes: Sequence[str] = ()
) -> Callable[[], bytes]:
    """A function that makes this node's answer to the query that has just come in."""
    versions = versions_here()

    def reply() -> bytes:
        received_us = clock_us()
        head = {"v": VERSION, "party": node, "versions": versions, "received_us": received_us}
        if takes:
            head["takes"] = list(takes)
        payload: bytes = msgpack.packb({**head, "sent_us": clock_us()})
        return payload

    return reply


def decode_info(payload: bytes) -> NodeInfo:
    """Decode an answer; ``OversizedMessage`` or ``MalformedMessage`` if it is none."""
    body = unpacked_answer(payload, BYTES_MAX)
    versions = body.get("versions")
    if not (
        _is_text(body.get("party"))
        and all(_is_count(body.get(name)) for name in ("v", "received_us", "sent_us"))
        and type(versions) is dict
        and len(versions) <= VERSIONS_MAX
        and all(_is_text(part) for pair in versions.items() for part in pair)
    ):
        raise MalformedMessage("the answer lacks v, party, versions, received_us or sent_us")
    times = body["received_us"], body["sent_us"]
    return NodeInfo(body["party"], body["v"], versions, *times, _takes(body.get("takes")))


def _takes(value: Any) -> tuple[str, ...]:
    """What a node takes; nothing that cannot be understood is a reason to refuse its answer."""
    is_list = type(value) in (list, tuple) and len(value) <= TAKES_MAX
    return tuple(value) if is_list and all(map(_is_text, value)) else ()


def _is_text(value: Any) -> bool:
    return type(value) is str and len(value) <= TEXT_MAX and value.isprintable()


def _is_count(value: Any) -> bool:
    return type(value) is int and 0 <= value <= TIME_US_MAX
