"""Keys, tokens and attachments: by hand, as Zenoh's own serialiser and two other projects do."""

import pytest
import zenoh
from helpers_ros2 import DEFINITIONS
from zenoh_ros2_sdk.attachment import Attachment
from zenoh_ros2_sdk.entity import EndpointEntity, NodeEntity
from zenoh_ros2_sdk.entity import EntityKind as TheirKind
from zenoh_ros2_sdk.keyexpr import (
    endpoint_liveliness_keyexpr,
    node_liveliness_keyexpr,
    topic_keyexpr,
)
from zenoh_ros2_sdk.qos import QosProfile, QosReliability
from zenoh_ros2_sdk.utils import get_type_hash

from encircle.ros2.wire import (
    EntityKind,
    NodeName,
    Quality,
    Topic,
    attachment,
    dds_type,
    gid_of,
    node_token,
    quality_text,
    topic_key,
    topic_token,
)

POSE_HASH = "RIHS01_10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8"
POSE = Topic("/r1/pose", "geometry_msgs/msg/PoseStamped", POSE_HASH)
NODE = NodeName(7, "a1b2c3", 0, "encircle")
GID = bytes(range(16))


def test_a_topics_key_is_that_of_two_other_projects():
    by_pamoja_ros2 = f"7/r1/pose/geometry_msgs::msg::dds_::PoseStamped_/{POSE_HASH}"
    theirs = topic_keyexpr(7, POSE.name, dds_type(POSE.type_name), POSE_HASH)
    assert topic_key(7, POSE) == by_pamoja_ros2 == theirs


def test_the_token_of_a_node():
    by_hand = "@ros2_lv/7/a1b2c3/0/0/NN/%/%/encircle"
    theirs = node_liveliness_keyexpr(NodeEntity(7, "a1b2c3", 0, "encircle"))
    assert node_token(NODE) == by_hand == theirs


@pytest.mark.parametrize(
    ("kind", "their_kind"),
    [
        (EntityKind.PUBLISHER, TheirKind.PUBLISHER),
        (EntityKind.SUBSCRIPTION, TheirKind.SUBSCRIPTION),
    ],
)
def test_the_token_of_a_publisher_or_subscription(kind, their_kind):
    by_hand = (
        f"@ros2_lv/7/a1b2c3/0/3/{kind}/%/%/encircle/%r1%pose"
        f"/geometry_msgs::msg::dds_::PoseStamped_/{POSE_HASH}/::,10:,:,:,,"
    )
    node = NodeEntity(7, "a1b2c3", 0, "encircle")
    described = (POSE.name, dds_type(POSE.type_name), POSE_HASH, QosProfile().encode())
    theirs = endpoint_liveliness_keyexpr(EndpointEntity(node, 3, their_kind, *described))
    assert topic_token(NODE, 3, kind, POSE) == by_hand == theirs


@pytest.mark.parametrize("best_effort", [False, True])
@pytest.mark.parametrize("depth", [1, 10, 100])
def test_others_read_the_quality_of_service_as_it_is_meant(best_effort, depth):
    read = QosProfile.decode(quality_text(Quality(best_effort, depth)))
    reliability = QosReliability.BEST_EFFORT if best_effort else QosReliability.RELIABLE
    assert read == QosProfile(reliability=reliability, history_depth=depth)


def test_an_attachment_has_33_bytes():
    by_hand = bytes.fromhex("020100000000000000e40b540200000010") + GID
    made = attachment(258, 10_000_000_000, GID)
    assert made == by_hand
    assert Attachment.from_bytes(made) == Attachment(258, 10_000_000_000, GID)


def test_attachments_are_what_zenohs_serialiser_makes():
    """rmw_zenoh writes them with it, field by field."""
    serialised = zenoh.ext.z_serialize
    number, time = (serialised(zenoh.ext.Int64(n)).to_bytes() for n in (-2, 1_700_000_000_123))
    gid = serialised(GID).to_bytes()
    assert attachment(-2, 1_700_000_000_123, GID) == number + time + gid
    names = [
        serialised(n).to_bytes() for n in ("sequence_number", "source_timestamp", "source_gid")
    ]
    keyed = names[0] + number + names[1] + time + names[2] + gid
    assert attachment(-2, 1_700_000_000_123, GID, by_name=True) == keyed


def test_publishers_have_ids_of_their_own():
    tokens = [topic_token(NODE, number, EntityKind.PUBLISHER, POSE) for number in range(50)]
    gids = {gid_of(token) for token in tokens}
    assert len(gids) == 50
    assert {len(gid) for gid in gids} == {16}


def test_the_hash_in_the_tests_is_that_of_the_definition():
    """That of ``ros2 topic info`` on any installation, too."""
    assert get_type_hash(POSE.type_name, DEFINITIONS[POSE.type_name], DEFINITIONS) == POSE_HASH
