"""Mutated packets for whoever takes in what others send: each is taken, or refused and counted.

A recorded run is played to all receivers once more, message by message. Before each message come
changed ones, made of it and of others, on its key and on others; every receiver gets every one.
What is taken changes a receiver, as it may; it goes on from there. ``mutated`` raises what any of
them raises, and for a packet that takes more work or memory than its length allows.
"""

import copy
import json
import random
import sys
import tracemalloc
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from helpers_clocked_swarm import play_by_clock
from helpers_mutations import mutant
from helpers_swarm import recorded

from encircle.agents.brain.real_time_core import RealTimeRobotCore
from encircle.agents.brain.robot_core import RobotCore
from encircle.agents.process.real_time import is_timed
from encircle.live.rounds import RoundCollector
from encircle.live.scene_feed import SceneFeed
from encircle.protocol.codec import decode
from encircle.protocol.errors import ProtocolError
from encircle.protocol.keys import robot_key, world_key
from encircle.protocol.messages import Setup
from encircle.protocol.plugins import PluginLoadError
from encircle.protocol.wire.earlier_versions import upgraded
from encircle.protocol.zenoh.node_info import decode_info, info_replier
from encircle.protocol.zenoh.scenario_query import (
    RunDescription,
    decode_description,
    encode_description,
)
from encircle.ros2.bridge import Bridge, TimeSource
from encircle.ros2.message_types import MessageTypes
from encircle.ros2.plane_messages import PlaneMessages
from encircle.ros2.releases import RELEASES
from encircle.ros2.steered_robot import CommandMail, SteeredRobot, Steering
from encircle.ros2.steering_node import TWIST, TWIST_STAMPED, SteeringNode
from encircle.scene.builder import SceneBuilder
from encircle.scene.stage import stage_of
from encircle.world.arena.engine import build
from encircle.world.coordinator.failure_detector import FailureDetector
from encircle.world.coordinator.real_time_core import RealTimeWorldCore
from encircle.world.coordinator.world_core import WorldCore
from encircle.world.loading.load import load
from encircle.world.recording.recording import RecordingError
from encircle.world.recording.schemas import KINDS
from encircle.world.scenario.errors import ScenarioError
from encircle.world.scenario.model import Scenario

BY_CLOCK_EVERY = 3
OTHER_KEY_SHARE = 0.1
NEAR, AHEAD = 16, 80
"""So many messages that come next are changed first of all, and looked at for observations."""
FOR_GOOD_EVERY = 16
WATCHED_EVERY = 251
"""Of so many packets one is given under watch: its memory and its work are measured."""
PEAK_BYTES_MAX, PEAK_PER_BYTE = 16 * 2**20, 100
CALLS_MAX, CALLS_PER_BYTE = 300_000, 100

Message = tuple[str, bytes]
TAKEN = "taken"


class Receiver:
    """Someone who takes in messages. ``give`` says what became of one, or raises."""

    def give(self, key: str, payload: bytes) -> str:
        """``taken``, or the cause of the refusal."""
        raise NotImplementedError

    def hear(self, key: str, payload: bytes) -> None:
        """A message of the run as it was recorded."""
        self.give(key, payload)


def _cause(before: Counter[str], after: Counter[str]) -> str:
    return next(iter(after - before), TAKEN)


class Robot(Receiver):
    """A robot's core in lock-step, or one that ROS 2 steers.

    After an observation that it takes, the true one comes too late. So that it takes many, most
    packets are given to a copy of it.
    """

    def __init__(self, core: RobotCore) -> None:
        self.core = core
        self.given = 0

    def hear(self, key: str, payload: bytes) -> None:
        self.core.receive(key, payload)

    def give(self, key: str, payload: bytes) -> str:
        core, before = self.core, self.core.refused.copy()
        self.given += 1
        if self.given % FOR_GOOD_EVERY:
            core = copy.copy(core)
            core.refused = before.copy()
        is_timed(core, key, payload)
        core.receive(key, payload)
        failed = core.failed
        assert failed is None or isinstance(failed.error, PluginLoadError), f"{failed}"
        return _cause(before, core.refused)


