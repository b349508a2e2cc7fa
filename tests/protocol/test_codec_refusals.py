"""Whatever is wrong with a payload raises the right error, naming what is wrong, and no other.

Oracle: the table of wrong values below, by the kind of field, written from ``docs`` and the
messages' annotations rather than from the decoder.
"""

from math import inf, nan
from typing import Any

import msgpack
import pytest
from helpers_messages import SAMPLES
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.protocol.codec import BYTES_MAX, decode, decode_pose, encode
from encircle.protocol.errors import (
    MalformedMessage,
    OversizedMessage,
    ProtocolError,
    WrongRun,
    WrongVersion,
)
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
from encircle.protocol.wire.declaration import declared_fields

TEXT = (5, None, b"r1", ["r1"], True, "x" * 257)
COUNT = (-1, 1.0, "1", True, None, 2**53, [1])
TOO_LARGE = (1e9, -1e9, 10**9, 1e308)
COUNT_OR_NONE = tuple(value for value in COUNT if value is not None)
NUMBER = ("1", nan, inf, -inf, True, None, 2**53, [1.0], *TOO_LARGE)
POINT_OR_NONE = (
    1.0,
    [],
    [1.0],
    [1.0, 2.0, 3.0],
    [nan, 0.0],
    [0.0, -inf],
    ["1", 2.0],
    [True, 0.0],
    [None, 0.0],
    [[1.0], 2.0],
    [0, 2**53],
    [1e9, 0.0],
    [0.0, -1e9],
    [0, 10**9],
    "ab",
    b"ab",
    {"x": 1.0, "y": 2.0},
    msgpack.ExtType(5, b"ab"),
    msgpack.Timestamp(1, 2),
)
POINT = (*POINT_OR_NONE, None)
NOT_A_LIST = (None, 1.0, "ab", b"ab", {"a": 1.0})
NUMBERS = (
    *NOT_A_LIST,
    ["1"],
    [nan],
    [inf, -inf],
    [1.0, True],
    [None],
    [[1.0]],
    [1e9],
    [0.0, -1e9],
    [1e308, 1e308],
)
COUNTS_BY_NAME = (None, [], "a", {"a": -1}, {"a": 1.5}, {"a": None}, {b"a": 1}, {"a": True})
NO_FATES = ([[0, 5]], [[0, 5], [5]], [[5, 5], [5, 0]], [[0, 4], [0, 0]], [[0, -13], [0, 0]])
"""No tables of what became of packets that two robots sent at tick 4."""
NOT_PLAIN: tuple[Any, ...] = (
    *(None, [], "a", 1.0, {b"a": 1}, {"a": {b"a": 1}}),
    *({"a": number} for number in (nan, inf, -inf, 2**53)),
    *({"a": [1.0, {"b": [[number]]}]} for number in (nan, -inf)),
    {"a": msgpack.ExtType(5, b"ab")},
    {"a": [msgpack.Timestamp(1, 2)]},
)
PLAIN_MAP = (*NOT_PLAIN, *({"a": number} for number in TOO_LARGE), {"a": [1.0, {"b": [[1e9]]}]})
DEEP: Any = {"a": {"a": {"a": {"a": {"a": {"a": {"a": 1}}}}}}}
SAY = (*NOT_PLAIN, {"a": "x" * 1030}, {"a": {"b": b"x" * 1030}}, DEEP)

_TOLD = [3, 1.0, 2.0, 0.0, -0.5, 1.0, 0.5, 2.0]
NOT_POSITIVE_DEFINITE = ([0, 0, 1], [1, 0, 0], [1, 1, 1], [1.0, -2.0, 1.0], [-1.0, 0.0, -1.0])
"""Covariances that no estimate can have; ``_TOLD`` is one as a robot may tell it at tick 3."""

