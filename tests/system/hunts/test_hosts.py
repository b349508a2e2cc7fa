"""Hunts over many hosts, each a network namespace of its own: world, router and four robots."""

import json
import time
from collections.abc import Iterator

import pytest
from helpers_hosts import Hosts, NodeProcess, possible
from helpers_waiting import ample_s

import encircle
from encircle.protocol.codec import decode
from encircle.protocol.messages import Command
from encircle.replay.replaying import replay
from encircle.world.recording.recording import read_recording

ROBOTS = ("r1", "r2", "r3", "r4")
LONG = {
    "ticks_max": 400,
    "team": {"robots": 4, "sensing_range_m": 500.0},
    "target": {
        "behaviour": "patrol",
        "parameters": {"waypoints": [[60, 0], [60, 60], [0, 60], [0, 0]]},
        "step_m_max": 0.5,
    },
}
"""A hunt that lasts some seconds: the target is faster than the robots."""
UNDER_WAY_TICK = 100

pytestmark = [
    pytest.mark.hosts,
    pytest.mark.skipif(not possible(), reason="network namespaces need root and iproute2"),
]


@pytest.fixture
def hosts(tmp_path) -> Iterator[Hosts]:
    (tmp_path / "logs").mkdir()
    made = Hosts(("hub", "world", *ROBOTS), tmp_path / "logs")
    yield made
    made.close()


def everything(
    hosts: Hosts, scenario: str, *options: str
) -> tuple[NodeProcess, NodeProcess, list[NodeProcess]]:
    """Router, world and robots, each on its host, told everything by environment variables."""
    hub = hosts.endpoint("hub")
    open_to_all = {"ENCIRCLE_LISTEN": hub, "ENCIRCLE_WITHOUT_AUTHENTICATION": "yes"}
    router = hosts.start("hub", "encircle.protocol.programs.router", settings=open_to_all)
    run = {"ENCIRCLE_CONNECT": hub, "ENCIRCLE_RUN": "far"}
    world = hosts.start("world", "world", scenario, *options, settings=run)
    robots = [hosts.start(r, "agents", settings=run | {"ENCIRCLE_ROBOT": r}) for r in ROBOTS]
    return router, world, robots


def test_a_hunt_through_a_router_is_the_one_in_memory(hosts, tmp_path):
    router, world, robots = everything(hosts, "sim1", "--out", str(tmp_path / "run"))
    assert [node.end() for node in (world, *robots)] == [0] * 5, world.said
    assert world.result()["digest"] == encircle.run("sim1", link="memory").digest
    assert replay(tmp_path / "run").same
    assert router.terminate() == 0
    assert "10.99.0.1:7447 without authentication" in router.said


def test_a_hunt_over_a_full_mesh_is_the_one_in_memory(hosts):
    """Everybody listens and knows everybody: no host is in the middle."""
    nodes = []
    for name in ("world", *ROBOTS):
        others = [other for other in ("world", *ROBOTS) if other != name]
        settings = {
            "ENCIRCLE_RUN": "mesh",
            "ENCIRCLE_LISTEN": hosts.endpoint(name),
            "ENCIRCLE_CONNECT": ",".join(map(hosts.endpoint, others)),
            "ENCIRCLE_WITHOUT_AUTHENTICATION": "yes",
        }
        command = ("world", "sim1") if name == "world" else ("agents", name)
        nodes.append(hosts.start(name, *command, settings=settings))
    assert [node.end() for node in nodes] == [0] * 5, nodes[0].said
    assert nodes[0].result()["digest"] == encircle.run("sim1", link="memory").digest


