"""Messages to bytes and back. One msgpack map per message, string keys, ``v`` and ``run`` first.

Decoding trusts nothing: length, version, run, the exact set of fields, each once, each field's type
and every number's finiteness are checked, and the error names the field, its value and who sent it.
Fields, their order and their checks are those that the messages' classes declare
(``encircle.protocol.wire.declaration``). A long payload is looked through before it is unpacked,
which takes far more memory. Encoding is canonical: the order of fields is fixed, and a field that
may be left out is left out if it has its default; so equal messages have equal bytes.
"""

import math
import reprlib
from collections.abc import Mapping
from functools import lru_cache
from typing import Any, TypeAlias, TypeVar

import msgpack

from encircle.protocol import VERSION
from encircle.protocol.consistency import problem_of
from encircle.protocol.errors import MalformedMessage, OversizedMessage, WrongRun, WrongVersion
from encircle.protocol.messages import (
    Command,
    End,
    Intervention,
    Observation,
    Pose,
    Radio,
    Setup,
    State,
)
from encircle.protocol.wire.checks import are_plain_reports
from encircle.protocol.wire.layout import Layout, layout_of
from encircle.protocol.wire.limits import COUNT_MAX, PLACE_MAX, TEXT_MAX
from encircle.protocol.wire.packing import (
    DuplicateName,
    bytes_in_list,
    check_names,
    map_header,
    map_header_bytes,
    map_size,
)
from encircle.protocol.wire.payload import NOTHING_SAID
from encircle.protocol.wire.payload import payload as checked_payload

Message: TypeAlias = Setup | Observation | Pose | Command | End | State | Radio | Intervention

M = TypeVar("M", Setup, Observation, Pose, Command, End, State, Radio, Intervention)

BYTES_MAX: dict[type[Any], int] = {
    Setup: 64 * 1024,
    Observation: 4 * 1024 * 1024,
    Pose: 4096,
    Command: 16 * 1024,
    End: 1024,
    State: 256 * 1024,
    Radio: 1024 * 1024,
    Intervention: 16 * 1024,
}
_LAYOUTS = {kind: layout_of(kind) for kind in BYTES_MAX}
LEAN_BYTES_MAX = 64 * 1024
"""What an observation takes at most besides its packets, for the largest team."""
PACKET_BYTES_MIN = 64
"""No pose is shorter: the names of its fields alone take more."""
VERSION_AND_RUN_BYTES = 8  # "v", version, "run", and the size of a name below 32 letters
VERSION_AND_RUN_FIELDS = 2
SHOWN_MAX, UNKNOWN_SHOWN_MAX = 80, 5
_FLOAT = {float}
DECODED_POSES_MAX = 4096
_decoded_poses: dict[tuple[bytes, str], Pose] = {}
_NONE = type(None)
_POSE_TYPES = frozenset(
    (int, str, str, int, int, tuple, tuple, detection, str, xi, point, tuple, sent_us)
    for detection in (tuple, _NONE)
    for xi in (float, _NONE)
    for point in (int, _NONE)
    for sent_us in (int, _NONE)
)


def encode(message: Message, run: str) -> bytes:
    """The message's canonical bytes, for the given run."""
    payload = encode_any_length(message, run)
    assert len(payload) <= BYTES_MAX[type(message)], f"{type(message).__name__} of {len(payload)} B"
    return payload


def encode_any_length(message: Message, run: str, **instead: Any) -> bytes:
    """As ``encode``, without its limit: other senders pack longer, and envelopes shorter.

    ``instead``: values of fields, by name, that are written in place of the message's own.
    """
    layout = _LAYOUTS[type(message)]
    values = layout.values(message)
    if instead:
        changed = list(values)
        for name, value in instead.items():
            changed[layout.names.index(name) - VERSION_AND_RUN_FIELDS] = value
        values = tuple(changed)
    count = len(layout.always) - VERSION_AND_RUN_FIELDS
    # A map is packed as the list of its names and values in turn is, after the header, and that
    # takes half the time.
    in_turn = [*layout.names_in_turn]
    in_turn[1::2] = values[:count]
    packed: bytes = msgpack.packb(in_turn)
    parts = [packed[layout.list_header_bytes :]]
    if values[count:] != layout.default_values:
        for (name, default), value in zip(layout.defaults.items(), values[count:], strict=True):
            if value != default:
                parts.append(msgpack.packb(name) + msgpack.packb(value))
    headers = _headers(type(message), run)  # type: ignore[arg-type]  # types are hashable
    return headers[len(parts) - 1] + b"".join(parts)


