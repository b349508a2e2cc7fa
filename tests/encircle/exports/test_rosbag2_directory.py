"""The ROS 2 bag: read by rosbags, and without it, by the bytes of one type, against the truth."""

import struct
from math import atan2, cos, isnan, pi, sin

import numpy as np
import pytest
from helpers_exports import lossy_hunt, radios_of, states_of
from mcap.reader import make_reader
from rosbags.interfaces import QosDurability
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from encircle.exports.ros_messages import TYPES
from encircle.exports.rosbag2_directory import export
from encircle.scene.builder import scene_of_recording

STORES = ("ROS2_HUMBLE", "ROS2_IRON", "ROS2_JAZZY", "ROS2_KILTED", "ROS2_LYRICAL")


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    path = tmp_path_factory.mktemp("rosbag2") / "bag"
    export(lossy_hunt(), path)
    return path


@pytest.fixture(scope="module")
def topics(exported):
    """By topic: (time in ns, message), as rosbags reads them."""
    store, found = get_typestore(Stores.ROS2_JAZZY), {}
    with Reader(exported) as reader:
        for connection, time_ns, data in reader.messages():
            message = store.deserialize_cdr(data, connection.msgtype)
            found.setdefault(connection.topic, []).append((time_ns, message))
    return found


def test_odometry_is_where_the_world_says(topics):
    recording = lossy_hunt()
    states, tick_s = states_of(recording), recording.scenario.tick_s
    for k, robot in enumerate(recording.scenario.ids):
        before = states[0]
        for (time_ns, odometry), state in zip(topics[f"/{robot}/odom"], states, strict=True):
            assert time_ns == state.tick * round(tick_s * 1e9)
            stamp = odometry.header.stamp
            assert stamp.sec * 10**9 + stamp.nanosec == time_ns
            assert (odometry.header.frame_id, odometry.child_frame_id) == ("map", robot)
            pose = odometry.pose.pose
            assert (pose.position.x, pose.position.y) == state.robots[k]
            heading = 2.0 * atan2(pose.orientation.z, pose.orientation.w)
            off = (heading - state.headings_rad[k] + pi) % (2.0 * pi) - pi
            assert off == pytest.approx(0.0, abs=1e-9)
            forwards, left = odometry.twist.twist.linear.x, odometry.twist.twist.linear.y
            velocity = (
                cos(heading) * forwards - sin(heading) * left,
                sin(heading) * forwards + cos(heading) * left,
            )
            way = np.subtract(state.robots[k], before.robots[k]) / tick_s
            assert velocity == pytest.approx(way, abs=1e-9)
            before = state


def test_transforms_and_the_target_say_the_same(topics):
    states = states_of(lossy_hunt())
    for (_, message), state in zip(topics["/tf"], states, strict=True):
        places = {
            t.child_frame_id: (t.transform.translation.x, t.transform.translation.y)
            for t in message.transforms
        }
        assert places == dict(
            zip(("r1", "r2", "r3", "target"), (*state.robots, state.target), strict=True)
        )
    poses = [m.pose.position for _, m in topics["/target/pose"]]
    assert [(p.x, p.y) for p in poses] == [state.target for state in states]


def test_pose_packets_are_the_bytes_that_were_sent(topics):
    recording = lossy_hunt()
    for robot in recording.scenario.ids:
        sent = [payload for _, of, payload in recording.of_channel("pose") if of == robot]
        messages = [message for _, message in topics[f"/{robot}/pose_packet"]]
        assert [bytes(message.data) for message in messages] == sent
        assert messages[0].layout.dim[0].label == "encircle pose packet, msgpack"


def test_markers_show_the_bodies_as_large_as_they_are(topics):
    scenario = lossy_hunt().scenario
    for (_, message), state in zip(
        topics["/encircle/markers/bodies"], states_of(lossy_hunt()), strict=True
    ):
        clear, *markers = message.markers
        assert clear.action == clear.DELETEALL
        assert {marker.header.frame_id for marker in message.markers} == {"map"}
        assert len({(marker.ns, marker.id) for marker in markers}) == len(markers)
        discs = {m.ns: m for m in markers if m.type == m.CYLINDER}
        place = discs["r1"].pose.position
        assert (place.x, place.y) == state.robots[0]
        assert discs["target"].scale.x == pytest.approx(2.0 * scenario.target.radius_m)
    arena = topics["/encircle/markers/arena"][0][1].markers[1:]
    assert [m.scale.x / 2.0 for m in arena] == pytest.approx(
        [o.radius_m for o in scenario.obstacles]
    )


