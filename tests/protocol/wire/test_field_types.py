"""Types put together from annotations: words, schemas and checks that say the same.

Oracle: the table below, written by hand.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import pytest

from encircle.protocol.messages import Command, Observation, Pose
from encircle.protocol.wire.declaration import Field, declared_fields
from encircle.protocol.wire.field_types import (
    Boolean,
    CheckedBy,
    Count,
    Duration,
    Items,
    Point,
    Real,
    Text,
    field_type,
)


class Reading(NamedTuple):
    """A row with names."""

    sensor: Text
    value: Real


TYPES = [
    (Count, "count", [0, 2**53 - 1], [-1, 1.0, True, None, "1"]),
    (Duration, "real above 0", [0.1], [0.0, -1.0, None]),
    (Real | None, "real or null", [None, 1.5], ["1", True]),
    (tuple[Text, ...], "list of texts", [(), ("a", "b")], [("a", 1), "ab", None]),
    (
        Annotated[tuple[Count, ...], Items(2)],
        "list of at most 2 counts",
        [(), (1, 2)],
        [(1, 2, 3)],
    ),
    (
        Annotated[tuple[Count, ...], Items(3, 2)],
        "list of 2 to 3 counts",
        [(1, 2), (1, 2, 3)],
        [(1,), (1, 2, 3, 4)],
    ),
    (tuple[Text, Real], "[text, real]", [("a", 1.0)], [("a",), ("a", 1.0, 2.0), (1.0, "a")]),
    (
        tuple[Text, Real, Count],
        "[text, real, count]",
        [("a", 1.0, 2)],
        [("a", 1.0), ("a", 1.0, -2), ["a", 1.0, 2]],
    ),
    (Reading, "[text, real]", [("a", 1.0)], [("a",), (1.0, "a")]),
    (
        tuple[tuple[Point, ...], ...] | None,
        "list of lists of points or null",
        [None, (((1.0, 2.0),), ())],
        [((1.0, 2.0),)],
    ),
    (Mapping[Text, Boolean], "map, text to boolean", [{}, {"a": True}], [{1: True}, {"a": 1}, ()]),
]


@pytest.mark.parametrize(
    ("annotation", "words", "right", "wrong"), TYPES, ids=[t[1] for t in TYPES]
)
def test_a_type_has_its_words_and_takes_what_it_should(annotation, words, right, wrong):
    composed = field_type(annotation)
    assert composed.text == words
    for value in right:
        assert composed.check(value) == value
    for value in wrong:
        with pytest.raises(ValueError, match=r"\w"):
            composed.check(value)


def test_a_named_tuple_is_made_of_a_row():
    reading = field_type(Reading).check(("lidar", 2))
    assert type(reading) is Reading
    assert reading.value == 2.0


def test_only_types_with_maps_inside_have_names_that_could_come_twice():
    assert field_type(tuple[Mapping[Text, Count], ...] | None).has_map
    assert not field_type(tuple[Reading, ...]).has_map


@pytest.mark.parametrize("annotation", [int, float | None, tuple[str, ...], dict, Count | Text])
def test_an_annotation_that_says_not_how_it_is_sent_is_refused(annotation):
    with pytest.raises(TypeError, match="no type of"):
        field_type(annotation)


def test_a_field_without_a_meaning_or_a_type_is_refused_by_name():
    @dataclass
    class Battery:
        charge: Count

    @dataclass
    class Lamp:
        colour: Annotated[str, Field("its colour")]

    with pytest.raises(TypeError, match=r"Battery\.charge: declare it as"):
        declared_fields(Battery)
    with pytest.raises(TypeError, match=r"Lamp\.colour: .*no type of"):
        declared_fields(Lamp)


REPORT = ("r2", 6, 1.0, 2.0)
CELLS = ("r2", "x" * 257, b"r2", 6, -1, 2**53, True, None, 1.0, -0.5, 1e9, float("nan"), (), {})
ROWS = {
    "scan": [(1.0,) * 8],
    "seen": [(), (("r2", 1.0, 2.0), ("r3", 3, -4.0)), (("r" * 40, 1.0, 2.0),)],
    "relayed": [(), (REPORT,), (REPORT, ("r3", 6, 1, 2)), (REPORT,) * 16, (REPORT,) * 17],
    "timing": [(1, 2, ()), (1, 2, (("r2", 3, 4),) * 256), (1, 2, (("r2", 3, 4),) * 257)],
}


def outcome(check, value):
    try:
        return check(value)
    except ValueError:
        return "refused"


def variants(value):
    """The value, and the value with each of its parts, at any depth, replaced by odd cells."""
    yield value
    for place, part in enumerate(value[:2]):
        inner = variants(part) if isinstance(part, tuple) else ()
        for odd in (*CELLS, *inner):
            yield (*value[:place], odd, *value[place + 1 :])
    if value and isinstance(value[-1], tuple):
        for odd in variants(value[-1]):
            yield (*value[:-1], odd)


@pytest.mark.parametrize(
    ("kind", "name"),
    [(Observation, "scan"), (Observation, "seen"), (Pose, "relayed"), (Command, "timing")],
)
def test_a_quicker_check_judges_as_the_one_from_the_annotation(kind, name):
    annotation = kind.__dataclass_fields__[name].type
    slow = field_type(without_quicker_checks(annotation))
    quick = field_type(annotation)
    assert quick.text == slow.text
    for sample in ROWS[name]:
        for value in variants(sample):
            assert outcome(quick.check, value) == outcome(slow.check, value)


def without_quicker_checks(annotation):
    """The same annotation, of which the check follows alone; a named tuple becomes a row."""
    if name := getattr(annotation, "_fields", None):
        parts = [without_quicker_checks(annotation.__annotations__[field]) for field in name]
        return tuple[tuple(parts)]
    if metadata := getattr(annotation, "__metadata__", None):
        kept = [item for item in metadata if not isinstance(item, CheckedBy)]
        inner = annotation.__origin__
        if not any(hasattr(item, "check") for item in kept):
            inner = without_quicker_checks(inner)
        return Annotated[(inner, *kept)] if kept else inner
    if type(None) in getattr(annotation, "__args__", ()):
        return without_quicker_checks(annotation.__args__[0]) | None
    return annotation
