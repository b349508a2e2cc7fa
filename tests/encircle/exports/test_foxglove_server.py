"""The live server, spoken to by a client that shares nothing with foxglove-sdk."""

import socket

import pytest
from helpers_exports import lossy_hunt, states_of
from helpers_foxglove_client import PROTOCOL, Client
from helpers_protobuf import decoded_messages
from helpers_waiting import until

from encircle.exports.foxglove_file import export
from encircle.exports.foxglove_server import FoxgloveServer, ServerFailed
from encircle.scene.builder import scene_of_recording

TOPICS = ["/poses", "/scene/beliefs/r3", "/values", "/run"]


@pytest.fixture(scope="module")
def scene():
    return scene_of_recording(lossy_hunt())


@pytest.fixture
def server(scene):
    made = FoxgloveServer(scene.stage, port=0)
    yield made
    made.stop()


@pytest.fixture
def subscribed(server):
    """Makes a client that the server sends topics to."""
    clients = []

    def make(topics):
        before = server.subscriptions
        client = Client(server.address, topics)
        clients.append(client)
        until(lambda: server.subscriptions == before + len(topics) or client.failure, "a client")
        assert client.failure is None
        return client

    yield make
    for client in clients:
        client.close()


def of_topic(client, topic):
    return [(time_ns, message) for found, time_ns, message in client.messages if found == topic]


def test_a_client_gets_what_the_file_has(server, subscribed, scene, tmp_path):
    client = subscribed(TOPICS)
    assert client.protocol == PROTOCOL
    assert scene.stage.title in client.server["name"]
    server.take(scene.frames)
    expected = len(scene.frames)
    until(lambda: len(of_topic(client, "/values")) == expected, "all messages")
    export(lossy_hunt(), tmp_path / "hunt.mcap")
    written = decoded_messages(tmp_path / "hunt.mcap")
    for topic in TOPICS:
        in_file = [(time_ns, message) for found, time_ns, _, message in written if found == topic]
        assert of_topic(client, topic) == in_file
    assert client.times == [state.tick * 10**8 for state in states_of(lossy_hunt())]
    channels = {topic for topic, _, _, _ in written} | {"/events"}
    assert client.channels.keys() >= channels


def test_who_comes_later_is_told_what_stays_the_same_and_sees_what_follows(
    server, subscribed, scene
):
    first = subscribed(["/values"])
    server.take(scene.frames[:5])
    second = subscribed(["/run", "/poses"])
    server.take(scene.frames[5:7])
    until(lambda: len(second.messages) == 3, "messages of a later client")
    assert [time_ns // 10**8 for time_ns, _ in of_topic(second, "/run")] == [5]
    assert [time_ns // 10**8 for time_ns, _ in of_topic(second, "/poses")] == [5, 6]
    until(lambda: len(first.messages) == 7, "messages of the first client")


def test_it_goes_on_without_clients_and_stops_twice(server, subscribed, scene):
    server.take(scene.frames[:3])
    client = subscribed(["/values"])
    server.stop()
    server.stop()
    until(client.ended.is_set, "the connection's end")
    assert client.messages == []


def test_clients_may_publish_nothing(subscribed):
    client = subscribed(["/run"])
    assert client.server["capabilities"] == ["time"]


def test_it_listens_on_loopback_alone(server):
    assert server.address.startswith("ws://127.0.0.1:")


def test_a_port_in_use_is_told(scene):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(ServerFailed, match=f"127.0.0.1:{port}.*in use"):
            FoxgloveServer(scene.stage, port=port)
