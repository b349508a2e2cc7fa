"""Runs by the clock as real processes. Nothing here depends on how fast the machine is."""

import json
import os
import signal
import subprocess
import sys
import threading
from typing import Any

import pytest
from helpers_agents import BODIES
from helpers_waiting import ample_s, communicated, ended, joined, taken, until

import encircle
from encircle.agents.brain.robot_core import RobotCore
from encircle.agents.process.real_time import answer
from encircle.agents.process.robot_runs import RobotRuns
from encircle.agents.process.slow_decisions import SlowDecisions
from encircle.network.recorded_ledger import ledger_of
from encircle.protocol import mailbox
from encircle.protocol.codec import decode, encode
from encircle.protocol.connections import MemoryHub
from encircle.protocol.keys import robot_key
from encircle.protocol.messages import Command, CommandMode, End, Observation, Setup
from encircle.protocol.real_time import ReceptionCount
from encircle.replay.replaying import replay
from encircle.runner.launch import free_endpoint
from encircle.world.recording.recording import read_recording

RUN = "clocked"

FROZEN_TICKS = 30

pytestmark = pytest.mark.realtime


def by_clock() -> tuple[str, ...]:
    """Ticks that are long enough, at this moment, for robots to answer in time: 20 ms or more."""
    return "clock=wall", "radio=direct", f"tick_s={ample_s() / 50.0}"


def summary(path) -> dict[str, Any]:
    return json.loads((path / "summary.json").read_text())


def test_robots_that_hear_each_other_catch_the_target_and_the_replay_is_the_same(tmp_path):
    overrides = (*by_clock(), "ticks_max=1500")
    hunt = encircle.run("sim1", overrides=overrides, out=tmp_path / "run")
    assert hunt.captured
    told = hunt.timing["real_time"]
    assert told["ticks"] == hunt.result.ticks
    assert set(told["robots"]) == {"r1", "r2", "r3", "r4"}
    check = replay(tmp_path / "run")
    assert check.same
    assert check.unchecked == ()
    transport = summary(tmp_path / "run")["transport"]
    pairs = [x for x in transport["links"] if "world" not in (x["sender"], x["receiver"])]
    assert len(pairs) == 12
    # Loopback loses nothing, and there is room for what waits.
    assert all(x["lost"] == 0 for x in transport["links"])
    assert sum(x["sent"] for x in pairs) > 100
    # All are on one machine, so their clocks are one.
    for clock in transport["clocks"]:
        assert abs(clock["offset_s"]) <= clock["error_s"]
        assert clock["steady"]


def test_a_frozen_robot_is_held_then_stands_still_and_goes_on(tmp_path):
    pids: dict[str, int] = {}
    frozen: list[int] = []
    woken: list[int] = []

    def look(report: dict[str, Any]) -> None:
        pids.update(report.get("started", {}))
        tick = report.get("tick", 0)
        if tick >= 20 and not frozen:
            frozen.append(tick)
            os.kill(pids["r2"], signal.SIGSTOP)
        elif frozen and not woken and tick >= frozen[0] + FROZEN_TICKS:
            woken.append(tick)
            os.kill(pids["r2"], signal.SIGCONT)

    endless = {
        "ticks_max": 180,
        "team": {"robots": 3, "hold_ticks_max": 4},
        "target": {
            "behaviour": "patrol",
            "parameters": {"waypoints": [[60, 0], [60, 60], [0, 60], [0, 0]]},
            "step_m_max": 0.5,
        },
        "capture": {"stop_distance_m": 1.0},
    }
    hunt = encircle.run(endless, overrides=by_clock(), out=tmp_path / "run", progress=look)
    assert hunt.result.ended == "ticks"
    assert hunt.result.departures == ()
    counts = hunt.timing["real_time"]["robots"]["r2"]
    assert counts["held"] >= 1
    # The signal, and the report before it, take a few ticks.
    assert counts["stood_still"] >= FROZEN_TICKS - 4 - 15
    check = replay(tmp_path / "run")
    assert check.same
    assert check.unchecked == ()
    recording = read_recording(tmp_path / "run")
    commands = [
        decode(Command, payload, recording.run)
        for _, robot, payload in recording.of_channel("command")
        if robot == "r2"
    ]
    assert commands[-1].refused[ReceptionCount.PASSED_OVER] >= 10
    assert commands[-1].tick > woken[0]
    assert ledger_of(recording).participations["r2"][-1].missed == 0


