"""What is seen of a hunt at a tick, as messages of ROS 2.

Everything is in the frame ``map``, the arena's own, and each robot and the target have a frame of
their own by their name, whose x axis points to where they last set out. Velocities are the way
since the state before, divided by the time since. Covariances are 0, since this is the truth.
"""

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

from encircle.protocol.messages import Point, State
from encircle.ros2.marker_messages import MarkerMessages
from encircle.ros2.message_types import MessageTypes
from encircle.ros2.plane_messages import PlaneMessages
from encircle.ros2.wire import Quality, Topic
from encircle.scene.frame import Frame
from encircle.scene.palette import (
    ARRIVED,
    DARK,
    LATE,
    LOST,
    UNKNOWN_LOSS,
    PacketStyle,
    robot_colour,
)
from encircle.scene.stage import Stage

TARGET = "target"
MARKERS = "visualization_msgs/msg/MarkerArray"
ROLES = ("arrived", "late", "chance", "signal", "cut", "crowd")
"""What becomes of packets, by the colours of the palette; a marker's number is its place here."""


class Body(NamedTuple):
    """Where a robot or the target is: name, position in m, heading in rad, velocity in m/s."""

    name: str
    position: Point
    heading_rad: float
    velocity_mps: Point


class SceneTopics:
    """The topics that a scene is put on, in the order in which they are sent."""

    def __init__(self, types: MessageTypes, robots: tuple[str, ...]) -> None:
        self.clock = types.topic("/clock", "rosgraph_msgs/msg/Clock", Quality(depth=1))
        self.tf = types.topic("/tf", "tf2_msgs/msg/TFMessage", Quality(depth=100))
        names = (*robots, TARGET)
        self.poses = tuple(
            types.topic(f"/{name}/pose", "geometry_msgs/msg/PoseStamped") for name in names
        )
        self.odometry = tuple(
            types.topic(f"/{name}/odom", "nav_msgs/msg/Odometry") for name in names
        )
        self.markers = types.topic("/encircle/markers", MARKERS)
        self.traffic = types.topic("/encircle/traffic", MARKERS)

    def all(self, with_clock: bool) -> tuple[Topic, ...]:
        """All of them, without ``/clock`` if nobody is to take the time from there."""
        clock = (self.clock,) if with_clock else ()
        return (*clock, self.tf, *self.poses, *self.odometry, self.markers, self.traffic)


def bodies(stage: Stage, state: State, before: State | None) -> tuple[Body, ...]:
    """All robots in robot order, then the target.

    ``before``: an earlier state of the same run, for velocities; without one they are 0.
    """
    since_s = 0.0 if before is None else (state.tick - before.tick) * stage.tick_s
    positions = (*state.robots, state.target)
    earlier = positions if before is None else (*before.robots, before.target)
    velocities = [
        ((x - x0) / since_s, (y - y0) / since_s) if since_s > 0.0 else (0.0, 0.0)
        for (x, y), (x0, y0) in zip(positions, earlier, strict=True)
    ]
    headings_rad = (*state.headings_rad, math.atan2(velocities[-1][1], velocities[-1][0]))
    return tuple(map(Body, (*stage.robots, TARGET), positions, headings_rad, velocities))


class SceneMessages:
    """Makes the messages of one run's states; ``types``: of the release that is to read them."""

    def __init__(self, types: MessageTypes, stage: Stage) -> None:
        self.topics = SceneTopics(types, stage.robots)
        self._stage = stage
        self._plane = PlaneMessages(types)
        self._markers = MarkerMessages(self._plane)

    def of(
        self, state: State, before: State | None, stamp_ns: int, with_clock: bool
    ) -> Iterator[tuple[Topic, Any]]:
        """Topics and messages of a state; ``stamp_ns``: the time of all of them.

        ``with_clock``: tell that time also to those that take theirs from ``/clock``, before all
        else.
        """
        plane, topics, stage = self._plane, self.topics, self._stage
        stamp = plane.time(stamp_ns)
        header = plane.header(stamp)
        moving = bodies(stage, state, before)
        if with_clock:
            yield topics.clock, plane.make("rosgraph_msgs/msg/Clock", stamp)
        transforms = [plane.transform(header, b.name, b.position, b.heading_rad) for b in moving]
        yield topics.tf, plane.make("tf2_msgs/msg/TFMessage", transforms)
        for topic, body in zip(topics.poses, moving, strict=True):
            yield topic, plane.pose_stamped(header, body.position, body.heading_rad)
        for topic, body in zip(topics.odometry, moving, strict=True):
            yield topic, plane.odometry(header, *body)
        marks = self._markers
        shown = [marks.obstacle(header, k, *o) for k, o in enumerate(stage.obstacles)]
        for number, body in enumerate(moving):
            if body.name == TARGET:
                colour, radius_m = None, stage.target_radius_m
                text = f"{TARGET}, captured" if state.captured else TARGET
            else:
                colour, radius_m, text = number, stage.radius_m, body.name
            shown += marks.body(header, number, body.position, radius_m, colour, text)
        shown.append(marks.circle(header, state.target, stage.stop_distance_m))
        yield topics.markers, plane.make(MARKERS, shown)

    def traffic(self, frame: Frame, stamp_ns: int) -> tuple[Topic, Any]:
        """Topic and message of what is said and meant at a tick: packets by fate, and goals.

        A packet is a line from its sender to its receiver; one that is lost ends on the way.
        """
        header = self._plane.header(self._plane.time(stamp_ns))
        flights: dict[str, list[tuple[Point, Point]]] = {role: [] for role in ROLES}
        for packet in frame.packets:
            style = self._style_of(packet.due, frame.tick)
            (x, y), (x1, y1) = frame.robots[packet.sender], frame.robots[packet.receiver]
            end = x + style.reach * (x1 - x), y + style.reach * (y1 - y)
            flights[style.role].append(((x, y), end))
        shown = [
            self._markers.lines(header, "packets", number, DARK[role], flights[role])
            for number, role in enumerate(ROLES)
        ]
        for number, (at, goal) in enumerate(zip(frame.robots, frame.goals, strict=True)):
            way = [] if goal is None else [(at, goal)]
            shown.append(self._markers.lines(header, "goals", number, robot_colour(number), way))
        return self.topics.traffic, self._plane.make(MARKERS, shown)

    def _style_of(self, due: int, tick: int) -> PacketStyle:
        if due > 0:
            return ARRIVED if due == tick + 1 else LATE
        causes = self._stage.causes
        return LOST.get(causes[-due], UNKNOWN_LOSS) if -due < len(causes) else UNKNOWN_LOSS