def body_of(payload: bytes, run: str) -> bytes:
    """The payload without map size, version and run: what a digest covers.

    The payload must begin as ours do; see ``begins_canonically``.
    """
    return payload[map_header_bytes(payload) + VERSION_AND_RUN_BYTES + len(run) :]


def begins_canonically(kind: type[Any], payload: bytes, run: str) -> bool:
    """Whether version and run come first, in the shortest form. Not all senders do that."""
    return payload.startswith(_headers(kind, run))  # type: ignore[arg-type]  # types are hashable


@lru_cache(maxsize=64)
def _headers(kind: type[Any], run: str) -> tuple[bytes, ...]:
    """What a payload may begin with, by how many of the fields that may be left out are there."""
    parts: list[bytes] = [msgpack.packb(part) for part in ("v", VERSION, "run", run)]
    layout = _LAYOUTS[kind]
    sizes = range(len(layout.always), len(layout.names) + 1)
    return tuple([map_header(size) + b"".join(parts) for size in sizes])


def decode_pose(payload: bytes, run: str) -> Pose:
    """As ``decode(Pose, ...)``, remembered: one packet has many receivers in one process.

    A robot decodes one packet per peer and tick, so there is a quick way for packets like ours.
    """
    pose = _decoded_poses.get((payload, run))
    if pose is None:
        pose = _plain_pose(payload, run) or decode(Pose, payload, run)
        remember_pose(pose, payload, run)
    return pose


def remember_pose(pose: Pose, payload: bytes, run: str) -> None:
    """Remember a pose that this process has encoded itself, so that it need not decode it."""
    if len(_decoded_poses) >= DECODED_POSES_MAX:
        _decoded_poses.clear()
    _decoded_poses[payload, run] = pose


def _plain_pose(payload: bytes, run: str) -> Pose | None:
    """The pose if everything about it is as our encoder writes it; else ``decode`` is to judge."""
    if len(payload) > BYTES_MAX[Pose] or not begins_canonically(Pose, payload, run):
        return None
    try:
        body = msgpack.unpackb(payload, use_list=False)
    except Exception:  # as in decode, which will say what is wrong
        return None
    say = NOTHING_SAID
    if len(body) != len(_LAYOUTS[Pose].always):
        try:
            say = checked_payload(body.popitem()[1]) if next(reversed(body)) == "say" else say
            check_names(payload)
        except (ValueError, DuplicateName):
            return None
    if tuple(body) != _LAYOUTS[Pose].always or map_size(payload) != len(body) + bool(say):
        return None
    values = tuple(body.values())
    if tuple(map(type, values)) not in _POSE_TYPES:
        return None
    _, _, robot, tick, sequence, *rest = values
    position, velocity, detection, mode, xi, point, relayed, sent_us = rest
    numbers = position + velocity + (detection or ()) + (() if xi is None else (xi,))
    if (
        len(position) == len(velocity) == 2
        and (detection is None or len(detection) == 2)
        and set(map(type, numbers)) <= _FLOAT
        and math.isfinite(sum(numbers))
        and max(map(abs, numbers)) < PLACE_MAX
        and 0 <= tick <= COUNT_MAX
        and 0 <= sequence <= COUNT_MAX
        and (point is None or 0 <= point <= COUNT_MAX)
        and (sent_us is None or 0 <= sent_us <= COUNT_MAX)
        and len(robot) <= TEXT_MAX
        and len(mode) <= TEXT_MAX
        and (not relayed or are_plain_reports(relayed))
    ):
        return Pose(*(robot, tick, sequence, *rest, say))
    return None


