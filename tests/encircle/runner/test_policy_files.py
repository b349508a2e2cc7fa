"""Policies named by their file, without packaging: in memory, over Zenoh, in studies, on hosts.

``POLICY`` remembers how often it was asked, says so, and heads for where it is told.
"""

import hashlib
import json
import os
import sys
import time
from pathlib import Path

import pytest
from helpers_agents import BODIES, observation
from helpers_cluster import Cluster
from helpers_commands import ours
from helpers_interrupts import Group
from helpers_waiting import completed, until

import encircle
from encircle.agents.brain.robot_core import RobotCore
from encircle.protocol.codec import decode, encode
from encircle.protocol.keys import robot_key
from encircle.protocol.messages import CommandMode, Pose, Setup
from encircle.protocol.plugin_files import FOLDERS, FileProblem, function_in_file, source_digest
from encircle.protocol.plugins import policy_source
from encircle.replay.replaying import replay
from encircle.runner.testimony import RunFailed
from encircle.world.recording.recording import RecordingError, read_recording
from encircle.world.scenario.errors import ScenarioError

POLICY = '''
"""A policy of a reader's own."""
from beside import GAIN
from encircle import Decision


def teller(memory, view, *, gain: float = GAIN):
    asked = (memory or 0) + 1
    x, y = view.position
    goal = view.target.position if view.target else view.position
    heard = {packet.robot: packet.say["asked"] for packet in view.heard if packet.say}
    step = (gain * (goal[0] - x), gain * (goal[1] - y))
    return asked, Decision("tell", step, goal, say={"asked": asked, "heard": heard})


def plain(view):
    return None


def breaks(memory, view):
    raise KeyError("nothing")


async def later(memory, view):
    return None


class Holder:
    def __init__(self, memory, view):
        pass


def prints(memory, view):
    print("here I am")
    return teller(memory, view)


def never(memory, view):
    while view.tick == 0:
        pass
    return teller(memory, view)
'''
NAME = "own/robots.py:teller"
OVERRIDES = (f"team.strategy={NAME}", "ticks_max=25")


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch) -> Path:
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "robots.py").write_text(POLICY)
    (tmp_path / "own" / "beside.py").write_text("GAIN = 0.5\n")
    # What would stand for Python's own, were the folder looked through first.
    (tmp_path / "own" / "types.py").write_text("raise RuntimeError('not this one')\n")
    monkeypatch.chdir(tmp_path)
    # Of another test's folder.
    sys.modules.pop("beside", None)
    return tmp_path


def said(out: Path) -> list[dict]:
    recording = read_recording(out)
    return [
        decode(Pose, payload, recording.run).say
        for _, robot, payload in recording.of_channel("pose")
        if robot == "r1"
    ]


