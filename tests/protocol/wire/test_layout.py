"""Fields that may be left out: a later one changes no bytes of messages that do without it.

Two kinds of message stand for one kind before and after a field was added to it.
"""

from dataclasses import dataclass
from typing import Annotated

import msgpack
import pytest

from encircle.protocol import codec
from encircle.protocol.codec import begins_canonically, body_of, decode, encode
from encircle.protocol.describe import table
from encircle.protocol.errors import MalformedMessage
from encircle.protocol.wire.declaration import Field
from encircle.protocol.wire.field_types import Count, Real, Text
from encircle.protocol.wire.layout import layout_of


@dataclass(frozen=True, slots=True)
class Before:
    robot: Annotated[Text, Field("the sender")]
    tick: Annotated[Count, Field("the tick")]


@dataclass(frozen=True, slots=True)
class After:
    robot: Annotated[Text, Field("the sender")]
    tick: Annotated[Count, Field("the tick")]
    battery: Annotated[Real | None, Field("charge that is left", may_be_left_out=True)] = None
    errors: Annotated[Count, Field("faults so far", may_be_left_out=True)] = 0


@pytest.fixture(autouse=True)
def _kinds(monkeypatch):
    for kind in (Before, After):
        monkeypatch.setitem(codec.BYTES_MAX, kind, 1000)
        monkeypatch.setitem(codec._LAYOUTS, kind, layout_of(kind))


def test_a_message_whose_fields_have_their_defaults_is_the_bytes_that_it_was():
    assert encode(After("r1", 7), "g1") == encode(Before("r1", 7), "g1")
    assert decode(After, encode(Before("r1", 7), "g1"), "g1") == After("r1", 7)


@pytest.mark.parametrize(
    ("message", "fields"),
    [
        (After("r1", 7, 0.5), {"battery": 0.5}),
        (After("r1", 7, None, 3), {"errors": 3}),
        (After("r1", 7, 0.5, 3), {"battery": 0.5, "errors": 3}),
    ],
)
def test_other_values_are_sent_and_come_back(message, fields):
    payload = encode(message, "g1")
    head = {"v": 4, "run": "g1"}
    assert payload == msgpack.packb({**head, "robot": "r1", "tick": 7, **fields})
    assert decode(After, payload, "g1") == message
    assert begins_canonically(After, payload, "g1")
    assert body_of(payload, "g1").startswith(b"\xa5robot")


def test_a_default_may_be_sent_all_the_same():
    body = {"v": 4, "run": "g1", "robot": "r1", "tick": 7, "errors": 0, "battery": None}
    assert decode(After, msgpack.packb(body), "g1") == After("r1", 7)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"battery": "full"}, "battery is 'full', must be a number"),
        ({"errors": None}, "errors is None, must be a whole number"),
        ({"colour": 1}, r"fields missing \[\], unknown \['colour'\]"),
    ],
)
def test_what_is_not_left_out_is_checked_as_ever(change, complaint):
    body = {"v": 4, "run": "g1", "robot": "r1", "tick": 7, **change}
    with pytest.raises(MalformedMessage, match=complaint):
        decode(After, msgpack.packb(body), "g1")


def test_a_field_that_may_not_be_left_out_is_still_missed():
    body = {"v": 4, "run": "g1", "robot": "r1", "battery": 0.5, "errors": 0}
    with pytest.raises(MalformedMessage, match=r"fields missing \['tick'\], unknown \[\]"):
        decode(After, msgpack.packb(body), "g1")


def test_a_field_may_not_come_twice_even_if_it_could_be_left_out():
    payload = bytearray(encode(After("r1", 7, 0.5), "g1"))
    payload[0] += 1
    with pytest.raises(MalformedMessage, match="a field comes twice"):
        decode(After, bytes(payload) + b"\xa7battery\xc0", "g1")


def test_a_message_of_more_than_fifteen_fields_has_a_longer_header_and_the_same_body(monkeypatch):
    names = [f"field_{k:02d}" for k in range(20)]
    many = dataclass(frozen=True, slots=True)(
        type("Many", (), {"__annotations__": dict.fromkeys(names, Annotated[Count, Field("it")])})
    )
    monkeypatch.setitem(codec.BYTES_MAX, many, 1000)
    monkeypatch.setitem(codec._LAYOUTS, many, layout_of(many))
    message = many(*range(20))
    payload = encode(message, "g1")
    fields = dict(zip(names, range(20), strict=True))
    assert payload == msgpack.packb({"v": 4, "run": "g1", **fields})
    assert decode(many, payload, "g1") == message
    assert begins_canonically(many, payload, "g1")
    assert body_of(payload, "g1").startswith(b"\xa8field_00\x00")


def test_the_table_says_what_may_be_left_out_and_what_it_is_then():
    assert "charge that is left; may be left out, and is then null |" in table(After)
    assert "faults so far; may be left out, and is then 0 |" in table(After)


def test_what_may_be_left_out_comes_last_and_has_a_default_of_its_type():
    @dataclass
    class Early:
        first: Annotated[Count, Field("early", may_be_left_out=True)] = 0
        second: Annotated[Count, Field("late")] = 0

    @dataclass
    class Bare:
        first: Annotated[Count, Field("without a default", may_be_left_out=True)]

    with pytest.raises(TypeError, match="Early: fields that may be left out come last"):
        layout_of(Early)
    with pytest.raises(TypeError, match=r"Bare\.first: may be left out, so it needs a default"):
        layout_of(Bare)