def decode(kind: type[M], payload: bytes, run: str) -> M:
    """Decode and check a payload.

    Raises ``OversizedMessage``, ``MalformedMessage``, ``WrongVersion`` or ``WrongRun``.
    """
    if len(payload) > BYTES_MAX[kind]:
        raise OversizedMessage(
            f"{kind.__name__} of {len(payload)} bytes, at most {BYTES_MAX[kind]} are allowed"
        )
    if len(payload) > LEAN_BYTES_MAX and kind is Observation:
        _check_bulk(payload)
    try:
        body = msgpack.unpackb(payload, use_list=False)
    except Exception as error:  # msgpack raises ValueError, TypeError, StackError and others
        raise MalformedMessage(f"{kind.__name__} is not msgpack: {error or type(error)}") from error
    if type(body) is not dict:
        raise MalformedMessage(f"{kind.__name__} is not a map but {_shown(body)}")
    if type(body.get("v")) is not int or body["v"] != VERSION:
        raise WrongVersion(
            f"{kind.__name__} has version {_shown(body.get('v'))}, this program speaks {VERSION}"
        )
    if body.get("run") != run:
        raise WrongRun(f"{kind.__name__} is for run {_shown(body.get('run'))}, this is {run!r}")
    layout = _LAYOUTS[kind]
    if tuple(body) == layout.names:
        values = tuple(body.values())[2:]
    else:
        values = _values_in_order(kind, layout, body)
    # Unpacked, a field that came twice is there once; the map's header tells.
    if payload[0] != 0x80 + len(body) and map_size(payload) != len(body):
        raise MalformedMessage(f"{kind.__name__}: a field comes twice")
    for index in layout.map_indices:
        if values[index]:
            _check_names(kind, payload)
            break
    try:
        message = kind(*[check(value) for check, value in zip(layout.checks, values, strict=True)])
    except (TypeError, ValueError):
        raise _wrong_value(kind, body, values) from None
    if (problem := problem_of(message)) is not None:
        raise MalformedMessage(f"{kind.__name__}: {problem}")
    return message


def _check_bulk(payload: bytes) -> None:
    """Refuse, without unpacking it, an observation that is long for another reason than packets."""
    try:
        packets = bytes_in_list(
            payload, "inbox", PACKET_BYTES_MIN, len(_LAYOUTS[Observation].names)
        )
    except Exception as error:  # as in decode
        raise MalformedMessage(f"Observation is not msgpack: {error or type(error)}") from error
    if len(payload) - packets > LEAN_BYTES_MAX:
        raise MalformedMessage(
            f"Observation has {len(payload) - packets} bytes besides its packets,"
            f" at most {LEAN_BYTES_MAX} are allowed"
        )


def _check_names(kind: type[Any], payload: bytes) -> None:
    """Refuse a name that comes twice in a map inside the message."""
    try:
        check_names(payload)
    except DuplicateName as error:
        raise MalformedMessage(f"{kind.__name__}: {_shown(str(error))} comes twice") from None


def _values_in_order(kind: type[Any], layout: Layout, body: Mapping[Any, Any]) -> tuple[Any, ...]:
    """The values of fields that came in another order, or of which some are left out."""
    missing = [name for name in layout.always if name not in body]
    unknown = [name for name in body if name not in layout.names]
    if missing or unknown:
        shown = sorted([str(name)[:SHOWN_MAX] for name in unknown])[:UNKNOWN_SHOWN_MAX]
        raise MalformedMessage(
            f"{kind.__name__}: fields missing {sorted(missing)}, unknown {shown}"
        )
    values = {**layout.defaults, **body}
    return tuple([values[name] for name in layout.names[2:]])


def _wrong_value(
    kind: type[Any], body: Mapping[str, Any], values: tuple[Any, ...]
) -> MalformedMessage:
    """The error that names the first field whose value is refused."""
    layout = _LAYOUTS[kind]
    for name, check, value in zip(layout.names[2:], layout.checks, values, strict=True):
        try:
            check(value)
        except (TypeError, ValueError) as error:
            return MalformedMessage(
                f"{kind.__name__} from {_shown(body.get('robot', 'world'))}:"
                f" {name} is {_shown(value)}, must be {error}"
            )
    raise AssertionError(f"{kind.__name__}: no field is wrong")


def _shown(value: object) -> str:
    # reprlib goes neither deep nor far, whatever a stranger sends.
    text = reprlib.repr(value)
    return text if len(text) <= SHOWN_MAX else text[:SHOWN_MAX] + "..."
