"""Hunts as real processes to which something happens: they go on, or say why not."""

import json
import os
import resource
import signal
import sys
from pathlib import Path

import pytest
from helpers_hosts import NodeProcess
from helpers_hunt import ENDLESS, LONG, ROBOTS
from helpers_waiting import LONGEST_S, completed
from helpers_world import departures_of

import encircle
from encircle.protocol import VERSION
from encircle.replay.replaying import replay
from encircle.world.recording.recording import read_recording
from encircle.world.recording.resuming import rebuild

ENOUGH_BYTES = 150_000
"""Of a recording: the hunt is under way, and two chunks at least are on the disk."""
ROOM_BYTES = 400_000


def teams_at(recording, tick: int) -> dict[str, tuple[str, ...]]:
    from encircle.protocol.codec import decode
    from encircle.protocol.messages import Command

    return {
        robot: decode(Command, payload, recording.run).team
        for at, robot, payload in recording.of_channel("command")
        if at == tick
    }


def test_robots_killed_started_anew_frozen_and_thawed_are_lost_and_counted_in_again(hunt):
    silent = hunt.lose_the_silent()
    hunt.start_all()
    hunt.wait_for_ticks()
    hunt.signal("r2", signal.SIGKILL)
    hunt.wait_for(lambda seen: seen == [("r2", "lost: it is gone")])
    hunt.wait_for_ticks()
    hunt.start_robot("r2")
    hunt.wait_for(lambda seen: seen[1:] == [("r2", "back")])
    hunt.wait_for_ticks()
    hunt.signal("r3", signal.SIGSTOP)
    # On a machine so busy that an answer may take long, Zenoh may give its connection up before.
    hunt.wait_for(lambda seen: seen[2:] in ([("r3", silent)], [("r3", "lost: it is gone")]))
    hunt.wait_for_ticks()
    hunt.signal("r3", signal.SIGCONT)
    hunt.wait_for(lambda seen: seen[3:] == [("r3", "back")])
    hunt.wait_for_ticks()
    assert hunt.world.terminate() == 1
    assert "stopped by SIGTERM" in hunt.world.said
    assert [node.end() for node in hunt.robots.values()] == [1] * 4

    departures = hunt.world.result()["departures"]
    for tick, robot, what in departures:
        assert f"world: tick {tick}: robot {robot} is {what}" in hunt.world.said
    assert json.loads((hunt.out / "summary.json").read_text())["departures"] == departures
    ticks = [tick for tick, _, _ in departures]
    recording = read_recording(hunt.out)
    assert replay(hunt.out).same
    everybody = dict.fromkeys(ROBOTS, ROBOTS)
    without = dict.fromkeys(("r1", "r3", "r4"), ("r1", "r3", "r4"))
    assert teams_at(recording, ticks[0] - 1) == everybody
    assert teams_at(recording, ticks[0] + 1) == without
    assert teams_at(recording, ticks[1] + 5) == everybody
    assert set(teams_at(recording, ticks[2] + 1)) == {"r1", "r2", "r4"}
    assert teams_at(recording, ticks[3] + 5) == everybody
    # Whoever takes the run up comes to the same, losses and returns included.
    rebuilt = departures_of(rebuild(recording).core)
    assert [(t, robot, what[:4]) for t, robot, what in rebuilt] == [
        (t, robot, what[:4]) for t, robot, what in departures
    ]


def test_a_run_without_any_robot_left_fails_with_one_line(hunt):
    hunt.start_all()
    hunt.wait_for_ticks()
    for robot in ROBOTS:
        hunt.signal(robot, signal.SIGKILL)
    assert hunt.world.end() == 1
    assert hunt.world.said.splitlines()[-1].endswith(", and no robot is left")
    assert replay(hunt.out).same


def test_robots_wait_for_a_world_that_is_resumed_and_finish_its_run(finite_hunt):
    hunt = finite_hunt
    hunt.start_all("--world-timeout", f"{LONGEST_S}")
    hunt.world.wait_until(lambda _world: recorded_bytes(hunt.out) > ENOUGH_BYTES)
    hunt.world.kill()
    for node in hunt.robots.values():
        node.wait_until(lambda robot: f"waiting up to {LONGEST_S:g} s for it" in robot.said)
    again = hunt.start("world", "--resume", str(hunt.out), "--listen", hunt.endpoint)
    assert again.end() == 0, again.said
    assert [node.end() for node in hunt.robots.values()] == [0] * 4
    unbroken = encircle.run(hunt.scenario, link="memory")
    assert again.result()["digest"] == unbroken.digest
    assert again.result()["departures"] == []
    assert replay(hunt.out).same
    assert read_recording(hunt.out).complete


def recorded_bytes(out: Path) -> int:
    recording = out / "recording.mcap"
    return recording.stat().st_size if recording.exists() else 0


