"""What a policy says, checked and frozen; the oracles are msgpack and Python's own maps."""

import copy
import pickle
from collections import Counter, OrderedDict, namedtuple
from decimal import Decimal
from enum import Enum, IntEnum
from math import inf, nan
from types import MappingProxyType

import msgpack
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.protocol.wire.limits import COUNT_MAX, SAY_BYTES_MAX, SAY_DEPTH_MAX
from encircle.protocol.wire.payload import NOTHING_SAID, FrozenMap, payload

CHEAP = settings(deadline=None, derandomize=True, max_examples=200)
leaves = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-COUNT_MAX, COUNT_MAX),
    st.floats(allow_nan=False, allow_infinity=False),
    st.text(max_size=5),
    st.binary(max_size=5),
)


def holding(inner):
    return st.one_of(
        st.lists(inner, max_size=3),
        st.lists(inner, max_size=3).map(tuple),
        st.dictionaries(st.text(max_size=4), inner, max_size=3),
    )


values = leaves
for _ in range(SAY_DEPTH_MAX - 1):
    values = st.one_of(leaves, holding(values))
maps = st.dictionaries(st.text(max_size=4), values, max_size=4)

Pair = namedtuple("Pair", "x y")


class Colour(Enum):
    RED = 1


class Rank(IntEnum):
    FIRST = 1


def with_lists(value):
    """As msgpack gives it back: tuples as lists."""
    if isinstance(value, dict):
        return {name: with_lists(v) for name, v in value.items()}
    return [with_lists(v) for v in value] if isinstance(value, list | tuple) else value


def nested(depth, wrap=lambda inner: {"x": inner}):
    value = wrap(1)
    for _ in range(depth - 2):
        value = wrap(value)
    return {"x": value}