class ClockedRobot(Robot):
    """A robot's core by the clock, once it has its setup."""

    def __init__(self, core: RobotCore) -> None:
        super().__init__(core)
        self.timed: RealTimeRobotCore | None = None
        self.now_us = 0

    def hear(self, key: str, payload: bytes) -> None:
        if self.timed is None:
            super().hear(key, payload)
        else:
            self.give(key, payload)

    def give(self, key: str, payload: bytes) -> str:
        if self.timed is None:
            if self.core.setup is None:
                return super().give(key, payload)
            self.timed = RealTimeRobotCore(self.core)
        before = self.core.refused.copy()
        self.now_us += 1000
        self.timed.take(self.now_us, key, payload)
        if self.now_us % 3000 == 0:
            action = self.timed.decide()
            if action is not None:
                self.timed.messages(action, self.now_us)
        elif self.now_us % 50_000 == 0:
            self.timed.stop(self.now_us)
        return _cause(before, self.core.refused)


class World(Receiver):
    """The world's core in lock-step, and its failure detector."""

    def __init__(self, scenario: Scenario, run: str) -> None:
        self.core = WorldCore(build(scenario, scenario.seed), run)
        self.detector = FailureDetector(self.core)
        for robot in self.core.arena.ids:
            self.detector.token_appeared(robot)
        self.detector.begin()
        # Whatever it seems to have sent brings it back.
        self.detector.token_vanished(self.core.arena.ids[-1])

    def give(self, key: str, payload: bytes) -> str:
        before = self.core.rounds.refused.copy()
        self.detector.sign_of_life(key, payload)
        self.core.receive(key, payload)
        self.core.rounds.commit()
        assert self.core.rounds.plugin_failure is None
        return _cause(before, self.core.rounds.refused)


class ClockedWorld(Receiver):
    """The world's core by the clock; ``state`` messages of the recording end its ticks."""

    def __init__(self, scenario: Scenario, run: str) -> None:
        self.core = RealTimeWorldCore(build(scenario, scenario.seed), run)
        for robot in self.core.arena.ids:
            self.core.join(robot)
        self.now_us = 1_700_000_000_000_000
        self.core.now_us = self.now_us
        self.core.begin()

    def give(self, key: str, payload: bytes) -> str:
        before = self.core.rounds.refused.copy()
        self.now_us += 100
        self.core.take(key, payload, self.now_us)
        return _cause(before, self.core.rounds.refused)

    def hear(self, key: str, payload: bytes) -> None:
        if key.endswith("/state"):
            self.core.end_tick(self.now_us)
            self.core.rounds.commit()
            assert self.core.rounds.plugin_failure is None
        else:
            self.give(key, payload)


class Viewer(Receiver):
    """What shows a running hunt: rounds, and frames with what robots believe."""

    def __init__(self, scenario: Scenario, run: str, by_clock: bool) -> None:
        self.rounds = RoundCollector(run, scenario.ids, scenario.ticks_max, by_clock)
        self.scene = SceneFeed(scenario, scenario.seed, run)

    def give(self, key: str, payload: bytes) -> str:
        before = self.rounds.refused + self.scene.refused
        self.scene.take(self.rounds.take(key, payload))
        return TAKEN if self.rounds.refused + self.scene.refused == before else "refused"


class Frames(Receiver):
    """The builder of frames, given each message as it comes."""

    def __init__(self, scenario: Scenario, run: str) -> None:
        self.builder = SceneBuilder(scenario, scenario.seed, run)

    def give(self, key: str, payload: bytes) -> str:
        try:
            self.builder.take(None, key.split("/", 2)[-1], payload)
        except ProtocolError as error:
            return error.cause
        except RecordingError:
            return "not as recorded"
        return TAKEN


class Recordings(Receiver):
    """Who reads recordings, earlier versions' too."""

    def __init__(self, run: str) -> None:
        self.run = run

    def give(self, key: str, payload: bytes) -> str:
        kind = KINDS.get(key.rsplit("/", 1)[-1])
        if kind is None:
            return "unknown-key"
        try:
            decode(kind, upgraded(payload), self.run)
        except ProtocolError as error:
            return error.cause
        return TAKEN


