"""Messages that were valid, changed: by bits and bytes, and by what their msgpack holds.

Every change is drawn from the generator that is passed in, so that a seed makes the same bytes
again. A map is held as its pairs, so that a name may come twice; bytes that are themselves a
message, such as the packets in an inbox, are changed inside too.
"""

import math
import random
import struct
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import msgpack

Draws = random.Random
TIMES = (1, 1, 1, 2, 3)
NESTED_MAX = 700
"""Deeper than msgpack's own stack, which holds 512."""
LONG_SHARE, LONG_ITEMS = 0.002, 60_000


class Pairs(NamedTuple):
    """A map, as its pairs in their order."""

    pairs: list[list[Any]]


def mutant(draws: Draws, payload: bytes, others: Sequence[bytes]) -> tuple[str, bytes]:
    """A payload changed in one way or several; which one, and the bytes. ``others``: to splice."""
    if draws.random() < LONG_SHARE:
        return "long", _long(draws)
    name = draws.choice(tuple(CHANGES))
    for _ in range(draws.choice(TIMES)):
        try:
            payload = CHANGES[name](draws, payload, others)
        except RecursionError:
            break  # it is nested deeper than can be changed here
    return name, payload


# Bytes.


def _flip_bits(draws: Draws, payload: bytes, _: Sequence[bytes]) -> bytes:
    changed = bytearray(payload or b"\0")
    for _ in range(draws.randint(1, 3)):
        changed[draws.randrange(len(changed))] ^= 1 << draws.randrange(8)
    return bytes(changed)


def _set_bytes(draws: Draws, payload: bytes, _: Sequence[bytes]) -> bytes:
    changed = bytearray(payload or b"\0")
    changed[draws.randrange(len(changed))] = draws.choice((0, 0xC1, 0xFF, draws.randrange(256)))
    return bytes(changed)


def _truncate(draws: Draws, payload: bytes, _: Sequence[bytes]) -> bytes:
    return payload[: draws.randint(0, len(payload))]


def _insert(draws: Draws, payload: bytes, _: Sequence[bytes]) -> bytes:
    at = draws.randint(0, len(payload))
    piece = draws.choice((draws.randbytes(draws.randint(1, 40)), draws.choice(HEADERS)))
    return payload[:at] + piece + payload[at:]


def _overwrite_with_header(draws: Draws, payload: bytes, _: Sequence[bytes]) -> bytes:
    at, header = draws.randint(0, len(payload)), draws.choice(HEADERS)
    return payload[:at] + header + payload[at + draws.choice((1, len(header))) :]


def _cut_or_double(draws: Draws, payload: bytes, _: Sequence[bytes]) -> bytes:
    begin, end = sorted((draws.randint(0, len(payload)), draws.randint(0, len(payload))))
    return payload[:begin] + payload[begin:end] * draws.choice((0, 2)) + payload[end:]


def _splice(draws: Draws, payload: bytes, others: Sequence[bytes]) -> bytes:
    other = draws.choice(others)
    return payload[: draws.randint(0, len(payload))] + other[draws.randint(0, len(other)) :]


HEADERS = [bytes([first]) for first in range(0x80, 0x100)] + [
    bytes([first]) + struct.pack(form, count)
    for first, form in [(0xC6, ">I"), (0xC9, ">I"), (0xDB, ">I"), (0xDD, ">I"), (0xDF, ">I")]
    for count in (1, 2**16, 2**31, 2**32 - 1)
]
"""What announces more than follows."""

# What the msgpack holds.


def _another_value(draws: Draws, payload: bytes, _: Sequence[bytes]) -> bytes:
    return _within(draws, payload, lambda _value: odd_value(draws))


def _another_number(draws: Draws, payload: bytes, _: Sequence[bytes]) -> bytes:
    """Most are still numbers that a message may hold, so that more than its decoder is tried."""
    return _within(draws, payload, lambda value: _number_near(draws, value), _is_number)


def _another_text(draws: Draws, payload: bytes, _: Sequence[bytes]) -> bytes:
    return _within(draws, payload, lambda _value: draws.choice(TEXTS), lambda v: type(v) is str)


