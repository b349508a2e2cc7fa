"""Plug-ins that fail: one line that says whose, where, when and why, however they are run."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import helpers_plugins as plugins
import numpy as np
import pytest
from helpers_agents import BODIES, observation
from helpers_waiting import communicated

import encircle
from encircle.agents.brain.robot_core import RobotCore
from encircle.agents.policies.decision_check import validated
from encircle.agents.policies.interface import Decision
from encircle.agents.policies.registry import _installed
from encircle.protocol.codec import decode, encode
from encircle.protocol.keys import robot_key
from encircle.protocol.messages import Command, CommandMode, Setup
from encircle.protocol.plugins import InvalidPluginResult, PluginFailed
from encircle.replay.replaying import replay
from encircle.runner.launch import free_endpoint
from encircle.runner.testimony import RunFailed
from encircle.world.arena.engine import build
from encircle.world.coordinator.world_core import WorldCore
from encircle.world.loading.load import load
from encircle.world.recording.recording import read_recording
from encircle.world.scenario.errors import ScenarioError
from encircle.world.targets.behaviours import behaviour_named

SOURCE = """
from math import nan
from encircle import Decision


def chase(view, step=(0.1, 0.0), **other):
    goal = view.target.position if view.target else view.position
    return None, Decision("chase", step, goal, **other)


def raises(memory, view):
    if view.positions[view.own][0] > 3.0:
        raise ZeroDivisionError("division by\\nnothing")
    return chase(view)


def leaves(memory, view):
    raise SystemExit("enough")


class Own(BaseException):
    pass


def raises_own(memory, view):
    raise Own("mine")


def nan_step(memory, view):
    return chase(view, (nan, 0.0))


def long_step(memory, view):
    return chase(view, (0.1, 0.0, 0.0))


def no_choice(memory, view):
    return (0.1, 0.0)


def wild_point(memory, view):
    return chase(view, point=-1)


def too_large(memory, view):
    return chase(view, say={"x": b"x" * 2000})


def not_packable(memory, view):
    return chase(view, say={"x": [1, {2}]})


def nan_said(memory, view):
    return chase(view, say={"x": {"y": nan}})


def bytes_keys(memory, view):
    return chase(view, say={"x": {b"y": 1}})


def too_deep(memory, view):
    return chase(view, say={"x": [[[[[[1]]]]]]})


def no_map(memory, view):
    return chase(view, say=[1])


def half_text(memory, view):
    return chase(view, say={"x": "\\ud800"})


def no_pair(memory, view):
    return chase(view)[1]


def tires(memory, view):
    if view.tick == 5:
        raise RuntimeError("tired")
    return memory, (0.01, 0.0)


def nan_target(memory, view):
    return memory, (nan, 0.0)


def no_step(memory, view):
    return memory