def test_endpoints_may_come_from_zenoh_configuration_files(hosts, tmp_path):
    hub = json.dumps(hosts.endpoint("hub"))
    listening, connecting = tmp_path / "router.json5", tmp_path / "party.json5"
    listening.write_text(f"{{ mode: 'router', listen: {{ endpoints: [{hub}] }} }}")
    connecting.write_text(f"{{ mode: 'client', connect: {{ endpoints: [{hub}] }} }} // all of it")
    own = ("--zenoh-config", str(listening), "--without-authentication", "--for-run", "filed")
    router = hosts.start("hub", "encircle.protocol.programs.router", *own)
    filed = ("--zenoh-config", str(connecting), "--run", "filed")
    world = hosts.start("world", "world", "sim5", *filed)
    robots = [hosts.start(robot, "agents", robot, *filed) for robot in ROBOTS]
    assert [node.end() for node in (world, *robots, router)] == [0] * 6, world.said
    assert world.result()["digest"] == encircle.run("sim5", link="memory").digest


@pytest.fixture
def long_hunt(tmp_path) -> str:
    path = tmp_path / "long.json"
    path.write_text(json.dumps(LONG))
    return str(path)


@pytest.mark.parametrize("victim", ["r2", "world"])
def test_a_host_that_was_cut_off_for_two_seconds_changes_nothing(hosts, long_hunt, victim):
    _, world, robots = everything(hosts, long_hunt)
    world.wait_for_tick(UNDER_WAY_TICK)
    with hosts.cut_off(victim):
        time.sleep(2.0)
    assert [node.end() for node in (world, *robots)] == [0] * 5, world.said
    assert world.result()["ticks"] == LONG["ticks_max"]
    assert world.result()["digest"] == encircle.run(long_hunt, link="memory").digest


def test_a_run_can_be_told_to_end_when_a_host_stays_cut_off(hosts, long_hunt, tmp_path):
    answer_s = f"{ample_s():g}"
    own = ("--out", str(tmp_path / "run"), "--when-lost", "end", "--answer-timeout", answer_s)
    _, world, robots = everything(hosts, long_hunt, *own)
    world.wait_for_tick(UNDER_WAY_TICK)
    with hosts.cut_off("r2"):
        assert world.end() == 1
        assert f"no answer from r2 for {answer_s} s" in world.said
        assert [robots[k].end() for k in (0, 2, 3)] == [1, 1, 1]
        assert replay(tmp_path / "run").same


def test_a_run_goes_on_without_a_host_and_counts_it_in_again(hosts, tmp_path):
    """Cut off for longer than an answer may take: lost, then back when its cable is."""
    scenario = tmp_path / "endless.json"
    scenario.write_text(json.dumps(LONG | {"ticks_max": 1_000_000}))
    answer_s = f"{ample_s():g}"
    own = ("--answer-timeout", answer_s, "--out", str(tmp_path / "run"))
    silent = f"lost: no answer for {answer_s} s"
    _, world, _ = everything(hosts, str(scenario), *own)
    world.wait_for_tick(UNDER_WAY_TICK)
    with hosts.cut_off("r2"):
        world.wait_until(lambda world: f"robot r2 is {silent}" in world.said)
        world.wait_for_tick(world.tick + UNDER_WAY_TICK)
    world.wait_until(lambda world: "robot r2 is back" in world.said)
    world.wait_for_tick(world.tick + UNDER_WAY_TICK)
    assert world.terminate() == 1  # it would go on for ever
    (lost, *_), (back, *_) = departures = world.result()["departures"]
    assert [part[1:] for part in departures] == [
        ["r2", silent],
        ["r2", "back"],
    ]
    recording = read_recording(tmp_path / "run")
    answers = [tick for tick, who, _ in recording.of_channel("command") if who == "r2"]
    assert answers == [*range(lost), *range(back, world.result()["ticks"])]
    teams = {
        tick: decode(Command, payload, "far").team
        for tick, who, payload in recording.of_channel("command")
        if who == "r1"
    }
    # They are told of the loss with the next observation, and hear it a tick after it speaks.
    assert all("r2" not in teams[tick] for tick in range(lost + 1, back))
    assert all("r2" in teams[tick] for tick in range(back + 1, max(teams) + 1))
    assert replay(tmp_path / "run").same


