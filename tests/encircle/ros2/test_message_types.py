"""Types of messages: their hashes and bytes, beside those of other projects; and bad bytes."""

import subprocess
import sys

import numpy as np
import pytest
from helpers_ros2 import DEFINITIONS
from zenoh_ros2_sdk.utils import get_type_hash

from encircle.ros2.message_types import MessageTypes
from encircle.ros2.releases import NO_HASH, RELEASES

TWIST_BY_PAMOJA_ROS2 = bytes.fromhex(
    "00010000"
    "000000000000f83f"
    "000000000000d0bf"
    "0000000000000000"
    "0000000000000000"
    "0000000000000000"
    "000000000000e83f"
)
"""1.5 and -0.25 m/s, 0.75 rad/s."""


@pytest.fixture(scope="module", params=RELEASES)
def types(request):
    return MessageTypes(RELEASES[request.param])


def twist(types):
    vector = "geometry_msgs/msg/Vector3"
    parts = types.make(vector, 1.5, -0.25, 0.0), types.make(vector, 0.0, 0.0, 0.75)
    return types.make("geometry_msgs/msg/Twist", *parts)


def test_a_message_has_the_bytes_that_another_project_makes(types):
    assert types.encoded(twist(types)) == TWIST_BY_PAMOJA_ROS2


def test_a_message_is_read_as_it_was_meant(types):
    read = types.decoded(TWIST_BY_PAMOJA_ROS2, "geometry_msgs/msg/Twist")
    assert (read.linear.x, read.linear.y, read.angular.z) == (1.5, -0.25, 0.75)


def test_bytes_by_another_machine_order_are_read(types):
    numbers = np.array([1.5, -0.25, 0.0, 0.0, 0.0, 0.75], ">f8").tobytes()
    read = types.decoded(b"\0\0\0\0" + numbers, "geometry_msgs/msg/Twist")
    assert (read.linear.x, read.linear.y, read.angular.z) == (1.5, -0.25, 0.75)


@pytest.mark.parametrize("payload", [b"", b"\xff" * 60, TWIST_BY_PAMOJA_ROS2[:20]])
def test_bytes_of_no_such_message_are_told_of(types, payload):
    with pytest.raises(ValueError, match=f"{len(payload)} bytes are no geometry_msgs/msg/Twist"):
        types.decoded(payload, "geometry_msgs/msg/Twist")


@pytest.mark.parametrize("name", DEFINITIONS)
def test_hashes_are_those_that_another_project_works_out(name):
    theirs = get_type_hash(name, DEFINITIONS[name], DEFINITIONS)
    for release in ("jazzy", "kilted", "lyrical", "rolling"):
        assert MessageTypes(RELEASES[release]).topic("/any", name).type_hash == theirs


def test_humble_has_no_hashes():
    types = MessageTypes(RELEASES["humble"])
    assert types.topic("/clock", "rosgraph_msgs/msg/Clock").type_hash == NO_HASH


def test_the_room_is_imported_without_rosbags():
    """What only names topics and keys, and the help of the command, need no extra."""
    program = (
        "import sys; sys.modules['rosbags'] = None;"
        "import encircle.ros2.bridge, encircle.ros2.steering_node, encircle.cli.ros2"
    )
    subprocess.run([sys.executable, "-c", program], check=True)