number = 3
"""
SAYING = ("too_large", "not_packable", "nan_said", "bytes_keys", "too_deep", "no_map", "half_text")
STRATEGIES = ("raises", "leaves", "nan_step", "long_step", "no_choice", "wild_point", "no_pair")
STRATEGIES += ("raises_own", *SAYING)
TARGETS = ("tires", "nan_target", "no_step")
ENTRIES = (
    *(f"strategies {name} = failing:{name}" for name in STRATEGIES),
    *(f"targets {name} = failing:{name}" for name in TARGETS),
    "strategies no_module = nowhere_at_all:f",
    "strategies no_attribute = failing:nothing",
    "strategies no_function = failing:number",
    "strategies no_import = not_importable:f",
    "targets no_attribute = failing:nothing",
)
SAID = {  # with a tilde for what is left out
    "raises": "ZeroDivisionError: division by nothing",
    "leaves": "SystemExit: enough",
    "raises_own": "Own: mine",
    "nan_step": "answered step = (nan, 0.0): must be two numbers",
    "long_step": "answered step = (0.1, 0.0, 0.0): must be two numbers",
    "no_choice": "answered (0.1, 0.0): must be what it remembers, and a Decision",
    "wild_point": "answered point = -1: must be the number of a point",
    "no_pair": "answered Decision( ~ : must be what it remembers, and a Decision",
    "too_large": "answered say = {'x': b'x ~ : must be at most 1024 bytes as msgpack, this takes 2",
    "not_packable": "answered say = {'x': [1, {2}]}: must be made of ~ ; x.1 is of type set",
    "nan_said": "answered say = {'x': {'y': nan}}: must be made of ~ ; x.y is nan",
    "bytes_keys": "answered say = {'x': {b'y': 1}}: must be made of ~ ; x has other keys",
    "too_deep": "answered say = {'x': [[ ~ ]]}: must be nested 6 deep at most",
    "no_map": "answered say = [1]: must be a map with texts as keys",
    "half_text": "answered say = {'x': '\\ud800'}: must be made of ~ ; half of a surrogate pair",
    "tires": "RuntimeError: tired",
    "nan_target": "answered step = (nan, 0.0): must be two numbers",
    "no_step": "answered None: must be what it remembers, and a step",
}
SEEN = {
    "ticks_max": 30,
    "team": {"positions": [[3.5, 0.0], [-3.0, 0.5], [0.0, 3.0]], "strategy": "pursuit"},
    "target": {"behaviour": "still"},
}


@pytest.fixture(autouse=True)
def installed(tmp_path_factory, monkeypatch):
    folder = tmp_path_factory.mktemp("plugins")
    files = {"failing.py": SOURCE, "not_importable.py": "raise OSError('no licence')\n"}
    plugins.put_there(folder, files, ENTRIES)
    plugins.make_importable(folder, monkeypatch)
    yield folder
    plugins.forget(folder)
    behaviour_named.cache_clear()
    _installed.cache_clear()


def scenario(name, **changes):
    tree = json.loads(json.dumps({**SEEN, **changes}))
    tree["target" if name in TARGETS else "team"].update(
        {"behaviour" if name in TARGETS else "strategy": name}
    )
    return tree


def check_line(line, name, by_clock=False, robots="r1"):
    """The line names plug-in, source, robot, tick, error, and the file of the traceback.

    ``robots``: a pattern of those that may be named first.
    """
    kind = "target behaviour" if name in TARGETS else "policy"
    # By the clock it may be any robot, and a tick later.
    place = "" if name in TARGETS else f" in robot {'r[123]' if by_clock else robots}"
    tick = r"\d+" if by_clock else 5 if name == "tires" else 0
    source = re.escape(f"{kind} {name!r} (failing:{name} of strangers 1.0)")
    assert "\n" not in line
    said = ".*".join(map(re.escape, SAID[name].split(" ~ ")))
    assert re.search(f"{source} failed{place} at tick {tick}: {said}", line)
    path = Path(re.search(r"; traceback in (\S+?)(;|$)", line)[1])
    text = path.read_text()
    assert "Traceback (most recent call last)" in text
    if name in ("raises", "leaves", "tires"):
        assert "failing.py" in text
    return path


@pytest.mark.parametrize("name", [*STRATEGIES, *TARGETS])
def test_in_memory_the_run_fails_with_a_line_that_says_all(name, tmp_path):
    out = tmp_path / "run"
    with pytest.raises(RunFailed) as caught:
        encircle.run(scenario(name), link="memory", out=out)
    assert check_line(str(caught.value), name).parent == out
    summary = json.loads((out / "summary.json").read_text())
    assert summary["ended"] == f"failed: {caught.value}"
    assert read_recording(out).complete


@pytest.mark.parametrize(
    ("name", "how"),
    [
        ("raises", {}),
        ("nan_step", {"clock": "wall"}),
        ("raises", {"clock": "wall", "radio": "direct"}),
        ("tires", {}),
        ("tires", {"clock": "wall"}),
    ],
)
@pytest.mark.parametrize("when_lost", ["go-on", "end"])
def test_over_zenoh_the_run_fails_with_the_same_line(name, how, when_lost, tmp_path):
    out = tmp_path / "run"
    with pytest.raises(RunFailed) as caught:
        encircle.run(scenario(name, **how), out=out, when_lost=when_lost)
    # The first one to fail ends the run: the others may not have come so far.
    assert check_line(str(caught.value), name, "clock" in how, "r[123]").parent == out
    assert not caught.value.resumable
    assert json.loads((out / "summary.json").read_text())["ended"].startswith("failed: ")


@pytest.mark.parametrize("how", [{}, {"clock": "wall"}], ids=["lock-step", "by-clock"])
@pytest.mark.parametrize("name", [*SAYING, "no_pair"])
def test_over_zenoh_what_cannot_be_said_fails_with_the_same_line(name, how):
    with pytest.raises(RunFailed) as caught:
        encircle.run(scenario(name, **how))
    check_line(str(caught.value), name, bool(how), "r[123]").unlink()
    assert not caught.value.resumable


def test_without_a_directory_the_traceback_is_in_a_temporary_file():
    for link in ("memory", "zenoh"):
        with pytest.raises(RunFailed) as caught:
            encircle.run(scenario("raises"), link=link)
        check_line(str(caught.value), "raises").unlink()


def command(*words, scenario=None, folder=None):
    if scenario is not None:
        (folder / "failing.json").write_text(json.dumps(scenario))
    return subprocess.Popen(
        [sys.executable, "-m", "encircle", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=folder,
    )


@pytest.mark.parametrize("link", ["memory", "zenoh"])
def test_the_command_ends_with_that_line_and_status_1(link, tmp_path):
    words = ("run", "failing.json", "--link", link, "--out", "out")
    process = command(*words, scenario=scenario("raises"), folder=tmp_path)
    said, error = communicated(process)
    assert process.returncode == 1
    assert said == ""
    last = error.splitlines()[-1]
    assert last.startswith("encircle: the run failed: policy 'raises' (failing:raises of")
    assert last.endswith("traceback in out/traceback-r1.txt")
    assert "Traceback" not in error


def started_by_hand(name, folder):
    """World and robots, each started by itself: name to (status, what it said on stderr)."""
    endpoint = free_endpoint()
    tree = scenario(name)
    nodes = {
        "world": command(
            *("world", "failing.json", "--listen", endpoint, "--run", "hand", "--out", "out"),
            scenario=tree,
            folder=folder,
        )
    }
    for robot in ("r1", "r2", "r3"):
        words = ("robot", robot, "--connect", endpoint, "--run", "hand")
        nodes[robot] = command(*words, folder=folder)
    said = {who: communicated(process)[1] for who, process in nodes.items()}
    return {who: (process.returncode, said[who]) for who, process in nodes.items()}


def test_started_by_hand_the_robot_says_it_and_the_world_says_whom_to_ask(tmp_path):
    ends = started_by_hand("raises", tmp_path)
    assert [status for status, _ in ends.values()] == [1, 1, 1, 1]
    (line,) = [said for said in ends["r1"][1].splitlines() if "failed" in said]
    assert line.startswith("robot r1: policy 'raises'")
    check_line(line, "raises").unlink()
    assert "world: robot r1 has failed at tick 0, and says itself how" in ends["world"][1]
    assert "Traceback" not in "".join(said for _, said in ends.values())


def test_started_by_hand_the_world_says_how_the_target_failed(tmp_path):
    ends = started_by_hand("tires", tmp_path)
    assert [status for status, _ in ends.values()] == [1, 1, 1, 1]
    (line,) = [said for said in ends["world"][1].splitlines() if "failed" in said]
    assert line.startswith("world: target behaviour 'tires'")
    assert "; traceback in out/traceback-target.txt" in line
    assert "Traceback" not in "".join(said for _, said in ends.values())


def test_a_strategy_that_cannot_be_loaded_ends_the_robot_with_status_2(tmp_path, installed):
    """The world has what the robots' host has not: it cannot find out before the run."""
    endpoint, name = free_endpoint(), "half"
    there = tmp_path / "there"
    plugins.put_there(there, {"half.py": SOURCE}, ["strategies half = half:chase"], "half")
    here = tmp_path / "here"
    plugins.put_there(here, {"half.py": "x = 1\n"}, ["strategies half = half:chase"], "half")
    tree = scenario("raises")
    tree["team"]["strategy"] = name
    (tmp_path / "half.json").write_text(json.dumps(tree))
    words = {"world": ("world", "half.json", "--listen", endpoint)}
    words |= {robot: ("robot", robot, "--connect", endpoint) for robot in ("r1", "r2", "r3")}
    nodes = {
        who: subprocess.Popen(
            [sys.executable, "-m", "encircle", *said, "--run", "half"],
            stderr=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            text=True,
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": str(there if who == "world" else here)},
        )
        for who, said in words.items()
    }
    said = {who: communicated(process)[1] for who, process in nodes.items()}
    assert nodes["world"].returncode == 1
    assert "has failed at tick 0, and says itself how" in said["world"]
    failed = [who for who in ("r1", "r2", "r3") if "half:chase of half 1.0 cannot be" in said[who]]
    assert failed
    assert all(nodes[who].returncode == 2 for who in failed)


