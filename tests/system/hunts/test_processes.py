"""Hunts as real processes over Zenoh: the run as in memory, and an orderly end when asked for."""

import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from helpers_commands import ours, run_forked, started_unheard
from helpers_waiting import LONGEST_S, ample_s, communicated, joined, until

import encircle
from encircle.protocol.codec import BYTES_MAX, encode
from encircle.protocol.keys import robot_key
from encircle.protocol.messages import Command, End, Pose
from encircle.protocol.zenoh.connection import ZenohConnection
from encircle.protocol.zenoh.endpoints import Endpoints
from encircle.replay.replaying import replay
from encircle.runner import launch
from encircle.runner.launch import free_endpoint
from encircle.runner.testimony import RunFailed
from encircle.world.recording.recording import read_recording

PAPER = ("sim1", "sim2", "sim3", "sim4", "sim5")
BAD_RADIO = (
    'channel.loss={model="gilbert-elliott",good_to_bad=0.1,bad_to_good=0.3}',
    'channel.delay={model="gamma",mean_s=0.3,std_s=0.2}',
    "sensing.noise_m_std=0.05",
)


def endless() -> dict[str, Any]:
    """A hunt that goes on until somebody ends it."""
    return {
        "ticks_max": 1_000_000,
        "team": {"robots": 3, "sensing_range_m": 500.0},
        "target": {
            "behaviour": "patrol",
            "parameters": {"waypoints": [[60, 0], [60, 60], [0, 60], [0, 0]]},
            "step_m_max": 0.5,
        },
    }


@pytest.mark.parametrize("name", PAPER)
def test_digest_is_the_same_in_memory_and_over_zenoh(name):
    memory = encircle.run(name, link="memory")
    assert encircle.run(name).result == memory.result


def test_digest_is_the_same_over_a_lossy_and_slow_radio(tmp_path):
    memory = encircle.run("sim1", link="memory", overrides=BAD_RADIO, seed=7)
    zenoh = encircle.run("sim1", overrides=BAD_RADIO, seed=7, out=tmp_path / "run")
    assert zenoh.result == memory.result
    assert memory.result.packets_lost["burst-loss"] > 0
    assert replay(tmp_path / "run").same


def test_recording_is_the_same_in_memory_and_over_zenoh(tmp_path):
    recordings = []
    for link in ("memory", "zenoh"):
        hunt = encircle.run("sim2", link=link, out=tmp_path / link)
        name = hunt.run.encode()
        recordings.append(
            [(t, k, p.replace(name, b"")) for t, k, p in read_recording(tmp_path / link).messages]
        )
    assert recordings[0] == recordings[1]


@pytest.mark.parametrize(
    "order", [("r3", "world", "r1", "r4", "r2"), ("r4", "r3", "r2", "r1", "world")]
)
def test_digest_does_not_depend_on_the_order_in_which_processes_start(order):
    memory = encircle.run("sim1", link="memory")
    assert encircle.run("sim1", start_order=order).digest == memory.digest


def test_digest_does_not_depend_on_load():
    memory = encircle.run("sim1", link="memory", overrides=BAD_RADIO)
    spin = [sys.executable, "-c", "while True: pass"]
    hogs = [subprocess.Popen(spin) for _ in range(2 * (os.cpu_count() or 1))]
    try:
        assert encircle.run("sim1", overrides=BAD_RADIO).digest == memory.digest
    finally:
        for hog in hogs:
            hog.kill()
            hog.wait()


