"""What a hunt publishes to Foxglove: one code path for files and for a live server.

``HuntTopics`` takes frames and logs messages to a context of foxglove-sdk. Whether that has a file
or a WebSocket server as its sink is nothing to it. Poses, frames, shapes and events are protobuf
messages of Foxglove's own schemas; numbers and decisions are JSON with a schema, which plotting
tools read field by field. Log time is simulated time.
"""

from collections.abc import Mapping
from math import cos, sin
from typing import Any

from foxglove import Channel, Context
from foxglove.channels import (
    FrameTransformsChannel,
    LogChannel,
    PoseInFrameChannel,
    PosesInFrameChannel,
    SceneUpdateChannel,
)
from foxglove.messages import (
    FrameTransform,
    FrameTransforms,
    Log,
    LogLevel,
    PoseInFrame,
    PosesInFrame,
    Quaternion,
    Timestamp,
    Vector3,
)

from encircle.exports.drawing import curves, layers
from encircle.exports.drawing.events import is_warning
from encircle.exports.drawing.flights import Flights, fate_of
from encircle.exports.drawing.shapes import FRAME_ID, Point
from encircle.exports.foxglove_shapes import UPRIGHT, pose_at, scene_update
from encircle.scene.frame import Frame
from encircle.scene.stage import Stage

TARGET = "target"
NUMBER, INTEGER, TEXT = {"type": "number"}, {"type": "integer"}, {"type": "string"}
TEXTS = {"type": "array", "items": TEXT}
RUN = {
    **dict.fromkeys(("run", "title", "clock", "behaviour"), TEXT),
    **dict.fromkeys(("robots", "policies", "channel"), TEXTS),
    **dict.fromkeys(("seed", "ticks_max", "capture_count"), INTEGER),
    **dict.fromkeys(("tick_s", "stop_distance_m"), NUMBER),
}
"""Properties of the JSON schema of the topic ``/run``; the others likewise."""
POINT = {"type": "object", "properties": {"x": NUMBER, "y": NUMBER}}
DECISION = {"mode": TEXT, "xi_ticks": NUMBER, "point": INTEGER, "goal_m": POINT}
PACKET = {
    **dict.fromkeys(("sender", "receiver", "fate"), TEXT),
    **dict.fromkeys(("due_tick", "copy_due_tick"), INTEGER),
}
PACKETS = {
    **dict.fromkeys(("tick", "sent", "arrived", "late", "lost"), INTEGER),
    "packets": {"type": "array", "items": {"type": "object", "properties": PACKET}},
}


