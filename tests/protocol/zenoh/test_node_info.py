"""What a node says of itself when it is asked, and what is taken for such an answer."""

import msgpack
import pytest

from encircle.protocol import VERSION
from encircle.protocol.errors import MalformedMessage, OversizedMessage
from encircle.protocol.zenoh.node_info import (
    BYTES_MAX,
    NodeInfo,
    decode_info,
    info_replier,
    versions_here,
)

GOOD = {"v": 1, "party": "r1", "versions": {"x": "2"}, "received_us": 5, "sent_us": 6}


def test_an_answer_comes_back_as_it_was_given():
    times = iter((100, 107))
    assert decode_info(info_replier("world", lambda: next(times))()) == NodeInfo(
        "world", VERSION, versions_here(), 100, 107
    )


def test_an_answer_of_any_version_and_with_more_in_it_is_read():
    found = decode_info(msgpack.packb({**GOOD, "v": 99, "mood": "fine"}))
    assert found == NodeInfo("r1", 99, {"x": "2"}, 5, 6)


@pytest.mark.parametrize(
    "change",
    [
        {"v": "3"},
        {"v": True},
        {"party": None},
        {"party": "r" * 65},
        {"party": "r1\nok     all is well"},
        {"versions": []},
        {"versions": {"x": 2}},
        {"versions": {str(k): "1" for k in range(17)}},
        {"received_us": -1},
        {"received_us": 1.5},
        {"sent_us": 2**53},
    ],
)
def test_whatever_else_is_refused(change):
    with pytest.raises(MalformedMessage):
        decode_info(msgpack.packb({**GOOD, **change}))


@pytest.mark.parametrize("payload", [b"", b"\xc1", b"\x93", msgpack.packb([1]), b"\x81\x01"])
def test_bytes_that_are_no_answer_are_refused(payload):
    with pytest.raises(MalformedMessage):
        decode_info(payload)


def test_an_answer_that_is_too_long_is_refused_unopened():
    with pytest.raises(OversizedMessage):
        decode_info(msgpack.packb({**GOOD, "more": "x" * BYTES_MAX}))
