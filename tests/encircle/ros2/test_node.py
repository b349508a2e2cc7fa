"""A node of ROS 2 on real sessions: what it sends has a number and an id, and commands come in."""

import queue

import pytest
from helpers_connections import connecting_to, listening
from helpers_waiting import LONGEST_S, until

from encircle.protocol.zenoh.liveliness import alive_keys
from encircle.protocol.zenoh.raw_session import RawSession
from encircle.protocol.zenoh.session import closing, open_session
from encircle.ros2.commands import Goal, Velocity
from encircle.ros2.message_types import MessageTypes
from encircle.ros2.node import RosNode
from encircle.ros2.releases import NO_HASH, RELEASES
from encircle.ros2.steered_robot import CommandMail
from encircle.ros2.steering_node import SteeringNode
from encircle.ros2.wire import gid_of
from encircle.runner.launch import free_endpoint

TYPES = MessageTypes(RELEASES["jazzy"])
TWIST = "geometry_msgs/msg/Twist"


@pytest.fixture
def endpoint():
    return free_endpoint()


@pytest.fixture
def ours(endpoint):
    with RawSession(listening(endpoint)) as session:
        yield session


@pytest.fixture
def theirs(ours, endpoint):
    """A session of somebody else's."""
    with closing(open_session(connecting_to(endpoint))) as session:
        yield session


def twist(x=0.0):
    vector = "geometry_msgs/msg/Vector3"
    return TYPES.make(TWIST, TYPES.make(vector, x, 0.0, 0.0), TYPES.make(vector, 0.0, 0.0, 0.0))


@pytest.mark.parametrize("release", ["humble", "jazzy"])
def test_messages_are_numbered_from_1_and_say_which_publisher_has_sent_them(ours, theirs, release):
    types = MessageTypes(RELEASES[release])
    node = RosNode(ours, 3, "encircle")
    topics = [types.topic(name, TWIST) for name in ("/one", "/two")]
    node.advertise(topics)
    samples = queue.Queue()
    theirs.declare_subscriber("3/**", samples.put)
    sent = {topic.name: 0 for topic in topics}

    def send():
        for topic in topics:
            node.publish(topic, b"payload")
            sent[topic.name] += 1

    until(lambda: send() or samples.qsize() >= 6, "messages")
    tokens = sorted(alive_keys(theirs, "@ros2_lv/3/*/*/*/MP/**", LONGEST_S))
    assert len(tokens) == 2
    gids = {f"/{token.split('/')[9].strip('%')}": gid_of(token) for token in tokens}
    last = {}
    while not samples.empty():
        sample = samples.get_nowait()
        domain, name, _, type_hash = str(sample.key_expr).split("/")
        assert (domain, type_hash) == ("3", topics[0].type_hash)
        assert (type_hash == NO_HASH) == (release == "humble")
        attached = sample.attachment.to_bytes()
        assert len(attached) == 33
        number = int.from_bytes(attached[:8], "little")
        assert number == last.get(name, number - 1) + 1, "none is left out"
        assert 1 <= number <= sent[f"/{name}"]
        assert attached[17:] == gids[f"/{name}"]
        last[name] = number
    assert set(last) == {"one", "two"}


def test_the_node_and_its_topics_are_told_by_tokens(ours, theirs):
    node = RosNode(ours, 3, "encircle_r3")
    node.advertise([TYPES.topic("/out", TWIST)])
    node.subscribe(TYPES.topic("/in", TWIST), lambda _payload: None)
    tokens = [token.split("/") for token in alive_keys(theirs, "@ros2_lv/**", LONGEST_S)]
    kinds = {parts[5]: parts for parts in tokens}
    assert set(kinds) == {"NN", "MP", "MS"}
    assert {parts[2] for parts in tokens} == {ours.id}
    assert {parts[8] for parts in tokens} == {"encircle_r3"}
    assert (kinds["MP"][9], kinds["MS"][9]) == ("%out", "%in")
    assert len({parts[4] for parts in tokens}) == 3, "each has a number of its own"


class Steering:
    """A robot's node, with what it has refused."""

    def __init__(self, session):
        self.mail, self.lines = CommandMail(), []
        SteeringNode(RosNode(session, 0, "n"), TYPES, "r3", self.mail, self.lines.append)


@pytest.mark.parametrize("type_hash", ["RIHS01_of_another_release", NO_HASH])
def test_a_command_is_taken_whatever_its_hash(ours, theirs, type_hash):
    steering = Steering(ours)
    key = f"0/r3/cmd_vel/geometry_msgs::msg::dds_::Twist_/{type_hash}"
    payload = TYPES.encoded(twist(0.5))
    put = lambda: theirs.put(key, payload)  # noqa: E731
    until(lambda: put() or steering.mail.newest().number, "the command")
    assert steering.mail.newest().command == Velocity(0.5, 0.0, 0.0)
    assert steering.lines == []


def test_a_goal_and_a_velocity_take_each_others_place(ours, theirs):
    steering = Steering(ours)
    header = TYPES.make(
        "std_msgs/msg/Header", TYPES.make("builtin_interfaces/msg/Time", 0, 0), "map"
    )
    pose = TYPES.make(
        "geometry_msgs/msg/Pose",
        TYPES.make("geometry_msgs/msg/Point", 1.0, 2.0, 0.0),
        TYPES.make("geometry_msgs/msg/Quaternion", 0.0, 0.0, 0.0, 1.0),
    )
    goal = TYPES.encoded(TYPES.make("geometry_msgs/msg/PoseStamped", header, pose))
    stamped = TYPES.encoded(TYPES.make("geometry_msgs/msg/TwistStamped", header, twist(0.5)))

    def say(name, kind, payload):
        theirs.put(f"0/r3/{name}/geometry_msgs::msg::dds_::{kind}_/any", payload)

    def newest():
        return steering.mail.newest().command

    until(lambda: say("goal_pose", "PoseStamped", goal) or newest(), "the goal")
    assert newest() == Goal(1.0, 2.0)
    say("cmd_vel_stamped", "TwistStamped", stamped)
    until(lambda: isinstance(newest(), Velocity), "the velocity")
    assert newest() == Velocity(0.5, 0.0, 0.0, in_arena=True)


def test_what_is_no_command_is_counted_and_told_and_changes_nothing(ours, theirs):
    steering = Steering(ours)
    key = "0/r3/cmd_vel/geometry_msgs::msg::dds_::Twist_/any"
    refused = (b"", b"\xff" * 52, TYPES.encoded(twist(float("nan"))))
    for payload in refused:
        before = steering.mail.refused

        def say(payload=payload):
            theirs.put(key, payload)

        until(lambda: say() or steering.mail.refused > before, "a refusal")  # noqa: B023
    until(lambda: len(steering.lines) == steering.mail.refused, "the lines")
    assert steering.mail.newest().number == 0
    assert all(
        line.startswith("ros2: refused a message on /r3/cmd_vel: ") for line in steering.lines
    )
    assert "linear.x = nan" in steering.lines[-1]