class Answers(Receiver):
    """Who asks nodes what they are, and a world for its scenario: gets anything for an answer."""

    def give(self, key: str, payload: bytes) -> str:
        outcome = TAKEN
        for read in (decode_info, decode_description):
            try:
                answer = read(payload)
            except ProtocolError as error:
                outcome = error.cause
                continue
            if isinstance(answer, RunDescription):
                try:
                    load(json.loads(answer.scenario))
                except (ScenarioError, ValueError, RecursionError):
                    return "no scenario"
                for setup in answer.setups:
                    try:
                        decode(Setup, setup, answer.run)
                    except ProtocolError as error:
                        return error.cause
            return TAKEN
        return outcome


class _Session:
    """The hunt's side of a bridge: hands it what it listens to."""

    take: Callable[[str, bytes], None]

    def subscribe(self, _key: str, take: Callable[[str, bytes], None]) -> None:
        self.take = take

    def watch(self, _key: str, _tell: Callable[[str, bool], None]) -> None:
        """Nobody comes or goes."""


class _Ros:
    """ROS 2's side: remembers who listens to what, and drops what it is sent."""

    def __init__(self) -> None:
        self.topics: dict[str, Callable[[bytes], None]] = {}

    def advertise(self, _topics: Sequence[Any]) -> None:
        """Anybody may."""

    def publish(self, _topic: Any, _payload: bytes) -> None:
        """It is gone."""

    def subscribe(self, topic: Any, take: Callable[[bytes], None]) -> None:
        self.topics[topic.name] = take


class RosBridge(Receiver):
    """The bridge that shows states to ROS 2."""

    def __init__(self, scenario: Scenario, run: str) -> None:
        session, stage = _Session(), stage_of(scenario, scenario.seed, run)
        types = MessageTypes(RELEASES["jazzy"])
        self.bridge = Bridge(
            *(session, run, stage, lambda: (), _Ros(), types, TimeSource.SIMULATED),  # type: ignore[arg-type]
            log=lambda _line: None,
        )

    def give(self, key: str, payload: bytes) -> str:
        if not key.endswith("/state"):
            return "unknown-key"
        before = self.bridge.report.refused
        self.bridge._take(payload)
        return TAKEN if self.bridge.report.refused == before else "refused"


class RosCommands(Receiver):
    """What ROS 2 tells a robot, in messages of the three types that it listens to."""

    def __init__(self, robot: str) -> None:
        self.ros, self.mail = _Ros(), CommandMail()
        types = MessageTypes(RELEASES["jazzy"])
        SteeringNode(self.ros, types, robot, self.mail, lambda _line: None)  # type: ignore[arg-type]
        self.valid = [types.encoded(made) for made in _commands(PlaneMessages(types))]

    def give(self, key: str, payload: bytes) -> str:
        before = self.mail.refused
        for take in self.ros.topics.values():
            take(payload)
        return TAKEN if self.mail.refused - before < len(self.ros.topics) else "refused"


def _commands(plane: PlaneMessages) -> Iterator[Any]:
    header, vector = plane.header(plane.time(1)), plane.vector(1.0, 0.5, 0.1)
    twist = plane.make(TWIST, vector, vector)
    yield twist
    yield plane.make(TWIST_STAMPED, header, twist)
    yield plane.pose_stamped(header, (1.0, 2.0), 0.5)


def receivers(scenario: Scenario, run: str, by_clock: bool) -> dict[str, Receiver]:
    """Everybody, at the beginning of a run."""
    robot, other = scenario.ids[0], scenario.ids[-1]
    mail = CommandMail()
    steering = Steering(mail, lambda _perception, _by_clock: None, wait_s_max=0.0)
    made: dict[str, Receiver] = {
        "robot": Robot(RobotCore(robot, run)),
        "steered robot": Robot(SteeredRobot(steering, robot, run)),
        "robot by the clock": ClockedRobot(RobotCore(other, run)),
        "viewer": Viewer(scenario, run, by_clock),
        "frames": Frames(scenario, run),
        "recordings": Recordings(run),
        "answers": Answers(),
        "ROS 2 bridge": RosBridge(scenario, run),
        "ROS 2 commands": RosCommands(robot),
    }
    if by_clock:
        made["world by the clock"] = ClockedWorld(scenario, run)
    else:
        made["world"] = World(scenario, run)
    return made


