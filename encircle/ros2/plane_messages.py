"""Poses, velocities and times of things that move in the plane, as messages of ROS 2.

z is 0 and turns are about it. Velocities of ``nav_msgs/Odometry`` are in the frame of what moves,
as that asks for; here they come in in the arena's frame and are turned.
"""

import math
from typing import Any

import numpy as np

from encircle.protocol.messages import Point
from encircle.ros2.message_types import MessageTypes

FRAME = "map"
"""The arena's own frame."""
NS_PER_S = 1_000_000_000
_DIAGONAL = 7
"""From one diagonal entry of a row-major 6 x 6 matrix to the next."""


class PlaneMessages:
    """Makes messages; ``types``: of the release that is to read them."""

    def __init__(self, types: MessageTypes) -> None:
        self.make = types.make

    def time(self, time_ns: int) -> Any:
        """A time; from the epoch, or from the run's first tick where time is simulated."""
        return self.make("builtin_interfaces/msg/Time", *divmod(time_ns, NS_PER_S))

    def header(self, stamp: Any) -> Any:
        """What a stamped message in the arena's frame begins with."""
        return self.make("std_msgs/msg/Header", stamp, FRAME)

    def turn(self, heading_rad: float) -> Any:
        """A turn about z."""
        half = 0.5 * heading_rad
        return self.make("geometry_msgs/msg/Quaternion", 0.0, 0.0, math.sin(half), math.cos(half))

    def vector(self, x: float, y: float, z: float = 0.0) -> Any:
        """A vector."""
        return self.make("geometry_msgs/msg/Vector3", x, y, z)

    def pose(self, position: Point, heading_rad: float = 0.0, z_m: float = 0.0) -> Any:
        """A position in m and a heading in rad."""
        point = self.make("geometry_msgs/msg/Point", *position, z_m)
        return self.make("geometry_msgs/msg/Pose", point, self.turn(heading_rad))

    def pose_stamped(self, header: Any, position: Point, heading_rad: float) -> Any:
        """The same, with time and frame."""
        return self.make("geometry_msgs/msg/PoseStamped", header, self.pose(position, heading_rad))

    def transform(self, header: Any, frame: str, position: Point, heading_rad: float) -> Any:
        """From the arena's frame to one that moves."""
        parts = self.vector(*position), self.turn(heading_rad)
        transform = self.make("geometry_msgs/msg/Transform", *parts)
        return self.make("geometry_msgs/msg/TransformStamped", header, frame, transform)

    def odometry(
        self,
        header: Any,
        frame: str,
        position: Point,
        heading_rad: float,
        velocity_mps: Point,
        position_m2: float = 0.0,
        velocity_m2ps2: float = 0.0,
    ) -> Any:
        """Where something is and how fast; ``velocity_mps`` in the arena's frame.

        ``position_m2``, ``velocity_m2ps2``: variances along x and along y; 0 for the truth.
        """
        cos, sin = math.cos(heading_rad), math.sin(heading_rad)
        vx, vy = velocity_mps
        twist = self.make(
            "geometry_msgs/msg/Twist",
            self.vector(cos * vx + sin * vy, cos * vy - sin * vx),
            self.vector(0.0, 0.0),
        )
        pose = self.pose(position, heading_rad)
        return self.make(
            "nav_msgs/msg/Odometry",
            header,
            frame,
            self.make("geometry_msgs/msg/PoseWithCovariance", pose, _covariance(position_m2)),
            self.make("geometry_msgs/msg/TwistWithCovariance", twist, _covariance(velocity_m2ps2)),
        )


def _covariance(variance: float) -> "np.ndarray[Any, np.dtype[np.float64]]":
    """36 numbers: the same variance along x and y, and nothing else."""
    matrix = np.zeros(36)
    matrix[[0, _DIAGONAL]] = variance
    return matrix
