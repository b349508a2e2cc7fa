"""Entities of shapes as ``foxglove.SceneUpdate``.

Each update takes away all that its topic showed and says all that it shows now: a viewer that
jumps to a time reads one message per topic.
"""

from collections.abc import Sequence

from foxglove.messages import Color as FoxgloveColor
from foxglove.messages import (
    CylinderPrimitive,
    LinePrimitive,
    LinePrimitiveLineType,
    Point3,
    Pose,
    Quaternion,
    SceneEntity,
    SceneEntityDeletion,
    SceneEntityDeletionType,
    SceneUpdate,
    TextPrimitive,
    Timestamp,
    Vector3,
)

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

DISC_HEIGHT_M = 0.05
UPRIGHT = Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)


def scene_update(entities: Sequence[Entity], at: Timestamp) -> SceneUpdate:
    """All that a topic shows from a time on."""
    clear = SceneEntityDeletion(timestamp=at, type=SceneEntityDeletionType.All, id="")
    return SceneUpdate(deletions=[clear], entities=[_entity(e, at) for e in entities])


def _entity(entity: Entity, at: Timestamp) -> SceneEntity:
    shapes = entity.shapes
    lines = [_line(s) for s in shapes if isinstance(s, Line)]
    return SceneEntity(
        timestamp=at,
        frame_id=FRAME_ID,
        id=entity.name,
        cylinders=[_disc(s) for s in shapes if isinstance(s, Disc)],
        lines=lines + [_segments(s) for s in shapes if isinstance(s, Segments)],
        texts=[_label(s) for s in shapes if isinstance(s, Label)],
    )


def _disc(disc: Disc) -> CylinderPrimitive:
    width = 2.0 * disc.radius_m
    return CylinderPrimitive(
        pose=pose_at(disc.centre, disc.z_m),
        size=Vector3(x=width, y=width, z=DISC_HEIGHT_M),
        bottom_scale=1.0,
        top_scale=1.0,
        color=_colour(disc.colour),
    )


def _line(line: Line) -> LinePrimitive:
    kind = LinePrimitiveLineType.LineLoop if line.closed else LinePrimitiveLineType.LineStrip
    return _drawn_line(kind, line)


def _segments(segments: Segments) -> LinePrimitive:
    return _drawn_line(LinePrimitiveLineType.LineList, segments)


def _drawn_line(kind: LinePrimitiveLineType, shape: Line | Segments) -> LinePrimitive:
    return LinePrimitive(
        type=kind,
        pose=pose_at((0.0, 0.0)),
        thickness=shape.width_m,
        points=[Point3(x=x, y=y, z=shape.z_m) for x, y in shape.points],
        color=_colour(shape.colour),
    )


def _label(label: Label) -> TextPrimitive:
    return TextPrimitive(
        pose=pose_at(label.centre, label.z_m),
        billboard=True,
        font_size=label.height_m,
        color=_colour(label.colour),
        text=label.text,
    )


def pose_at(point: Point, z_m: float = 0.0, orientation: Quaternion = UPRIGHT) -> Pose:
    """A pose at a point of the arena."""
    x, y = point
    return Pose(position=Vector3(x=x, y=y, z=z_m), orientation=orientation)


def _colour(colour: Colour) -> FoxgloveColor:
    return FoxgloveColor(r=colour.r, g=colour.g, b=colour.b, a=colour.a)
