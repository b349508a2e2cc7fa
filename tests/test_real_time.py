"""Runs by the clock as real processes. Nothing here depends on how fast the machine is."""

import json
import os
import signal
from typing import Any

import encircle
from encircle.replaying import read_recording, replay
from encircle.transport import traffic_of
from protocol.codec import decode
from protocol.messages import Command
from protocol.real_time import PASSED_OVER

AT_50_HZ = ("clock=wall", "tick_s=0.02")
LONG = (*AT_50_HZ, "radio=direct", "ticks_max=1500")
FROZEN_TICKS = 30


def summary(path) -> dict[str, Any]:
    return json.loads((path / "summary.json").read_text())


def test_robots_that_hear_each_other_catch_the_target_and_the_replay_is_the_same(tmp_path):
    hunt = encircle.run("sim1", overrides=LONG, out=tmp_path / "run")
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
    # Loopback and a blocking sender lose nothing.
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
    hunt = encircle.run(
        endless, overrides=[*AT_50_HZ, "radio=direct"], out=tmp_path / "run", progress=look
    )
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
    assert commands[-1].refused[PASSED_OVER] >= 10
    assert commands[-1].tick > woken[0]
    assert traffic_of(recording).stays["r2"][-1].missed == 0
