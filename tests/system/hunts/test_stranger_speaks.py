"""A robot of other make and a policy of the reader's own hear each other, and somebody looks on.

``stranger/robot.py`` knows docs/protocol.md alone and takes part as r4. r1 to r3 follow a policy
that lies in a file: it takes the place in the ring that the stranger's share leaves to it, and has
the stranger wait before it goes in. What each of them heard is read off the recording.
"""

import json
import sys
from contextlib import ExitStack
from math import cos, pi, sin
from pathlib import Path

import msgpack
import pytest
import zenoh
from helpers_commands import ours
from helpers_hosts import NodeProcess
from helpers_paths import STRANGER
from helpers_waiting import until

from encircle.protocol.codec import decode
from encircle.protocol.messages import Command, Observation, Pose
from encircle.protocol.plugin_files import FOLDERS
from encircle.replay.replaying import replay
from encircle.runner.launch import free_endpoint
from encircle.world.recording.recording import read_recording

RUN = "speaking"
TEAM = ("r1", "r2", "r3", "r4")
TICKS, WAIT_TICKS = 60, 40
RING_M = 4.0
POLICY = '''
from math import cos, hypot, pi, sin

from encircle import Decision
from encircle.agents.policies.paper import xi_star

WAIT_TICKS = 40


def attentive(memory, view):
    """Fits in where the newest share that was heard leaves room, and says what it has heard."""
    shares = [(p.tick, p.say["share"]) for p in view.heard if "share" in p.say]
    memory = max(shares, key=lambda told: told[0]) if shares else memory
    newest = {p.robot: p.packet.tick for p in view.peers if p.packet and "share" in p.packet.say}
    say = {"wait": view.tick < WAIT_TICKS, "heard": [tick for tick, _ in shares]}
    if newest:
        say["newest"] = newest
    if memory is None or view.target is None:
        return memory, xi_star(None, view)[1]._replace(say=say)
    share = memory[1]
    angle = share["bearing_rad"] + (1 + view.team.index(view.robot)) * 2 * pi / share["of"]
    x, y = view.target.position
    ring = view.parameters.ring_radius_m
    goal = x + ring * cos(angle), y + ring * sin(angle)
    step = goal[0] - view.position[0], goal[1] - view.position[1]
    return memory, Decision("fit", step, goal, say=say)
'''


@pytest.fixture(scope="module")
def hunt(tmp_path_factory):
    """The hunt's recording, the world's result and what the onlooker has printed."""
    folder = tmp_path_factory.mktemp("speaking")
    (folder / "robots.py").write_text(POLICY)
    packages = folder / "packages"
    packages.mkdir()
    for module in (msgpack, zenoh):
        place = Path(module.__file__).parent
        (packages / place.name).symlink_to(place)
    endpoint = free_endpoint()
    where = ("--connect", endpoint, "--run", RUN)
    with ExitStack() as stack:

        def start(name, command, **settings):
            node = NodeProcess(command, folder / name, settings)
            stack.callback(node.kill)
            return node

        world_words = ("--listen", endpoint, "--run", RUN, "--out", str(folder / "run"))
        changes = ("team.strategy=robots.py:attentive", f"ticks_max={TICKS}")
        settings = [word for change in changes for word in ("--set", change)]
        own = {FOLDERS: str(folder)}
        world = start("world", ours("world", "sim1", *world_words, *settings), **own)
        looks = [f":read:encircle/{RUN}/robots/*/{part}" for part in ("pose", "answers")]
        onlooker = start(
            "onlooker", [sys.executable, str(STRANGER / "onlooker.py"), endpoint, "0", "", *looks]
        )
        onlooker.wait_until(lambda node: "looking on" in node.said)
        robots = [start(robot, ours("agents", robot, *where), **own) for robot in TEAM[:3]]
        guest = [sys.executable, "-S", "-P", str(STRANGER / "robot.py"), "r4", RUN, endpoint]
        robots.append(start("r4", guest, PYTHONPATH=str(packages)))
        nodes = [world, *robots]
        until(
            lambda: not any(node.running for node in nodes),
            "the hunt's end",
            lambda: (world.tick, [node.running for node in nodes]),
        )
        assert [node.end() for node in nodes] == [0] * 5, [node.said for node in nodes]
        read = [json.loads(line) for line in onlooker.printed_text().split("\n")[:-1]]
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(FOLDERS, str(folder))
        yield read_recording(folder / "run"), world.result(), read


