"""Messages of version 3 are read as those of version 4; the oracle unpacks and packs them anew."""

import random
import struct
from dataclasses import replace

import msgpack
import pytest
from helpers_messages import SAMPLES
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.protocol import VERSION
from encircle.protocol.codec import decode, encode
from encircle.protocol.errors import MalformedMessage, WrongVersion
from encircle.protocol.messages import Observation, Pose, Setup
from encircle.protocol.wire.earlier_versions import VERSION_BEFORE, VERSION_SINCE, upgraded

RUN = "g1"
CHEAP = settings(deadline=None, derandomize=True, max_examples=200)
SINCE = {Setup: {"policy_parameters": {}, "policy_source": ""}, Pose: {"say": {}, "estimate": None}}
"""What version 4 added."""
BEFORE = {kind: replace(m, **SINCE.get(kind, {})) for kind, m in SAMPLES.items()}
"""A message of each kind that version 3 could say."""
KINDS = pytest.mark.parametrize("kind", BEFORE, ids=lambda kind: kind.__name__)


def of_version(payload, version):
    return msgpack.packb({**msgpack.unpackb(payload), "v": version})


def oddly_packed(body, draws):
    """As a stranger may pack it: fields in any order, numbers and headers of any length."""
    names = list(body)
    draws.shuffle(names)
    wide = draws.choice([b"\x03", b"\xcc\x03", b"\xcd\0\x03", b"\xd1\0\x03", b"\xcf" + b"\0" * 7])
    version = wide if wide[-1] else wide + b"\x03"
    packed = b"\xde" + struct.pack(">H", len(body))
    single = draws.random() < 0.5
    for name in names:
        packed += draws.choice([msgpack.packb(name), b"\xd9" + bytes([len(name)]) + name.encode()])
        value = msgpack.packb(body[name], use_single_float=single)
        packed += version if name == "v" else value
    return packed


def test_the_version_that_follows_is_this_programs():
    assert (VERSION_BEFORE, VERSION_SINCE) == (VERSION - 1, VERSION)


@KINDS
def test_a_message_of_version_3_is_the_same_of_version_4(kind):
    payload = encode(BEFORE[kind], RUN)
    before = of_version(payload, 3)
    assert upgraded(before) == payload
    assert decode(kind, upgraded(before), RUN) == BEFORE[kind]
    with pytest.raises(WrongVersion):
        decode(kind, before, RUN)


@KINDS
@pytest.mark.parametrize("version", [0, 1, 2, 4, 5, -3, 3.0, "3", None, True, [3]])
def test_any_other_version_stays_what_it_is(kind, version):
    payload = of_version(encode(BEFORE[kind], RUN), version)
    assert upgraded(payload) == payload


@KINDS
@CHEAP
@given(st.integers(0, 2**32))
def test_what_a_stranger_packed_in_its_own_way_keeps_all_but_the_version(kind, seed):
    body = msgpack.unpackb(of_version(encode(BEFORE[kind], RUN), 3))
    before = oddly_packed(body, random.Random(seed))
    after = upgraded(before)
    assert list(msgpack.unpackb(after).items()) == list({**msgpack.unpackb(before), "v": 4}.items())
    assert sum(a != b for a, b in zip(before, after, strict=True)) == 1


@CHEAP
@given(st.integers(0, 2**32), st.integers(0, 6))
def test_the_packets_in_an_inbox_are_upgraded_too_and_what_is_none_is_left(seed, count):
    draws = random.Random(seed)
    packet = encode(BEFORE[Pose], RUN)
    now = [packet, b"", b"\xc1", msgpack.packb([3]), of_version(packet, 2), of_version(packet, 7)]
    inbox = tuple(draws.choices(now, k=count))
    seen = replace(BEFORE[Observation], inbox=inbox)
    old = [of_version(packet, 3) if each == packet else each for each in inbox]
    body = {**msgpack.unpackb(encode(seen, RUN)), "v": 3, "inbox": old}
    assert decode(Observation, upgraded(msgpack.packb(body)), RUN) == seen
    assert decode(Observation, upgraded(oddly_packed(body, draws)), RUN).inbox == inbox
    # Only inboxes hold packets; and one of another version is not of a recording of that one.
    body["v"] = 4
    assert upgraded(msgpack.packb(body)) == msgpack.packb(body)


@KINDS
@CHEAP
@given(st.data())
def test_damaged_messages_raise_nothing_and_are_damaged_still(kind, data):
    payload = bytearray(of_version(encode(BEFORE[kind], RUN), 3))
    for _ in range(data.draw(st.integers(1, 3))):
        payload[data.draw(st.integers(0, len(payload) - 1))] = data.draw(st.integers(0, 255))
    cut = bytes(payload[: data.draw(st.integers(0, len(payload)))])
    after = upgraded(cut)
    assert len(after) == len(cut)
    assert upgraded(after) == after
    assert upgraded(cut[:0]) == b""


def test_a_version_that_comes_twice_is_refused_whatever_it_is():
    for pair in ((3, 3), (3, 4), (4, 3)):
        fields = [("v", pair[0]), ("run", RUN), ("v", pair[1])]
        fields += list(msgpack.unpackb(encode(BEFORE[Pose], RUN)).items())[2:]
        twice = msgpack.Packer().pack_map_pairs(fields)
        with pytest.raises((MalformedMessage, WrongVersion)):
            decode(Pose, upgraded(twice), RUN)