def mutated(seed: int, count: int) -> Counter[str]:
    """Give so many mutated packets of a seed's run to every receiver; what became of them."""
    by_clock = seed % BY_CLOCK_EVERY == 0
    played = play_by_clock(seed) if by_clock else recorded(seed, faults=False)
    run = "clocked" if by_clock else "swarm"
    draws = random.Random(f"mutated packets {seed}")
    everybody = receivers(played.scenario, run, by_clock)
    true = [(f"encircle/{run}/{topic}", payload) for _, topic, payload in played.messages]
    others = _others(played.scenario, run, everybody)
    sources = true + others
    payloads = [payload for _, payload in sources]
    asked = tuple(robot_key(run, played.scenario.ids[k], "observation") for k in (0, -1))
    figures: Counter[str] = Counter()
    for number in range(count):
        begin, at = number * len(true) // count, (number + 1) * len(true) // count
        for key, payload in true[begin:at]:
            for receiver in everybody.values():
                receiver.hear(key, payload)
        key, payload = _chosen(draws, true[at : at + AHEAD], asked, sources, others)
        change, packet = mutant(draws, payload, payloads)
        if draws.random() < OTHER_KEY_SHARE:
            key = draws.choice((draws.choice(sources)[0], *_strange_keys(run)))
        figures[f"made: {change}"] += 1
        figures[f"key: {key.rsplit('/', 1)[-1][:20]}"] += 1
        watched = (seed * count + number) % WATCHED_EVERY == 0
        for name, receiver in everybody.items():
            outcome = _given(name, receiver, key, packet, watched)
            figures[f"{name}: {outcome}"] += 1
            figures["given"] += 1
        figures["watched"] += watched
    figures["packets"] = count
    return figures


def _chosen(
    draws: random.Random,
    following: Sequence[Message],
    asked: Sequence[str],
    sources: Sequence[Message],
    others: Sequence[Message],
) -> Message:
    """What is changed: mostly what is about to come, so that it is in turn; else anything."""
    kind = draws.random()
    if kind < 0.3:
        observations = [message for message in following if message[0] in asked]
        if observations:
            return observations[draws.randrange(min(2, len(observations)))]
    if kind < 0.8 and following:
        return draws.choice(following[:NEAR])
    return draws.choice(others if kind > 0.95 else sources)


def _strange_keys(run: str) -> tuple[str, ...]:
    return (
        "",
        "elsewhere",
        world_key(run, "about"),
        robot_key("another", "r1", "pose"),
        robot_key(run, "r77", "command"),
        f"encircle/{run}/robots/../pose",
        "/" * 300,
    )


def _others(scenario: Scenario, run: str, everybody: dict[str, Receiver]) -> list[Message]:
    """What is sent beside a run: answers of nodes, and ROS 2's commands."""
    described = RunDescription(run, scenario.seed, scenario.model_dump_json())
    made = [
        (world_key(run, "about"), info_replier("world", lambda: 5)()),
        (world_key(run, "scenario"), encode_description(described)),
    ]
    commands = everybody["ROS 2 commands"]
    assert isinstance(commands, RosCommands)
    return made + [("0/r1/cmd_vel", payload) for payload in commands.valid]


def _given(name: str, receiver: Receiver, key: str, packet: bytes, watched: bool) -> str:
    try:
        return watch(receiver, key, packet) if watched else receiver.give(key, packet)
    except Exception as error:
        error.add_note(f"{name} on {key}, {len(packet)} bytes: {packet[:2000].hex()}")
        raise


def watch(receiver: Receiver, key: str, packet: bytes) -> str:
    """Give a packet, and hold the memory and the calls that it takes against its length."""
    calls = 0

    def count(_frame: Any, _event: str, _argument: Any) -> None:
        nonlocal calls
        calls += 1

    tracemalloc.start()
    sys.setprofile(count)
    try:
        outcome = receiver.give(key, packet)
    finally:
        sys.setprofile(None)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert peak <= PEAK_BYTES_MAX + PEAK_PER_BYTE * len(packet), f"{peak} bytes of memory"
    assert calls <= CALLS_MAX + CALLS_PER_BYTE * len(packet), f"{calls} calls"
    return outcome
