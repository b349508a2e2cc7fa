"""The messages of a state: where everything is, which way it looks and goes, and when."""

from dataclasses import replace
from math import atan2, cos, pi, sin

import numpy as np
import pytest
from helpers_scene import frames_of, hunted

from encircle.protocol.messages import State
from encircle.ros2.message_types import MessageTypes
from encircle.ros2.releases import RELEASES
from encircle.ros2.scene_messages import ROLES, SceneMessages
from encircle.scene.frame import Packet
from encircle.scene.stage import stage_of
from encircle.world.loading.load import load

SCENARIO = load({"team": {"robots": 2}, "obstacles": [{"position": [3.0, 4.0], "radius_m": 0.7}]})
STAGE = stage_of(SCENARIO, 1, "run")
BEFORE = State(4, ((0.0, 0.0), (1.0, 1.0)), (0.0, 0.0), (9.0, 9.0), False, ())
STATE = State(6, ((0.2, 0.0), (1.0, 1.4)), (0.0, pi / 2), (9.0, 8.0), True, ())
STAMP_NS = 12_000_000_034
TOPICS = {
    "/clock": "rosgraph_msgs/msg/Clock",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/r1/pose": "geometry_msgs/msg/PoseStamped",
    "/r2/pose": "geometry_msgs/msg/PoseStamped",
    "/target/pose": "geometry_msgs/msg/PoseStamped",
    "/r1/odom": "nav_msgs/msg/Odometry",
    "/r2/odom": "nav_msgs/msg/Odometry",
    "/target/odom": "nav_msgs/msg/Odometry",
    "/encircle/markers": "visualization_msgs/msg/MarkerArray",
    "/encircle/traffic": "visualization_msgs/msg/MarkerArray",
}


@pytest.fixture(scope="module", params=RELEASES)
def types(request):
    return MessageTypes(RELEASES[request.param])


def messages_of(types, state=STATE, before=BEFORE, with_clock=True):
    """By topic, as they are read from their bytes."""
    made = SceneMessages(types, STAGE).of(state, before, STAMP_NS, with_clock)
    return {t.name: types.decoded(types.encoded(m), t.type_name) for t, m in made}


def heading(turn):
    return 2.0 * atan2(turn.z, turn.w)


def test_every_topic_has_its_type_and_a_message(types):
    topics = SceneMessages(types, STAGE).topics.all(with_clock=True)
    assert {topic.name: topic.type_name for topic in topics} == TOPICS
    assert [*messages_of(types), "/encircle/traffic"] == [topic.name for topic in topics]


def test_there_is_no_clock_where_time_is_that_of_the_wall(types):
    assert "/clock" not in messages_of(types, with_clock=False)
    topics = SceneMessages(types, STAGE).topics.all(with_clock=False)
    assert "/clock" not in {topic.name for topic in topics}


def test_poses_are_where_everything_is_and_looks(types):
    messages = messages_of(types)
    for name, at, rad in (
        ("r1", (0.2, 0.0), 0.0),
        ("r2", (1.0, 1.4), pi / 2),
        ("target", (9.0, 8.0), -pi / 2),
    ):
        message = messages[f"/{name}/pose"]
        point = message.pose.position
        assert (point.x, point.y, point.z) == (*at, 0.0)
        assert heading(message.pose.orientation) == pytest.approx(rad)
        assert message.header.frame_id == "map"
        assert (message.header.stamp.sec, message.header.stamp.nanosec) == (12, 34)


def test_transforms_are_the_poses(types):
    messages = messages_of(types)
    transforms = messages["/tf"].transforms
    assert [t.child_frame_id for t in transforms] == ["r1", "r2", "target"]
    for transform in transforms:
        pose = messages[f"/{transform.child_frame_id}/pose"].pose
        moved = transform.transform.translation
        assert (moved.x, moved.y, moved.z) == (pose.position.x, pose.position.y, pose.position.z)
        assert transform.transform.rotation == pose.orientation
        assert transform.header == messages["/r1/pose"].header


def test_velocities_are_the_way_over_the_ticks_between_in_the_frame_of_what_moves(types):
    """0.2 s lie between: 1 m/s, 2 m/s and 5 m/s, each straight ahead."""
    messages = messages_of(types)
    for name, speed in (("r1", 1.0), ("r2", 2.0), ("target", 5.0)):
        message = messages[f"/{name}/odom"]
        linear = message.twist.twist.linear
        assert (linear.x, linear.y) == pytest.approx((speed, 0.0), abs=1e-12)
        assert message.child_frame_id == name
        assert message.pose.pose == messages[f"/{name}/pose"].pose


