"""What a velocity or a goal means for a robot's step, and what is no command."""

from math import cos, hypot, inf, nan, pi, sin

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.ros2.commands import (
    TURN_M,
    VALUE_MAX,
    CommandRefused,
    Goal,
    Velocity,
    goal_of,
    step_of,
    velocity_of,
)
from encircle.ros2.message_types import MessageTypes
from encircle.ros2.releases import RELEASES

TYPES = MessageTypes(RELEASES["jazzy"])
CHEAP = settings(max_examples=60, deadline=None, derandomize=True)
REALS = st.floats(-1e3, 1e3)


def vector(x, y, z):
    return TYPES.make("geometry_msgs/msg/Vector3", x, y, z)


def twist(x=0.0, y=0.0, turn=0.0):
    return TYPES.make("geometry_msgs/msg/Twist", vector(x, y, 0.0), vector(0.0, 0.0, turn))


def pose(x, y, frame="map"):
    header = TYPES.make(
        "std_msgs/msg/Header", TYPES.make("builtin_interfaces/msg/Time", 0, 0), frame
    )
    point = TYPES.make("geometry_msgs/msg/Point", x, y, 0.0)
    turn = TYPES.make("geometry_msgs/msg/Quaternion", 0.0, 0.0, 0.0, 1.0)
    return TYPES.make(
        "geometry_msgs/msg/PoseStamped", header, TYPES.make("geometry_msgs/msg/Pose", point, turn)
    )


def test_a_twist_is_a_velocity_in_the_robots_frame():
    assert velocity_of(twist(1.0, -2.0, 3.0)) == Velocity(1.0, -2.0, 3.0)


@pytest.mark.parametrize(("frame", "in_arena"), [("", False), ("r3", False), ("map", True)])
def test_a_stamped_twist_says_in_which_frame_it_is(frame, in_arena):
    assert velocity_of(twist(1.0), frame, "r3") == Velocity(1.0, 0.0, 0.0, in_arena)


@pytest.mark.parametrize("value", [nan, inf, -inf, 1e9])
@pytest.mark.parametrize("field", ["x", "y", "turn"])
def test_a_number_that_cannot_be_meant_is_no_command(field, value):
    name = {"x": "linear.x", "y": "linear.y", "turn": "angular.z"}[field]
    with pytest.raises(CommandRefused, match=f"{name} = {value}: must be from -1e"):
        velocity_of(twist(**{field: value}))


def test_what_does_not_move_a_robot_in_the_plane_is_not_looked_at():
    message = TYPES.make("geometry_msgs/msg/Twist", vector(1.0, 0.0, nan), vector(inf, nan, 0.0))
    assert velocity_of(message) == Velocity(1.0, 0.0, 0.0)


@pytest.mark.parametrize("frame", ["odom", "r4"])
def test_a_frame_that_is_not_known_is_refused(frame):
    with pytest.raises(CommandRefused, match=f"frame_id = '{frame}': must be 'r3' or 'map'"):
        velocity_of(twist(1.0), frame, "r3")
    with pytest.raises(CommandRefused, match=f"frame_id = '{frame}': must be 'map'"):
        goal_of(pose(1.0, 2.0, frame))


def test_a_goal_is_a_point():
    assert goal_of(pose(1.0, 2.0)) == goal_of(pose(1.0, 2.0, "")) == Goal(1.0, 2.0)
    with pytest.raises(CommandRefused, match=r"position\.y = nan"):
        goal_of(pose(1.0, nan))


@CHEAP
@given(REALS, REALS, st.floats(-10.0, 10.0), st.floats(-pi, pi), st.floats(1e-3, 1.0))
def test_a_velocity_in_the_robots_frame_is_turned_with_it(x, y, turn, heading, tick_s):
    """The complex plane as the oracle."""
    step, after = step_of(Velocity(x, y, turn), (5.0, 6.0), heading, tick_s)
    assert after == pytest.approx(heading + turn * tick_s)
    if x == y == 0.0:
        return
    turned = complex(x, y) * tick_s * complex(cos(after), sin(after))
    assert complex(*step) == pytest.approx(turned, abs=1e-9)
    assert hypot(*step) == pytest.approx(tick_s * hypot(x, y), abs=1e-9)


def test_a_velocity_in_the_arenas_frame_is_taken_as_it_is():
    step, _ = step_of(Velocity(1.0, 2.0, 0.5, in_arena=True), (0.0, 0.0), 1.0, 0.1)
    assert step == pytest.approx((0.1, 0.2))


def test_a_turn_on_the_spot_is_a_small_step_into_the_new_direction():
    step, heading = step_of(Velocity(0.0, 0.0, 2.0), (0.0, 0.0), 0.5, 0.1)
    assert heading == pytest.approx(0.7)
    assert step == pytest.approx((TURN_M * cos(0.7), TURN_M * sin(0.7)))


def test_no_velocity_is_no_step():
    assert step_of(Velocity(0.0, 0.0, 0.0), (3.0, 4.0), 0.5, 0.1) == ((0.0, 0.0), 0.5)


def test_a_goal_is_the_step_to_it():
    assert step_of(Goal(3.0, -1.0), (1.0, 1.0), 0.5, 0.1) == ((2.0, -2.0), 0.5)
    assert step_of(Goal(VALUE_MAX, 0.0), (0.0, 0.0), 0.0, 0.1)[0] == (VALUE_MAX, 0.0)
