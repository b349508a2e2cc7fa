"""Hunts that ROS 2 looks on at, and takes part in: processes, and another project's client.

zenoh-ros2-sdk finds topics by their tokens, subscribes to keys with hashes that it has worked out
itself, and publishes commands. There is no ROS 2 here.
"""

import re
import subprocess
import sys
from math import hypot, nan

import numpy as np
import pytest
from helpers_commands import command
from helpers_hosts import NodeProcess
from helpers_hunt import LONG, ROBOTS, Hunt
from helpers_ros2 import ODOMETRY, POSE_STAMPED, TWIST, TWIST_STAMPED, RosClient
from helpers_security import Lab, free_endpoint
from helpers_waiting import until

import encircle
from encircle.replay.replaying import replay
from encircle.runlog.ground_truth import ground_truth_of
from encircle.runlog.recorded_log import log_of_recording
from encircle.scene.builder import scene_of_recording
from encircle.world.recording.recording import read_recording

MARKERS = "visualization_msgs/msg/MarkerArray"
TICK_S = 0.1
TICKS = 120
SCENARIO = LONG | {"ticks_max": TICKS}
BY_CLOCK = SCENARIO | {"clock": "wall", "tick_s": 0.05, "ticks_max": 1_000_000}
JOIN = ("--join-timeout", "3600")


class RosHunt(Hunt):
    """A hunt with a router, and what ROS 2 has of it."""

    def __init__(self, folder, scenario, ros_endpoint=None, protocol="tcp"):
        super().__init__(folder, scenario)
        self.endpoint = free_endpoint(protocol)
        self.where = ("--connect", self.endpoint)
        if ros_endpoint is not None:
            self.where += ("--ros-connect", ros_endpoint)
        self.start_router()
        self.start_world("--connect")

    def start_ros2(self, *options):
        return self.start_as("ros2", "-m", "encircle", "ros2", *self.where, *JOIN, *options)

    def show(self, *options):
        node = self.start_ros2(*options)
        node.wait_until(lambda node: "showing run" in node.said)
        return node

    def steer(self, robot, *options):
        node = self.start_ros2("--robot", robot, "--command-wait", "3600", *options)
        node.wait_until(lambda node: "listens to ROS 2" in node.said)
        return node

    def truth(self):
        return ground_truth_of(read_recording(self.out))


@pytest.fixture
def hunts(tmp_path):
    made = []

    def make(*arguments):
        made.append(RosHunt(tmp_path, *arguments))
        return made[-1]

    yield make
    for hunt in made:
        hunt.close()


@pytest.fixture
def ros_router(tmp_path):
    """Of ROS 2's side, apart from that of the hunt."""
    endpoint = free_endpoint("tcp")
    command = ("-m", "encircle.protocol.programs.router", "--listen", endpoint)
    node = NodeProcess([sys.executable, *command], tmp_path / "ros-router", {})
    node.wait_for_listening()
    yield endpoint
    node.kill()


def tick_of(message):
    stamp = message.header.stamp
    return round((stamp.sec + 1e-9 * stamp.nanosec) / TICK_S)


def test_ros_2_sees_where_everybody_is_and_the_hunt_stays_what_it_was(hunts, ros_router, tmp_path):
    hunt = hunts(SCENARIO, ros_router)
    bridge = hunt.show("--domain", "5")
    with RosClient(ros_router, tmp_path / "messages", domain=5) as client:
        client.wait_for_topic("/encircle/markers")
        topics = client.topics()
        moving = [*ROBOTS, "target"]
        assert topics == (
            {"/clock": ["rosgraph_msgs/msg/Clock"], "/tf": ["tf2_msgs/msg/TFMessage"]}
            | {f"/encircle/{of}": [MARKERS] for of in ("markers", "traffic")}
            | {f"/{name}/pose": [POSE_STAMPED] for name in moving}
            | {f"/{name}/odom": [ODOMETRY] for name in moving}
        )
        (publisher,) = client.info("/r2/pose").publishers
        assert (publisher.node_name, publisher.topic_type) == ("encircle", POSE_STAMPED)
        poses = {name: client.echo(f"/{name}/pose", POSE_STAMPED) for name in moving}
        transforms = client.echo("/tf", "tf2_msgs/msg/TFMessage")
        clocks = client.echo("/clock", "rosgraph_msgs/msg/Clock")
        odometry = client.echo("/r4/odom", ODOMETRY)
        for robot in ROBOTS:
            hunt.start_robot(robot)
        assert hunt.world.end() == bridge.end() == 0
        until(lambda: tick_of(poses["target"][-1]) == TICKS, "the last pose")
    assert int(re.search(r"traffic of (\d+) ticks", bridge.said)[1]) > TICKS // 2
    truth = hunt.truth().positions
    for k, name in enumerate(moving):
        ticks = [tick_of(message) for message in poses[name]]
        assert ticks == sorted(set(ticks))
        assert len(ticks) > TICKS // 2
        seen = [(m.pose.position.x, m.pose.position.y) for m in poses[name]]
        assert np.array_equal(seen, truth[ticks, k])
    assert {t.child_frame_id for t in transforms[-1].transforms} == set(moving)
    assert len(clocks) > TICKS // 2
    for message in odometry[1:]:
        tick = tick_of(message)
        speed = np.hypot(*(truth[tick, 3] - truth[tick - 1, 3])) / TICK_S
        linear = message.twist.twist.linear
        assert hypot(linear.x, linear.y) == pytest.approx(speed, abs=0.05)
    assert hunt.world.result()["digest"] == encircle.run(SCENARIO, link="memory").digest


