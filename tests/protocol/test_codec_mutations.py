"""Valid bytes of every kind, damaged: decoding gives a message that can be sent on, or refuses.

Damage is by the bit (every single one), by splicing kinds together, and by rules that Hypothesis
chains: headers that announce more than there is, pieces doubled, lost and turned around. Whole
bytes and fields are damaged in ``test_codec_fuzz`` and ``test_codec_refusals``.
"""

import random
import struct
import tracemalloc

import pytest
from helpers_messages import GOLDEN
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.protocol.codec import (
    BYTES_MAX,
    LEAN_BYTES_MAX,
    decode,
    decode_pose,
    encode_any_length,
)
from encircle.protocol.errors import ProtocolError
from encircle.protocol.messages import Observation, Pose, Setup

RUN = "g1"
PAYLOADS = {kind: bytes.fromhex(hexadecimal) for kind, hexadecimal in GOLDEN.items()}
KINDS = pytest.mark.parametrize("kind", PAYLOADS, ids=lambda kind: kind.__name__)
SPLICES = 3000
FUZZ = settings(deadline=None, derandomize=True, max_examples=300)
ERROR_CHARACTERS_MAX = 1000
MEMORY_PER_BYTE_MAX = 100
"""Bytes of memory per byte of payload while decoding: an empty map takes one byte, and 80 here."""
HEADERS = [bytes([first]) for first in range(0x80, 0x100)] + [
    bytes([first]) + struct.pack(form, count)
    for first, form in [(0xC6, ">I"), (0xC9, ">I"), (0xDB, ">I"), (0xDD, ">I"), (0xDF, ">I")]
    for count in (0, 1, 2**16, 2**31, 2**32 - 1)
]
"""Everything that can announce what follows, among it the largest of counts."""


def judge(kind, payload):
    """Whether a payload is taken, after a check that it then stays what it is."""
    try:
        message = decode(kind, payload, RUN)
    except ProtocolError as error:
        refusal = error
    else:
        refusal = None
    if refusal is not None:
        assert type(refusal) is not ProtocolError
        assert 0 < len(str(refusal)) < ERROR_CHARACTERS_MAX
        if kind is Pose:
            with pytest.raises(type(refusal)):
                decode_pose(payload, RUN)
        return False
    assert type(message) is kind
    again = encode_any_length(message, RUN)
    if len(again) <= BYTES_MAX[kind]:  # whole numbers grow when they are written as reals
        assert encode_any_length(decode(kind, again, RUN), RUN) == again
    if kind is Pose:
        assert decode_pose(payload, RUN) == message
    return True


@KINDS
def test_every_single_bit_may_be_wrong(kind):
    payload, taken = PAYLOADS[kind], 0
    for place in range(8 * len(payload)):
        flipped = bytearray(payload)
        flipped[place // 8] ^= 1 << place % 8
        taken += judge(kind, bytes(flipped))
    # A number with a wrong bit is another number; a name or a length with one is no message.
    assert 0 < taken < 8 * len(payload) * 0.75


@KINDS
def test_messages_may_be_spliced_together(kind):
    draws = random.Random(kind.__name__)
    for _ in range(SPLICES):
        first, second = draws.choices(list(PAYLOADS.values()), k=2)
        begin, end = (draws.randrange(len(part) + 1) for part in (first, second))
        judge(kind, first[:begin] + second[end:])


@KINDS
@FUZZ
@given(st.data())
def test_damage_upon_damage_is_refused_or_harmless(kind, data):
    payload = PAYLOADS[kind]
    for _ in range(data.draw(st.integers(1, 4))):
        place = data.draw(st.integers(0, len(payload)))
        other = data.draw(st.integers(0, len(payload)))
        piece = payload[min(place, other) : max(place, other)]
        header = data.draw(st.sampled_from(HEADERS))
        payload = data.draw(
            st.sampled_from(
                [
                    payload[:place] + header + payload[place:],
                    payload[:place] + header + payload[place + len(header) :],
                    payload[:place] + piece + payload[place:],
                    payload.replace(piece, b"", 1),
                    payload[:place] + payload[place:][::-1],
                ]
            )
        )
    judge(kind, payload)


@KINDS
def test_a_header_that_announces_more_than_there_is_is_refused_wherever_it_stands(kind):
    payload = PAYLOADS[kind]
    for header in (b"\xdd\xff\xff\xff\xff", b"\xdf\xff\xff\xff\xff", b"\xc6\xff\xff\xff\xff"):
        assert not judge(kind, header)
        for place in range(len(payload)):
            judge(kind, payload[:place] + header + payload[place:])


@pytest.mark.parametrize("element", [b"\x01", b"\x90", b"\x80", b"\xa0", b"\xc0"])
def test_decoding_takes_memory_in_proportion_to_the_length(element):
    """What a robot may get, a stranger may send: only so much of it is unpacked to be judged."""
    assert BYTES_MAX[Setup] <= LEAN_BYTES_MAX
    for count in (BYTES_MAX[Observation] // 8, LEAN_BYTES_MAX - 5):
        payload = b"\xdd" + struct.pack(">I", count) + element * count
        for kind in (Observation, Setup):
            tracemalloc.start()
            try:
                assert not judge(kind, payload)
                peak = tracemalloc.get_traced_memory()[1]
            finally:
                tracemalloc.stop()
            assert peak < MEMORY_PER_BYTE_MAX * LEAN_BYTES_MAX + 2 * len(payload)
