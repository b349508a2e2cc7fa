"""ROS 2 messages of a hunt, all of standard types.

The definitions are those of Humble; Iron, Jazzy, Kilted and Lyrical have the same, by their type
hashes. A message's stamp is the simulated time of its tick, its frame ``map``.
"""

from collections.abc import Iterator, Mapping, Sequence
from math import cos, sin
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_typestore

from encircle.exports.drawing.shapes import (
    FRAME_ID,
    Colour,
    Disc,
    Entity,
    Label,
    Line,
    Point,
    Segments,
)

TYPES = get_typestore(Stores.ROS2_HUMBLE)
KINDS: Mapping[str, Any] = dict(TYPES.types)
POINT = KINDS["geometry_msgs/msg/Point"]
NS_PER_S = 1_000_000_000
DISC_HEIGHT_M = 0.05
NO_COVARIANCE = np.zeros(36)
"""Poses are the truth."""
INFO, WARN = 20, 30
"""Levels of ``rcl_interfaces/msg/Log``."""
MARKER = KINDS["visualization_msgs/msg/Marker"]
NO_COLOUR = Colour(0.0, 0.0, 0.0, 0.0)
NO_SIZE = (0.0, 0.0, 0.0)


def made(kind: str, *values: Any) -> Any:
    """A message of a type such as ``geometry_msgs/msg/Point``, its fields in their order."""
    return KINDS[kind](*values)


def serialised(message: Any) -> memoryview:
    """A message in CDR."""
    return TYPES.serialize_cdr(message, message.__msgtype__)


def header(time_ns: int, frame_id: str = FRAME_ID) -> Any:
    """A header with a time since the start of the hunt."""
    return made("std_msgs/msg/Header", stamp(time_ns), frame_id)


def stamp(time_ns: int) -> Any:
    """A time since the start of the hunt."""
    return made("builtin_interfaces/msg/Time", *divmod(time_ns, NS_PER_S))


def pose(point: Point, heading_rad: float = 0.0, z_m: float = 0.0) -> Any:
    """Where a body is and which way it faces."""
    turn = (0.0, 0.0, sin(heading_rad / 2.0), cos(heading_rad / 2.0))
    position = made("geometry_msgs/msg/Point", *point, z_m)
    return made("geometry_msgs/msg/Pose", position, made("geometry_msgs/msg/Quaternion", *turn))


def pose_stamped(time_ns: int, point: Point) -> Any:
    """``geometry_msgs/PoseStamped`` of a body without a heading."""
    return made("geometry_msgs/msg/PoseStamped", header(time_ns), pose(point))


def odometry(time_ns: int, body: str, point: Point, heading_rad: float, velocity_mps: Point) -> Any:
    """``nav_msgs/Odometry``. The velocity is given in the arena's frame, and told in the body's."""
    vx, vy = velocity_mps
    c, s = cos(heading_rad), sin(heading_rad)
    still = made("geometry_msgs/msg/Vector3", 0.0, 0.0, 0.0)
    linear = made("geometry_msgs/msg/Vector3", c * vx + s * vy, c * vy - s * vx, 0.0)
    twist = made("geometry_msgs/msg/Twist", linear, still)
    return made(
        "nav_msgs/msg/Odometry",
        header(time_ns),
        body,
        made("geometry_msgs/msg/PoseWithCovariance", pose(point, heading_rad), NO_COVARIANCE),
        made("geometry_msgs/msg/TwistWithCovariance", twist, NO_COVARIANCE),
    )


def transforms(time_ns: int, bodies: Sequence[tuple[str, Point, float]]) -> Any:
    """``tf2_msgs/TFMessage`` of bodies: name, position in m, heading in rad."""
    found = []
    for name, point, heading_rad in bodies:
        where = pose(point, heading_rad)
        x, y = point
        translation = made("geometry_msgs/msg/Vector3", x, y, 0.0)
        moved = made("geometry_msgs/msg/Transform", translation, where.orientation)
        found.append(made("geometry_msgs/msg/TransformStamped", header(time_ns), name, moved))
    return made("tf2_msgs/msg/TFMessage", found)


def number(value: float) -> Any:
    """``std_msgs/Float64``."""
    return made("std_msgs/msg/Float64", float(value))


def text(value: str) -> Any:
    """``std_msgs/String``."""
    return made("std_msgs/msg/String", value)


