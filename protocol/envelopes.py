"""Envelopes: several messages between the world and one process in one.

A process of one or several robots answers a round with one message instead of a pose and a command
for each of its robots, and the world asks those robots with one. Whoever opens an envelope has the
messages as they would have come by themselves, byte for byte, each with its key; what they mean,
and all checks, are as ever. Observations of one round have many packets in common: an envelope
holds each packet once, and with each observation the numbers of those in its inbox.

Only a node that is known to open envelopes is sent one: the world says so in its node information,
and a process by its first envelope.
"""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import msgpack

from encircle.protocol import VERSION
from encircle.protocol.codec import BYTES_MAX
from encircle.protocol.errors import MalformedMessage, OversizedMessage, WrongRun, WrongVersion
from encircle.protocol.keys import robot_key
from encircle.protocol.messages import Observation

ANSWERS, OBSERVATIONS = "answers", "observations"
"""Last parts of the keys of envelopes: from a process to the world, and from the world to it."""
INSIDE = {ANSWERS: ("pose", "command"), OBSERVATIONS: ("observation",)}
ANSWERS_BYTES_MAX = 48 * 1024
"""A world takes no message above 64 KiB; an answer of one robot takes 20 KiB at most."""
OBSERVATIONS_BYTES_MAX = 512 * 1024
"""Half of what a gate has room for on the way to one node."""
_EMPTY_INBOX = b"\xa5inbox\x90"


class Enclosed(NamedTuple):
    """A message in an envelope: the robot and channel of its key, its bytes.

    ``inbox``: of an observation that was encoded with an empty inbox, the packets that were in it.
    """

    robot: str
    channel: str
    payload: bytes
    inbox: Sequence[bytes] = ()


def sealed(messages: Sequence[Enclosed], run: str, bytes_max: int) -> Iterator[bytes]:
    """Envelopes with the messages in their order, none much longer than ``bytes_max``."""
    packets: dict[bytes, int] = {}
    rows: list[tuple[str, str, bytes, list[int]]] = []
    length = 0
    for robot, channel, payload, inbox in messages:
        added = len(payload) + 2 * len(inbox)
        added += sum(len(packet) for packet in inbox if packet not in packets)
        if rows and length + added > bytes_max:
            yield _envelope(packets, rows, run)
            packets, rows, length = {}, [], 0
            added = len(payload) + sum(len(packet) + 2 for packet in inbox)
        numbers = [packets.setdefault(packet, len(packets)) for packet in inbox]
        rows.append((robot, channel, payload, numbers))
        length += added
    if rows:
        yield _envelope(packets, rows, run)


def _envelope(
    packets: dict[bytes, int], rows: list[tuple[str, str, bytes, list[int]]], run: str
) -> bytes:
    body = {"v": VERSION, "run": run, "packets": list(packets), "messages": rows}
    envelope: bytes = msgpack.packb(body)
    return envelope


def opened(channel: str, envelope: bytes, run: str) -> Iterator[tuple[str, bytes]]:
    """The messages of an envelope that came on a key with this last part: key and payload of each.

    Raises ``MalformedMessage``, ``OversizedMessage``, ``WrongVersion`` or ``WrongRun``, at once for
    what is wrong with the envelope itself.
    """
    packets, rows = _read(envelope, run)
    allowed = INSIDE[channel]
    for row in rows:
        if not _is_row(row, allowed, len(packets)):
            raise MalformedMessage(f"{channel}: not a message of {' or '.join(allowed)}")
        robot, inside, payload, numbers = row
        if numbers:
            payload = with_inbox(payload, [packets[number] for number in numbers])
        yield robot_key(run, robot, inside), payload


def _read(envelope: bytes, run: str) -> tuple[tuple[bytes, ...], tuple[Any, ...]]:
    try:
        body = msgpack.unpackb(envelope, use_list=False)
    except Exception as error:  # msgpack raises ValueError, TypeError, StackError and others
        raise MalformedMessage(f"an envelope is not msgpack: {error or type(error)}") from error
    if type(body) is not dict or set(body) != {"v", "run", "packets", "messages"}:
        raise MalformedMessage("an envelope must have v, run, packets and messages")
    if type(body["v"]) is not int or body["v"] != VERSION:
        raise WrongVersion(f"an envelope of version {body['v']!r:.20}, not {VERSION}")
    if body["run"] != run:
        raise WrongRun(f"an envelope for run {body['run']!r:.40}, this is {run!r}")
    packets, rows = body["packets"], body["messages"]
    if type(packets) is not tuple or type(rows) is not tuple or not _are_bytes(packets):
        raise MalformedMessage("an envelope's packets must be byte strings, its messages a list")
    return packets, rows


def _are_bytes(packets: tuple[Any, ...]) -> bool:
    return all(type(packet) is bytes for packet in packets)


def _is_row(row: Any, allowed: Sequence[str], packets: int) -> bool:
    if type(row) is not tuple or tuple(map(type, row)) != (str, str, bytes, tuple):
        return False
    return row[1] in allowed and all(type(n) is int and 0 <= n < packets for n in row[3])


def with_inbox(observation: bytes, inbox: Sequence[bytes]) -> bytes:
    """An observation, encoded with an empty inbox, as it is with these packets in it.

    ``MalformedMessage`` if it has no empty inbox, ``OversizedMessage`` if it becomes too long.
    """
    # What follows the inbox are numbers and names of robots, which cannot look like this.
    at = observation.rfind(_EMPTY_INBOX)
    if at < 0:
        raise MalformedMessage("an observation in an envelope has no empty inbox")
    at += len(_EMPTY_INBOX) - 1
    if len(observation) + sum(map(len, inbox)) + 5 * len(inbox) > BYTES_MAX[Observation]:
        raise OversizedMessage("an observation in an envelope is too long with its inbox")
    packed: bytes = msgpack.packb(inbox if type(inbox) is list else list(inbox))
    return b"".join((observation[:at], packed, observation[at + 1 :]))