def test_numbers_are_those_of_the_scene(topics):
    frames = scene_of_recording(lossy_hunt()).frames
    for (_, table), frame in zip(topics["/encircle/ages_ticks"], frames, strict=True):
        assert [dim.label for dim in table.layout.dim] == ["receiver", "sender"]
        ages = [-1 if isnan(age) else age for age in table.data]
        assert np.reshape(ages, (3, 3)).tolist() == [list(row) for row in frame.ages]
    gaps = [message.data for _, message in topics["/encircle/gap_rad"]]
    assert gaps == [frame.values.gap_rad for frame in frames]
    assert "r2 is lost" in [m.msg for _, m in topics["/encircle/events"]]


def test_packets_are_drawn_with_as_many_marks_as_were_lost(topics):
    drawn = topics["/encircle/markers/packets"]
    lost_marks = 0
    for (_, message), radio in zip(drawn, radios_of(lossy_hunt()), strict=False):
        lost = sum(due == -1 for row in radio.fates for due in row)
        ways = [m for m in message.markers if m.ns == "loss" and m.id == 0]
        assert sum(len(m.points) for m in ways) == 2 * lost
        lost_marks += lost
    assert lost_marks > 0


def test_a_float_is_in_the_file_as_cdr_says(exported):
    """OMG's CDR: two bytes of encapsulation, little-endian, two of options, then the double."""
    frames = scene_of_recording(lossy_hunt()).frames
    with open(exported / "hunt.mcap", "rb") as file:
        found = list(make_reader(file).iter_messages(topics=["/encircle/gap_rad"]))
    schema, channel, _ = found[0]
    assert (schema.name, schema.encoding) == ("std_msgs/msg/Float64", "ros2msg")
    assert channel.message_encoding == "cdr"
    for (_, _, message), frame in zip(found, frames, strict=True):
        assert message.data[:4] == b"\x00\x01\x00\x00"
        assert struct.unpack("<d", message.data[4:12]) == (frame.values.gap_rad,)
        assert message.log_time == frame.tick * 10**8


def test_a_stamped_pose_is_in_the_file_as_cdr_says(exported):
    """Seconds, nanoseconds, the frame's name with its length and ending, padding, seven doubles."""
    with open(exported / "hunt.mcap", "rb") as file:
        found = list(make_reader(file).iter_messages(topics=["/target/pose"]))
    for (_, _, message), state in zip(found, states_of(lossy_hunt()), strict=True):
        body = message.data[4:]
        seconds, nanoseconds, length = struct.unpack("<iII", body[:12])
        assert seconds * 10**9 + nanoseconds == message.log_time
        assert body[12 : 12 + length] == b"map\0"
        assert struct.unpack("<7d", body[16:72]) == (*state.target, 0.0, 0.0, 0.0, 0.0, 1.0)


def test_later_releases_have_the_same_types(topics):
    kinds = {message.__msgtype__ for found in topics.values() for _, message in found}
    assert "nav_msgs/msg/Odometry" in kinds
    for kind in kinds:
        hashes = {get_typestore(Stores[name]).hash_rihs01(kind) for name in STORES}
        assert hashes == {TYPES.hash_rihs01(kind)}


def test_the_bag_says_what_is_in_it(exported):
    last_tick = states_of(lossy_hunt())[-1].tick
    assert sorted(path.name for path in exported.iterdir()) == ["hunt.mcap", "metadata.yaml"]
    with Reader(exported) as reader:
        qualities = {c.topic: c.ext.offered_qos_profiles[0] for c in reader.connections}
        kept = {
            topic
            for topic, quality in qualities.items()
            if quality.durability is QosDurability.TRANSIENT_LOCAL
        }
        assert kept == {"/tf_static", "/encircle/run", "/encircle/markers/arena"}
        assert (reader.start_time, reader.end_time) == (0, last_tick * 10**8 + 1)
