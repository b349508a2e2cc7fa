"""A recording as a ROS 2 bag: a directory with ``metadata.yaml`` and messages in MCAP.

Standard types alone, so that RViz and plotting tools need no package of ours. The pose packets are
in it as they were, as bytes. Robots' names are namespaces; what the whole team has is below
``/encircle``.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from math import nan
from pathlib import Path
from typing import Any, Literal, TypeAlias

from rosbags.interfaces import (
    Connection,
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

from encircle.exports import ros_messages
from encircle.exports.drawing import curves, layers
from encircle.exports.drawing.events import is_warning
from encircle.exports.drawing.flights import Flights
from encircle.protocol.process.interrupts import check
from encircle.scene.builder import frames_of_recording
from encircle.scene.frame import Frame
from encircle.scene.stage import Stage, stage_of
from encircle.world.recording.recording import Recording

TopicMessage: TypeAlias = tuple[str, Any]
PACKET_LABEL = "encircle pose packet, msgpack"
BAG_NAME = "hunt"
BAG_VERSION: Literal[8] = 8
"""Of the two that rosbags writes the one that older readers know, too."""
ALWAYS = QosTime(0, 0)
KEPT = ("/tf_static", "/encircle/run", "/encircle/markers/arena")
"""Topics whose message stays true: subscribers that come later are to get it, too."""


def export(recording: Recording, out: Path, *, beliefs: bool = True) -> None:
    """Write a recording as a ROS 2 bag to a new directory.

    ``beliefs``: whether to work out what robots believed, which takes the longest. Raises
    ``RecordingError`` for a message that cannot be read.
    """
    stage = stage_of(recording.scenario, recording.seed, recording.run)
    packets: dict[int, list[tuple[str, bytes]]] = defaultdict(list)
    for tick, robot, payload in recording.of_channel("pose"):
        packets[tick].append((robot, payload))
    connections: dict[str, Connection] = {}
    out.mkdir()
    # The writer names its file after its directory, and creates both.
    made = out / BAG_NAME
    bag = Writer(made, version=BAG_VERSION, storage_plugin=StoragePlugin.MCAP)
    # Within the file, which every reader of MCAP undoes by itself.
    bag.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with bag:
        for name, value in (("run", stage.run), ("seed", str(stage.seed)), ("title", stage.title)):
            bag.set_custom_data(name, value)
        frames = frames_of_recording(recording, beliefs)
        for time_ns, topic, message in timed_messages(stage, frames, packets):
            if topic not in connections:
                connections[topic] = bag.add_connection(
                    topic,
                    message.__msgtype__,
                    typestore=ros_messages.TYPES,
                    offered_qos_profiles=[_quality(topic in KEPT)],
                )
            bag.write(connections[topic], time_ns, ros_messages.serialised(message))
    for path in list(made.iterdir()):
        path.rename(out / path.name)
    made.rmdir()


def timed_messages(
    stage: Stage, frames: Iterable[Frame], packets: Mapping[int, Sequence[tuple[str, bytes]]]
) -> Iterator[tuple[int, str, Any]]:
    """All messages in the order of time: time in ns, topic, message.

    ``packets``: by tick, the robots' pose packets as they were sent.
    """
    tick_ns = round(stage.tick_s * 1e9)
    flights = Flights(stage.causes)
    before: Frame | None = None
    for frame in frames:
        check()
        time_ns = frame.tick * tick_ns
        if before is None:
            yield from ((time_ns, *one) for one in _constants(stage, time_ns))
        for topic, message in (
            *_bodies(stage, time_ns, frame, before),
            *_scene(stage, time_ns, frame, flights),
            *_numbers(stage, frame),
            *_events(time_ns, frame),
        ):
            yield time_ns, topic, message
        for robot, payload in packets.get(frame.tick, ()):
            yield time_ns, f"/{robot}/pose_packet", ros_messages.payload(payload, PACKET_LABEL)
        before = frame


def _constants(stage: Stage, time_ns: int) -> Iterator[TopicMessage]:
    obstacles = [(f"obstacle_{k}", (x, y), 0.0) for k, (x, y, _) in enumerate(stage.obstacles, 1)]
    yield "/tf_static", ros_messages.transforms(time_ns, [("arena", (0.0, 0.0), 0.0), *obstacles])
    yield "/encircle/markers/arena", ros_messages.markers(time_ns, layers.arena(stage))
    yield "/encircle/run", ros_messages.text(f"{stage.title}, run {stage.run}, seed {stage.seed}")


def _bodies(
    stage: Stage, time_ns: int, frame: Frame, before: Frame | None
) -> Iterator[TopicMessage]:
    """Odometry of the robots, the target's pose, and both as transforms."""
    named = zip(stage.robots, frame.robots, frame.headings_rad, strict=True)
    bodies = [(name, point, heading_rad) for name, point, heading_rad in named]
    yield "/tf", ros_messages.transforms(time_ns, [*bodies, ("target", frame.target, 0.0)])
    for k, (name, (x, y), heading_rad) in enumerate(bodies):
        from_x, from_y = (x, y) if before is None else before.robots[k]
        velocity_mps = ((x - from_x) / stage.tick_s, (y - from_y) / stage.tick_s)
        odometry = ros_messages.odometry(time_ns, name, (x, y), heading_rad, velocity_mps)
        yield f"/{name}/odom", odometry
    yield "/target/pose", ros_messages.pose_stamped(time_ns, frame.target)


def _scene(stage: Stage, time_ns: int, frame: Frame, flights: Flights) -> Iterator[TopicMessage]:
    for layer, draw in layers.moving_layers(stage, frame, flights.take(frame)).items():
        yield f"/encircle/markers/{layer}", ros_messages.markers(time_ns, draw())


def _numbers(stage: Stage, frame: Frame) -> Iterator[TopicMessage]:
    for name, value in curves.values(frame).items():
        yield f"/encircle/{name}", ros_messages.number(value)
    for robot, distance_m in curves.distances_m(stage, frame).items():
        yield f"/{robot}/distance_m", ros_messages.number(distance_m)
    ages = [[nan if age < 0 else age for age in row] for row in frame.ages]
    yield "/encircle/ages_ticks", ros_messages.table(ages, ("receiver", "sender"))
    for robot, xi in zip(stage.robots, frame.xi, strict=True):
        if xi is not None:
            yield f"/{robot}/xi_ticks", ros_messages.number(xi)
    for robot, mode in zip(stage.robots, frame.modes, strict=True):
        if mode is not None:
            yield f"/{robot}/mode", ros_messages.text(mode)


def _events(time_ns: int, frame: Frame) -> Iterator[TopicMessage]:
    for event in frame.events:
        level = ros_messages.WARN if is_warning(event) else ros_messages.INFO
        yield "/encircle/events", ros_messages.log(time_ns, level, event.kind, event.text)


def _quality(kept: bool) -> Qos:
    """Quality of service as publishers have it by default; of what stays true, kept for all."""
    return Qos(
        QosHistory.KEEP_LAST,
        1 if kept else 10,
        QosReliability.RELIABLE,
        QosDurability.TRANSIENT_LOCAL if kept else QosDurability.VOLATILE,
        ALWAYS,
        ALWAYS,
        QosLiveliness.AUTOMATIC,
        ALWAYS,
        False,
    )
