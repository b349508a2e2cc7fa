"""A node of ROS 2 over Zenoh: publishers and subscriptions that others discover by their tokens."""

import time
from collections.abc import Callable, Iterable

from encircle.protocol.zenoh.raw_session import RawSession
from encircle.ros2.wire import (
    EntityKind,
    NodeName,
    Topic,
    attachment,
    gid_of,
    node_token,
    topic_key,
    topic_token,
)

_Put = Callable[[bytes, bytes], None]


class RosNode:
    """One node on a session.

    ``by_name``: attachments as old packages of rmw_zenoh have them (``encircle.ros2.releases``).
    """

    def __init__(self, session: RawSession, domain: int, name: str, by_name: bool = False) -> None:
        self._session = session
        self._node = NodeName(domain, session.id, 0, name)
        self._by_name = by_name
        self._count = 0
        self._publishers: dict[str, tuple[_Put, bytes]] = {}
        self._sent: dict[str, int] = {}
        session.declare_token(node_token(self._node))

    def advertise(self, topics: Iterable[Topic]) -> None:
        """Be a publisher of topics, each once."""
        for topic in topics:
            put = self._session.publisher(topic_key(self._node.domain, topic))
            token = self._declare(EntityKind.PUBLISHER, topic)
            self._publishers[topic.name] = put, gid_of(token)

    def publish(self, topic: Topic, payload: bytes) -> None:
        """Send an encoded message; ``ConnectionClosed`` once the session is closed."""
        put, gid = self._publishers[topic.name]
        number = self._sent[topic.name] = self._sent.get(topic.name, 0) + 1
        put(payload, attachment(number, time.time_ns(), gid, self._by_name))

    def subscribe(self, topic: Topic, take: Callable[[bytes], None]) -> None:
        """Have ``take`` called for each message of others, on one of Zenoh's threads.

        The type's hash is not compared: a message of another layout fails when it is decoded, and
        is then told of.
        """
        any_hash = topic_key(self._node.domain, topic).rpartition("/")[0] + "/*"
        self._session.subscribe(any_hash, lambda _key, payload: take(payload))
        self._declare(EntityKind.SUBSCRIPTION, topic)

    def _declare(self, kind: EntityKind, topic: Topic) -> str:
        self._count += 1
        token = topic_token(self._node, self._count, kind, topic)
        self._session.declare_token(token)
        return token