def of(recording, kind, robot):
    """The messages of a robot, by tick."""
    channel = kind.__name__.lower()
    return {
        tick: decode(kind, payload, RUN)
        for tick, who, payload in recording.of_channel(channel)
        if who == robot
    }


def heard_of(recording, robot, sender):
    """What was delivered to a robot of one sender: tick of delivery to poses."""
    return {
        tick: [p for p in (decode(Pose, b, RUN) for b in seen.inbox) if p.robot == sender]
        for tick, seen in of(recording, Observation, robot).items()
    }


def test_nothing_of_it_is_refused(hunt):
    recording, result, _ = hunt
    assert result["refused"] == {}
    assert result["ended"] in ("captured", "ticks")
    for robot in TEAM:
        assert all(not command.refused for command in of(recording, Command, robot).values())


def test_the_stranger_says_its_share_and_nothing_while_it_has_none(hunt):
    recording, _, _ = hunt
    said = {tick: pose.say for tick, pose in of(recording, Pose, "r4").items()}
    modes = {tick: command.mode for tick, command in of(recording, Command, "r4").items()}
    assert {tick for tick, say in said.items() if say == {}} == {
        tick for tick, mode in modes.items() if mode == "search"
    }
    shares = [say["share"] for say in said.values() if say]
    assert len(shares) > TICKS // 2
    assert shares[-1]["of"] == 4


@pytest.mark.parametrize("robot", TEAM[:3])
def test_our_policy_hears_the_stranger_and_goes_where_its_share_leaves_room(hunt, robot):
    recording, _, _ = hunt
    commands, poses = of(recording, Command, robot), of(recording, Pose, robot)
    share, fits = None, 0
    for tick, packets in heard_of(recording, robot, "r4").items():
        told = [packet for packet in packets if packet.say]
        assert poses[tick].say["heard"] == tuple(packet.tick for packet in told)
        share = told[-1].say["share"] if told else share
        command = commands[tick]
        assert (command.mode == "fit") == (share is not None and command.estimate is not None)
        if command.mode == "fit":
            fits += 1
            angle = share["bearing_rad"] + (1 + TEAM.index(robot)) * 2 * pi / share["of"]
            x, y = command.estimate
            expected = (x + RING_M * cos(angle), y + RING_M * sin(angle))
            assert command.goal == pytest.approx(expected, abs=1e-5)
            assert poses[tick].say["newest"] == {"r4": tick - 1}
    assert fits > TICKS // 2


def test_the_stranger_hears_our_policy_and_waits_until_it_need_not(hunt):
    recording, _, _ = hunt
    modes = {tick: command.mode for tick, command in of(recording, Command, "r4").items()}
    in_ring = [tick for tick, mode in modes.items() if mode == "shrink"]
    # What is said at a tick is heard at the next.
    assert min(in_ring) == WAIT_TICKS + 1
    heard = heard_of(recording, "r4", "r1")
    assert [p.say["wait"] for p in heard[WAIT_TICKS]] == [True]
    assert [p.say["wait"] for p in heard[WAIT_TICKS + 1]] == [False]


def test_somebody_who_looks_on_reads_what_all_of_them_say(hunt):
    recording, _, read = hunt
    said = {
        (tick, robot): pose.say
        for robot in TEAM
        for tick, pose in of(recording, Pose, robot).items()
    }
    assert {robot for _, robot, _ in read} == set(TEAM)
    for tick, robot, say in read:
        assert msgpack.packb(say) == msgpack.packb(said[tick, robot])


def test_fresh_robots_of_ours_say_the_same_again(hunt):
    recording, _, _ = hunt
    check = replay(recording)
    assert {robot for _, robot, _ in check.differences} <= {"r4"}
