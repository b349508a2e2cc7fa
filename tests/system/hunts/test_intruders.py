"""Hunts over mutual TLS as processes, while those who do not belong, and one who does, break in.

Each is refused and counted by the router, and the run is the one in memory, to the last bit.
"""

import json
import sys
from contextlib import ExitStack
from datetime import timedelta

import pytest
from helpers_hosts import NodeProcess
from helpers_hunt import LONG
from helpers_security import REFUSED_S_MAX, ROBOTS, Lab, free_endpoint
from helpers_waiting import LONGEST_S

import encircle
from encircle.protocol.codec import encode
from encircle.protocol.keys import robot_key, world_key
from encircle.protocol.messages import Command, End, Pose, State
from encircle.protocol.zenoh.connection import ZenohConnection
from encircle.protocol.zenoh.endpoints import ConnectionFailed, Endpoints

TICKS = 1500
SCENARIO = LONG | {"ticks_max": TICKS}
"""A hunt that lasts some seconds, long enough for all that follows: the target is too fast."""
UNDER_WAY_TICK = 20
COUNTING_ROUTER = """
import json, sys
from encircle.protocol.zenoh.refusals import counting_refusals
from encircle.protocol.programs.router import main
with counting_refusals() as found:
    status = main(sys.argv[1:])
messages = [[*case, number] for case, number in found.messages.items()]
print(json.dumps({"connections": found.connections, "messages": messages}))
sys.exit(status)
"""
RUN = "guarded"


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    return Lab(tmp_path_factory.mktemp("intruders"))


@pytest.fixture
def started(tmp_path):
    """Start ``python`` with arguments as a node; all are ended with the test."""
    with ExitStack() as stack:

        def start(name, *arguments):
            node = NodeProcess([sys.executable, *arguments], tmp_path / name, {})
            stack.callback(node.kill)
            return node

        yield start


def written(scenario, folder):
    path = folder / "scenario.json"
    path.write_text(json.dumps(scenario))
    return str(path)


def hunt(lab, started, scenario, endpoint, world_config):
    parts = ("--run", RUN, "--zenoh-config")
    world = started("world", "-m", "encircle.world", scenario, *parts, str(world_config))
    robots = [
        started(robot, "-m", "encircle.agents", robot, *parts, str(lab.connecting(robot, endpoint)))
        for robot in ROBOTS
    ]
    return world, robots


def link(lab, who, endpoint, connect_s_max=LONGEST_S):
    config = lab.connecting(who, endpoint)
    return ZenohConnection(Endpoints(config=config, connect_s_max=connect_s_max), "encircle/**")


def forgeries() -> list[tuple[str, bytes]]:
    """What would change or end the run at once, each valid in itself, were it let through.

    Among the answers in r3's name are those to the ticks that are about to be asked.
    """
    sent = []
    for tick in range(UNDER_WAY_TICK, TICKS, 3):
        pose = Pose("r3", tick, tick, (0.0, 0.0), (0.0, 0.0), None, "search", None, None)
        command = Command("r3", tick, (0.1, 0.1), "search", None, None, None, None, None, ())
        sent += [
            (robot_key(RUN, "r3", "pose"), encode(pose, RUN)),
            (robot_key(RUN, "r3", "command"), encode(command, RUN)),
        ]
    ends = [(robot_key(RUN, r, "end"), encode(End(r, 0, "captured"), RUN)) for r in ROBOTS]
    state = encode(State(0, ((0.0, 0.0),), (0.0,), (0.0, 0.0), True, ()), RUN)
    return [*sent, *ends, (world_key(RUN, "state"), state)]


def test_intruders_are_refused_and_counted_and_change_nothing(lab, started, tmp_path):
    scenario = written(SCENARIO, tmp_path)
    endpoint = free_endpoint("tls")
    config = lab.listening("router", endpoint, "router")
    router = started("router", "-c", COUNTING_ROUTER, "--zenoh-config", str(config))
    router.wait_for_listening()
    world, robots = hunt(lab, started, scenario, endpoint, lab.connecting("world", endpoint))
    world.wait_for_tick(UNDER_WAY_TICK)

    expired = lab.dated("r3", timedelta(days=-3), timedelta(days=-1))
    for stranger in (None, lab.foreign("r3"), expired):
        with pytest.raises(ConnectionFailed, match="cannot connect"):
            link(lab, stranger, endpoint, REFUSED_S_MAX)
    posing = link(lab, "r2", endpoint)
    messages = forgeries()
    for key, payload in messages:
        posing.session.put(key, payload)
    for key in (robot_key(RUN, "r3", "alive"), world_key(RUN, "alive")):
        posing.session.liveliness().declare_token(key).undeclare()
    posing.close()
    assert "result" not in world.reports()[-1], "the hunt was over before the intruders were done"

    assert [node.end() for node in (world, *robots)] == [0] * 5, world.said
    assert world.result()["digest"] == encircle.run(scenario, link="memory").digest
    assert world.result()["refused"] == {}
    assert router.terminate() == 0
    counts = router.reports()[-1]
    # Who gives up in the middle of a handshake counts as something else.
    assert {"no-certificate", "unknown-authority", "expired"} <= set(counts["connections"])
    refused = {(who, what): number for who, what, number in counts["messages"]}
    assert refused.pop(("r2", "put")) == len(messages)
    assert refused.pop(("r2", "liveliness token")) == 2
    assert refused == {("r2", "declare subscriber"): 1}


def test_a_world_that_is_connected_to_directly_holds_the_rules_itself(lab, started, tmp_path):
    scenario = written(SCENARIO | {"ticks_max": TICKS // 2}, tmp_path)
    endpoint = free_endpoint("tls")
    world, robots = hunt(lab, started, scenario, endpoint, lab.listening("world", endpoint, "peer"))
    world.wait_for_tick(UNDER_WAY_TICK)
    with pytest.raises(ConnectionFailed, match="cannot connect"):
        link(lab, None, endpoint, REFUSED_S_MAX)
    posing = link(lab, "r2", endpoint)
    for key, payload in forgeries():
        posing.session.put(key, payload)
    posing.close()
    assert "result" not in world.reports()[-1], "the hunt was over before the intruders were done"
    assert [node.end() for node in (world, *robots)] == [0] * 5, world.said
    assert world.result()["digest"] == encircle.run(scenario, link="memory").digest
    assert world.result()["refused"] == {}
