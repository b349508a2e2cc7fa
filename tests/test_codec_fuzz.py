"""Mutated bytes: the short way for poses judges as the long one, and nothing else escapes."""

import msgpack
from hypothesis import given, settings
from hypothesis import strategies as st

from protocol.codec import decode, decode_pose, encode
from protocol.errors import ProtocolError
from protocol.messages import Command, End, Observation, Pose, Radio, Setup, State

RUN = "fuzz"
POSE = Pose("r1", 7, 7, (1.5, -2.25), (0.5, 0.0), (3.0, 4.0), "encircle", 2.0, 1)
BARE = Pose("r2", 0, 0, (0.0, 0.0), (0.0, 0.0), None, "search", None, None)
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
    ]
)


def judged(decoder, payload):
    try:
        return decoder(payload)
    except ProtocolError as error:
        return type(error), str(error)


def same_either_way(payload: bytes) -> None:
    short = judged(lambda p: decode_pose(p, RUN), payload)
    assert short == judged(lambda p: decode(Pose, p, RUN), payload)


@SETTINGS
@given(st.sampled_from([POSE, BARE]), st.data())
def test_a_pose_with_changed_bytes_is_judged_the_same_either_way(pose, data):
    payload = bytearray(encode(pose, RUN))
    for _ in range(data.draw(st.integers(1, 4))):
        payload[data.draw(st.integers(0, len(payload) - 1))] = data.draw(st.integers(0, 255))
    same_either_way(bytes(payload[: data.draw(st.integers(0, len(payload)))] or payload))
    same_either_way(bytes(payload))


@SETTINGS
@given(st.sampled_from([POSE, BARE]), st.data())
def test_a_pose_with_changed_values_is_judged_the_same_either_way(pose, data):
    body = msgpack.unpackb(encode(pose, RUN))
    for name in data.draw(st.lists(st.sampled_from(list(body)), min_size=1, max_size=3)):
        body[name] = data.draw(ODD)
    same_either_way(msgpack.packb(body))


@SETTINGS
@given(st.sampled_from([Setup, Observation, Pose, Command, End, State, Radio]), st.binary())
def test_random_bytes_raise_only_errors_of_the_protocol(kind, payload):
    outcome = judged(lambda p: decode(kind, p, RUN), payload)
    assert isinstance(outcome, tuple)
