"""What a world says of its run when it is asked, and what is taken for such an answer."""

import msgpack
import pytest

from encircle.protocol import VERSION
from encircle.protocol.errors import MalformedMessage, OversizedMessage, WrongVersion
from encircle.protocol.zenoh.scenario_query import (
    BYTES_MAX,
    RunDescription,
    decode_description,
    description_replier,
    encode_description,
)

DESCRIBED = RunDescription("demo", 2**63 - 1, '{"title": "x"}', (b"one", b"two"))
GOOD = {"v": VERSION, "run": "demo", "seed": 1, "scenario": "{}", "setups": [b"s"]}


def test_an_answer_comes_back_as_it_was_given():
    assert decode_description(encode_description(DESCRIBED)) == DESCRIBED


def test_an_answer_with_more_in_it_is_read():
    found = decode_description(msgpack.packb({**GOOD, "mood": "fine"}))
    assert found == RunDescription("demo", 1, "{}", (b"s",))


@pytest.mark.parametrize(
    "change",
    [
        {"run": "a/b"},
        {"run": None},
        {"seed": -1},
        {"seed": True},
        {"seed": 2**63},
        {"scenario": {}},
        {"setups": None},
        {"setups": ["text"]},
        {"setups": [b""] * 257},
    ],
)
def test_whatever_else_is_refused(change):
    with pytest.raises(MalformedMessage):
        decode_description(msgpack.packb({**GOOD, **change}))


@pytest.mark.parametrize("payload", [b"", b"\xc1", b"\x93", msgpack.packb([1]), b"\x81\x01"])
def test_bytes_that_are_no_answer_are_refused(payload):
    with pytest.raises(MalformedMessage):
        decode_description(payload)


@pytest.mark.parametrize("version", [VERSION - 1, VERSION + 1, "4", None])
def test_an_answer_of_another_version_is_refused(version):
    with pytest.raises(WrongVersion, match=f"not {VERSION}"):
        decode_description(msgpack.packb({**GOOD, "v": version}))


def test_an_answer_that_is_too_long_is_refused_unopened():
    with pytest.raises(OversizedMessage):
        decode_description(bytes(BYTES_MAX + 1))


def test_an_answer_is_made_once_and_one_that_is_too_long_is_none():
    made = []

    def describe():
        made.append(1)
        return DESCRIBED

    reply = description_replier(describe)
    assert decode_description(reply()) == decode_description(reply()) == DESCRIBED
    assert len(made) == 1
    too_long = RunDescription("demo", 1, "x" * BYTES_MAX)
    with pytest.raises(OversizedMessage):
        encode_description(too_long)
    assert description_replier(lambda: too_long)() == b""
