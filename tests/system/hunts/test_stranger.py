"""A robot written from docs/protocol.md alone takes part like any other.

``stranger/robot.py`` imports zenoh, msgpack and the standard library, and is run where nothing else
can be imported. The hunts over Zenoh take some seconds, the rest less than one.
"""

import ast
import importlib.util
import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from math import atan2, pi
from pathlib import Path

import msgpack
import pytest
import zenoh
from helpers_agents import BODIES
from helpers_hosts import wait_for_robots
from helpers_paths import STRANGER
from helpers_waiting import communicated, completed, ended

from encircle.agents.brain.robot_core import RobotCore
from encircle.protocol.codec import decode, encode
from encircle.protocol.keys import parse_key, robot_key
from encircle.protocol.messages import Command, Observation, Pose, Setup, State
from encircle.runner.launch import free_endpoint
from encircle.world.arena.engine import build
from encircle.world.coordinator.world_core import WorldCore
from encircle.world.loading.load import load
from encircle.world.recording.recording import read_recording

PROGRAM = STRANGER / "robot.py"
OURS = ("encircle",)
ALLOWED = ("msgpack", "zenoh")
TEAM = ("r1", "r2", "r3", "r4")
RUN = "guests"


@pytest.fixture(scope="module")
def packages(tmp_path_factory) -> Path:
    """A directory with the two packages that the robot may import, and nothing else."""
    place = tmp_path_factory.mktemp("packages")
    for module in (msgpack, zenoh):
        folder = Path(module.__file__).parent
        (place / folder.name).symlink_to(folder)
    return place


def alone(packages: Path) -> tuple[list[str], dict[str, str]]:
    """A Python without site-packages and without the working directory, and its environment."""
    return [sys.executable, "-S", "-P"], {"PYTHONPATH": str(packages)}


def test_it_imports_nothing_but_zenoh_msgpack_and_the_standard_library():
    tree = ast.parse(PROGRAM.read_text())
    named = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            named |= {name.name.partition(".")[0] for name in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0
            named.add(node.module.partition(".")[0])
    assert named - set(sys.stdlib_module_names) == set(ALLOWED)
    assert "import" not in PROGRAM.read_text().replace("\nimport ", "\n")


@pytest.mark.parametrize("name", [*OURS, "numpy", "scipy", "pydantic"])
def test_nothing_else_can_be_imported_where_it_runs(packages, tmp_path, name):
    command, environment = alone(packages)
    script = f"import msgpack, zenoh\nimport {name}"
    done = completed([*command, "-c", script], cwd=tmp_path, env=environment)
    assert f"ModuleNotFoundError: No module named '{name}'" in done.stderr


@pytest.fixture
def joined(packages, tmp_path) -> Iterator:
    """A hunt over Zenoh with the stranger as r4: its result and where it was recorded."""
    with ExitStack() as stack:

        def start(command, **options):
            process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, **options)
            stack.enter_context(process)
            stack.callback(process.kill)
            return process

        def hunt(*changes: str):
            endpoint, out = free_endpoint(), tmp_path / "run"
            ours = [sys.executable, "-m"]
            settings = [part for change in changes for part in ("--set", change)]
            world = start(
                [
                    *(*ours, "encircle.world", "sim1", "--listen", endpoint, "--run", RUN),
                    *("--out", str(out), "--json", *settings),
                ],
                stdout=subprocess.PIPE,
            )
            robots = [
                start([*ours, "encircle.agents", robot, "--connect", endpoint, "--run", RUN])
                for robot in TEAM[:3]
            ]
            wait_for_robots(endpoint, RUN, 3)
            command, environment = alone(packages)
            guest = [*command, str(PROGRAM), "r4", RUN, endpoint]
            robots.append(start(guest, cwd=tmp_path, env=environment, stdout=subprocess.PIPE))
            said, errors = communicated(world)
            assert [ended(robot) for robot in robots] == [0] * 4, errors
            reports = map(json.loads, said.splitlines())
            return next(report["result"] for report in reports if "result" in report), out

        yield hunt


