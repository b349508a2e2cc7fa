"""What policies say, in pose packets: its limits, and that both ways of decoding it agree."""

from dataclasses import replace
from math import inf, nan

import msgpack
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.protocol.codec import _plain_pose, decode, decode_pose, encode
from encircle.protocol.errors import MalformedMessage, OversizedMessage, ProtocolError
from encircle.protocol.messages import Pose
from encircle.protocol.wire.packing import map_header
from encircle.protocol.wire.payload import payload as said
from encircle.protocol.wire.target_estimate import TargetEstimate

RUN = "g1"
SETTINGS = settings(deadline=None, derandomize=True, max_examples=400)
SILENT = Pose("r2", 7, 7, (1.5, -2.25), (0.5, 0.0), (3.0, 4.0), "encircle", 2.0, 1)
SPEAKING = replace(SILENT, say=said({"bid": 1.5, "for": [0, {"r3": None}], "who": "r2"}))
LOUD = replace(SILENT, relayed=(("r1", 6, 1.0, 2.0),), say=said({"x": b"x" * 1018}))
TELLING = replace(SPEAKING, estimate=TargetEstimate(0, 1.0, 2.0, 0.0, 0.0, 0.5, 0.0, 0.5))
POSES = [SILENT, SPEAKING, LOUD, TELLING]
NUMBERS = (0, -1, 2**53 - 1, 2**53, -(2**60), 2**64 - 1, 1.5, -0.0, 1e308, nan, -inf)
TEXTS = ("", "r2", "\x00", "x" * 400, b"", b"x" * 1010, b"x" * 1030)
OTHERS = (None, True, msgpack.ExtType(5, b"x"), msgpack.Timestamp(1, 2))
LEAVES = st.sampled_from([*NUMBERS, *TEXTS, *OTHERS])
NAMES = st.sampled_from(["x", "y", "bid", "", "x" * 300, b"x", 1, None, 1.5])
VALUES = st.recursive(
    LEAVES,
    lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(NAMES, inner, max_size=3)),
    max_leaves=12,
)


def packed(fields, announced=None):
    """A map of these (name, value), in this order; a value that is ``Raw`` as its bytes."""
    head = map_header(len(fields) if announced is None else announced)
    parts = [part for field in fields for part in field]
    return head + b"".join(part[0] if type(part) is Raw else msgpack.packb(part) for part in parts)


class Raw(tuple):
    """Bytes that are msgpack already."""


def fields_of(pose):
    return list(msgpack.unpackb(encode(pose, RUN)).items())


def saying(value):
    return packed([*fields_of(SILENT), ("say", value)])


def judged(decoder, payload):
    try:
        return decoder(payload)
    except ProtocolError as error:
        return type(error), str(error)


def judgement(payload):
    """What decoding comes to, after a check that the quick way comes to the same."""
    quick = judged(lambda p: decode_pose(p, RUN), payload)
    assert quick == judged(lambda p: decode(Pose, p, RUN), payload)
    if (plain := _plain_pose(payload, RUN)) is not None:
        assert plain == quick
    if type(quick) is Pose:
        hash(quick)
        assert decode(Pose, encode(quick, RUN), RUN) == quick
    return quick


@pytest.mark.parametrize("pose", [SILENT, SPEAKING, LOUD])
def test_what_our_robots_send_is_decoded_the_quick_way(pose):
    assert _plain_pose(encode(pose, RUN), RUN) == pose == judgement(encode(pose, RUN))


def test_nothing_said_takes_no_bytes():
    assert "say" not in dict(fields_of(SILENT))
    assert judgement(saying({})) == SILENT
    assert len(encode(SPEAKING, RUN)) == len(encode(SILENT, RUN)) + 4 + len(
        msgpack.packb(SPEAKING.say)
    )


@SETTINGS
@given(VALUES)
def test_whatever_is_said_is_judged_the_same_either_way(value):
    judgement(saying(value))


@SETTINGS
@given(st.dictionaries(st.sampled_from(["x", "y", "bid", ""]), VALUES, max_size=3))
def test_what_is_heard_is_what_was_said_or_nothing(value):
    outcome = judgement(saying(value))
    try:
        expected = said(value)
    except ValueError:
        expected = None
    if expected is None:
        assert outcome[0] in (MalformedMessage, OversizedMessage)
    else:
        assert outcome == replace(SILENT, say=expected)


@SETTINGS
@given(st.sampled_from(POSES), st.data())
def test_fields_in_any_order_or_twice_are_judged_the_same_either_way(pose, data):
    fields = fields_of(pose)
    if data.draw(st.booleans()):
        fields.append(("say", data.draw(VALUES)))
    for field in data.draw(st.lists(st.sampled_from(fields), max_size=2)):
        fields.insert(data.draw(st.integers(0, len(fields))), field)
    if data.draw(st.booleans()):
        fields.append(fields.pop(data.draw(st.integers(0, len(fields) - 1))))
    announced = len(fields) + data.draw(st.sampled_from([0, 0, 0, -1, 1]))
    outcome = judgement(packed(fields, announced))
    names = [name for name, _ in fields]
    if len(set(names)) < len(names):
        assert type(outcome) is tuple


@SETTINGS
@given(st.data())
def test_a_name_that_comes_twice_in_what_is_said_is_refused_at_any_depth(data):
    value = b"\x82\xa1x" + msgpack.packb(data.draw(VALUES)) + b"\xa1x\x01"
    for _ in range(data.draw(st.integers(0, 5))):
        value = data.draw(st.sampled_from([b"\x91", b"\x81\xa1y", b"\x92\xc0"])) + value
    # A pose too long is refused for that already.
    assert judgement(saying(Raw([value])))[0] in (MalformedMessage, OversizedMessage)


def test_the_name_that_comes_twice_is_named():
    for value in (b"\x82\xa1x\x01\xa1x\x02", b"\x81\xa1a\x92\xc0\x82\xa1x\x01\xa1x\x02"):
        assert judgement(saying(Raw([value]))) == (
            MalformedMessage,
            "Pose: 'x' comes twice",
        )


@pytest.mark.parametrize("size", range(1022, 1028))
def test_1024_bytes_may_be_said_and_no_more(size):
    value = {"x": b"x" * (size - 6)}
    assert len(msgpack.packb(value)) == size
    outcome = judgement(saying(value))
    if size <= 1024:
        assert outcome == replace(SILENT, say=said(value))
    else:
        assert outcome[0] is MalformedMessage
        assert outcome[1].startswith("Pose from 'r2': say is {'x': b'xxx")
        assert outcome[1].endswith(f"must be at most 1024 bytes as msgpack, this takes {size}")


def test_it_is_measured_as_it_would_be_sent_on():
    # In the shortest form each of these texts takes two bytes, and here six.
    long = b"\xdf\0\0\0\x01\xdb\0\0\0\x01x\xdd\0\0\x01\x2c" + b"\xdb\0\0\0\x01y" * 300
    assert judgement(saying(Raw([long]))).say == {"x": ("y",) * 300}


@pytest.mark.parametrize("cut", [1, 3, 10])
def test_what_is_cut_off_is_refused(cut):
    assert judgement(encode(SPEAKING, RUN)[:-cut])[0] is MalformedMessage
    assert judgement(encode(SPEAKING, RUN) + b"\xc0" * cut)[0] is MalformedMessage
