"""Keys: what is built is taken apart again, and nothing else is taken."""

import string

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.protocol.errors import UnknownKey
from encircle.protocol.keys import (
    ROBOT_CHANNELS,
    WORLD_CHANNELS,
    Key,
    check_name,
    parse_key,
    robot_key,
    world_key,
)

CHEAP = settings(max_examples=100, deadline=None, derandomize=True)
ALLOWED = string.ascii_letters + string.digits + "-_"
names = st.text(ALLOWED, min_size=1, max_size=31)


def test_keys_are_those_of_the_protocol():
    assert robot_key("g1", "r2", "pose") == "encircle/g1/robots/r2/pose"
    assert world_key("g1", "state") == "encircle/g1/world/state"


@CHEAP
@given(names, names, st.sampled_from(ROBOT_CHANNELS))
def test_a_robots_key_is_taken_apart_into_what_it_was_built_from(run, robot, channel):
    assert parse_key(robot_key(run, robot, channel)) == Key(run, robot, channel)


@CHEAP
@given(names, st.sampled_from(WORLD_CHANNELS))
def test_the_worlds_key_is_taken_apart_and_names_no_robot(run, channel):
    assert parse_key(world_key(run, channel)) == Key(run, None, channel)


@pytest.mark.parametrize(
    "key",
    [
        "",
        "/",
        "encircle",
        "encircle/g1",
        "encircle/g1/robots",
        "encircle/g1/robots/r1",
        "encircle/g1/robots/r1/",
        "encircle/g1/robots/r1/shout",
        "encircle/g1/robots/r1/state",
        "encircle/g1/robots/r1/pose/more",
        "/encircle/g1/robots/r1/pose",
        "Encircle/g1/robots/r1/pose",
        "encircle/g1/robot/r1/pose",
        "encircle/g1/world",
        "encircle/g1/world/pose",
        "encircle/g1/world/r1/state",
        "encircle/g1/world/state ",
        "other/g1/world/state",
        "encircle/*/world/state",
        "encircle/g1/robots/*/pose",
        "encircle/g1/robots//pose",
        f"encircle/{'g' * 32}/world/state",
        "encircle/g1/robots/r1\x1b[2J/pose",
    ],
)
def test_a_key_that_is_not_of_the_protocol_is_refused_by_name(key):
    with pytest.raises(UnknownKey) as caught:
        parse_key(key)
    assert repr(key) in str(caught.value)


@CHEAP
@given(st.text(max_size=80))
def test_any_text_is_parsed_or_refused(key):
    try:
        run, robot, channel = parse_key(key)
    except UnknownKey:
        return
    built = world_key(run, channel) if robot is None else robot_key(run, robot, channel)
    assert built == key


def test_a_very_long_key_is_not_repeated_in_full():
    with pytest.raises(UnknownKey) as caught:
        parse_key("x" * 100_000)
    assert len(str(caught.value)) < 300


@CHEAP
@given(names)
def test_a_valid_name_is_returned_unchanged(name):
    assert check_name("run", name) == name


@pytest.mark.parametrize(
    "name", ["", "x" * 32, "a/b", "a*", "**", "a b", "é", "a\n", "\n", ".", "a$", "٣"]
)
def test_a_name_that_may_not_stand_in_a_key_is_refused_with_its_kind(name):
    with pytest.raises(ValueError, match=r"robot .* is not a valid name") as caught:
        check_name("robot", name)
    assert repr(name) in str(caught.value)
