"""Round trips and golden bytes; what is refused is in test_codec_refusals."""

import string
from math import nextafter, pi
from typing import Any

import msgpack
import pytest
from helpers_messages import GOLDEN, SAMPLES, sent_names
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.protocol import VERSION
from encircle.protocol.codec import BYTES_MAX, _plain_pose, body_of, decode, decode_pose, encode
from encircle.protocol.errors import WrongRun
from encircle.protocol.messages import (
    Command,
    End,
    Observation,
    Pose,
    Radio,
    Setup,
    State,
)
from encircle.protocol.wire.limits import COUNT_MAX, NUMBER_MAX, PLACE_MAX, RELAYED_MAX

CHEAP = settings(max_examples=60, deadline=None, derandomize=True)


numbers = st.floats(-NUMBER_MAX, NUMBER_MAX, exclude_min=True, exclude_max=True)
points = st.tuples(numbers, numbers)
metres = st.floats(-PLACE_MAX, PLACE_MAX)
places = st.tuples(metres, metres)
texts = st.text(max_size=20)
counts = st.integers(0, 2**53 - 1)
values = st.one_of(
    numbers, st.integers(1 - 10**9, 10**9 - 1), st.booleans(), texts, st.binary(), st.none()
)
sightings = st.lists(st.tuples(texts, metres, metres), max_size=5).map(tuple)
reports = st.tuples(texts, counts, metres, metres)
angles = st.floats(-pi, pi)
names = st.text(string.ascii_letters + string.digits + "-_", min_size=1, max_size=31)
reasons = st.sampled_from(("captured", "ticks")) | st.text(max_size=192).map("failed: {}".format)


def tuples_of(items: Any, size: int = 5) -> Any:
    return st.lists(items, max_size=size).map(tuple)


def states(robots: list[tuple[Any, float]]) -> Any:
    spots, headings = zip(*robots, strict=True) if robots else ((), ())
    touching = tuples_of(st.tuples(texts, texts))
    fixed = map(st.just, (spots, headings))
    return st.builds(State, counts, *fixed, points, st.booleans(), touching)


def radios(count: int) -> Any:
    """N x N fates of packets sent at some tick, and copies of them or none."""
    sent = 1000
    due = st.integers(sent + 1, COUNT_MAX)
    pairs = [[(i, k) for i in range(count)] for k in range(count)]
    fates = st.integers(-10, -1) | due
    rows = [
        st.tuples(
            *[st.just((0, 0)) if i == k else st.tuples(fates, st.just(0) | due) for i, k in row]
        )
        for row in pairs
    ]

    def radio(table: Any, copied: bool) -> Radio:
        first, second = (tuple(tuple(p[n] for p in row) for row in table) for n in (0, 1))
        return Radio(sent, first, second if copied else ())

    return st.builds(radio, st.tuples(*rows), st.booleans())


messages = st.one_of(
    st.builds(
        Setup,
        texts,
        st.lists(names, max_size=5, unique=True).map(tuple),
        st.floats(0.0, NUMBER_MAX, exclude_min=True, exclude_max=True),
        texts,
        st.dictionaries(texts, values | tuples_of(values), max_size=5),
        st.sampled_from(("world", "direct")),
        st.integers(0, 2**52),
        st.integers(2**52, COUNT_MAX),
    ),
    st.builds(
        Observation,
        texts,
        counts,
        places,
        angles,
        st.none() | places,
        st.lists(st.floats(0.0, NUMBER_MAX, exclude_max=True), min_size=8, max_size=30).map(tuple),
        sightings,
        tuples_of(st.binary(max_size=300)),
        tuples_of(texts),
        st.none() | counts,
    ),
    st.builds(
        Pose,
        texts,
        counts,
        counts,
        places,
        places,
        st.none() | places,
        texts,
        st.none() | numbers,
        st.none() | counts,
        tuples_of(reports, RELAYED_MAX),
        st.none() | counts,
    ),
    st.builds(
        Command,
        texts,
        counts,
        points,
        texts,
        st.none() | numbers,
        st.none() | counts,
        st.none() | points,
        st.none() | points,
        st.none() | texts,
        tuples_of(texts),
        st.booleans(),
        st.dictionaries(texts, counts, max_size=5),
        st.none() | st.tuples(counts, counts, tuples_of(st.tuples(texts, counts, counts))),
    ),
    st.builds(End, texts, counts, reasons),
    st.lists(st.tuples(points, angles), max_size=5).flatmap(states),
    st.integers(0, 5).flatmap(radios),
)


@pytest.mark.parametrize("kind", SAMPLES, ids=lambda kind: kind.__name__)
def test_a_sample_of_each_kind_has_its_golden_bytes(kind):
    assert encode(SAMPLES[kind], "g1").hex() == "".join(GOLDEN[kind].split())