def test_by_the_clock_a_host_that_is_cut_off_holds_nobody_up(hosts, tmp_path):
    """Cut off long after all buffers on the way to it are full; the others never wait for it."""
    answer_s = 2.0 + 2.0 * ample_s()
    by_clock = {"clock": "wall", "radio": "direct", "tick_s": answer_s / 200.0}
    by_clock["ticks_max"] = 1_000_000
    scenario = tmp_path / "clocked.json"
    scenario.write_text(json.dumps(LONG | by_clock))
    _, world, _ = everything(hosts, str(scenario), "--answer-timeout", f"{answer_s}")
    world.wait_for_tick(UNDER_WAY_TICK)
    with hosts.cut_off("r2"):
        world.wait_until(
            lambda world: f"robot r2 is lost: no answer for {answer_s:g} s" in world.said
        )
    world.wait_until(lambda world: "robot r2 is back" in world.said)
    assert world.terminate() == 1  # it would go on for ever
    # If the router waited for room on the way to r2, nothing of the others would pass it, either.
    assert {robot for _, robot, _ in world.result()["departures"]} == {"r2"}
    assert world.result()["real_time"]["robots"]["r2"]["stood_still"] > 100


def test_the_doctor_says_what_a_host_can_reach(hosts, long_hunt):
    """It is asked on a robot's host: nobody there yet, all there, and then the cable is out."""
    hub = hosts.endpoint("hub")

    def findings(status: int) -> dict[str, list[list[str]]]:
        own = ("--connect", hub, "--run", "far", "--robot", "r2", "--json", "--check-timeout", "2")
        doctor = hosts.start("r2", "encircle.doctor.doctor", *own)
        assert doctor.end() == status, doctor.said
        found = {}
        for finding in doctor.reports()[-1]["findings"]:
            found.setdefault(finding["check"], []).append([finding["level"], finding["said"]])
        return found

    assert ["wrong", f"{hub} cannot be reached: Connection refused"] in findings(1)["endpoints"]
    _, world, robots = everything(hosts, long_hunt)
    world.wait_for_tick(1)
    found = findings(0)
    assert found["run"] == [["ok", "run far: world, r1, r2, r3, r4"]]
    told = [said.partition(":")[0] for level, said in found["versions"] if level == "ok"]
    assert {"router", "world", *ROBOTS} <= set(told)
    assert [level for level, said in found["clock"] if "this one" in said] == ["ok"] * 6
    with hosts.cut_off("r2"):
        assert findings(1)["endpoints"][0][0] == "wrong"
    assert [node.end() for node in (world, *robots)] == [0] * 5, world.said


def test_a_router_that_is_restarted_changes_nothing(hosts, long_hunt):
    router, world, robots = everything(hosts, long_hunt)
    world.wait_for_tick(UNDER_WAY_TICK)
    router.kill()
    time.sleep(1.0)
    endpoint = hosts.endpoint("hub")
    again = ("--listen", endpoint, "--without-authentication", "--for-run", "far")
    router = hosts.start("hub", "encircle.protocol.programs.router", *again)
    assert [node.end() for node in (world, *robots)] == [0] * 5, world.said
    assert router.end() == 0
    assert world.result()["ticks"] == LONG["ticks_max"]
    assert world.result()["digest"] == encircle.run(long_hunt, link="memory").digest


def test_a_router_that_does_not_come_back_ends_the_run(hosts, long_hunt, tmp_path):
    own = ("--out", str(tmp_path / "run"), "--answer-timeout", f"{ample_s()}")
    router, world, robots = everything(hosts, long_hunt, *own)
    world.wait_for_tick(UNDER_WAY_TICK)
    router.kill()
    assert world.end() == 1
    assert "no answer from" in world.said
    assert replay(tmp_path / "run").same
    # They would wait for the router for some seconds more.
    assert [robot.terminate() for robot in robots] == [1] * 4