def table(rows: Sequence[Sequence[float]], names: tuple[str, str]) -> Any:
    """``std_msgs/Float64MultiArray`` of rows by columns, with the names of both."""
    values = np.array(rows, np.float64)
    sizes = (len(values), len(values[0]))
    dimensions = [
        made("std_msgs/msg/MultiArrayDimension", names[0], sizes[0], sizes[0] * sizes[1]),
        made("std_msgs/msg/MultiArrayDimension", names[1], sizes[1], sizes[1]),
    ]
    layout = made("std_msgs/msg/MultiArrayLayout", dimensions, 0)
    return made("std_msgs/msg/Float64MultiArray", layout, values.ravel())


def payload(data: bytes, name: str) -> Any:
    """``std_msgs/UInt8MultiArray`` of bytes as they are, with what they are as a label."""
    dimension = made("std_msgs/msg/MultiArrayDimension", name, len(data), len(data))
    layout = made("std_msgs/msg/MultiArrayLayout", [dimension], 0)
    return made("std_msgs/msg/UInt8MultiArray", layout, np.frombuffer(data, np.uint8))


def log(time_ns: int, level: int, name: str, message: str) -> Any:
    """``rcl_interfaces/Log``."""
    return made("rcl_interfaces/msg/Log", stamp(time_ns), level, name, message, "", "", 0)


def markers(time_ns: int, entities: Sequence[Entity]) -> Any:
    """``visualization_msgs/MarkerArray``: all that a topic showed goes, all of this is shown."""
    clear = _marker(time_ns, "", 0, MARKER.CUBE, action=MARKER.DELETEALL)
    shown = [marker for entity in entities for marker in _markers(time_ns, entity)]
    return made("visualization_msgs/msg/MarkerArray", [clear, *shown])


def _markers(time_ns: int, entity: Entity) -> Iterator[Any]:
    for index, shape in enumerate(entity.shapes):
        about = (time_ns, entity.name, index)
        if isinstance(shape, Disc):
            width = 2.0 * shape.radius_m
            where, size = pose(shape.centre, 0.0, shape.z_m), (width, width, DISC_HEIGHT_M)
            yield _marker(*about, MARKER.CYLINDER, shape.colour, size, where)
        elif isinstance(shape, Label):
            where, size = pose(shape.centre, 0.0, shape.z_m), (0.0, 0.0, shape.height_m)
            kind = MARKER.TEXT_VIEW_FACING
            yield _marker(*about, kind, shape.colour, size, where, label=shape.text)
        else:
            kind = MARKER.LINE_LIST if isinstance(shape, Segments) else MARKER.LINE_STRIP
            size = (shape.width_m, 0.0, 0.0)
            yield _marker(*about, kind, shape.colour, size, ORIGIN, _points(shape))


def _points(shape: Line | Segments) -> list[Any]:
    closing = shape.points[:1] if isinstance(shape, Line) and shape.closed else ()
    return [POINT(x, y, shape.z_m) for x, y in (*shape.points, *closing)]


def _marker(
    time_ns: int,
    namespace: str,
    index: int,
    kind: int,
    colour: Colour = NO_COLOUR,
    size: tuple[float, float, float] = NO_SIZE,
    where: Any = None,
    points: Sequence[Any] = (),
    label: str = "",
    action: int = 0,
) -> Any:
    return MARKER(
        header=header(time_ns),
        ns=namespace,
        id=index,
        type=kind,
        action=action,
        pose=ORIGIN if where is None else where,
        scale=made("geometry_msgs/msg/Vector3", *size),
        color=made("std_msgs/msg/ColorRGBA", colour.r, colour.g, colour.b, colour.a),
        lifetime=FOR_EVER,
        frame_locked=False,
        points=list(points),
        colors=[],
        texture_resource="",
        texture=NO_TEXTURE,
        uv_coordinates=[],
        text=label,
        mesh_resource="",
        mesh_file=NO_MESH,
        mesh_use_embedded_materials=False,
    )


ORIGIN = pose((0.0, 0.0))
FOR_EVER = made("builtin_interfaces/msg/Duration", 0, 0)
NO_BYTES = np.empty(0, np.uint8)
NO_TEXTURE = made("sensor_msgs/msg/CompressedImage", header(0, ""), "", NO_BYTES)
NO_MESH = made("visualization_msgs/msg/MeshFile", "", NO_BYTES)