def test_in_lock_step_a_ros_2_node_decides_tick_by_tick(hunts, tmp_path):
    """It answers each tick with a velocity: the path is then known beforehand."""
    hunt = hunts(SCENARIO)
    speed_mps, turn_radps, bad_tick = 0.5, -0.3, 20
    with RosClient(hunt.endpoint, tmp_path / "messages") as client:
        commands = client.publisher("/r3/cmd_vel", TWIST)

        def drive(message):
            if tick_of(message) == bad_tick:
                commands.publish(**client.twist(nan))
            commands.publish(**client.twist(speed_mps, 0.0, turn_radps))

        believed = client.echo("/r3/belief/pose", POSE_STAMPED, drive)
        targets = client.echo("/r3/belief/target", ODOMETRY)
        steered = hunt.steer("r3")
        client.wait_for_topic("/r3/belief/pose")
        until(lambda: client.info("/r3/cmd_vel").subscriber_count == 1, "who takes velocities")
        for robot in ("r1", "r2", "r4"):
            hunt.start_robot(robot)
        assert hunt.world.end() == 0
        assert steered.end() == 0
    path = hunt.truth().robots[:, 2]
    assert [tick_of(message) for message in believed] == list(range(TICKS))
    at = [(m.pose.position.x, m.pose.position.y) for m in believed]
    assert np.allclose(at, path[:TICKS], atol=1e-6), "it knows where it is"
    headings = turn_radps * TICK_S * np.arange(1, TICKS + 1)
    steps = speed_mps * TICK_S * np.stack([np.cos(headings), np.sin(headings)], axis=1)
    expected = path[0] + np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    assert np.allclose(path, expected, atol=1e-3)
    assert targets, "it believes to know where the target is"
    assert "refused a message on /r3/cmd_vel: linear.x = nan: must be" in steered.said
    assert f"ros2: {TICKS} commands taken, 1 refused" in steered.said
    recording = read_recording(hunt.out)
    checked = replay(recording)
    assert checked.same
    assert checked.unchecked == (f"r3: ROS 2 has decided at {TICKS} ticks; not checked there",)
    assert (log_of_recording(recording).modes[:, 2] == "ros2").all()
    beliefs = [frame.beliefs[2] for frame in scene_of_recording(recording).frames[:-1]]
    assert [(round(b.position[0], 3), round(b.position[1], 3)) for b in beliefs] == [
        (round(x, 3), round(y, 3)) for x, y in path[:TICKS].tolist()
    ]
    assert hunt.world.result()["departures"] == []


def test_with_certificates_ros_2_sees_and_steers_by_a_router_of_its_own(
    hunts, ros_router, tmp_path, monkeypatch
):
    """The bridge shows the viewer's certificate, and who steers r3 that of r3."""
    monkeypatch.setenv("ENCIRCLE_CERTIFICATES", str(Lab(tmp_path).directory))
    hunt = hunts(SCENARIO | {"ticks_max": 30}, ros_router, "tls")
    bridge = hunt.show()
    with RosClient(ros_router, tmp_path / "messages") as client:
        commands = client.publisher("/r3/cmd_vel", TWIST)
        client.echo(
            "/r3/belief/pose", POSE_STAMPED, lambda _: commands.publish(**client.twist(1.0))
        )
        poses = client.echo("/r3/pose", POSE_STAMPED)
        client.wait_for_topic("/r3/pose")
        steered = hunt.steer("r3")
        client.wait_for_topic("/r3/belief/pose")
        for robot in ("r1", "r2", "r4"):
            hunt.start_robot(robot)
        assert [node.end() for node in (hunt.world, steered, bridge)] == [0, 0, 0]
        until(lambda: poses and tick_of(poses[-1]) == 30, "the last pose")
    path = hunt.truth().robots[:, 2]
    assert path[-1] - path[0] == pytest.approx([30 * 1.0 * TICK_S, 0.0], abs=1e-3)
    assert spot(poses[-1]) == tuple(path[-1])