def _nested(draws: Draws, payload: bytes, _: Sequence[bytes]) -> bytes:
    depth, in_map = draws.choice((1, 3, 40, NESTED_MAX)), draws.random() < 0.5

    def wrapped(value: Any) -> Any:
        raw = packed(value)
        return Raw((b"\x81\xa1x" if in_map else b"\x91") * depth + raw)

    return _within(draws, payload, wrapped)


def _fields(draws: Draws, payload: bytes, _: Sequence[bytes]) -> bytes:
    """A map's pairs doubled, left out, added, named otherwise or in another order."""

    def changed(value: Any) -> Any:
        pairs = list(value.pairs)
        kind = draws.randrange(5)
        if kind == 0 and pairs:
            pairs.insert(draws.randint(0, len(pairs)), draws.choice(pairs))
        elif kind == 1 and pairs:
            pairs.pop(draws.randrange(len(pairs)))
        elif kind == 2:
            pairs.append([draws.choice((*TEXTS, 3, None)), odd_value(draws)])
        elif kind == 3 and pairs:
            at = draws.randrange(len(pairs))
            pairs[at] = [draws.choice((*TEXTS, b"v", 0)), pairs[at][1]]
        else:
            draws.shuffle(pairs)
        return Pairs(pairs)

    return _within(draws, payload, changed, lambda value: type(value) is Pairs)


def _items(draws: Draws, payload: bytes, _: Sequence[bytes]) -> bytes:
    """A list's items doubled, left out, turned around or many."""

    def changed(value: Any) -> Any:
        at = draws.randint(0, len(value))
        return draws.choice(
            (
                value * draws.choice((2, 17, 257)),
                value[:at],
                value[at:] + value[:at],
                [*value[:at], odd_value(draws), *value[at:]],
            )
        )

    return _within(draws, payload, changed, lambda value: type(value) is list)


def _version_or_run(draws: Draws, payload: bytes, _: Sequence[bytes]) -> bytes:
    """The bytes of another version, with its fields as this one's or without the later ones."""

    def changed(value: Any) -> Any:
        pairs = [list(pair) for pair in value.pairs]
        for pair in pairs:
            if pair[0] == "v":
                pair[1] = draws.choice((0, 1, 2, 3, 3, 5, 99, 2**63, -1, 4.0, "4", None, True))
            elif pair[0] == "run" and draws.random() < 0.2:
                pair[1] = draws.choice(("another", "", 0, None))
        if draws.random() < 0.5:
            pairs = [pair for pair in pairs if pair[0] not in LATER]
        return Pairs(pairs)

    return _within(draws, payload, changed, lambda value: type(value) is Pairs)


LATER = ("say", "estimate", "policy_parameters", "policy_source")
"""The fields that version 4 has added."""
CHANGES: dict[str, Callable[[Draws, bytes, Sequence[bytes]], bytes]] = {
    "bits flipped": _flip_bits,
    "bytes set": _set_bytes,
    "truncated": _truncate,
    "bytes inserted": _insert,
    "header overwritten": _overwrite_with_header,
    "piece cut or doubled": _cut_or_double,
    "spliced": _splice,
    "another value": _another_value,
    "another number": _another_number,
    "another text": _another_text,
    "nested": _nested,
    "fields": _fields,
    "items": _items,
    "another version": _version_or_run,
}

TEXTS = (
    *("", "r1", "r2", "r77", "world", "x" * 256, "x" * 257, "a/b", "*", "\0", "\u202e", "\u4e2d"),
    *("robot", "tick", "say", "v", "run", "encircle", "search", "stop", "steered", "captured"),
    *("xi-star", "auction", "voronoi", "nobody", "os:getcwd", "tests/x.py:f", "direct", "world"),
)
NUMBERS = (
    *(0, 1, -1, 2, 7, 255, 2**31, 2**53 - 1, 2**53, 2**63, 2**64 - 1, -(2**63)),
    *(0.0, -0.0, 0.5, 1e-300, 5e-324, 999_999_999.0, -999_999_999.0, 1e9, 1e300, -1e300),
    *(math.nan, math.inf, -math.inf, math.pi, -100.0, 1e6),
)


