"""Lanes: which message takes which, who drops what, and what is told in lots."""

import itertools
import json
from contextlib import ExitStack

import pytest
from helpers_connections import connecting_to, in_thread, listening, received
from helpers_waiting import LONGEST_S, result_of
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.protocol.keys import robot_key, world_key
from encircle.protocol.zenoh.configuration import configuration
from encircle.protocol.zenoh.connection import ZenohConnection
from encircle.protocol.zenoh.endpoints import Endpoints
from encircle.protocol.zenoh.lanes import (
    GATE_SETTINGS,
    QUEUE_SETTINGS,
    ROUND,
    SURE,
    VIEWERS,
    message_priority,
)
from encircle.runner.launch import free_endpoint
from encircle.world.process.sending import BATCH_BYTES_MAX, batches, send_in_batches

OBSERVATION = robot_key("t", "r1", "observation")
TOO_MANY = 1500
"""Messages of 20 KB: more than all that may wait anywhere between two links."""


@pytest.mark.parametrize(
    ("key", "first", "again"),
    [
        (OBSERVATION, ROUND, SURE),
        (robot_key("t", "r1", "pose"), ROUND, SURE),
        (robot_key("t", "r1", "command"), ROUND, SURE),
        (robot_key("t", "r1", "setup"), SURE, SURE),
        (robot_key("t", "r1", "end"), SURE, SURE),
        (world_key("t", "state"), VIEWERS, SURE),
        (world_key("t", "radio"), VIEWERS, SURE),
    ],
)
def test_a_message_takes_the_lane_of_its_kind_and_said_again_the_sure_one(key, first, again):
    assert (message_priority(key, False), message_priority(key, True)) == (first, again)


def differing(config):
    """What a configuration has otherwise than Zenoh's own, of all that lanes are about."""
    default = configuration(Endpoints(connect=("tcp/127.0.0.1:1",)))
    names = [*QUEUE_SETTINGS, *GATE_SETTINGS]
    return {name for name in names if config.get_json(name) != default.get_json(name)}


def test_who_listens_waits_for_nobody_unless_a_file_says_otherwise(tmp_path):
    gate = listening("tcp/127.0.0.1:0")
    assert differing(configuration(gate)) == set(GATE_SETTINGS)
    assert differing(configuration(connecting_to("tcp/127.0.0.1:1"))) == set()
    path = tmp_path / "own.json5"
    own = [{"messages": ["put"], "overwrite": {"express": True}}]
    path.write_text(json.dumps({"qos": {"network": own}}))
    config = configuration(Endpoints(listen=gate.listen, config=path))
    assert len(json.loads(config.get_json("qos/network"))) == 1
    assert differing(config) == set(GATE_SETTINGS)


@pytest.fixture
def links():
    """A gate, and who is connected to it and known to hear it."""
    endpoint = free_endpoint()
    with ExitStack() as stack:
        gate = ZenohConnection(listening(endpoint), "encircle/t/robots/*/*")
        stack.callback(gate.close)
        robot = ZenohConnection(connecting_to(endpoint), robot_key("t", "r1", "*"))
        stack.callback(robot.close)
        robot.answer_info_queries(robot_key("t", "r1", "about"), "r1")
        while not gate.flush(robot_key("t", "r1", "about"), LONGEST_S):
            pass
        yield gate, robot


def observations():
    return [(OBSERVATION, b"%d " % number + bytes(20_000)) for number in range(TOO_MANY)]


def test_a_gate_drops_what_finds_no_room_but_not_what_is_said_again(links):
    gate, robot = links
    for key, payload in observations():
        gate.send(key, payload)
    last = (OBSERVATION, b"the last")
    gate.send(*last)
    gate.send(*last)
    found = []
    while not found or found[-1] != last:
        found += received(robot)
    numbers = [int(payload.split()[0]) for _, payload in found[:-1]]
    assert numbers == sorted(numbers)
    assert len(numbers) < TOO_MANY


def test_who_is_told_much_at_once_hears_all_of_it_in_order(links):
    gate, robot = links
    told = in_thread(send_in_batches, gate, observations())
    assert received(robot, TOO_MANY) == observations()
    result_of(told)


@given(st.lists(st.tuples(st.sampled_from("ab"), st.integers(0, 2 * BATCH_BYTES_MAX))))
@settings(max_examples=100, deadline=None, derandomize=True)
def test_lots_are_cut_only_between_messages_on_one_key(told):
    messages = [(key, bytes(length)) for key, length in told]
    found = list(batches(messages))
    assert [message for batch in found for message in batch] == messages
    for before, after in itertools.pairwise(found):
        assert before[-1][0] == after[0][0]
        assert sum(len(payload) for _, payload in (*before, after[0])) > BATCH_BYTES_MAX


def test_a_round_is_one_lot():
    one_each = [(robot_key("t", f"r{k}", "observation"), bytes(BATCH_BYTES_MAX)) for k in range(9)]
    assert list(batches(one_each)) == [one_each]