@pytest.mark.realtime
def test_by_the_clock_a_ros_2_node_steers_a_robot_and_one_that_is_silent_lets_it_stop(
    hunts, tmp_path
):
    hunt = hunts(BY_CLOCK)
    with RosClient(hunt.endpoint, tmp_path / "messages") as client:
        steered = hunt.steer("r3")
        for robot in ("r1", "r2", "r4"):
            hunt.start_robot(robot)
        at = client.echo("/r3/belief/pose", POSE_STAMPED)
        commands = client.publisher("/r3/cmd_vel_stamped", TWIST_STAMPED)
        goals = client.publisher("/r3/goal_pose", POSE_STAMPED)
        until(lambda: at, "the first tick")
        start = spot(at[-1])
        header = client.make(
            "std_msgs/msg/Header", client.make("builtin_interfaces/msg/Time", 0, 0), "map"
        )
        northward = client.make(TWIST, *client.twist(0.0, 1.0).values())
        commands.publish(header=header, twist=northward)
        until(lambda: spot(at[-1])[1] > start[1] + 0.1, "it to go north")
        until(lambda: "no command for 0.5 s, standing" in steered.said, "it to stand")
        stood = spot(at[-1])
        assert abs(stood[0] - start[0]) < 0.05
        goal = stood[0] + 2.0, stood[1] + 1.0
        pose = client.make(
            "geometry_msgs/msg/Pose",
            client.make("geometry_msgs/msg/Point", *goal, 0.0),
            client.make("geometry_msgs/msg/Quaternion", 0.0, 0.0, 0.0, 1.0),
        )
        goals.publish(header=header, pose=pose)
        until(lambda: np.allclose(spot(at[-1]), goal, atol=0.01), "it to reach its goal")
        assert hunt.departures == []
        hunt.world.terminate()
        steered.end()
    checked = replay(read_recording(hunt.out))
    assert not checked.differences
    assert "r3: ROS 2 has decided at" in checked.unchecked[0]


def spot(message):
    return message.pose.position.x, message.pose.position.y


def test_a_robot_that_is_there_already_is_not_steered(hunts):
    hunt = hunts(SCENARIO)
    first = hunt.start_robot("r3", *JOIN)
    first.wait_until(lambda node: "waiting for the world" in node.said)
    second = hunt.start_ros2("--robot", "r3")
    assert second.end() == 1
    assert "robot r3 in run faulty" in second.said
    assert first.running


def test_a_robot_that_is_not_of_the_team_is_not_let_in(hunts):
    hunt = hunts(SCENARIO)
    stranger = hunt.start_as(
        "ros2", "-m", "encircle", "ros2", *hunt.where, "--robot", "r9", "--join-timeout", "5"
    )
    assert stranger.end() == 1
    assert "did not take this robot in" in stranger.said


def test_a_run_that_is_not_there_is_told_of(hunts):
    hunt = hunts(SCENARIO)
    where = ("--connect", hunt.endpoint, "--run", "other", "--join-timeout", "1")
    done = command("ros2", *where)
    assert done.returncode == 1
    assert done.stderr.startswith("ros2: no world of run other answers at")


@pytest.mark.parametrize(
    ("options", "line"),
    [
        (("--release", "jazy"), "'jazy' is not one of humble, jazzy, kilted, lyrical, rolling"),
        (("--domain", "233"), "'233' is not a whole number from 0 to 232"),
        (("--robot", "r3", "--time", "sim"), "--time does not go with --robot"),
        (("--listen", "tcp/127.0.0.1:1"), "--listen tcp/127.0.0.1:1: it only connects"),
        (("--command-timeout", "1"), "--command-timeout goes with --robot"),
        (("--certificates", "nowhere"), "--ros-connect"),
        (("--ros-connect", "7447"), "connect = '7447': must be PROTOCOL/"),
    ],
)
def test_what_does_not_go_together_is_one_line(options, line):
    done = command("ros2", "--connect", "tcp/127.0.0.1:1", "--run", "g1", *options)
    assert done.returncode == 2
    assert line in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_without_rosbags_a_line_says_what_to_install():
    program = (
        "import sys; sys.modules['rosbags'] = None; from encircle.cli.main import main;"
        "sys.exit(main(['ros2', '--connect', 'tcp/127.0.0.1:1', '--run', 'g1', '--robot', 'r1']))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert done.stderr == 'encircle: ros2 needs rosbags: pip install "encircle[ros2]"\n'