WRONG: dict[type[Any], dict[str, tuple[Any, ...]]] = {
    Setup: {
        "robot": TEXT,
        "team": (*NOT_A_LIST, [1], [None], ["r1", b"r2"], ["r"] * 257, ["r1", "r1"], [""], ["r 1"]),
        "tick_s": (*NUMBER, 0.0, 0, -0.1),
        "strategy": TEXT,
        "parameters": PLAIN_MAP,
        "policy_parameters": PLAIN_MAP,
        "policy_source": TEXT,
        "radio": (*TEXT, "", "World", "wifi", {}, ["world"]),
        "first_tick": COUNT,
        "answer_tick": COUNT,
    },
    Observation: {
        "robot": TEXT,
        "tick": COUNT,
        "position": POINT,
        "heading_rad": (*NUMBER, 3.2, -3.2),
        "target": POINT_OR_NONE,
        "scan": (*NUMBERS, [], [1.0] * 7, [1] * 361, [1.0] * 7 + [-0.1], [1] * 7 + [-1]),
        "seen": (
            *NOT_A_LIST,
            ["r2"],
            [["r2", 1.0]],
            [["r2", 1.0, 2.0, 3.0]],
            [["r2", nan, 0.0]],
            [["r2", inf, -inf]],
            [["r2", 1e9, 0.0]],
            [["r2", 0.0, -1e9]],
            [["r2", 0, 10**9]],
            [[2, 1.0, 2.0]],
            [["r2", "1", 2.0]],
            [["x" * 257, 1, 2.0]],
            [["x" * 257, 1.0, 2.0]],
        ),
        "inbox": (*NOT_A_LIST, ["a"], [1], [None], [[b"a"]]),
        "lost": (*NOT_A_LIST, [1], [None], ["r1", b"r2"], ["r"] * 257),
        "sent_us": COUNT_OR_NONE,
        "answered": COUNT_OR_NONE,
        "admitted": (
            1.0,
            "ab",
            {},
            [None],
            ["r2"],
            [["r2"]],
            [["r2", -1]],
            [[2, 1]],
            [["r2", 1, 2]],
        ),
    },
    Pose: {
        "robot": TEXT,
        "tick": COUNT,
        "sequence": COUNT,
        "position": POINT,
        "velocity": POINT,
        "detection": POINT_OR_NONE,
        "mode": TEXT,
        "xi": tuple(v for v in NUMBER if v is not None),
        "point": COUNT_OR_NONE,
        "relayed": (
            *NOT_A_LIST,
            [None],
            ["r1"],
            [["r1", 2, 1.0]],
            [["r1", 2, 1.0, 2.0, 3.0]],
            [[1, 2, 1.0, 2.0]],
            [["x" * 257, 2, 1.0, 2.0]],
            [["r1", -1, 1.0, 2.0]],
            [["r1", 2.0, 1.0, 2.0]],
            [["r1", True, 1.0, 2.0]],
            [["r1", 2**53, 1.0, 2.0]],
            [["r1", 2, nan, 2.0]],
            [["r1", 2, 1.0, -inf]],
            [["r1", 2, 1e9, 2.0]],
            [["r1", 2, "1", 2.0]],
            [["r1", 2, 1.0, None]],
            [["r1", 2, [1.0, 2.0], 3.0]],
            [["r1", 2, 1.0, 2.0], ["r1", 1, 1.0, nan]],
            [["r1", 2, 1.0, 2.0]] * 17,
            [["r1", 2, 1, 2]] * 17,
        ),
        "sent_us": COUNT_OR_NONE,
        "say": SAY,
        "estimate": (
            *(v for v in NOT_A_LIST if v is not None),
            [],
            [2, 1.0, 2.0, 0.0, 0.0, 1.0, 0.0],
            [2, 1.0, 2.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0],
            *([*_TOLD[:k], wrong, *_TOLD[k + 1 :]] for k in range(1, 8) for wrong in NUMBER),
            *([wrong, *_TOLD[1:]] for wrong in (*COUNT, 4)),
            *([*_TOLD[:5], *wrong] for wrong in NOT_POSITIVE_DEFINITE),
        ),
    },
    Command: {
        "robot": TEXT,
        "tick": COUNT,
        "step": POINT,
        "mode": TEXT,
        "xi": tuple(v for v in NUMBER if v is not None),
        "point": COUNT_OR_NONE,
        "goal": POINT_OR_NONE,
        "estimate": POINT_OR_NONE,
        "predictor": tuple(v for v in TEXT if v is not None),
        "team": (*NOT_A_LIST, [1], [None], ["r1", b"r2"], ["r"] * 257),
        "published": (None, 0, 1, "true", 1.0, []),
        "refused": COUNTS_BY_NAME,
        "timing": (
            *(v for v in NOT_A_LIST if v is not None),
            [],
            [1, 2],
            [1, 2, None],
            [1, 2, [], []],
            [-1, 2, []],
            [1, 2.0, []],
            [1, 2**53, []],
            [1, 2, ["r2"]],
            [1, 2, [["r2", 3]]],
            [1, 2, [["r2", 3, 4, 5]]],
            [1, 2, [[2, 3, 4]]],
            [1, 2, [["r2", -3, 4]]],
            [1, 2, [["r2", 3, 4.0]]],
            [1, 2, [["x" * 257, 3, 4]]],
            [1, 2, [["r2", 3, 4]] * 257],
        ),
    },
    End: {
        "robot": TEXT,
        "tick": COUNT,
        "reason": (*TEXT, "", "over", "Failed: so", "failed: " + "x" * 193),
    },
    State: {
        "tick": COUNT,
        "robots": (*NOT_A_LIST, [1.0], [None], [[1.0]], [[nan, 0.0]], [b"ab"]),
        "headings_rad": (*NUMBERS, [3.2], [], [0.0, 0.0]),
        "target": POINT,
        "captured": (None, 0, 1, "true", 1.0),
        "contacts": (*NOT_A_LIST, ["ab"], [["r1"]], [["r1", 2]], [["r1", "r2", "r3"]]),
    },
    Radio: {
        "tick": COUNT,
        "fates": (*NOT_A_LIST, [1], [[1.0]], [[True]], [["1"]], [[2**53]], [None], *NO_FATES),
        "copies": (
            *(*NOT_A_LIST, [1], [[1.0]], [[True]], [["1"]], [[2**53]], [None]),
            *(*NO_FATES, [[0, -1], [0, 0]]),
        ),
    },
    Intervention: {"tick": COUNT, "event": NOT_PLAIN},
}
WRONG_BY_TYPE = {
    "text": TEXT,
    "text or null": tuple(v for v in TEXT if v is not None),
    "count": COUNT,
    "count or null": COUNT_OR_NONE,
    "real": NUMBER,
    "real or null": tuple(v for v in NUMBER if v is not None),
    "point": POINT,
    "point or null": POINT_OR_NONE,
    "boolean": (None, 0, 1, "true", 1.0, []),
    "map, text to count": COUNTS_BY_NAME,
}
"""By the type that docs/protocol.md gives a field, for those that the table above leaves out."""
ALWAYS = {
    kind: [field.name for field in declared_fields(kind) if not field.may_be_left_out]
    for kind in SAMPLES
}
KINDS = pytest.mark.parametrize("kind", SAMPLES, ids=lambda kind: kind.__name__)
FUZZ = settings(max_examples=300, deadline=None, derandomize=True)


