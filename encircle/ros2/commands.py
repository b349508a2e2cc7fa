"""What ROS 2 tells a robot to do, and the step that it then takes in a tick.

A velocity (``geometry_msgs/Twist``) is by custom in the robot's own frame: x forward, y to the
left, z of the turn counter-clockwise. A stamped one may also be in the arena's. In a tick of length
T the robot turns by ``turn * T`` and then moves by ``(x, y) * T`` along its new heading, as the
arena's unicycle does. A heading is in this project the direction of the last step: a robot that is
to turn on the spot takes a step of ``TURN_M`` in the new direction. A goal
(``geometry_msgs/PoseStamped``) is a point to go to, as fast as the robot can. The brain shortens
every step to what the robot can do, and keeps it from collisions, as it does for any policy.
"""

import math
from typing import Any, NamedTuple, TypeAlias

from encircle.protocol.messages import Point
from encircle.ros2.plane_messages import FRAME

TURN_M = 0.001
VALUE_MAX = 1e6
"""The largest velocity, turn or coordinate that is taken to be meant."""


class CommandRefused(ValueError):
    """A message that is no command for this robot; the text says why."""


class Velocity(NamedTuple):
    """How fast to go, in m/s and rad/s; ``in_arena``: x and y are the arena's."""

    x_mps: float
    y_mps: float
    turn_radps: float
    in_arena: bool = False


class Goal(NamedTuple):
    """Where to go, in m."""

    x_m: float
    y_m: float


RobotCommand: TypeAlias = Velocity | Goal


def velocity_of(twist: Any, frame: str = "", own_frame: str = "") -> Velocity:
    """The velocity that a ``Twist`` means; raises ``CommandRefused``.

    ``frame``: that of a stamped one; the arena's, the robot's own, or none.
    """
    if frame not in ("", own_frame, FRAME):
        raise CommandRefused(f"frame_id = {frame!r}: must be {own_frame!r} or {FRAME!r}, or empty")
    velocity = Velocity(twist.linear.x, twist.linear.y, twist.angular.z, frame == FRAME)
    _check("linear.x", velocity.x_mps)
    _check("linear.y", velocity.y_mps)
    _check("angular.z", velocity.turn_radps)
    return velocity


def goal_of(pose: Any) -> Goal:
    """The point that a ``PoseStamped`` means; its orientation does not matter here."""
    frame = pose.header.frame_id
    if frame not in ("", FRAME):
        raise CommandRefused(f"frame_id = {frame!r}: must be {FRAME!r}, or empty")
    at = pose.pose.position
    return Goal(_check("position.x", at.x), _check("position.y", at.y))


def _check(name: str, value: float) -> float:
    if not abs(value) <= VALUE_MAX:
        raise CommandRefused(f"{name} = {value}: must be from {-VALUE_MAX:g} to {VALUE_MAX:g}")
    return float(value)


def step_of(
    command: RobotCommand, position: Point, heading_rad: float, tick_s: float
) -> tuple[Point, float]:
    """The step in m that a command asks for in a tick, and the heading in rad that it means.

    ``heading_rad``: the robot's before.
    """
    if isinstance(command, Goal):
        x, y = position
        return (command.x_m - x, command.y_m - y), heading_rad
    heading_rad += command.turn_radps * tick_s
    x_m, y_m = command.x_mps * tick_s, command.y_mps * tick_s
    if x_m == y_m == 0.0 and command.turn_radps != 0.0:
        return (TURN_M * math.cos(heading_rad), TURN_M * math.sin(heading_rad)), heading_rad
    if command.in_arena:
        return (x_m, y_m), heading_rad
    cos, sin = math.cos(heading_rad), math.sin(heading_rad)
    return (cos * x_m - sin * y_m, sin * x_m + cos * y_m), heading_rad
