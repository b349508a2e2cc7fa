"""ROS 2's side of a steered robot: what it is told of a tick, and the commands that it gives.

The robot tells what it believes, not the truth: a ROS 2 node that steers it gets what a policy of
this project would get.
"""

import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from math import atan2
from typing import Any

from encircle.agents.brain.brain import Perception
from encircle.protocol.errors import ConnectionClosed
from encircle.ros2.commands import RobotCommand, goal_of, velocity_of
from encircle.ros2.message_types import MessageTypes
from encircle.ros2.node import RosNode
from encircle.ros2.plane_messages import NS_PER_S, PlaneMessages
from encircle.ros2.steered_robot import CommandMail
from encircle.ros2.wire import Topic

TWIST, TWIST_STAMPED = "geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped"
POSE_STAMPED, POSE_ARRAY = "geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/PoseArray"


class SteeringNode:
    """The topics of one robot: beliefs out, commands in.

    ``log``: gets a line on each message that is no command.
    """

    def __init__(
        self,
        node: RosNode,
        types: MessageTypes,
        robot: str,
        mail: CommandMail,
        log: Callable[[str], None],
    ) -> None:
        self._node, self._types, self._robot = node, types, robot
        self._mail, self._log = mail, log
        self._plane = PlaneMessages(types)
        self._pose = types.topic(f"/{robot}/belief/pose", POSE_STAMPED)
        self._target = types.topic(f"/{robot}/belief/target", "nav_msgs/msg/Odometry")
        self._peers = types.topic(f"/{robot}/belief/peers", POSE_ARRAY)
        node.advertise((self._pose, self._target, self._peers))
        self._listen(f"/{robot}/cmd_vel", TWIST, velocity_of)
        self._listen(f"/{robot}/cmd_vel_stamped", TWIST_STAMPED, self._velocity_of_stamped)
        self._listen(f"/{robot}/goal_pose", POSE_STAMPED, goal_of)

    def _velocity_of_stamped(self, message: Any) -> RobotCommand:
        return velocity_of(message.twist, message.header.frame_id, self._robot)

    def _listen(self, name: str, type_name: str, read: Callable[[Any], RobotCommand]) -> None:
        topic = self._types.topic(name, type_name)
        self._node.subscribe(topic, partial(self._take, topic, read))

    def _take(self, topic: Topic, read: Callable[[Any], RobotCommand], payload: bytes) -> None:
        try:
            self._mail.put(read(self._types.decoded(payload, topic.type_name)))
        except ValueError as error:
            self._mail.refuse()
            self._log(f"ros2: refused a message on {topic.name}: {error}")

    def tell(self, perception: Perception, by_clock: bool) -> None:
        """Tell what the robot believes at a tick; its own position last, which ends the tick's."""
        observation, view, plane = perception.observation, perception.view, self._plane
        simulated_ns = round(observation.tick * view.tick_s * NS_PER_S)
        header = plane.header(plane.time(time.time_ns() if by_clock else simulated_ns))
        peers = [
            plane.pose(peer.position, atan2(peer.velocity[1], peer.velocity[0]))
            for peer in view.peers
        ]
        self._send(self._peers, plane.make(POSE_ARRAY, header, peers))
        if view.target is not None:
            estimate = view.target
            position_m2, _, velocity_m2ps2 = estimate.covariance
            velocity = (estimate.vx, estimate.vy)
            heading_rad = atan2(estimate.vy, estimate.vx)
            believed = (estimate.position, heading_rad, velocity, position_m2, velocity_m2ps2)
            self._send(self._target, plane.odometry(header, "target", *believed))
        own = observation.position, observation.heading_rad
        self._send(self._pose, plane.pose_stamped(header, *own))

    def _send(self, topic: Topic, message: Any) -> None:
        # Without ROS 2 the robot goes on, and stands.
        with suppress(ConnectionClosed):
            self._node.publish(topic, self._types.encoded(message))