def command_line(*arguments: str, scenario: dict[str, Any], folder: Path) -> subprocess.Popen[str]:
    path = folder / "endless.json"
    path.write_text(json.dumps(scenario))
    return subprocess.Popen(
        [sys.executable, "-m", "encircle", "run", str(path), *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=folder,
    )


class Running:
    """An endless hunt from the command line, with the process ids of its parts."""

    def __init__(self, folder: Path) -> None:
        self.out = folder / "run"
        self.answer_s = ample_s()
        options = ("--out", str(self.out), "--when-lost", "end")
        options += ("--answer-timeout", f"{self.answer_s}")
        self.cli = command_line(*options, scenario=endless(), folder=folder)
        self.pids: dict[str, int] = {}
        assert self.cli.stderr is not None
        for line in self.cli.stderr:
            if line.startswith("processes: "):
                parts = line.removeprefix("processes: ").split(", ")
                self.pids = {name: int(pid) for name, pid in (p.split() for p in parts)}
                break
        self.wait_for_chunks()

    def wait_for_chunks(self) -> None:
        """Until the recording has a few chunks: the hunt is under way."""
        recording = self.out / "recording.mcap"

        def size() -> int:
            return recording.stat().st_size if recording.exists() else 0

        until(lambda: size() >= 300_000, "the hunt to get under way", size)

    def end(self) -> tuple[int, str]:
        """Wait for the command's end; its status and what it said."""
        _, said = communicated(self.cli)
        return self.cli.returncode, said

    def wait_for_the_end_of_all(self) -> None:
        until(lambda: not any(map(is_alive, self.pids.values())), f"the end of {self.pids}")


def is_alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


@pytest.fixture
def running(tmp_path) -> Iterator[Running]:
    hunt = Running(tmp_path)
    yield hunt
    hunt.cli.kill()
    hunt.cli.wait()
    for pid in hunt.pids.values():
        if is_alive(pid):
            os.kill(pid, signal.SIGKILL)


def one_line(said: str) -> str:
    lines = [line for line in said.splitlines() if line.startswith("encircle:")]
    assert len(lines) == 1, said
    return lines[0]


@pytest.mark.parametrize(
    ("victim", "number", "said"),
    [
        ("r2", signal.SIGKILL, "robot r2 is gone"),
        ("r3", signal.SIGTERM, "robot r3 is gone"),
        ("world", signal.SIGKILL, "the world was killed by SIGKILL"),
        ("world", signal.SIGTERM, "stopped by SIGTERM"),
    ],
)
def test_a_process_that_dies_ends_the_run_with_a_line_that_names_it(running, victim, number, said):
    os.kill(running.pids[victim], number)
    status, text = running.end()
    assert status == 1
    assert said in one_line(text)
    running.wait_for_the_end_of_all()
    check = replay(running.out)
    assert check.same
    assert check.ticks > 10


def test_a_robot_that_dies_before_the_run_has_begun_is_named(monkeypatch):
    start = launch._Launch._start

    async def start_and_kill(self, name, *arguments):
        """The world starts after r1, so that no run can have begun with it."""
        await start(self, name, *arguments)
        if name == "r1":
            os.kill(self.processes["r1"].pid, signal.SIGKILL)

    monkeypatch.setattr(launch._Launch, "_start", start_and_kill)
    with pytest.raises(RunFailed, match="robot r1 was killed by SIGKILL"):
        encircle.run("sim1", start_order=("r1", "world", "r2", "r3", "r4"))


@pytest.mark.parametrize("said", ["listening", "tick", "result"])
def test_an_error_in_whoever_is_told_how_far_it_is_ends_the_run_and_is_raised(said):
    pids: dict[str, int] = {}

    def follow(report):
        pids.update(report.get("started", {}))
        if said in report:
            raise ZeroDivisionError(f"in my own progress: {said}")

    with pytest.raises(ZeroDivisionError, match=f"in my own progress: {said}"):
        encircle.run("sim1" if said == "result" else endless(), progress=follow)
    assert len(pids) > 3
    until(lambda: not any(map(is_alive, pids.values())), "the end of every process")


def test_ctrl_c_ends_the_run_in_order(running):
    running.cli.send_signal(signal.SIGINT)
    status, text = running.end()
    assert status == 1
    assert "stopped by SIGINT" in one_line(text)
    running.wait_for_the_end_of_all()
    assert read_recording(running.out).complete


def test_nothing_is_left_when_the_launcher_itself_is_killed(running):
    running.cli.kill()
    running.end()
    running.wait_for_the_end_of_all()


@pytest.mark.parametrize("victim", ["r1", "world"])
def test_a_process_that_freezes_ends_the_run(running, victim):
    os.kill(running.pids[victim], signal.SIGSTOP)
    status, text = running.end()
    assert status == 1
    # On a machine so busy that an answer may take long, Zenoh may give the connection up before.
    silent = (f"no answer from r1 for {running.answer_s:g} s", "robot r1 is gone")
    assert any(said in text for said in silent) == (victim == "r1")
    assert ("the world has said nothing" in text) == (victim == "world")
    running.wait_for_the_end_of_all()


def test_what_strangers_send_is_refused_counted_and_changes_nothing():
    expected = encircle.run("sim1", link="memory", overrides=["target.step_m_max=0.29"]).digest
    endpoint = free_endpoint()
    world = subprocess.Popen(
        ours(
            *("world", "sim1", "--listen", endpoint, "--run", "noisy"),
            *("--set", "target.step_m_max=0.29", "--json"),
        ),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    robots = []
    try:
        access = Endpoints(connect=(endpoint,), connect_s_max=LONGEST_S)
        stranger = ZenohConnection(access, robot_key("noisy", "nobody", "*"))
        stop = threading.Event()
        flood = threading.Thread(target=send_garbage, args=(stranger, stop))
        flood.start()
        robots = [
            started_unheard(ours("agents", f"r{k}", "--connect", endpoint, "--run", "noisy"))
            for k in range(1, 5)
        ]
        out, _ = communicated(world)
        stop.set()
        joined(flood)
        stranger.close()
    finally:
        for process in (world, *robots):
            process.kill()
            process.wait()
    result = next(
        report["result"] for report in map(json.loads, out.splitlines()) if "result" in report
    )
    assert result["digest"] == expected
    assert set(result["refused"]) == {
        "malformed",
        "oversized",
        "out-of-turn",
        "wrong-run",
        "wrong-sender",
        "unknown-key",
    }


def send_garbage(link: ZenohConnection, stop: threading.Event) -> None:
    """Every kind of bad message on every kind of key, a few hundred times a second at most."""
    pose = Pose("r9", 0, 0, (0.0, 0.0), (0.0, 0.0), None, "encircle", 0.0, 0)
    command = Command("r1", 999_999, (9.0, 9.0), "encircle", None, None, None, None, None, ())
    messages = [
        (robot_key("noisy", "r1", "pose"), b"\xc1 not msgpack"),
        (robot_key("noisy", "r1", "pose"), encode(pose, "noisy")),
        (robot_key("noisy", "r1", "pose"), bytes(BYTES_MAX[Pose] + 1)),
        (robot_key("noisy", "r2", "command"), encode(command, "another")),
        (robot_key("noisy", "r1", "command"), encode(command, "noisy")),
        (robot_key("noisy", "r1", "observation"), b""),
        (robot_key("noisy", "r2", "end"), b"nonsense"),
        (robot_key("noisy", "r3", "end"), encode(End("r3", 0, "captured"), "another")),
        (robot_key("noisy", "r4", "surprise"), b"?"),
    ]
    for _ in range(2000):
        for key, payload in messages:
            link.send(key, payload)
        if stop.wait(0.02):
            return


def test_a_robot_without_a_world_gives_up_with_one_line():
    place = ("--connect", free_endpoint(), "--run", "alone")
    done = run_forked(ours("agents", "r1", *place, "--join-timeout", "1"))
    assert done.returncode == 1
    # On a busy machine it says before that it is connecting.
    assert "cannot connect to tcp/127.0.0.1" in done.stderr.splitlines()[-1]


def test_a_world_whose_robots_stay_away_names_them():
    place = ("--listen", free_endpoint(), "--run", "empty")
    done = run_forked(ours("world", "sim1", *place, "--join-timeout", "1"))
    assert done.returncode == 1
    begun, ended = done.stderr.splitlines()
    assert "recording nothing" in begun
    assert begun.endswith("waiting for r1, r2, r3, r4")
    assert ended == "world: r1, r2, r3, r4 did not join within 1 s"


def test_a_port_in_use_is_one_clear_line(tmp_path):
    endpoint = free_endpoint()
    with_port = ZenohConnection(Endpoints(listen=(endpoint,)), "x/*")
    try:
        done = run_forked(ours("world", "sim1", "--listen", endpoint, "--run", "late"))
    finally:
        with_port.close()
    assert done.returncode == 1
    assert len(done.stderr.splitlines()) == 1
    assert endpoint in done.stderr