def odd_value(draws: Draws) -> Any:
    """Some value that is seldom the right one."""
    return draws.choice(
        (
            *(None, True, False, [], {}, [None], [[]], {"x": 1}, b"", b"\xff" * 20),
            draws.choice(NUMBERS),
            draws.choice(TEXTS),
            [draws.choice(NUMBERS), draws.choice(NUMBERS)],
            [["r2", 6, 1.0, 2.0]] * draws.choice((1, 16, 17)),
            {draws.choice(TEXTS): draws.choice(NUMBERS) for _ in range(draws.randint(0, 6))},
            [1.0] * draws.choice((8, 360, 361)),
            msgpack.ExtType(draws.randrange(128), draws.randbytes(draws.choice((0, 1, 8, 300)))),
            msgpack.Timestamp(draws.randrange(2**32)),
            Raw(b"\xc1"),
            Raw(b"\xa4\xff\xfe\xfd\xfc"),  # text that is no UTF-8
        )
    )


def _number_near(draws: Draws, value: Any) -> Any:
    changed = draws.choice(
        (
            *(value + 1, value - 1, -value, value * 2, value / 3.0, value * 1e6, float(value)),
            draws.choice(NUMBERS),
            draws.uniform(-20.0, 20.0),
        )
    )
    return changed if type(changed) is float or -(2**63) <= changed < 2**64 else 2**64 - 1


def _is_number(value: Any) -> bool:
    return type(value) in (int, float)


def _long(draws: Draws) -> bytes:
    element = draws.choice((b"\x01", b"\x90", b"\x80", b"\xa0", b"\xc0", b"\x81\xa1x\x01"))
    count = draws.randint(1, LONG_ITEMS)
    head = draws.choice((b"", b"\x82\xa1v\x04\xa5inbox", b"\x81\xa3say"))
    return head + b"\xdd" + struct.pack(">I", count) + element * count


# From bytes to what can be changed, and back.


class Raw(NamedTuple):
    """Bytes to stand where a value is, as they are."""

    raw: bytes


def packed(value: Any) -> bytes:
    """A value as msgpack, pairs and raw bytes among it."""
    if type(value) is Raw:
        return value.raw
    if type(value) is Pairs:
        head = _head(len(value.pairs), 0x80, 0xDE)
        return head + b"".join(packed(part) for pair in value.pairs for part in pair)
    if type(value) is list:
        return _head(len(value), 0x90, 0xDC) + b"".join(map(packed, value))
    if type(value) is dict:
        return packed(Pairs([list(pair) for pair in value.items()]))
    return bytes(msgpack.packb(value))


def _head(count: int, short: int, long: int) -> bytes:
    if count < 16:
        return bytes([short + count])
    return bytes([long + 1]) + struct.pack(">I", count)


def _unpacked(payload: bytes) -> Any:
    return msgpack.unpackb(
        payload,
        strict_map_key=False,
        object_pairs_hook=lambda pairs: Pairs([list(pair) for pair in pairs]),
    )


def _within(
    draws: Draws,
    payload: bytes,
    change: Callable[[Any], Any],
    fits: Callable[[Any], bool] = lambda _value: True,
) -> bytes:
    """The payload with one of the values inside it changed, of those that fit; else some bits."""
    try:
        tree = _unpacked(payload)
    except Exception:  # of a payload that was changed before
        return _flip_bits(draws, payload, ())
    places: list[tuple[Any, Any]] = []
    _find(tree, fits, places)
    if (fits(tree) and draws.random() < 0.3) or not places:
        return packed(change(tree)) if fits(tree) else _flip_bits(draws, payload, ())
    holder, at = draws.choice(places)
    value = holder[at]
    if type(value) is bytes and len(value) > 40 and draws.random() < 0.7:
        holder[at] = _within(draws, value, change, fits)
    else:
        holder[at] = change(value) if fits(value) else odd_value(draws)
    return packed(tree)


def _find(value: Any, fits: Callable[[Any], bool], places: list[tuple[Any, Any]]) -> None:
    """Note where values are that fit, and messages within bytes."""
    holders = value.pairs if type(value) is Pairs else [value] if type(value) is list else []
    for holder in holders:
        for at in range(1 if type(value) is Pairs else 0, len(holder)):
            item = holder[at]
            if fits(item) or (type(item) is bytes and len(item) > 40):
                places.append((holder, at))
            _find(item, fits, places)