def test_a_tick_may_be_longer_than_the_world_would_wait_for_an_answer(tmp_path):
    scenario = tmp_path / "slow.json"
    tick_s = 0.2 + ample_s()
    slow = {"ticks_max": 2, "team": {"robots": 2}, "clock": "wall", "tick_s": tick_s}
    scenario.write_text(json.dumps(slow))
    endpoint = free_endpoint()
    where = ("--run", "slow")
    world = [sys.executable, "-m", "encircle.world", str(scenario), "--listen", endpoint, *where]
    nodes = [
        subprocess.Popen(
            [*world, "--json", "--answer-timeout", f"{tick_s / 4.0}"],
            stdout=subprocess.PIPE,
            text=True,
        ),
        *(
            subprocess.Popen(
                [sys.executable, "-m", "encircle.agents", r, "--connect", endpoint, *where]
            )
            for r in ("r1", "r2")
        ),
    ]
    try:
        said = [json.loads(line) for line in communicated(nodes[0])[0].splitlines()]
        assert [ended(node) for node in nodes] == [0, 0, 0]
    finally:
        for node in nodes:
            node.kill()
            node.wait()
    assert said[-1]["result"]["departures"] == []
    assert said[-1]["result"]["ended"] == "ticks"
    assert {"waiting": []} in said
    counts = said[-1]["result"]["real_time"]["robots"]
    assert all(sum(each.values()) == 0 for each in counts.values())


class Robot:
    """The robot's rounds by the clock on a link in memory, in a thread of their own."""

    def __init__(self) -> None:
        hub = MemoryHub()
        self.world = hub.connection([robot_key(RUN, "r1", "")])
        self.connection = hub.connection([robot_key(RUN, "r1", "")])
        self.core = RobotCore("r1", RUN)
        setup = Setup("r1", ("r1", "r2"), 0.001, "xi-star", BODIES, "direct")
        self.core.receive(robot_key(RUN, "r1", "setup"), encode(setup, RUN))
        seen = Observation("r1", 0, (4.0, 0.0), 0.0, None, (6.0,) * 8, (), (), sent_us=1)
        first = robot_key(RUN, "r1", "observation"), encode(seen, RUN)
        arguments = (self.core, self.connection, first, SlowDecisions(self.core, print))
        self.thread = threading.Thread(target=answer, args=arguments, daemon=True)
        self.thread.start()

    def end(self) -> None:
        end = encode(End("r1", 9, "captured"), RUN)
        self.world.send(robot_key(RUN, "r1", "end"), end)


def test_a_robot_that_hears_its_peers_but_not_the_world_stands_still():
    robot, modes = Robot(), []

    def stopped():
        # Far more often than the silence after which it is to stop, 10 ms.
        robot.world.send(robot_key(RUN, "r2", "pose"), b"whatever")
        while not robot.world.inbox.empty():
            key, payload = robot.world.receive()
            if key.endswith("/command"):
                modes.append(decode(Command, payload, RUN).mode)
        return CommandMode.STOP in modes

    until(stopped, "the robot to stand still")
    robot.end()
    joined(robot.thread)
    assert modes.count(CommandMode.STOP) == 1
    assert modes[-1] == CommandMode.STOP


def test_the_end_is_heard_even_where_there_is_no_room(monkeypatch):
    monkeypatch.setattr(mailbox, "MAIL_MAX", 0)
    robot = Robot()
    robot.end()
    joined(robot.thread)
    assert robot.core.ended == "captured"


def test_garbage_before_the_first_observation_does_not_hide_that_the_world_goes_by_the_clock():
    hub = MemoryHub()
    world, connection = (hub.connection([robot_key(RUN, "r1", "")]) for _ in range(2))
    runs = RobotRuns("r1", RUN, lambda _line: None, rejoins=False)
    thread = threading.Thread(target=runs.answer, args=(connection,), daemon=True)
    thread.start()
    seen = Observation("r1", 0, (4.0, 0.0), 0.0, None, (6.0,) * 8, (), (), sent_us=1)
    told = {
        "setup": [encode(Setup("r1", ("r1", "r2"), 0.02, "xi-star", BODIES), RUN)],
        "observation": [b"garbage", encode(seen, RUN)],
    }
    for channel, payloads in told.items():
        for payload in payloads:
            world.send(robot_key(RUN, "r1", channel), payload)
    said = dict(taken(world.inbox) for _ in range(2))
    world.send(robot_key(RUN, "r1", "end"), encode(End("r1", 9, "captured"), RUN))
    joined(thread)
    command = decode(Command, said[robot_key(RUN, "r1", "command")], RUN)
    assert command.timing is not None
    assert command.refused == {"malformed": 1}
    assert runs.core.ended == "captured"