@pytest.mark.parametrize(
    ("key", "name", "said"),
    [
        ("team.strategy", "no_module", "ModuleNotFoundError: No module named 'nowhere_at_all'"),
        ("team.strategy", "no_attribute", "module 'failing' has no attribute 'nothing'"),
        ("team.strategy", "no_function", "failing:number of strangers 1.0 is int"),
        ("team.strategy", "no_import", "OSError: no licence"),
        ("target.behaviour", "no_attribute", "module 'failing' has no attribute 'nothing'"),
    ],
)
def test_what_cannot_be_loaded_is_a_problem_of_the_scenario(key, name, said):
    with pytest.raises(ScenarioError) as caught:
        load("sim1", [f"{key}={name}"])
    first, line = str(caught.value).splitlines()
    assert first == "scenario 'sim1' has one problem:"
    assert line.startswith(f"  {key} = {name!r}: ")
    assert said in line


@pytest.mark.parametrize("command_name", ["run", "study", "world"])
def test_what_cannot_be_loaded_is_status_2_before_anything_starts(command_name, tmp_path):
    words = {
        "run": ("run", "sim1", "--out", "out"),
        "study": ("study", "loss", "--out", "out"),
        "world": ("world", "sim1", "--run", "x", "--listen", free_endpoint(), "--out", "out"),
    }[command_name]
    process = command(*words, "--set", "target.behaviour=no_attribute", folder=tmp_path)
    said, error = communicated(process)
    assert (process.returncode, said) == (2, "")
    assert "target.behaviour = 'no_attribute': failing:nothing of strangers 1.0 cannot be" in error
    assert "Traceback" not in error
    assert not (tmp_path / "out").exists()