def test_robots_whose_world_does_not_come_back_end_with_one_line(hunt):
    hunt.start_all("--world-timeout", "0.5")
    hunt.wait_for_ticks()
    hunt.world.kill()
    for name, node in hunt.robots.items():
        assert node.end() == 1
        # Between them a line a second says where it is, and on a busy machine it says more.
        *before, standing, ended = node.said.splitlines()
        assert f"robot {name}: waiting for the world of run faulty at {hunt.endpoint}" in before
        assert f"robot {name}: joined run faulty, one of {len(ROBOTS)} robots" in before
        assert standing.startswith(f"robot {name}: the world of run faulty at {hunt.endpoint} is")
        assert "standing still" in standing
        assert ended.endswith("is gone, and was not back within 0.5 s")


def test_a_router_that_is_killed_and_started_anew_changes_nothing(finite_hunt):
    hunt = finite_hunt
    router = hunt.start_router()
    hunt.start_world("--connect")
    for robot in ROBOTS:
        hunt.start_robot(robot)
    hunt.wait_for_ticks()
    router.kill()
    hunt.start_router()
    assert [node.end() for node in (hunt.world, *hunt.robots.values())] == [0] * 5
    assert hunt.world.result()["departures"] == []
    assert hunt.world.result()["digest"] == encircle.run(hunt.scenario, link="memory").digest


def test_a_second_robot_of_one_id_and_a_second_world_do_not_start(hunt):
    hunt.start_all()
    hunt.wait_for_ticks()
    second = hunt.start("agents", "r2", "--connect", hunt.endpoint)
    other = hunt.start("world", "sim1", "--connect", hunt.endpoint)
    assert (second.end(), other.end()) == (1, 1)
    assert second.said.splitlines()[-1] == "robot r2: there is a robot r2 in run faulty already"
    assert other.said.splitlines() == ["world: there is a world of run faulty already"]
    hunt.wait_for_ticks()
    hunt.world.terminate()
    assert hunt.world.result()["refused"] == {}
    assert hunt.world.result()["departures"] == []
    assert replay(hunt.out).same


OTHER_VERSION = """
import sys, encircle.protocol
encircle.protocol.VERSION = 99
from encircle.agents.__main__ import main
sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.parametrize("world_goes", [False, True])
def test_a_robot_that_speaks_another_version_says_which_and_the_run_goes_on_without_it(
    hunt, world_goes
):
    silent = hunt.lose_the_silent()
    hunt.start_world()
    for robot in ROBOTS[1:]:
        node = hunt.start_robot(robot)
        node.wait_until(lambda robot: "waiting for the world" in robot.said)
    # It is there from before the first tick until it is lost and was asked for its version.
    join_s = 10.0 * float(hunt.limits[-1])
    options = ("--connect", hunt.endpoint, "--join-timeout", f"{join_s}")
    odd = hunt.start_as("r1", "-c", OTHER_VERSION, "r1", *options)
    hunt.wait_for(lambda seen: seen == [("r1", silent)])
    mismatch = f"robot r1 speaks version 99 of the wire, this is {VERSION}"
    hunt.world.wait_until(lambda world: mismatch in world.said)
    if world_goes:
        hunt.world.kill()
    assert odd.end() == 1
    last = odd.said.splitlines()[-1]
    assert last.startswith(f"robot r1: the world of run faulty at {hunt.endpoint} speaks another")
    assert f"has version {VERSION}, this program speaks 99" in last
    if not world_goes:
        hunt.wait_for_ticks()


DEAF = """
import sys
from encircle.protocol.zenoh.connection import ZenohConnection
heard, receive = [], ZenohConnection.receive
def receive_some(link):
    while True:
        key, payload = receive(link)
        heard.append(key.rsplit("/")[-1])
        if heard[-1] != "observation" or heard.count("setup") > 1 or len(heard) < 20:
            return key, payload
