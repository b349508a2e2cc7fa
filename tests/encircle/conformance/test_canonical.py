"""Texts of values are equal if the values are, also after pickling, and else are not."""

import copy
import pickle
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from encircle.conformance.canonical import canonical

PLAIN = st.none() | st.booleans() | st.integers() | st.text() | st.binary()
PLAIN |= st.floats(allow_nan=False)
KEYS = st.text(max_size=3) | st.integers()
VALUES = st.recursive(
    PLAIN,
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.lists(inner, max_size=4).map(tuple)
        | st.dictionaries(KEYS, inner, max_size=4)
        | st.sets(KEYS, max_size=4)
    ),
    max_leaves=12,
)


@dataclass
class Bid:
    robot: str
    price: float


@given(VALUES)
def test_a_value_that_was_pickled_and_fetched_back_has_the_same_text(value):
    assert canonical(pickle.loads(pickle.dumps(value))) == canonical(value)


@given(VALUES, VALUES)
def test_values_of_the_same_text_are_equal(one, other):
    if canonical(one) == canonical(other):
        assert one == other


@given(st.dictionaries(KEYS, PLAIN))
def test_the_order_of_a_map_does_not_count(value):
    assert canonical(dict(reversed(value.items()))) == canonical(value)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (0.0, -0.0),
        (1, 1.0),
        (True, 1),
        ((1, 2), [1, 2]),
        (np.array([1.0, 2.0]), np.array([1.0, 2.5])),
        (np.array([[1, 2]]), np.array([[1], [2]])),
        (Bid("r1", 1.0), Bid("r1", 2.0)),
        ({"a": Bid("r1", 1.0)}, {"a": Bid("r2", 1.0)}),
        (np.random.default_rng(1), np.random.default_rng(2)),
    ],
)
def test_what_differs_has_another_text(one, other):
    assert canonical(one) != canonical(other)
    assert canonical(copy.deepcopy(one)) == canonical(one)


def test_a_generator_that_has_drawn_has_another_text():
    generator = np.random.default_rng(1)
    before = canonical(generator)
    generator.normal()
    assert canonical(generator) != before


def test_objects_that_hold_each_other_come_to_an_end():
    robots = [{} for _ in range(12)]
    for robot in robots:
        robot["team"] = robots
    assert canonical(robots)


def test_what_cannot_be_pickled_is_named_by_its_type():
    assert canonical(x for x in "ab") == "builtins.generator"