def body_of_sample(kind):
    return msgpack.unpackb(encode(SAMPLES[kind], "g1"))


def refusal(kind, payload, error):
    """The message of the error, which must be of exactly this type."""
    with pytest.raises(ProtocolError) as caught:
        decode(kind, payload, "g1")
    assert type(caught.value) is error, f"{type(caught.value).__name__}: {caught.value}"
    return str(caught.value)


WRONG_VALUES = [
    pytest.param(kind, field.name, value, id=f"{kind.__name__}-{field.name}-{place}")
    for kind, fields in WRONG.items()
    for field in declared_fields(kind)
    for place, value in enumerate(fields.get(field.name) or WRONG_BY_TYPE[field.type.text])
]


@pytest.mark.parametrize(("kind", "name", "value"), WRONG_VALUES)
def test_a_wrong_value_is_malformed_and_the_error_names_kind_and_field(kind, name, value):
    payload = msgpack.packb(body_of_sample(kind) | {name: value})
    message = refusal(kind, payload, MalformedMessage)
    assert message.startswith(kind.__name__)
    assert name in message
    assert len(message) < 500


def test_the_table_of_wrong_values_covers_every_field():
    assert {(case.values[0], case.values[1]) for case in WRONG_VALUES} == {
        (kind, name) for kind in SAMPLES for name in kind.__slots__
    }


def test_there_is_no_copy_of_a_packet_that_was_not_sent():
    body = body_of_sample(Radio) | {"fates": [[0, 5], [0, 0]], "copies": [[0, 0], [6, 0]]}
    assert "copies" in refusal(Radio, msgpack.packb(body), MalformedMessage)


def test_the_error_says_who_sent_what():
    payload = msgpack.packb(body_of_sample(Pose) | {"position": [nan, 0.0]})
    message = refusal(Pose, payload, MalformedMessage)
    assert "'r2'" in message
    assert "nan" in message