def refusal(value):
    with pytest.raises(ValueError) as caught:  # noqa: PT011  # its text is what is returned
        payload(value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400
    return str(caught.value)


@CHEAP
@given(maps)
def test_what_may_be_said_is_kept_and_is_the_same_once_unpacked(value):
    packed = msgpack.packb(value)
    if len(packed) > SAY_BYTES_MAX:
        assert "at most" in refusal(value)
        return
    frozen = payload(value)
    assert with_lists(frozen) == with_lists(value)
    assert msgpack.packb(frozen) == packed
    again = payload(msgpack.unpackb(packed, use_list=False))
    assert again == frozen
    assert hash(again) == hash(frozen)
    assert payload(frozen) == frozen


@CHEAP
@given(maps)
def test_what_was_checked_is_frozen_throughout(value):
    if len(msgpack.packb(value)) > SAY_BYTES_MAX:
        return
    left = [payload(value)]
    while left:
        inner = left.pop()
        assert type(inner) in (FrozenMap, tuple, str, bytes, bool, int, float, type(None))
        left += inner.values() if isinstance(inner, dict) else inner if type(inner) is tuple else []


def test_the_map_that_was_given_may_be_changed_afterwards():
    given, names = {"a": [1, 2], "b": {"c": 3}}, {"d": 4}
    frozen = payload(given)
    given["a"].append(3)
    given["b"].update(names)
    assert frozen == {"a": (1, 2), "b": {"c": 3}}


@pytest.mark.parametrize(
    "change",
    [
        lambda m: m.__setitem__("a", 2),
        lambda m: m.__setitem__("z", 2),
        lambda m: m.__delitem__("a"),
        lambda m: m.clear(),
        lambda m: m.pop("a"),
        lambda m: m.pop("z", None),
        lambda m: m.popitem(),
        lambda m: m.setdefault("z", 1),
        lambda m: m.setdefault("a", 1),
        lambda m: m.update({"a": 2}),
        lambda m: m.update(a=2),
        lambda m: m.__ior__({"a": 2}),
        lambda m: exec("m |= {'a': 2}", {"m": m}),
        lambda m: exec("m['b']['c'] += 1", {"m": m}),
        lambda m: exec("m['b'] |= {'d': 1}", {"m": m}),
        lambda m: exec("del m['b']['c']", {"m": m}),
        lambda m: exec("m['l'][0] = 5", {"m": m}),
    ],
)
def test_it_cannot_be_changed(change):
    frozen = payload({"a": 1, "b": {"c": 1}, "l": [1]})
    with pytest.raises(TypeError):
        change(frozen)
    assert frozen == {"a": 1, "b": {"c": 1}, "l": (1,)}


def test_nothing_can_be_hung_onto_it():
    with pytest.raises(AttributeError):
        payload({"a": 1}).note = 1
    with pytest.raises(TypeError, match=r"make a new map, such as \{\*\*old, \.\.\.\}"):
        NOTHING_SAID["a"] = 1


def test_it_is_a_key_a_member_and_equal_to_a_plain_map():
    one, other = payload({"a": [1, {"b": 2}], "c": None}), payload({"c": None, "a": (1, {"b": 2})})
    assert one == other == {"a": (1, {"b": 2}), "c": None}
    assert {one: 1}[other] == 1
    assert len({one, other, payload({"a": 1})}) == 2
    assert payload({"a": 1}) != payload({"a": 2})
    assert {**one, "c": 3}["c"] == 3


@CHEAP
@given(maps)
def test_copies_and_pickles_are_equal_and_frozen_too(value):
    if len(msgpack.packb(value)) > SAY_BYTES_MAX:
        return
    frozen = payload(value)
    for protocol in range(pickle.HIGHEST_PROTOCOL + 1):
        again = pickle.loads(pickle.dumps(frozen, protocol))
        assert (type(again), again) == (FrozenMap, frozen)
    for again in (copy.copy(frozen), copy.deepcopy(frozen), copy.deepcopy({"m": [frozen]})["m"][0]):
        assert (type(again), again) == (FrozenMap, frozen)
        with pytest.raises(TypeError):
            again["z"] = 1


@pytest.mark.parametrize(
    ("number", "plain"),
    [
        (np.float64(0.1), 0.1),
        (np.float32(0.5), 0.5),
        (np.int64(-7), -7),
        (np.uint8(7), 7),
        (np.bool_(True), True),
        (np.array(2.5), 2.5),
        (np.str_("x"), "x"),
    ],
)
def test_numbers_of_numpys_are_taken_as_plain_ones(number, plain):
    for value in ({"a": number}, {"a": [number]}, {"a": {"b": (number,)}}):
        said = payload(value)["a"]
        while type(said) in (tuple, FrozenMap):
            said = said[0] if type(said) is tuple else said["b"]
        assert (type(said), said) == (type(plain), plain)


def test_any_kind_of_map_is_taken():
    for value in (OrderedDict(a=1), Counter("a"), MappingProxyType({"a": 1}), FrozenMap(a=1)):
        assert payload(value) == {"a": 1}
        assert payload({"m": value}) == {"m": {"a": 1}}


@pytest.mark.parametrize(
    ("value", "named"),
    [
        (Pair(1, 2), "is of type Pair"),
        ({1, 2}, "is of type set"),
        (frozenset({1}), "is of type frozenset"),
        (object(), "is of type object"),
        (Decimal(1), "is of type Decimal"),
        (1j, "is of type complex"),
        (Colour.RED, "is of type Colour"),
        (Rank.FIRST, "is of type Rank"),
        (bytearray(b"x"), "is of type bytearray"),
        (memoryview(b"x"), "is of type memoryview"),
        (range(3), "is of type range"),
        (np.zeros(2), "is of type ndarray"),
        (np.zeros((1, 1)), "is of type ndarray"),
        (np.complex64(1), "is of type complex"),
        (np.longdouble(1), "is of type longdouble"),
        (np.datetime64("2026-01-01"), "is of type date"),
        (msgpack.ExtType(5, b"x"), "is of type ExtType"),
        (msgpack.Timestamp(1, 2), "is of type Timestamp"),
        (print, "is of type builtin_function_or_method"),
        (nan, "is nan"),
        (inf, "is inf"),
        (-inf, "is -inf"),
        (np.float64(nan), "is nan"),
        (np.float32(inf), "is inf"),
        (2**53, "is 9007199254740992"),
        (-(2**53), "is -9007199254740992"),
        ({1: 2}, "has other keys"),
        ({b"x": 2}, "has other keys"),
        ({None: 2}, "has other keys"),
        ({"x": 1, 2: 2}, "has other keys"),
    ],
)
def test_anything_else_is_refused_with_its_place(value, named):
    assert f"a {named}" in refusal({"a": value})
    assert f"a.b.1 {named}" in refusal({"a": {"b": [0, value]}})
    assert "numbers that are finite, texts, bytes" in refusal({"a": value})


@pytest.mark.parametrize("value", [None, 1, "x", b"x", [], [("a", 1)], {"a"}, Pair(1, 2)])
def test_what_is_no_map_is_refused(value):
    assert refusal(value) == "a map with texts as keys"


@pytest.mark.parametrize("key", [1, b"a", None, ("a",), 1.5])
def test_keys_are_texts(key):
    assert "it has other keys" in refusal({key: 1})


@pytest.mark.parametrize("text", ["\ud800", "x\udfff"])
def test_half_of_a_surrogate_pair_is_no_text(text):
    for value in ({"a": text}, {text: 1}, {"a": [{text: 1}]}):
        assert "half of a surrogate pair" in refusal(value)


@pytest.mark.parametrize("wrap", [lambda v: {"x": v}, lambda v: [v], lambda v: (0, v)])
def test_it_is_nested_so_deep_and_no_deeper(wrap):
    payload(nested(SAY_DEPTH_MAX, wrap))
    for depth in (SAY_DEPTH_MAX + 1, 100, 5000):
        assert f"nested {SAY_DEPTH_MAX} deep at most" in refusal(nested(depth, wrap))


def test_what_contains_itself_is_too_deep():
    value = {}
    value["a"] = [value]
    assert "deep at most" in refusal(value)


@pytest.mark.parametrize("size", range(SAY_BYTES_MAX - 2, SAY_BYTES_MAX + 3))
def test_the_limit_is_of_bytes_as_msgpack(size):
    # One byte for the map, two for its key, three before the bytes.
    value = {"a": b"x" * (size - 6)}
    assert len(msgpack.packb(value)) == size
    if size <= SAY_BYTES_MAX:
        assert payload(value) == value
    else:
        assert refusal(value) == f"at most {SAY_BYTES_MAX} bytes as msgpack, this takes {size}"


def test_to_say_nothing_is_always_the_same():
    assert payload({}) is payload(FrozenMap()) is NOTHING_SAID
    assert NOTHING_SAID == {}