def test_replay_tells_of_a_strategy_that_fails(tmp_path, installed):
    with pytest.raises(RunFailed):
        encircle.run(scenario("raises"), link="memory", out=tmp_path / "run")
    with pytest.raises(PluginFailed, match=r"'raises' .* failed in robot r1 at tick 0"):
        replay(tmp_path / "run")
    process = command("replay", "run", "--check", folder=tmp_path)
    said, error = communicated(process)
    assert (process.returncode, said) == (1, "")
    check_line(error.strip(), "raises").unlink()


@pytest.mark.parametrize("link", ["memory", "zenoh"])
def test_a_target_that_fails_while_a_run_is_taken_up_ends_it_with_its_line(
    link, tmp_path, installed
):
    source = installed / "failing.py"
    source.write_text(SOURCE.replace("view.tick == 5", "view.tick == 500"))
    encircle.run(scenario("tires"), link="memory", out=tmp_path / "run")
    recording = tmp_path / "run" / "recording.mcap"
    recording.write_bytes(recording.read_bytes()[:-3000])
    source.write_text(SOURCE)
    plugins.forget(installed)
    behaviour_named.cache_clear()
    with pytest.raises(RunFailed) as caught:
        encircle.resume(tmp_path / "run", link=link)
    assert check_line(str(caught.value), "tires").parent == tmp_path / "run"


