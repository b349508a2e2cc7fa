"""How answers are unpacked: what a few bytes of a stranger's may become in memory."""

import tracemalloc

import msgpack
import pytest

from encircle.protocol.errors import MalformedMessage, OversizedMessage
from encircle.protocol.zenoh.answers import ENTRIES_MAX, unpacked_answer

BYTES = 2**20


def nested(element: bytes, count: int) -> bytes:
    """So many elements in lists of lists, none of which is long."""
    lists = [b"\xdc" + (200).to_bytes(2, "big") + element * 200] * (count // 200)
    while len(lists) > 1:
        size = min(len(lists), 200)
        parts = [lists[at : at + size] for at in range(0, len(lists), size)]
        lists = [b"\xdc" + len(part).to_bytes(2, "big") + b"".join(part) for part in parts]
    return lists[0]


@pytest.mark.parametrize("element", [b"\x80", b"\x90", b"\x81\xa1a\x80", b"\xa3abc", b"\x01"])
@pytest.mark.parametrize("is_nested", [False, True])
def test_an_answer_takes_no_more_memory_than_its_length_allows(element, is_nested):
    count = BYTES // len(element)
    many = b"\xdd" + count.to_bytes(4, "big") + element * count
    payload = b"\x81\xa1a" + (nested(element, count) if is_nested else many)
    assert msgpack.unpackb(payload)["a"]
    tracemalloc.start()
    try:
        with pytest.raises(MalformedMessage):
            unpacked_answer(payload, len(payload))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 4 * len(payload)


def test_an_answer_with_as_many_entries_as_may_be_is_read():
    body = {"a": [b"x"] * ENTRIES_MAX, "b": {f"{n}": [] for n in range(ENTRIES_MAX - 3)}}
    assert unpacked_answer(msgpack.packb(body), BYTES) == body
    with pytest.raises(MalformedMessage, match="maps and lists"):
        unpacked_answer(msgpack.packb({**body, "c": {}}), BYTES)
    with pytest.raises(OversizedMessage):
        unpacked_answer(bytes(BYTES + 1), BYTES)
