"""What a commanded step becomes: limits, and the unicycle's closed forms."""

from math import atan2, cos, hypot, pi, remainder, sin

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.world.arena.dynamics import holonomic_headings, limited, unicycle

SETTINGS = settings(deadline=None, derandomize=True, max_examples=200)
SIZES = st.floats(-1e6, 1e6)
STEPS = st.lists(st.tuples(SIZES, SIZES), min_size=1, max_size=6)
ANGLES = st.floats(-pi, pi)


@SETTINGS
@given(steps=STEPS, limit=st.floats(1e-3, 10.0))
def test_a_step_is_shortened_to_the_limit_in_its_direction_or_left_as_it_is(steps, limit):
    wanted = np.array(steps)
    made = limited(wanted, np.full(len(steps), limit))
    for before, after in zip(wanted.tolist(), made.tolist(), strict=True):
        if hypot(*before) <= limit * (1 - 1e-12):
            assert after == before
        else:
            assert hypot(*after) == pytest.approx(min(limit, hypot(*before)), rel=1e-12)
            assert after == pytest.approx([c * hypot(*after) / hypot(*before) for c in before])


def test_each_body_has_its_own_limit():
    made = limited(np.array([[3.0, 4.0], [3.0, 4.0], [0.0, 0.0]]), np.array([1.0, 10.0, 1.0]))
    np.testing.assert_allclose(made, [[0.6, 0.8], [3.0, 4.0], [0.0, 0.0]], rtol=1e-15)


@pytest.mark.parametrize("size", [1e150, 1e155, 1e200, 1e308])
def test_a_step_of_any_finite_size_is_shortened_to_the_limit(size):
    made = limited(np.array([[-size, 0.0], [0.1, 0.0]]), np.array([0.3, 0.3]))
    np.testing.assert_allclose(made, [[-0.3, 0.0], [0.1, 0.0]], rtol=1e-12)


@SETTINGS
@given(heading=ANGLES, steps=STEPS, turn_max=st.floats(0.01, pi))
def test_a_unicycle_turns_no_faster_than_it_can_and_rolls_forward_along_its_heading(
    heading, steps, turn_max
):
    headings = np.full(len(steps), heading)
    turned, made = unicycle(headings, np.array(steps), turn_max)
    for after, step, command in zip(turned.tolist(), made.tolist(), steps, strict=True):
        assert -pi - 1e-12 <= after <= pi + 1e-12
        assert abs(remainder(after - heading, 2 * pi)) <= turn_max + 1e-9
        forward = step[0] * cos(after) + step[1] * sin(after)
        aside = step[1] * cos(after) - step[0] * sin(after)
        assert forward >= 0.0
        assert abs(aside) <= 1e-9 * hypot(*command)
        assert hypot(*step) <= hypot(*command) * (1 + 1e-12)


@SETTINGS
@given(heading=ANGLES, command=ANGLES, turn_max=st.floats(0.01, pi))
def test_a_unicycle_turns_the_shorter_way_as_far_as_it_must_or_can(heading, command, turn_max):
    step = np.array([[0.3 * cos(command), 0.3 * sin(command)]])
    turned, made = unicycle(np.array([heading]), step, turn_max)
    before, after = (abs(remainder(command - h, 2 * pi)) for h in (heading, float(turned[0])))
    assert after == pytest.approx(max(0.0, before - turn_max), abs=1e-9)
    # What of the command lies along the new heading.
    assert hypot(*made[0]) == pytest.approx(0.3 * max(0.0, cos(after)), abs=1e-9)


@pytest.mark.parametrize("turn_max", [pi / 6, 0.1, 0.5])
@pytest.mark.parametrize("side", [1, -1])
def test_a_unicycle_commanded_sideways_for_ever_runs_on_a_circle(turn_max, side):
    # Each tick it turns by turn_max and rolls L sin(turn_max): chords of a circle with exterior
    # angle turn_max, whose radius is chord / (2 sin(turn_max / 2)) = L cos(turn_max / 2).
    length, heading, place = 0.3, 0.7, np.zeros(2)
    places = []
    for _ in range(200):
        command = heading + side * pi / 2
        step = length * np.array([[cos(command), sin(command)]])
        turned, made = unicycle(np.array([heading]), step, turn_max)
        heading, place = float(turned[0]), place + made[0]
        places.append(place)
    radius = length * cos(turn_max / 2)
    chord, first = places[1] - places[0], (places[0] + places[1]) / 2
    inward = np.array([-chord[1], chord[0]]) / hypot(*chord) * side
    centre = first + inward * radius * cos(turn_max / 2)
    np.testing.assert_allclose(np.hypot(*(np.array(places) - centre).T), radius, rtol=1e-9)


def test_a_unicycle_told_to_go_backward_turns_round_without_rolling():
    turned, made = unicycle(np.array([0.0]), np.array([[-0.3, 0.0]]), pi / 6)
    assert abs(turned[0]) == pytest.approx(pi / 6)
    assert (made == 0.0).all()


def test_a_unicycle_without_a_command_stands_and_keeps_its_heading():
    turned, made = unicycle(np.array([1.0, -2.0]), np.zeros((2, 2)), 0.5)
    np.testing.assert_allclose(turned, [1.0, -2.0], atol=1e-15)
    assert (made == 0.0).all()


@pytest.mark.parametrize("start", [-3.0, 0.5, 2.9])
def test_a_unicycle_comes_to_face_where_it_is_told_and_then_makes_the_whole_step(start):
    heading = np.array([start])
    for _ in range(7):
        heading, made = unicycle(heading, np.array([[0.0, 0.3]]), pi / 6)
    assert heading[0] == pytest.approx(pi / 2)
    np.testing.assert_allclose(made, [[0.0, 0.3]], atol=1e-12)


@SETTINGS
@given(heading=ANGLES, step=st.tuples(SIZES, SIZES))
def test_a_holonomic_body_faces_where_it_goes_and_keeps_its_heading_at_rest(heading, step):
    after = float(holonomic_headings(np.array([heading]), np.array([step]))[0])
    if step == (0.0, 0.0):
        assert after == heading
    else:
        assert after == pytest.approx(atan2(step[1], step[0]), abs=1e-15)
