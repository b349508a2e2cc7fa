"""Keys, liveliness tokens and attachments of rmw_zenoh, the middleware of ROS 2 over Zenoh.

A topic's messages travel as CDR on ``domain/topic/type/hash``. Each message has an attachment: its
number, when it was sent, and which publisher sent it. Who takes part is told by tokens: one of each
node, publisher and subscription. As documented in ``docs/design.md`` of rmw_zenoh, and as its
sources have it where that is silent. Nothing here sends.
"""

import hashlib
from dataclasses import dataclass
from enum import StrEnum

GID_BYTES = 16
TOKENS = "@ros2_lv"
_NONE = "%"
"""What stands for ``/`` in a part of a token."""


class EntityKind(StrEnum):
    """What a token is of."""

    NODE = "NN"
    PUBLISHER = "MP"
    SUBSCRIPTION = "MS"


@dataclass(frozen=True, slots=True)
class Quality:
    """A topic's quality of service, as far as it is not ROS 2's default, which is reliable.

    ``depth``: of its history, in messages. Nothing here keeps messages for those that come late.
    """

    best_effort: bool = False
    depth: int = 10


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic: its name, from ``/`` on, the type of its messages, that type's hash, its quality."""

    name: str
    type_name: str
    type_hash: str
    quality: Quality = Quality()


@dataclass(frozen=True, slots=True)
class NodeName:
    """A node of ROS 2 as tokens name it.

    ``session``: the Zenoh session's id. ``number``: the node's, within its session.
    """

    domain: int
    session: str
    number: int
    name: str


def dds_type(type_name: str) -> str:
    """A type's name in keys: ``geometry_msgs/msg/Pose`` is ``geometry_msgs::msg::dds_::Pose_``."""
    package, kind, name = type_name.split("/")
    return f"{package}::{kind}::dds_::{name}_"


def topic_key(domain: int, topic: Topic) -> str:
    """The key of a topic's messages."""
    return "/".join(
        (str(domain), topic.name.strip("/"), dds_type(topic.type_name), topic.type_hash)
    )


def mangled(name: str) -> str:
    """A name with slashes as one part of a token."""
    return name.replace("/", _NONE)


def quality_text(quality: Quality) -> str:
    """A quality of service in a token, where what is the default is left empty.

    Reliability, durability, history and depth, deadline, lifespan, liveliness, apart by colons.
    Without a depth rmw_zenoh takes its default of 42, so that it is always told.
    """
    return f"{'2' if quality.best_effort else ''}::,{quality.depth}:,:,:,,"


def node_token(node: NodeName) -> str:
    """The token of a node."""
    return _token(node, node.number, EntityKind.NODE)


def topic_token(node: NodeName, number: int, kind: EntityKind, topic: Topic) -> str:
    """The token of a publisher or a subscription; ``number``: its own within the session."""
    of_topic = (
        mangled(topic.name),
        dds_type(topic.type_name),
        topic.type_hash,
        quality_text(topic.quality),
    )
    return "/".join((_token(node, number, kind), *of_topic))


def _token(node: NodeName, number: int, kind: EntityKind) -> str:
    where = (TOKENS, str(node.domain), node.session, str(node.number), str(number), kind.value)
    enclave = namespace = _NONE
    return "/".join((*where, enclave, namespace, mangled(node.name)))


def gid_of(token: str) -> bytes:
    """The id of a publisher, ``GID_BYTES`` long.

    Receivers only tell publishers apart by it. rmw_zenoh takes another hash of the same token.
    """
    return hashlib.blake2b(token.encode(), digest_size=GID_BYTES).digest()


def attachment(sequence: int, time_ns: int, gid: bytes, by_name: bool = False) -> bytes:
    """The attachment of a message.

    ``sequence``: the publisher's numbering, from 1. ``time_ns``: when it was sent, Unix time.
    ``by_name``: with the names of the fields, as old packages have it
    (``encircle.ros2.releases``).
    """
    number, time, length = (
        sequence.to_bytes(8, "little", signed=True),
        time_ns.to_bytes(8, "little", signed=True),
        bytes([len(gid)]),
    )
    if not by_name:
        return number + time + length + gid
    names = [bytes([len(name)]) + name for name in _FIELDS]
    return b"".join((names[0], number, names[1], time, names[2], length, gid))


_FIELDS = (b"sequence_number", b"source_timestamp", b"source_gid")