def test_the_hunt_captures_and_nothing_is_refused(joined):
    result, out = joined()
    assert result["ended"] == "captured"
    assert result["refused"] == {}
    # All four are needed for that, and each is where the last had to come to.
    recording = read_recording(out)
    assert recording.scenario.capture_count == 4
    assert max(result["distances_m"]) <= recording.scenario.capture.stop_distance_m

    by_robot = {robot: commands(recording, robot) for robot in TEAM}
    assert [len(found) for found in by_robot.values()] == [result["ticks"]] * 4
    for robot in TEAM[:3]:
        # r4 starts out of sight of all: who plans with it from tick 1 on knows it from its packets.
        assert not any(who == "r4" for who, _, _ in observations(recording, robot)[1].seen)
        assert all(command.team == TEAM for command in by_robot[robot][1:])
        assert all(not command.refused for command in by_robot[robot])
    # It goes to a place in the ring and closes in, and in the end stands in a gap of its own.
    modes = [command.mode for command in by_robot["r4"]]
    assert modes[0] == "search"
    assert {"encircle", "shrink"} <= set(modes)
    assert modes[-1] == "shrink"
    last = decode(State, list(recording.of_channel("state"))[-1][2], RUN)
    assert max(gaps(last)) < pi


def test_what_it_says_changes_what_the_others_do(joined):
    """Fresh brains of ours decide as recorded, and differently where its packets are left out."""
    _, out = joined()
    recording = read_recording(out)
    for robot in TEAM[:3]:
        recorded = commands(recording, robot)
        assert decided(recording, robot, lambda packet: True) == recorded
        without = decided(recording, robot, lambda packet: decode(Pose, packet, RUN).robot != "r4")
        assert without[0] == recorded[0]
        assert [command.step for command in without] != [command.step for command in recorded]


def test_it_survives_a_loss_of_its_own_and_one_of_another(joined):
    """It is taken away and comes back with a fresh setup; r2 is gone for a while, too."""
    away = '{kind="crash",robot="r4",tick=8,ticks=6}'
    other = '{kind="crash",robot="r2",tick=20,ticks=8}'
    result, out = joined(f"events=[{away},{other}]")
    assert result["ended"] == "captured"
    assert result["refused"] == {}
    recording = read_recording(out)
    setups = [
        decode(Setup, payload, RUN)
        for _, robot, payload in recording.of_channel("setup")
        if robot == "r4"
    ]
    assert [setup.first_tick for setup in setups] == [0, 14]
    found = {command.tick: command for command in commands(recording, "r4")}
    ticks = result["ticks"]
    assert list(found) == [*range(8), *range(14, ticks)]
    assert "r2" in found[19].team
    assert all("r2" not in found[tick].team for tick in range(20, 28))
    assert "r2" in found[ticks - 1].team
    # The others plan without it, and count it in again when they hear it.
    theirs = {command.tick: command for command in commands(recording, "r1")}
    assert all("r4" not in theirs[tick].team for tick in range(8, 14))
    assert all("r4" in theirs[tick].team for tick in range(15, ticks))


def commands(recording, robot: str) -> list[Command]:
    return [
        decode(Command, payload, RUN)
        for _, who, payload in recording.of_channel("command")
        if who == robot
    ]


def observations(recording, robot: str) -> list[Observation]:
    return [
        decode(Observation, payload, RUN)
        for _, who, payload in recording.of_channel("observation")
        if who == robot
    ]


def decided(recording, robot: str, heard) -> list[Command]:
    """What a fresh robot of ours decides on a recording of which it hears only some packets."""
    core = RobotCore(robot, RUN)
    setup = next(body for _, who, body in recording.of_channel("setup") if who == robot)
    core.receive(robot_key(RUN, robot, "setup"), setup)
    found = []
    for said in observations(recording, robot):
        left = replace(said, inbox=tuple(filter(heard, said.inbox)))
        for key, answer in core.receive(robot_key(RUN, robot, "observation"), encode(left, RUN)):
            if parse_key(key).channel == "command":
                found.append(decode(Command, answer, RUN))
    return found


def gaps(state: State) -> list[float]:
    x, y = state.target
    bearings = sorted(atan2(b - y, a - x) for a, b in state.robots)
    return [b - a for a, b in zip(bearings, [*bearings[1:], bearings[0] + 2 * pi], strict=True)]


@pytest.fixture
def stranger():
    spec = importlib.util.spec_from_file_location("stranger", PROGRAM)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("scenario", ["sim1", "sim2", "sim3", "sim4", "sim5"])