def test_in_memory_and_over_zenoh_it_is_one_run_that_is_replayed_and_resumed(folder):
    memory = encircle.run("sim1", link="memory", overrides=OVERRIDES, out=folder / "memory")
    over_zenoh = encircle.run("sim1", overrides=OVERRIDES, out=folder / "zenoh")
    assert over_zenoh.digest == memory.digest
    spoken = said(folder / "zenoh")
    assert [told["asked"] for told in spoken] == list(range(1, 26))
    # A packet is heard a tick after it was sent.
    assert spoken[3]["heard"] == {"r2": 3, "r3": 3, "r4": 3}
    assert replay(folder / "zenoh").same
    recorded = (folder / "zenoh" / "recording.mcap").read_bytes()
    (folder / "zenoh" / "recording.mcap").write_bytes(recorded[: len(recorded) * 2 // 3])
    assert encircle.resume(folder / "zenoh", link="memory").digest == memory.digest


def test_a_run_is_not_taken_up_with_another_file(folder):
    out = folder / "cut"
    encircle.run("sim1", link="memory", overrides=OVERRIDES, out=out)
    recorded = (out / "recording.mcap").read_bytes()
    (out / "recording.mcap").write_bytes(recorded[: len(recorded) * 2 // 3])
    (folder / "own" / "robots.py").write_text(POLICY + "\n# another\n")
    with pytest.raises(RecordingError, match=f"policy '{NAME}' was recorded with a source of SHA-"):
        encircle.resume(out, link="memory")


def test_what_a_policy_prints_is_not_what_the_command_prints():
    command = ours("encircle", "run", "sim1", "--link", "memory", "--json", "--out", "out")
    done = completed([*command, "--set", "team.strategy=own/robots.py:prints"])
    assert json.loads(done.stdout)["digest"]
    assert "here I am" in done.stderr


def test_a_hunt_in_memory_whose_policy_never_answers_ends_with_a_further_signal(folder):
    command = ours("encircle", "run", "sim1", "--link", "memory", "--out", "out")
    group = Group([*command, "--set", "team.strategy=own/robots.py:never"], folder)
    try:
        group.wait_for_first_line()
        until(lambda: (folder / "out" / "recording.mcap").exists(), "the hunt to begin")

        def ended() -> bool:
            group.signal()
            time.sleep(0.2)
            return group.status is not None

        until(ended, "its end")
        assert group.end() == 1
        assert "stopped by SIGINT, in the middle of" in group.said.splitlines()[-1]
    finally:
        group.kill()


def test_its_own_parameters_are_set_in_the_scenario_and_change_the_run():
    runs = [
        encircle.run("sim1", link="memory", overrides=[*OVERRIDES, *others]).digest
        for others in ((), ("team.policy_parameters.gain=0.5",), ("team.policy_parameters.gain=1",))
    ]
    # That the default is said changes the configuration, and with it the digest.
    assert len(set(runs)) == 3


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        (
            {"team.strategy": "own/robots.py:telle"},
            "robots.py has no 'telle'; it has teller, plain",
        ),
        ({"team.strategy": "own/robot.py:teller"}, "there is no file own/robot.py in "),
        ({"team.strategy": "own/robots.py:plain"}, "it takes (view), must take (memory, view)"),
        ({"team.strategy": "own/robots.py:Holder"}, "it is a class, must be a function"),
        ({"team.strategy": "own/robots.py:later"}, "it is async, or yields; must be a plain"),
        ({"team.strategy": "own/robots.py"}, "name its function too, as own/robots.py:my_policy"),
        ({"team.strategy": "own/empty.py:f"}, "SyntaxError"),
        ({"team.strategy": "colorsys:rgb_to_hsv"}, "unknown policy"),
        ({"team.strategy": "/own/robots.py:teller"}, "must lie below the working directory or"),
        ({"team.strategy": "own/../own/robots.py:teller"}, "must lie below the working directory"),
        ({"team.policy_parameters.gain": "high"}, "gain = 'high': must be a number"),
        ({"team.policy_parameters.gian": "1"}, "gian = 1: unknown key (did you mean 'gain'?)"),
    ],
)
def test_what_cannot_be_is_one_line_before_the_run(folder, changes, line):
    (folder / "own" / "empty.py").write_text("def f(:\n")
    overrides = [*OVERRIDES, *(f"{key}={value}" for key, value in changes.items())]
    with pytest.raises(ScenarioError) as caught:
        encircle.run("sim1", link="memory", overrides=overrides)
    assert line in str(caught.value)
    assert str(caught.value).count("\n") == 1


FAILED = r"policy 'own/robots.py:breaks' failed in robot r\d at tick 0: KeyError"


def test_one_that_fails_is_named_with_robot_and_tick():
    for link in ("memory", "zenoh"):
        with pytest.raises(RunFailed, match=FAILED):
            encircle.run("sim1", link=link, overrides=["team.strategy=own/robots.py:breaks"])


def test_a_changed_file_is_imported_anew(folder):
    before = encircle.run("sim1", link="memory", overrides=OVERRIDES).digest
    source = folder / "own" / "robots.py"
    source.write_text(POLICY.replace("asked = (memory or 0) + 1", "asked = (memory or 0) + 2"))
    assert encircle.run("sim1", link="memory", overrides=OVERRIDES).digest != before
    source.write_text(POLICY)
    assert encircle.run("sim1", link="memory", overrides=OVERRIDES).digest == before


def core_after(setup: Setup) -> RobotCore:
    core = RobotCore("r1", "run")
    core.receive(robot_key("run", "r1", "setup"), encode(setup, "run"))
    return core


def test_a_robot_whose_file_is_not_the_worlds_refuses_with_one_line(folder):
    setup = Setup("r1", ("r1",), 0.1, NAME, BODIES, policy_source=policy_source(NAME))
    same = core_after(setup)
    assert same.failed is None
    (folder / "own" / "robots.py").write_text(POLICY + "\n# another copy\n")
    other = core_after(setup)
    assert str(other.failed).count("\n") == 0
    assert f"policy {NAME!r} failed in robot r1 at tick 0" in str(other.failed)
    assert "put the world's file on this host" in str(other.failed)
    assert other.answer(observation()).command.mode == CommandMode.FAILED
    assert same.answer(observation()).command.mode == "tell"


def test_a_file_that_is_not_the_worlds_is_not_even_imported(folder):
    setup = Setup("r1", ("r1",), 0.1, NAME, BODIES, policy_source=policy_source(NAME))
    (folder / "own" / "robots.py").write_text("open('imported', 'w').close()\n")
    assert "put the world's file on this host" in str(core_after(setup).failed)
    assert not (folder / "imported").exists()


@pytest.mark.parametrize("text", ["from beside import teller", "teller = partial(pursue)"])
def test_a_file_may_have_its_function_from_elsewhere_and_its_source_is_its_own(folder, text):
    (folder / "own" / "beside.py").write_text(
        "from encircle.agents.policies.paper import pursue\n"
        "def teller(memory, view): return pursue(memory, view)\n"
    )
    (folder / "own" / "robots.py").write_text(
        "from functools import partial\nfrom encircle.agents.policies.paper import pursue\n" + text
    )
    source = hashlib.sha256((folder / "own" / "robots.py").read_bytes()).hexdigest()
    assert policy_source(NAME) == source
    assert encircle.run("sim1", link="memory", overrides=OVERRIDES).result.ticks == 25


def test_what_lies_beside_one_file_never_stands_for_what_lies_beside_another(folder):
    encircle.run("sim1", link="memory", overrides=OVERRIDES)
    (folder / "other").mkdir()
    (folder / "other" / "robots.py").write_text(POLICY)
    (folder / "other" / "beside.py").write_text("GAIN = 0.7\n")
    with pytest.raises(ScenarioError, match=r"beside.py cannot be imported: this process has"):
        encircle.run("sim1", link="memory", overrides=["team.strategy=other/robots.py:teller"])


def test_a_source_is_that_of_the_file_and_a_shipped_policy_has_none(folder):
    assert policy_source("xi-star") == ""
    digest = policy_source(NAME)
    assert len(digest) == 64
    assert source_digest(function_in_file(NAME)) == digest
    (folder / "own" / "robots.py").write_text(POLICY + "\n")
    assert policy_source(NAME) != digest


def test_folders_of_the_environment_come_first(folder, monkeypatch):
    other = folder / "elsewhere" / "own"
    other.mkdir(parents=True)
    (other / "robots.py").write_text("def teller(memory, view): return 3\n")
    monkeypatch.setenv(FOLDERS, str(folder / "nothing") + os.pathsep + str(folder / "elsewhere"))
    assert function_in_file(NAME)(None, None) == 3
    monkeypatch.delenv(FOLDERS)
    assert function_in_file(NAME).__module__ != "robots"
    with pytest.raises(FileProblem, match="no file"):
        function_in_file("robots.py:teller")


POLICIES = {"name": "policy", "key": "team.strategy", "values": ["xi-star", NAME]}
GAINS = {"name": "gain", "key": "team.robots.r2.policy_parameters.gain", "values": [0.1, 0.9]}
OF_FILE = {"ticks_max": 20, "team.strategy": NAME}
PLAN = {
    "name": "files",
    "scenario": "sim1",
    "seeds": 2,
    "measures": ["captured", "path_m_total"],
    "axes": [POLICIES],
    "set": {"ticks_max": 20},
}


def test_a_study_runs_it_on_all_cores_and_its_table_knows_the_file(folder):
    study = encircle.study(PLAN, folder / "out")
    assert study.run(workers=2) == 4
    assert set(study.table().policy) == {"xi-star", NAME}
    assert encircle.study(PLAN, folder / "out").run(workers=2) == 0
    (folder / "own" / "robots.py").write_text(POLICY + "\n# changed\n")
    with pytest.raises(encircle.StudyError, match="code"):
        encircle.study(PLAN, folder / "out").run(workers=2)


def test_its_own_parameters_of_one_robot_are_an_axis(folder):
    study = encircle.study({**PLAN, "axes": [GAINS], "set": OF_FILE}, folder / "out")
    assert study.run(workers=1) == 4
    assert set(study.table().gain) == {0.1, 0.9}


def test_a_cluster_runs_it_unless_a_worker_has_another_file(folder):
    (folder / "other" / "own").mkdir(parents=True)
    (folder / "other" / "own" / "beside.py").write_text("GAIN = 0.5\n")
    (folder / "other" / "own" / "robots.py").write_text(POLICY + "\n# another copy\n")
    here = encircle.study(PLAN, folder / "here")
    here.run(workers=1)
    for place, same in ((folder, True), (folder / "other", False)):
        cluster = Cluster(folder / "scratch")
        try:
            cluster.add_worker(place)
            study = encircle.study(PLAN, folder / f"out-{same}")
            if same:
                study.run(cluster=cluster.address)
                assert study.table().path_m_total.equals(here.table().path_m_total)
            else:
                with pytest.raises(encircle.StudyFailed, match="a worker runs code"):
                    study.run(cluster=cluster.address)
        finally:
            cluster.end()