def test_a_recording_of_a_plug_in_that_is_missing_here_says_so(tmp_path, monkeypatch, installed):
    with pytest.raises(RunFailed):
        encircle.run(scenario("tires"), link="memory", out=tmp_path / "run")
    monkeypatch.delenv("PYTHONPATH")
    process = command("replay", "run", folder=tmp_path)
    _, error = communicated(process)
    assert process.returncode == 2
    assert "cannot be understood here" in error
    assert "target.behaviour = 'tires': unknown target behaviour" in error


def test_a_robot_that_has_failed_says_so_whatever_it_is_asked_until_it_is_set_up_anew():
    told = []
    core = RobotCore("r1", "run", report_failure=told.append)

    def set_up(strategy):
        setup = Setup("r1", ("r1", "r2"), 0.1, strategy, BODIES, "world", 0, 0)
        core.receive(robot_key("run", "r1", "setup"), encode(setup, "run"))

    def asked(tick):
        said = observation("r1", tick, (3.5, 0.0), target=(0.0, 0.0))
        answer = core.receive(robot_key("run", "r1", "observation"), encode(said, "run"))
        return [decode(Command, payload, "run").mode for key, payload in answer if "command" in key]

    set_up("raises")
    assert [asked(0), asked(1), asked(1)] == [[CommandMode.FAILED]] * 3
    assert len(told) == 1
    set_up("pursuit")
    assert asked(0) == ["pursue"]
    assert core.failed is None


def test_only_who_is_asked_can_fail_a_run():
    world = WorldCore(build(load(SEEN), 1), "run")
    for robot in world.arena.ids:
        world.join(robot)
    world.begin()

    def failed(robot, tick):
        said = Command(robot, tick, (0.0, 0.0), CommandMode.FAILED, *[None] * 5, (), False)
        return world.receive(robot_key("run", robot, "command"), encode(said, "run"))

    assert failed("r1", 1) == failed("r9", 0) == []
    assert world.ended is None
    ends = failed("r2", 0)
    assert [key.rsplit("/", 2)[1:] for key, _ in ends] == [[f"r{k}", "end"] for k in (1, 2, 3)]
    assert world.ended == "failed: robot r2 has failed at tick 0, and says itself how"
    assert world.state.tick == 0
    assert failed("r1", 0) == []


GOOD = Decision("mode", (0.1, 0.2), (1.0, 2.0), 1.0, 2, "spline")


class _Rude:
    def __repr__(self):
        raise RuntimeError("no")


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("mode", [None, 1, b"x", "x" * 300, "failed", "stop", "\ud800", _Rude()]),
        ("step", [None, 1.0, (1.0,), (1.0, 2.0, 3.0), "ab", ("1", "2"), (True, 0), (1e10, 0.0)]),
        (
            "step",
            [(float("inf"), 0.0), (0.0, float("nan")), {}, (None, 0.0), _Rude(), (10**400, 0)],
        ),
        ("goal", [None, (float("nan"), 0.0), (0.0, 1e9), "no", ()]),
        ("xi", ["1", float("nan"), (1.0,), 1e10, 10**400, _Rude()]),
        ("point", [-1, 1.0, "1", True, 2**60, _Rude()]),
        ("predictor", [1, "x" * 300, b"x"]),
    ],
)
def test_a_choice_with_a_value_that_cannot_be_is_refused_by_name(name, values):
    for value in values:
        with pytest.raises(InvalidPluginResult, match=rf"^{name} = |^{name} = a _Rude"):
            validated((None, GOOD._replace(**{name: value})))


@pytest.mark.parametrize("given", [None, 3, "x", (1, 2), {}, _Rude()])
def test_what_is_no_choice_is_refused(given):
    with pytest.raises(InvalidPluginResult, match="must be what it remembers, and a Decision"):
        validated(given)


def test_what_numpy_makes_is_as_good_as_plain_numbers():
    given = Decision("mode", np.array([0.1, 0.2]), [1, 2.0], np.float64(1.0), np.int64(2), "spline")
    memory, decision = validated((given, given))
    assert memory is given
    assert decision == GOOD
    assert set(map(type, decision.step)) == {float}
    assert type(decision.point) is int
    assert validated((3, GOOD)) == (3, GOOD)
