"""Shapes for RViz: bodies with their names, obstacles, and the stop distance about the target.

A marker stays until one of the same namespace and number takes its place, so that each state brings
all of them anew, and whoever begins to look on late sees all within a tick. Colours are those of
the dark theme, since RViz is dark unless told otherwise.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from encircle.protocol.messages import Point
from encircle.ros2.plane_messages import PlaneMessages
from encircle.scene.palette import DARK, robot_colour

HEIGHT_M = 0.3
"""Of bodies and obstacles, which have none in the plane."""
TEXT_M = 0.6
CIRCLE_POINTS = 48
LINE_M = 0.05
CYLINDER, LINE_STRIP, LINE_LIST, TEXT = 3, 4, 5, 9
"""Kinds of markers, by the numbers of ``visualization_msgs/msg/Marker``."""
ADD, DELETE = 0, 2


class MarkerMessages:
    """Makes markers."""

    def __init__(self, plane: PlaneMessages) -> None:
        self._plane = plane
        make = plane.make
        nothing = make("std_msgs/msg/Header", plane.time(0), "")
        no_bytes = np.zeros(0, np.uint8)
        self._unused = {
            "lifetime": make("builtin_interfaces/msg/Duration", 0, 0),
            "frame_locked": False,
            "colors": [],
            "texture_resource": "",
            "texture": make("sensor_msgs/msg/CompressedImage", nothing, "", no_bytes),
            "uv_coordinates": [],
            "mesh_resource": "",
            "mesh_file": make("visualization_msgs/msg/MeshFile", "", no_bytes),
            "mesh_use_embedded_materials": False,
        }

    def obstacle(self, header: Any, number: int, x: float, y: float, radius_m: float) -> Any:
        """A solid disc."""
        return self._disc(header, "obstacles", number, (x, y), radius_m, DARK["obstacle"])

    def body(
        self,
        header: Any,
        number: int,
        position: Point,
        radius_m: float,
        colour: int | None,
        text: str,
    ) -> list[Any]:
        """A body and its name. ``colour``: that of a robot by robot order, None the target's."""
        x, y = position
        tint = DARK["target"] if colour is None else robot_colour(colour)
        pose = self._plane.pose((x, y + radius_m + TEXT_M), 0.0, HEIGHT_M)
        size = self._plane.vector(0.0, 0.0, TEXT_M)
        return [
            self._disc(header, "bodies", number, position, radius_m, tint),
            self._marker(header, "names", number, TEXT, pose, size, DARK["ink"], text=text),
        ]

    def circle(self, header: Any, centre: Point, radius_m: float) -> Any:
        """A line at a distance about a point."""
        angles = [2.0 * math.pi * k / CIRCLE_POINTS for k in range(CIRCLE_POINTS + 1)]
        points = [self._point(radius_m * math.cos(a), radius_m * math.sin(a)) for a in angles]
        shape = self._plane.pose(centre), self._plane.vector(LINE_M, 0.0)
        return self._marker(
            header, "stop distance", 0, LINE_STRIP, *shape, DARK["ring"], points=points
        )

    def lines(
        self,
        header: Any,
        namespace: str,
        number: int,
        colour: str,
        ends: Sequence[tuple[Point, Point]],
    ) -> Any:
        """Straight lines of one colour; without any, the marker is taken away."""
        points = [self._point(*point) for line in ends for point in line]
        shape = self._plane.pose((0.0, 0.0)), self._plane.vector(LINE_M, 0.0)
        action = ADD if ends else DELETE
        return self._marker(
            header, namespace, number, LINE_LIST, *shape, colour, points=points, action=action
        )

    def _point(self, x: float, y: float) -> Any:
        return self._plane.make("geometry_msgs/msg/Point", x, y, 0.0)

    def _disc(
        self, header: Any, namespace: str, number: int, at: Point, radius_m: float, colour: str
    ) -> Any:
        pose = self._plane.pose(at, 0.0, 0.5 * HEIGHT_M)
        size = self._plane.vector(2.0 * radius_m, 2.0 * radius_m, HEIGHT_M)
        return self._marker(header, namespace, number, CYLINDER, pose, size, colour)

    def _marker(
        self,
        header: Any,
        namespace: str,
        number: int,
        kind: int,
        pose: Any,
        size: Any,
        colour: str,
        points: Sequence[Any] = (),
        text: str = "",
        action: int = ADD,
    ) -> Any:
        red, green, blue = (int(colour[k : k + 2], 16) / 255.0 for k in (1, 3, 5))
        return self._plane.make(
            "visualization_msgs/msg/Marker",
            header=header,
            ns=namespace,
            id=number,
            type=kind,
            action=action,
            pose=pose,
            scale=size,
            color=self._plane.make("std_msgs/msg/ColorRGBA", red, green, blue, 1.0),
            points=list(points),
            text=text,
            **self._unused,
        )
