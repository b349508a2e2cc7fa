"""Mutated bytes: the short way for poses judges as the long one, and nothing else escapes."""

from dataclasses import replace

import msgpack
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.protocol.codec import BYTES_MAX, decode, decode_pose, encode
from encircle.protocol.errors import ProtocolError
from encircle.protocol.messages import Pose
from encircle.protocol.wire.payload import FrozenMap
from encircle.protocol.wire.target_estimate import TargetEstimate

RUN = "fuzz"
POSE = Pose("r1", 7, 7, (1.5, -2.25), (0.5, 0.0), (3.0, 4.0), "encircle", 2.0, 1)
BARE = Pose("r2", 0, 0, (0.0, 0.0), (0.0, 0.0), None, "search", None, None)
RELAYING = replace(POSE, relayed=(("r2", 6, 1.0, 2.0), ("r3", 6, 1.5, 2.5), ("r2", 5, 0.0, -1.0)))
TELLING = replace(BARE, estimate=TargetEstimate(0, 3.0, 4.0, -1.0, 0.5, 0.0025, 0.01, 1.5))
SPEAKING = replace(TELLING, say=FrozenMap(bid=1.5, who="r2"))
POSES = st.sampled_from([POSE, BARE, RELAYING, TELLING, SPEAKING, replace(SPEAKING, estimate=None)])
SETTINGS = settings(deadline=None, derandomize=True, max_examples=400)
ODD = st.sampled_from(
    [
        None,
        True,
        -1,
        0,
        2**60,
        1.5,
        float("nan"),
        float("inf"),
        1000000000.0,
        "",
        "x" * 300,
        b"",
        [],
        [1.0],
        [1.0, 2.0],
        [1, 2],
        [1.0, float("nan")],
        [1e300, 0.0],
        {},
        {"x": 1},
        [["r2", 6, 1.0, 2.0]],
        [["r2", 6, 1, 2]],
        [["r2", 6, 1.0, 2.0]] * 16,
        [["r2", 6, 1.0, 2.0]] * 17,
        [["r2", 6, 1, 2]] * 17,
        [["r2", 6, 1.0]],
        [["r2", 6, 1.0, 2.0, 3.0]],
        ["r2 6"],
        [{"a": 1, "b": 2, "c": 3, "d": 4}],
        [0, 1, 2, 3, 4, 1, 0, 1],
        [0, 1.0, 2.0, 3.0, 4.0, 1.0, 1.0, 1.0],
        [9, 1.0, 2.0, 3.0, 4.0, 1.0, 0.0, 1.0],
    ]
)
CELLS = ("r2", "x" * 256, "x" * 257, b"r2", 6, 0, -1, 2**53 - 1, 2**53, 2**64 - 1, True, None)
CELLS += (1.0, -0.0, 1e9, -1e9, 10**9, float("nan"), float("inf"), [], ["r2"], {})
REPORT = ["r2", 6, 1.0, 2.0]


def judged(decoder, payload):
    try:
        return decoder(payload)
    except ProtocolError as error:
        return type(error), str(error)


def same_either_way(payload: bytes) -> None:
    short = judged(lambda p: decode_pose(p, RUN), payload)
    assert short == judged(lambda p: decode(Pose, p, RUN), payload)


@SETTINGS
@given(POSES, st.data())
def test_a_pose_with_changed_bytes_is_judged_the_same_either_way(pose, data):
    payload = bytearray(encode(pose, RUN))
    for _ in range(data.draw(st.integers(1, 4))):
        payload[data.draw(st.integers(0, len(payload) - 1))] = data.draw(st.integers(0, 255))
    same_either_way(bytes(payload[: data.draw(st.integers(0, len(payload)))] or payload))
    same_either_way(bytes(payload))


@SETTINGS
@given(POSES, st.data())
def test_a_pose_with_changed_values_is_judged_the_same_either_way(pose, data):
    body = msgpack.unpackb(encode(pose, RUN))
    for name in data.draw(st.lists(st.sampled_from(list(body)), min_size=1, max_size=3)):
        body[name] = data.draw(ODD)
    same_either_way(msgpack.packb(body))


@pytest.mark.parametrize("first", [REPORT, ["r3", 6, 1, 2]], ids=["plain", "to convert"])
@pytest.mark.parametrize("place", range(4))
def test_whatever_is_relayed_is_judged_the_same_either_way(first, place):
    body = msgpack.unpackb(encode(POSE, RUN))
    for cell in CELLS:
        odd = [*REPORT[:place], cell, *REPORT[place + 1 :]]
        same_either_way(msgpack.packb(body | {"relayed": [first, odd]}))
        same_either_way(msgpack.packb(body | {"relayed": [odd] * 16}))


@SETTINGS
@given(st.sampled_from([*BYTES_MAX]), st.binary())
def test_random_bytes_raise_only_errors_of_the_protocol(kind, payload):
    outcome = judged(lambda p: decode(kind, p, RUN), payload)
    assert isinstance(outcome, tuple)
