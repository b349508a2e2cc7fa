"""``encircle foxglove`` beside a hunt of processes: a client sees it, and changes nothing."""

import re

import pytest
from helpers_commands import command
from helpers_foxglove_client import Client
from helpers_hunt import LONG, ROBOTS, Hunt
from helpers_waiting import until

import encircle
from encircle.runlog.ground_truth import ground_truth_of
from encircle.runner.launch import free_endpoint
from encircle.world.recording.recording import read_recording

TICKS = 120
SCENARIO = LONG | {"ticks_max": TICKS}
JOIN = ("--join-timeout", "3600")


@pytest.fixture
def hunt(tmp_path):
    made = Hunt(tmp_path, SCENARIO)
    yield made
    made.close()


def test_a_client_sees_the_hunt_to_its_end_and_changes_nothing(hunt):
    hunt.start_world()
    where = ("--connect", hunt.endpoint, *JOIN, "--port", "0")
    server = hunt.start_as("foxglove", "-m", "encircle", "foxglove", *where)
    server.wait_until(lambda node: "ws://" in node.said)
    client = Client(re.search(r"ws://\S+:\d+", server.said)[0], ["/poses", "/run"])
    until(client.begun.is_set, "a connection")
    for robot in ROBOTS:
        hunt.start_robot(robot)
    assert hunt.world.end() == server.end() == 0
    until(client.ended.is_set, "the end of the connection")
    client.close()
    assert client.failure is None
    positions = ground_truth_of(read_recording(hunt.out)).robots
    ticks = [time_ns // 10**8 for topic, time_ns, _ in client.messages if topic == "/poses"]
    assert ticks == sorted(set(ticks))
    assert ticks[-1] == TICKS
    assert len(ticks) > TICKS // 2
    for topic, time_ns, message in client.messages:
        if topic == "/poses":
            places = [(p["position"]["x"], p["position"]["y"]) for p in message["poses"]]
            assert places == [tuple(place) for place in positions[time_ns // 10**8]]
    assert hunt.world.result()["digest"] == encircle.run(SCENARIO, link="memory").digest


def test_a_run_that_is_not_there_is_told_in_a_line():
    endpoint = free_endpoint()
    answer = command("foxglove", "--connect", endpoint, "--run", "none", "--join-timeout", "0.5")
    assert answer.returncode == 1
    assert len(answer.stderr.strip().split("\n")) == 1
    assert endpoint in answer.stderr


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (("--listen", "tcp/127.0.0.1:7447", "--run", "none"), "who looks on connects"),
        (("--run", "none"), "Give --connect"),
        (("--connect", "tcp/127.0.0.1:7447"), "--run"),
        (("--connect", "tcp/127.0.0.1:7447", "--run", "none", "--port", "70000"), "70000"),
    ],
)
def test_what_does_not_go_together_is_told(options, told):
    answer = command("foxglove", *options)
    assert answer.returncode == 2
    assert told in answer.stderr