ZenohConnection.receive = receive_some
from encircle.agents.__main__ import main
sys.exit(main(sys.argv[1:]))
"""
"""A robot to which, from some tick on, no observation gets through, until it is set up anew."""


@pytest.mark.parametrize("clock", ["lockstep", pytest.param("wall", marks=pytest.mark.realtime)])
def test_a_robot_that_missed_what_it_was_asked_is_asked_anew_and_back(hunt, clock):
    hunt.scenario.write_text(json.dumps(ENDLESS | {"clock": clock, "tick_s": 0.02}))
    lost = ("r2", hunt.lose_the_silent())
    hunt.start_world()
    for robot in ("r1", "r3", "r4"):
        hunt.start_robot(robot)
    hunt.robots["r2"] = hunt.start_as("r2", "-c", DEAF, "r2", "--connect", hunt.endpoint)
    hunt.wait_for(lambda seen: seen == [lost, ("r2", "back")])
    hunt.wait_for_ticks()
    assert hunt.world.terminate() == 1
    assert [node.end() for node in hunt.robots.values()] == [1] * 4
    assert len(hunt.departures) == 2
    assert replay(hunt.out).same


class Command:
    """``encircle run`` of a long hunt, with the ids of the processes that it starts."""

    def __init__(self, folder: Path, *arguments: str) -> None:
        self.node = NodeProcess(
            [sys.executable, "-m", "encircle", "run", *arguments], folder / "cli", {}
        )
        self.node.wait_until(lambda cli: "processes: " in cli.said)
        line = next(x for x in self.node.said.splitlines() if x.startswith("processes: "))
        named = line.removeprefix("processes: ").split(", ")
        self.pids = {name: int(pid) for name, pid in (pair.split() for pair in named)}


def test_a_run_whose_world_was_killed_is_resumed_from_the_command_line(tmp_path):
    scenario, out = tmp_path / "long.json", tmp_path / "run"
    scenario.write_text(json.dumps(LONG))
    unbroken = encircle.run(scenario, link="memory")
    first = Command(tmp_path, str(scenario), "--out", str(out))
    first.node.wait_until(lambda _cli: recorded_bytes(out) > ENOUGH_BYTES)
    os.kill(first.pids["world"], signal.SIGKILL)
    assert first.node.end() == 1
    last = first.node.said.splitlines()[-1]
    assert last.startswith("encircle: the run failed: the world was killed by SIGKILL at tick ")
    assert last.endswith(f"; to go on: encircle run --resume {out}")

    broken = recorded_bytes(out)
    second = Command(tmp_path, "--resume", str(out), "--json")
    assert second.node.end() == 0, second.node.said
    assert second.node.printed()["digest"] == unbroken.digest
    assert replay(out).same
    assert read_recording(out).complete

    # As if it had been killed once more while it was resumed: it can be resumed once more.
    assert recorded_bytes(out) > broken + ENOUGH_BYTES
    os.truncate(out / "recording.mcap", broken + ENOUGH_BYTES)
    assert encircle.resume(out, link="memory").digest == unbroken.digest
    assert (out / "recording-broken-2.mcap").exists()


def test_a_robot_killed_in_a_run_from_the_command_line_is_told_of_and_shown(tmp_path):
    scenario, out = tmp_path / "long.json", tmp_path / "run"
    scenario.write_text(json.dumps(LONG))
    command = Command(tmp_path, str(scenario), "--out", str(out), "--json")
    command.node.wait_until(lambda _cli: recorded_bytes(out) > ENOUGH_BYTES)
    os.kill(command.pids["r2"], signal.SIGKILL)
    assert command.node.end() == 0
    [[tick, robot, what]] = command.node.printed()["departures"]
    assert (robot, what) == ("r2", "lost: it is gone")
    assert f"tick {tick}: robot r2 is lost: it is gone" in command.node.said.splitlines()
    assert "robot r2 was killed by SIGKILL" in command.node.said.splitlines()


def test_a_run_that_shall_end_when_a_robot_is_lost_does(tmp_path):
    scenario, out = tmp_path / "long.json", tmp_path / "run"
    scenario.write_text(json.dumps(ENDLESS))
    command = Command(tmp_path, str(scenario), "--out", str(out), "--when-lost", "end")
    command.node.wait_until(lambda _cli: recorded_bytes(out) > ENOUGH_BYTES)
    os.kill(command.pids["r3"], signal.SIGKILL)
    assert command.node.end() == 1
    assert "robot r3 is gone at tick" in command.node.said.splitlines()[-1]


@pytest.mark.parametrize("link", ["zenoh", "memory"])
def test_a_full_disk_ends_the_run_with_one_line_and_leaves_a_recording_to_go_on_with(
    tmp_path, link
):
    scenario, out = tmp_path / "long.json", tmp_path / "run"
    scenario.write_text(json.dumps(LONG))
    done = completed(
        [
            *(sys.executable, "-m", "encircle", "run", str(scenario), "--link", link),
            *("--out", str(out)),
        ],
        # As if the disk had so much room for a file, and no more.
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (ROOM_BYTES, ROOM_BYTES)),
    )
    assert done.returncode == 1
    failed = [line for line in done.stderr.splitlines() if line.startswith("encircle:")]
    reason = f"cannot record to {out / 'recording.mcap'}: File too large"
    assert [line.split("; ")[0] for line in failed] == [f"encircle: the run failed: {reason}"]
    assert "Traceback" not in done.stderr
    assert "ended with status" not in done.stderr
    check = replay(out)
    assert check.same
    assert not check.complete
    assert (
        encircle.resume(out, link="memory").digest == encircle.run(scenario, link="memory").digest
    )