@KINDS
def test_each_missing_field_is_named(kind):
    body = body_of_sample(kind)
    for name in ALWAYS[kind]:
        rest = {key: value for key, value in body.items() if key != name}
        assert f"missing ['{name}']" in refusal(kind, msgpack.packb(rest), MalformedMessage)


@KINDS
@pytest.mark.parametrize("name", ["speed", b"speed", "s" * 200], ids=["text", "bytes", "long"])
def test_an_unknown_field_is_named(kind, name):
    message = refusal(kind, msgpack.packb(body_of_sample(kind) | {name: 1.0}), MalformedMessage)
    assert ("speed" in message) or ("s" * 80 in message)
    assert len(message) < 500


@KINDS
def test_an_unknown_field_in_place_of_another_names_both(kind):
    body = body_of_sample(kind)
    body["speed"] = body.pop(ALWAYS[kind][-1])
    message = refusal(kind, msgpack.packb(body), MalformedMessage)
    assert "speed" in message
    assert ALWAYS[kind][-1] in message


@KINDS
@pytest.mark.parametrize("version", [0, 2, 3, 5, -1, "4", None, True, 1.0])
def test_another_version_is_refused_before_anything_else_is_looked_at(kind, version):
    payload = msgpack.packb({**body_of_sample(kind), "v": version, "speed": 1.0})
    assert f"version {version!r}," in refusal(kind, payload, WrongVersion)


@KINDS
def test_a_message_without_a_version_or_a_run_is_refused(kind):
    for name, error in (("v", WrongVersion), ("run", WrongRun)):
        body = body_of_sample(kind)
        del body[name]
        assert "None" in refusal(kind, msgpack.packb(body), error)


@KINDS
@pytest.mark.parametrize("run", ["g2", "G1", "", b"g1", 1, "g1" * 100])
def test_another_run_is_refused(kind, run):
    message = refusal(kind, msgpack.packb(body_of_sample(kind) | {"run": run}), WrongRun)
    assert "'g1'" in message
    assert len(message) < 300


@KINDS
def test_what_is_too_long_is_refused_unread(kind):
    limit = BYTES_MAX[kind]
    assert str(limit + 1) in refusal(kind, b"\xc1" * (limit + 1), OversizedMessage)
    refusal(kind, b"\xc1" * limit, MalformedMessage)


@KINDS
def test_every_truncation_is_malformed(kind):
    payload = encode(SAMPLES[kind], "g1")
    for length in range(len(payload)):
        refusal(kind, payload[:length], MalformedMessage)


@KINDS
def test_bytes_after_the_message_are_malformed(kind):
    refusal(kind, encode(SAMPLES[kind], "g1") + b"\xc0", MalformedMessage)


@KINDS
@pytest.mark.parametrize(
    "value", [None, 1, "text", b"bytes", [], [1, 2], 1.5, msgpack.Timestamp(0)]
)
def test_what_is_not_a_map_is_malformed(kind, value):
    assert "not a map" in refusal(kind, msgpack.packb(value), MalformedMessage)


@pytest.mark.parametrize("depth", [1, 200, 500, 900, 1000, 1020, 1024, 5000, 400_000])
def test_deep_nesting_is_malformed(depth):
    refusal(Observation, b"\x91" * depth + b"\xc0", MalformedMessage)


@pytest.mark.parametrize("depth", [1, 200, 500, 900, 1000, 1020, 1024, 5000])
def test_deep_nesting_inside_a_field_is_malformed_and_names_the_field(depth):
    payload = encode(SAMPLES[Observation], "g1")
    start = payload.index(b"scan") + 4
    nested = payload[:start] + b"\x91" * depth + payload[start:]
    message = refusal(Observation, nested, MalformedMessage)
    assert "scan" in message or "not msgpack" in message


@KINDS
@FUZZ
@given(st.binary(max_size=400))
def test_random_bytes_raise_nothing_but_protocol_errors(kind, payload):
    with pytest.raises(ProtocolError):
        decode(kind, payload, "g1")


@KINDS
@FUZZ
@given(st.data())
def test_a_damaged_message_is_refused_or_is_a_message_that_can_be_sent_on(kind, data):
    payload = bytearray(encode(SAMPLES[kind], "g1"))
    for _ in range(data.draw(st.integers(1, 3))):
        payload[data.draw(st.integers(0, len(payload) - 1))] = data.draw(st.integers(0, 255))
    try:
        message = decode(kind, bytes(payload), "g1")
    except ProtocolError:
        return
    assert decode(kind, encode(message, "g1"), "g1") == message