@pytest.mark.parametrize("kind", SAMPLES, ids=lambda kind: kind.__name__)
def test_golden_bytes_decode_to_the_sample(kind):
    assert decode(kind, bytes.fromhex(GOLDEN[kind]), "g1") == SAMPLES[kind]


def test_samples_cover_every_kind_of_message():
    assert set(SAMPLES) == set(BYTES_MAX) == set(GOLDEN)


@CHEAP
@given(messages, names)
def test_a_message_survives_the_round_trip_and_its_bytes_do(message, run):
    payload = encode(message, run)
    decoded = decode(type(message), payload, run)
    assert decoded == message
    assert encode(decoded, run) == payload


@pytest.mark.parametrize("x", [PLACE_MAX, -PLACE_MAX, 5e-324, -0.0])
def test_the_largest_and_smallest_numbers_survive_the_round_trip_everywhere(x):
    seen = tuple((f"r{k}", x, x) for k in range(50))
    message = Observation("r1", 0, (x, x), 0.0, (x, x), (abs(x),) * 360, seen, ())
    assert encode(decode(Observation, encode(message, "g1"), "g1"), "g1") == encode(message, "g1")


@CHEAP
@given(messages)
def test_encoding_is_that_of_plain_msgpack_in_field_order(message):
    fields = {name: getattr(message, name) for name in sent_names(message)}
    assert encode(message, "g1") == msgpack.packb({"v": VERSION, "run": "g1", **fields})


def fields_of(message):
    """The message's fields in canonical order, packed one by one."""
    names = sent_names(message)
    return b"".join(msgpack.packb(name) + msgpack.packb(getattr(message, name)) for name in names)


@pytest.mark.parametrize("length", range(1, 32))
def test_body_is_exactly_the_fields_whatever_the_length_of_the_runs_name(length):
    run = "x" * length
    for message in SAMPLES.values():
        assert body_of(encode(message, run), run) == fields_of(message)


def test_whole_numbers_are_taken_where_numbers_are_wanted():
    body = msgpack.unpackb(encode(SAMPLES[Pose], "g1"))
    payload = msgpack.packb(body | {"position": [1, 2], "xi": 2})
    assert decode(Pose, payload, "g1") == SAMPLES[Pose]


def test_decoded_messages_hold_tuples_so_that_they_are_hashable():
    decoded = decode(Observation, encode(SAMPLES[Observation], "g1"), "g1")
    assert hash(decoded) == hash(SAMPLES[Observation])


def test_whole_numbers_are_taken_in_what_is_relayed():
    body = msgpack.unpackb(encode(SAMPLES[Pose], "g1"))
    payload = msgpack.packb(body | {"relayed": [["r1", 2, 4, 0.25], ["r3", 1, 5, 0]]})
    assert decode(Pose, payload, "g1") == decode_pose(payload, "g1") == SAMPLES[Pose]
    assert [type(x) for report in decode_pose(payload, "g1").relayed for x in report[2:]] == [
        float
    ] * 4


def test_the_longest_packet_of_a_robot_of_ours_fits():
    # Names of robots and runs have at most 31 letters, modes of ours at most 8.
    x = nextafter(PLACE_MAX, 0.0)
    relayed = (("r" * 31, COUNT_MAX, x, -x),) * RELAYED_MAX
    longest = Pose(
        "r" * 31, COUNT_MAX, COUNT_MAX, (x, x), (x, x), (x, x), "encircle", x, COUNT_MAX, relayed
    )
    payload = encode(longest, "g" * 31)
    assert len(payload) < BYTES_MAX[Pose]
    assert decode_pose(payload, "g" * 31) == longest


def test_a_pose_of_ours_is_decoded_by_the_short_way():
    # It fails when ``Pose`` has a field that ``_plain_pose`` does not know.
    payload = encode(SAMPLES[Pose], "g1")
    assert _plain_pose(payload, "g1") == SAMPLES[Pose]


def test_decode_pose_is_decode_and_checks_the_run_each_time():
    payload = encode(SAMPLES[Pose], "g1")
    assert decode_pose(payload, "g1") == SAMPLES[Pose]
    for _ in range(2):
        with pytest.raises(WrongRun):
            decode_pose(payload, "g2")


@pytest.mark.parametrize(
    "message",
    [
        Pose("r" * 4200, 0, 0, (0.0, 0.0), (0.0, 0.0), None, "m", None, None),
        End("r1", 0, "x" * 2000),
        Setup("r1", ("r1",), 0.1, "xi-star", {"x" * 70_000: 1}),
    ],
)
def test_encoding_more_than_the_limit_is_our_own_mistake(message):
    with pytest.raises(AssertionError, match=type(message).__name__):
        encode(message, "g1")