def test_a_robot_that_moves_sideways_has_a_velocity_to_its_left(types):
    state = State(6, STATE.robots, (pi / 4, 0.0), STATE.target, False, ())
    linear = messages_of(types, state)["/r1/odom"].twist.twist.linear
    assert (linear.x, linear.y) == pytest.approx((cos(pi / 4), -sin(pi / 4)))


@pytest.mark.parametrize("before", [None, STATE])
def test_the_first_state_has_no_velocities(types, before):
    for name in ("r1", "target"):
        linear = messages_of(types, before=before)[f"/{name}/odom"].twist.twist.linear
        assert (linear.x, linear.y) == (0.0, 0.0)


def test_markers_show_bodies_names_obstacles_and_the_stop_distance(types):
    markers = messages_of(types)["/encircle/markers"].markers
    keys = [(m.ns, m.id) for m in markers]
    assert len(set(keys)) == len(keys), "none takes another one's place"
    (obstacle,) = [m for m in markers if m.ns == "obstacles"]
    assert (obstacle.pose.position.x, obstacle.pose.position.y) == (3.0, 4.0)
    assert (obstacle.scale.x, obstacle.scale.y) == (1.4, 1.4)
    bodies = [m for m in markers if m.ns == "bodies"]
    assert [(m.pose.position.x, m.pose.position.y) for m in bodies] == [
        *STATE.robots,
        STATE.target,
    ]
    radii_m = [SCENARIO.team.radius_m] * 2 + [SCENARIO.target.radius_m]
    assert [m.scale.x for m in bodies] == [2.0 * r for r in radii_m]
    kind = bodies[0]
    assert {(m.type, m.action, m.color.a) for m in bodies} == {(kind.CYLINDER, kind.ADD, 1.0)}
    names = [m for m in markers if m.ns == "names"]
    assert [m.text for m in names] == ["r1", "r2", "target, captured"]
    assert {m.type for m in names} == {names[0].TEXT_VIEW_FACING}
    (circle,) = [m for m in markers if m.ns == "stop distance"]
    assert circle.type == circle.LINE_STRIP
    far = [np.hypot(p.x, p.y) for p in circle.points]
    assert far == pytest.approx([SCENARIO.capture.stop_distance_m] * len(far))
    assert (circle.pose.position.x, circle.pose.position.y) == STATE.target


def test_robots_differ_in_colour(types):
    colours = [
        (m.color.r, m.color.g, m.color.b)
        for m in messages_of(types)["/encircle/markers"].markers
        if m.ns == "bodies"
    ]
    assert len(set(colours)) == 3


def test_packets_are_lines_by_fate_and_goals_lines_by_robot(types):
    """From r1 to r2, 2 m apart: on time, late, and lost by chance half the way there."""
    recording, _ = hunted("sim1", ["ticks_max=1"])
    frame = frames_of(recording)[0]
    causes = STAGE.causes
    lost = -causes.index("loss")
    packets = (Packet(0, 1, 8, 0), Packet(0, 1, 9, 0), Packet(0, 1, lost, 0), Packet(1, 0, -99, 0))
    frame = replace(
        frame,
        tick=7,
        robots=((0.0, 0.0), (2.0, 0.0)),
        goals=((5.0, 6.0), None),
        packets=packets,
    )
    topic, message = SceneMessages(types, STAGE).traffic(frame, STAMP_NS)
    markers = types.decoded(types.encoded(message), topic.type_name).markers
    lines = {(m.ns, m.id): [(p.x, p.y) for p in m.points] for m in markers if m.action == m.ADD}
    assert lines == {
        ("packets", 0): [(0.0, 0.0), (2.0, 0.0)],
        ("packets", 1): [(0.0, 0.0), (2.0, 0.0)],
        ("packets", 2): [(0.0, 0.0), (1.0, 0.0), (2.0, 0.0), (1.0, 0.0)],
        ("goals", 0): [(0.0, 0.0), (5.0, 6.0)],
    }
    gone = {(m.ns, m.id) for m in markers if m.action == m.DELETE}
    assert gone == {("packets", 3), ("packets", 4), ("packets", 5), ("goals", 1)}
    colours = [(m.color.r, m.color.g, m.color.b) for m in markers if m.ns == "packets"]
    assert len(set(colours)) == len(ROLES)