@KINDS
def test_a_field_that_comes_twice_is_refused_wherever_it_stands(kind):
    payload = encode(SAMPLES[kind], "g1")
    for name, value in body_of_sample(kind).items():
        again = msgpack.packb(name) + msgpack.packb(value)
        for doubled in (payload[1:] + again, again + payload[1:]):
            for header in (bytes([payload[0] + 1]), b"\xde\x00" + bytes([payload[0] - 0x7F])):
                if header != b"\x90":  # a map of 16 has no short header
                    assert "twice" in refusal(kind, header + doubled, MalformedMessage)


def test_a_name_that_comes_twice_in_a_map_within_is_refused():
    for kind, name in ((Setup, "parameters"), (Command, "refused")):
        body = msgpack.packb(body_of_sample(kind) | {name: {"late": 2}})
        doubled = body.replace(b"\x81\xa4late\x02", b"\x82\xa4late\x02\xa4late\x03")
        assert doubled != body
        assert refusal(kind, doubled, MalformedMessage) == f"{kind.__name__}: 'late' comes twice"


def test_a_message_may_say_its_map_in_a_longer_header():
    for kind, message in SAMPLES.items():
        payload = encode(message, "g1")
        size = payload[0] - 0x80
        for header in (b"\xde" + size.to_bytes(2, "big"), b"\xdf" + size.to_bytes(4, "big")):
            assert decode(kind, header + payload[1:], "g1") == message


def test_an_observation_may_be_long_by_packets_and_by_nothing_else():
    sample = body_of_sample(Observation)
    packets = [bytes([k % 256]) * 200 for k in range(10_000)]
    body = sample | {"inbox": packets}
    assert decode(Observation, msgpack.packb(body), "g1").inbox == tuple(packets)
    assert (
        decode(Observation, msgpack.packb(dict(reversed(body.items()))), "g1").inbox[0]
        == b"\0" * 200
    )
    long = {
        "scan": [1.0] * 10_000,
        "seen": [["r2", 1.0, 2.0]] * 4_000,
        "lost": ["r2"] * 30_000,
        "position": [[{}] * 70_000, 1.0],
        "inbox": [b"ab"] * 40_000,
        "tick": {"x": [b"a" * 200] * 400},
    }
    for name, value in long.items():
        message = refusal(Observation, msgpack.packb(body | {name: value}), MalformedMessage)
        assert "besides its packets, at most 65536 are allowed" in message
    strings = msgpack.packb(body | {"inbox": ["a" * 200] * 1_000})
    assert "besides its packets" in refusal(Observation, strings, MalformedMessage)
    cut = msgpack.packb(body)[:-1]
    assert "not msgpack" in refusal(Observation, cut, MalformedMessage)


FAR = (1.1e7, -1.1e7, 999_999_999.0)
NEAR_M = 1e7
PLACES = (
    (Observation, "position", lambda m: [m, 0.0]),
    (Observation, "target", lambda m: [0.0, m]),
    (Observation, "seen", lambda m: [["r2", 0.0, m]]),
    (Pose, "position", lambda m: [m, 0.0]),
    (Pose, "velocity", lambda m: [0.0, m]),
    (Pose, "detection", lambda m: [m, m]),
    (Pose, "relayed", lambda m: [["r1", 2, m, 0.0]]),
    (Pose, "estimate", lambda m: [3, 0.0, 0.0, m, 0.0, 1.0, 0.0, 1.0]),
)


@pytest.mark.parametrize(("kind", "name", "value"), PLACES)
def test_what_no_robot_can_calculate_with_is_refused(kind, name, value):
    """A place of 999,999,999 m has failed policies, whose next number was beyond what can be."""
    body = msgpack.unpackb(encode(SAMPLES[kind], "g1"))
    assert getattr(decode(kind, msgpack.packb(body | {name: value(NEAR_M)}), "g1"), name)
    for far in FAR:
        payload = msgpack.packb(body | {name: value(far)})
        with pytest.raises(MalformedMessage, match=f"{kind.__name__}: {name} has "):
            decode(kind, payload, "g1")
        if kind is Pose:
            with pytest.raises(MalformedMessage):
                decode_pose(payload, "g1")
