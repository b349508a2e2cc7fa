"""What is learned of msgpack bytes without unpacking them; the oracle is unpacking them."""

import struct
import tracemalloc

import msgpack
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.protocol.wire.packing import DuplicateName, bytes_in_list, check_names, map_size

CHEAP = settings(deadline=None, derandomize=True, max_examples=100)
values = st.recursive(
    st.one_of(st.none(), st.integers(-9, 9), st.text(max_size=3), st.binary(max_size=3)),
    lambda inner: st.one_of(
        st.lists(inner, max_size=4), st.dictionaries(st.text(max_size=3), inner, max_size=4)
    ),
    max_leaves=20,
)


@pytest.mark.parametrize("count", [0, 1, 15, 16, 65_535, 65_536])
def test_the_size_of_a_map_is_read_off_its_header_whatever_its_form(count):
    assert map_size(msgpack.packb(dict.fromkeys(range(count)))) == count
    assert map_size(b"\xdf" + struct.pack(">I", count) + b"\xc0") == count


@CHEAP
@given(values)
def test_what_is_there_once_is_not_taken_for_double(value):
    check_names(msgpack.packb(value))


@CHEAP
@given(values, st.sampled_from(["list", "map", "deep"]))
def test_a_name_that_comes_twice_is_found_at_any_depth(value, where):
    twice = b"\x82\xa1x" + msgpack.packb(value) + b"\xa1x" + msgpack.packb(value)
    payload = {"list": b"\x91" + twice, "map": b"\x81\xa1y" + twice, "deep": b"\x91" * 400 + twice}
    with pytest.raises(DuplicateName, match="x"):
        check_names(payload[where])


@CHEAP
@given(st.lists(st.binary(max_size=400), max_size=20), values, st.booleans())
def test_the_bytes_of_a_list_are_its_items_with_their_headers(items, other, first):
    body = {"inbox": items, "other": other} if first else {"other": other, "inbox": items}
    expected = sum(len(msgpack.packb(item)) for item in items)
    assert bytes_in_list(msgpack.packb(body), "inbox", 0, 2) == expected


def test_nothing_but_byte_strings_counts_and_no_more_than_can_be():
    body = {"inbox": [b"abc", "abc", [b"abc"], {}], "outbox": [b"abc"]}
    assert bytes_in_list(msgpack.packb(body), "inbox", 0, 2) == 5
    many = msgpack.packb({"inbox": [b""] * 1000})
    assert bytes_in_list(many, "inbox", 2, 1) == 2000
    assert bytes_in_list(many, "inbox", 3, 1) == 0
    assert bytes_in_list(msgpack.packb({"a": 1, "inbox": [b"abc"]}), "inbox", 0, 1) == 0


@pytest.mark.parametrize("element", [b"\x80", b"\x90", b"\x91", b"\x01", b"\xa1a", b"\xc4\x01a"])
def test_looking_through_takes_memory_for_the_bytes_alone(element):
    payload = b"\x81\xa1a\xdd\x00\x10\x00\x00" + element * 2**20 + b"\x01"
    tracemalloc.start()
    try:
        bytes_in_list(payload, "inbox", 64, 9)
        peak = tracemalloc.get_traced_memory()[1]
    except ValueError:  # what is nested too deeply
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 4 * len(payload)  # copies of the bytes themselves
