"""Another project's ROS 2 over Zenoh, as a client of tests: zenoh-ros2-sdk.

It builds keys, tokens, attachments and hashes of types by code of its own, from definitions that
are written down here, so that it fetches none. The bytes of messages it reads and writes with
rosbags, as we do.
"""

from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any

from helpers_waiting import LONGEST_S, until
from zenoh_ros2_sdk import (
    ROS2Publisher,
    ROS2Subscriber,
    ZenohSession,
    get_topic_info,
    get_topic_names_and_types,
    message_registry,
)

from encircle.protocol.zenoh.endpoints import host_and_port

DEFINITIONS = {
    "builtin_interfaces/msg/Time": "int32 sec\nuint32 nanosec\n",
    "std_msgs/msg/Header": "builtin_interfaces/Time stamp\nstring frame_id\n",
    "geometry_msgs/msg/Point": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/msg/Quaternion": "float64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1\n",
    "geometry_msgs/msg/Pose": "Point position\nQuaternion orientation\n",
    "geometry_msgs/msg/PoseStamped": "std_msgs/Header header\nPose pose\n",
    "geometry_msgs/msg/PoseArray": "std_msgs/Header header\nPose[] poses\n",
    "geometry_msgs/msg/Vector3": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/msg/Twist": "Vector3 linear\nVector3 angular\n",
    "geometry_msgs/msg/TwistStamped": "std_msgs/Header header\nTwist twist\n",
    "geometry_msgs/msg/PoseWithCovariance": "Pose pose\nfloat64[36] covariance\n",
    "geometry_msgs/msg/TwistWithCovariance": "Twist twist\nfloat64[36] covariance\n",
    "geometry_msgs/msg/Transform": "Vector3 translation\nQuaternion rotation\n",
    "geometry_msgs/msg/TransformStamped": (
        "std_msgs/Header header\nstring child_frame_id\nTransform transform\n"
    ),
    "tf2_msgs/msg/TFMessage": "geometry_msgs/TransformStamped[] transforms\n",
    "nav_msgs/msg/Odometry": (
        "std_msgs/Header header\nstring child_frame_id\n"
        "geometry_msgs/PoseWithCovariance pose\ngeometry_msgs/TwistWithCovariance twist\n"
    ),
    "rosgraph_msgs/msg/Clock": "builtin_interfaces/Time clock\n",
}
"""Fields of messages, as ROS 2 documents them."""
TWIST, TWIST_STAMPED = "geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped"
POSE_STAMPED, ODOMETRY = "geometry_msgs/msg/PoseStamped", "nav_msgs/msg/Odometry"


def write_definitions(folder: Path) -> Path:
    """The definitions as a folder of files, as the client looks for them."""
    for name, text in DEFINITIONS.items():
        path = folder / f"{name}.msg"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return folder


class RosClient:
    """A ROS 2 participant at a router; use as a context, one at a time."""

    def __init__(self, endpoint: str, folder: Path, domain: int = 0) -> None:
        host, port = host_and_port(endpoint)
        self._where = {"router_ip": host, "router_port": port, "domain_id": domain}
        self._session = ZenohSession.get_instance(host, port)
        message_registry._registry = None
        message_registry.get_registry(str(write_definitions(folder)))
        self._kept: list[Any] = []

    def __enter__(self) -> "RosClient":
        return self

    def __exit__(
        self,
        _kind: type[BaseException] | None,
        _error: BaseException | None,
        _traceback: TracebackType | None,
    ) -> None:
        for part in self._kept:
            part.close()
        self._session.close()

    def topics(self) -> dict[str, list[str]]:
        """Names of topics and their types, as ``ros2 topic list -t`` would show them."""
        return dict(get_topic_names_and_types(**self._where, timeout=LONGEST_S))

    def wait_for_topic(self, name: str) -> None:
        """Until a topic is in the graph."""
        until(lambda: name in self.topics(), f"topic {name}")

    def info(self, name: str) -> Any:
        """As ``ros2 topic info --verbose``."""
        return get_topic_info(name, **self._where, timeout=LONGEST_S, verbose=True)

    def echo(
        self, name: str, type_name: str, react: Callable[[Any], None] = lambda _message: None
    ) -> list[Any]:
        """The messages of a topic, as they come; ``react`` is called with each."""
        messages: list[Any] = []

        def take(message: Any) -> None:
            messages.append(message)
            react(message)

        self._kept.append(ROS2Subscriber(name, type_name, take, **self._where))
        return messages

    def publisher(self, name: str, type_name: str) -> ROS2Publisher:
        """A publisher; its ``publish`` takes the fields by name."""
        publisher = ROS2Publisher(name, type_name, **self._where)
        self._kept.append(publisher)
        return publisher

    def make(self, type_name: str, *fields: Any) -> Any:
        """A message, of a type that a topic of this client has, or that is part of one."""
        return self._session.store.types[type_name](*fields)

    def twist(self, x_mps: float, y_mps: float = 0.0, turn_radps: float = 0.0) -> dict[str, Any]:
        """The fields of a Twist."""
        vector = "geometry_msgs/msg/Vector3"
        return {
            "linear": self.make(vector, x_mps, y_mps, 0.0),
            "angular": self.make(vector, 0.0, 0.0, turn_radps),
        }