def test_strangers_among_themselves_capture_too(stranger, scenario):
    """No robot of ours in the team, and no network: the world's core and theirs."""
    arena = build(load(scenario), 1)
    world = WorldCore(arena, RUN)
    robots = {robot: stranger.Robot(robot, RUN) for robot in arena.ids}
    mail = [said for robot in arena.ids for said in world.join(robot)] + world.begin()
    while mail:
        answers = []
        for key, payload in mail:
            robot = parse_key(key).robot
            for channel, said in robots[robot].hear(parse_key(key).channel, payload):
                answers += world.receive(robot_key(RUN, robot, channel), said)
        mail = answers
    assert world.ended == "captured"
    assert not world.rounds.refused
    assert not any(robot.refused for robot in robots.values())


def setup(first_tick: int = 0, answer_tick: int = 0) -> bytes:
    message = Setup(
        "r4", TEAM, 0.1, "xi-star", BODIES, first_tick=first_tick, answer_tick=answer_tick
    )
    return encode(message, RUN)


def pose(robot: str, tick: int) -> bytes:
    where = (float(tick), 2.0)
    return encode(
        Pose(robot, tick, tick, where, (10.0, 0.0), (5.0, 5.0), "search", None, None), RUN
    )


def observation(tick: int, inbox: tuple[bytes, ...] = (), lost: tuple[str, ...] = ()) -> bytes:
    scan = (6.0,) * 24
    told = Observation("r4", tick, (0.0, 0.0), 0.0, None, scan, (), inbox, lost)
    return encode(told, RUN)


def planned(answer) -> Command:
    assert [channel for channel, _ in answer] == ["pose", "command"]
    return decode(Command, answer[1][1], RUN)


def test_it_remembers_what_it_need_not_answer_and_says_the_same_when_asked_twice(stranger):
    robot = stranger.Robot("r4", RUN)
    assert robot.hear("setup", setup(3, 5)) == []
    assert robot.hear("observation", observation(3, (pose("r1", 2),))) == []
    assert robot.hear("observation", observation(4)) == []
    answer = robot.hear("observation", observation(5))
    assert planned(answer).team == ("r1", "r4")
    assert planned(answer).estimate == (5.0, 5.0)
    assert robot.hear("observation", observation(5)) == answer
    assert robot.hear("observation", observation(7)) == []
    assert robot.refused == {"out-of-turn": 1}


def test_a_fresh_setup_makes_it_forget(stranger):
    robot = stranger.Robot("r4", RUN)
    robot.hear("setup", setup())
    robot.hear("observation", observation(0))
    assert planned(robot.hear("observation", observation(1, (pose("r1", 0),)))).team == ("r1", "r4")
    robot.hear("setup", setup(9, 9))
    after = planned(robot.hear("observation", observation(9)))
    assert (after.tick, after.team, after.estimate) == (9, ("r4",), None)


def test_it_plans_without_the_lost_until_it_hears_of_them_anew(stranger):
    robot = stranger.Robot("r4", RUN)
    robot.hear("setup", setup())
    teams = [
        planned(robot.hear("observation", observation(tick, *told))).team
        for tick, told in enumerate(
            [
                (),
                ((pose("r1", 0), pose("r2", 0)),),
                ((), ("r2",)),
                # Under way for long: it was sent before the loss.
                ((pose("r2", 1),), ("r2",)),
                ((), ("r2",)),
                ((pose("r2", 4),), ("r2",)),
            ]
        )
    ]
    everyone, without = ("r1", "r2", "r4"), ("r1", "r4")
    assert teams == [("r4",), everyone, without, without, without, everyone]


def test_it_refuses_what_is_none_of_its_business(stranger):
    robot = stranger.Robot("r4", RUN)
    assert robot.hear("observation", observation(0)) == []
    robot.hear("setup", setup())
    robot.hear("observation", b"\xc1")
    robot.hear("setup", encode(Setup("r3", TEAM, 0.1, "xi-star", BODIES), RUN))
    strange = (pose("r9", 0), pose("r4", 0), pose("r1", 1), b"nonsense")
    robot.hear("observation", observation(0))
    answer = planned(robot.hear("observation", observation(1, strange)))
    assert answer.team == ("r4",)
    assert answer.refused == {"inbox": 4, "malformed": 1, "out-of-turn": 1, "wrong-sender": 1}