class HuntTopics:
    """The topics of one hunt in a context. Its sink is there before, and closed before these are.

    ``begin`` logs what stays the same, ``take`` a frame, ``close`` ends the topics.
    """

    def __init__(self, stage: Stage, context: Context) -> None:
        self._stage, self._context = stage, context
        self._flights = Flights(stage.causes)
        self._channels: dict[str, Any] = {}
        for layer in ("arena", "bodies", "plan", "packets"):
            self._add(f"/scene/{layer}", SceneUpdateChannel)
        self._add("/poses", PosesInFrameChannel)
        self._add("/tf", FrameTransformsChannel)
        self._add("/events", LogChannel)
        self._add_json("/run", RUN)
        self._add_json("/values", dict.fromkeys(curves.VALUES, NUMBER))
        self._add_json("/distances_m", dict.fromkeys(stage.robots, NUMBER))
        self._add_json("/packets", PACKETS)
        self._add(f"/pose/{TARGET}", PoseInFrameChannel)
        for robot in stage.robots:
            self._add(f"/pose/{robot}", PoseInFrameChannel)
            self._add(f"/scene/beliefs/{robot}", SceneUpdateChannel)
            self._add_json(f"/decisions/{robot}", DECISION)
            peers = [peer for peer in stage.robots if peer != robot]
            self._add_json(f"/ages_ticks/{robot}", dict.fromkeys(peers, INTEGER))

    def begin(self, tick: int = 0) -> None:
        """Log what stays the same: run and obstacles."""
        stage = self._stage
        self._log("/run", tick, {name: _plain(getattr(stage, name)) for name in RUN})
        self._log("/scene/arena", tick, scene_update(layers.arena(stage), self._stamp(tick)))

    def take(self, frame: Frame) -> None:
        """Log all that there is to see at a frame's tick."""
        self._log_scene(frame)
        self._log_poses(frame)
        self._log_numbers(frame)
        for event in frame.events:
            level = LogLevel.Warning if is_warning(event) else LogLevel.Info
            stamp, name = self._stamp(frame.tick), " ".join((event.kind, *event.robots))
            log = Log(timestamp=stamp, level=level, message=event.text, name=name)
            self._log("/events", frame.tick, log)

    def close(self) -> None:
        """End the topics."""
        for channel in self._channels.values():
            channel.close()

    def time_ns(self, tick: int) -> int:
        """The simulated time of a tick in ns, as in recordings."""
        return tick * round(self._stage.tick_s * 1e9)

    def _add(self, topic: str, kind: type[Any]) -> None:
        self._channels[topic] = kind(topic, context=self._context)

    def _add_json(self, topic: str, properties: Mapping[str, Any]) -> None:
        schema = {"title": f"encircle{topic}", "type": "object", "properties": dict(properties)}
        self._channels[topic] = Channel(topic, schema=schema, context=self._context)

    def _log(self, topic: str, tick: int, message: Any) -> None:
        self._channels[topic].log(message, log_time=self.time_ns(tick))

    def _stamp(self, tick: int) -> Timestamp:
        seconds, ns = divmod(self.time_ns(tick), 1_000_000_000)
        return Timestamp(seconds, ns)

    def _log_scene(self, frame: Frame) -> None:
        stage, tick = self._stage, frame.tick
        drawn = layers.moving_layers(stage, frame, self._flights.take(frame))
        for layer, draw in drawn.items():
            # A live server has no reader for most of what robots believe.
            if self._channels[f"/scene/{layer}"].has_sinks():
                self._log(f"/scene/{layer}", tick, scene_update(draw(), self._stamp(tick)))

    def _log_poses(self, frame: Frame) -> None:
        tick, stamp = frame.tick, self._stamp(frame.tick)
        turns = [*map(turned, frame.headings_rad), UPRIGHT]
        points = [*frame.robots, frame.target]
        names = [*self._stage.robots, TARGET]
        poses = [pose_at(point, 0.0, turn) for point, turn in zip(points, turns, strict=True)]
        self._log(
            "/poses", tick, PosesInFrame(timestamp=stamp, frame_id=FRAME_ID, poses=poses[:-1])
        )
        for name, pose in zip(names, poses, strict=True):
            message = PoseInFrame(timestamp=stamp, frame_id=FRAME_ID, pose=pose)
            self._log(f"/pose/{name}", tick, message)
        transforms = [
            _transform(stamp, name, point, turn)
            for name, point, turn in zip(names, points, turns, strict=True)
        ]
        self._log("/tf", tick, FrameTransforms(transforms=transforms))

    def _log_numbers(self, frame: Frame) -> None:
        stage, tick = self._stage, frame.tick
        self._log("/values", tick, curves.values(frame))
        self._log("/distances_m", tick, curves.distances_m(stage, frame))
        self._log("/packets", tick, self._packets(frame))
        for k, robot in enumerate(stage.robots):
            self._log(f"/ages_ticks/{robot}", tick, curves.ages_ticks(stage, frame, k))
            self._log(f"/decisions/{robot}", tick, _decision(frame, k))

    def _packets(self, frame: Frame) -> dict[str, Any]:
        """The packets sent at a tick; ticks of arrival only of what arrives."""
        robots, packets = self._stage.robots, []
        counts = dict.fromkeys(("arrived", "late", "lost"), 0)
        for packet in frame.packets:
            fate = fate_of(packet, frame.tick, self._stage.causes)
            counts[fate if packet.due > 0 else "lost"] += 1
            due = {"due_tick": packet.due} if packet.due > 0 else {}
            copy = {"copy_due_tick": packet.copy_due} if packet.copy_due > 0 else {}
            ends = {"sender": robots[packet.sender], "receiver": robots[packet.receiver]}
            packets.append({**ends, "fate": fate, **due, **copy})
        return {"tick": frame.tick, "sent": len(packets), **counts, "packets": packets}


def turned(heading_rad: float) -> Quaternion:
    """The turn about the vertical from the x axis to a heading."""
    return Quaternion(x=0.0, y=0.0, z=sin(heading_rad / 2.0), w=cos(heading_rad / 2.0))


def _transform(stamp: Timestamp, name: str, point: Point, turn: Quaternion) -> FrameTransform:
    return FrameTransform(
        timestamp=stamp,
        parent_frame_id=FRAME_ID,
        child_frame_id=name,
        translation=Vector3(x=point[0], y=point[1], z=0.0),
        rotation=turn,
    )


def _decision(frame: Frame, robot: int) -> dict[str, Any]:
    """What a robot decided, without what it did not decide; empty at the last tick."""
    goal = frame.goals[robot]
    found = {
        "mode": frame.modes[robot],
        "xi_ticks": frame.xi[robot],
        "point": frame.points[robot],
        "goal_m": None if goal is None else {"x": goal[0], "y": goal[1]},
    }
    return {name: value for name, value in found.items() if value is not None}


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value
