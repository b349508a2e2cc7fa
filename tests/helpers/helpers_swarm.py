"""Short random hunts with everything wrong that can go wrong, and a witness who watches them.

A seed makes a scenario (``helpers_scenarios``) and a fate (who is killed, frozen or cut off
and when, what strangers send, what is given to the run by hand). ``play`` runs both cores on bytes
alone, answers in random order; the witness sees the messages that the world records and the state
it keeps, and nothing else. Some teams have a robot that says whatever a payload may hold
(``helpers_talker``).
"""

import random
from collections import Counter
from dataclasses import replace
from typing import NamedTuple

import helpers_talker
import msgpack
from helpers_interventions import drawn_event
from helpers_scenarios import scenario_of
from helpers_witness import Witness

from encircle.agents.brain.robot_core import RobotCore
from encircle.protocol import VERSION
from encircle.protocol.codec import decode, encode
from encircle.protocol.keys import parse_key, robot_key, world_key
from encircle.protocol.messages import Command, Observation
from encircle.world.arena.engine import build
from encircle.world.coordinator.membership import DepartureCause
from encircle.world.coordinator.result import Result
from encircle.world.coordinator.world_core import WorldCore
from encircle.world.loading.interventions import InterventionRefused
from encircle.world.loading.load import load
from encircle.world.scenario.model import Scenario

RUN = "swarm"
JUNK_BYTES_MAX = 80
FAULTS_PER_TICK = 0.025
JUNK_PER_TICK = 0.3
ASK_AGAIN = 0.05
RECKLESS, RECKLESS_SHARE = 1e6, 0.4
BY_HAND_SHARE, BY_HAND_PER_TICK = 0.4, 0.15
TALKER_SHARE = 0.25
FLICKER_SHARE = 0.25


def play(
    seed: int, junk: bool = True, faults: bool = True, order: int = 0, ahead: bool = True
) -> Result:
    """One run of a seed, watched. ``faults``: robots are struck, and some command what they like.

    ``junk``: strangers send something. ``order``: another one has robots answer in another order.
    ``ahead``: the world works ahead while they do.
    """
    return _Run(seed, junk, faults, order, ahead).play()


class Played(NamedTuple):
    """A run of a seed as it was recorded, and who commanded what it liked.

    ``scenario``: as written; ``faults``: by kind, how many there were.
    """

    scenario: Scenario
    messages: list[tuple[int, str, bytes]]
    reckless: frozenset[str]
    result: Result
    faults: Counter[str]


def recorded(seed: int, junk: bool = False, faults: bool = True, ahead: bool = False) -> Played:
    """The messages of a run with faults, as a recording holds them."""
    run, messages = _Run(seed, junk, faults, 0, ahead), []

    def record(tick: int, key: str, payload: bytes) -> None:
        messages.append((tick, key.removeprefix(f"encircle/{RUN}/"), payload))
        run.witness.record(tick, key, payload)

    run.world.record_with(record)
    result = run.play()
    counted = run.faults + run.witness.faults
    counted.update(f"event {event.kind}" for event in run.scenario.events)
    return Played(run.scenario, messages, frozenset(run.reckless), result, counted)


def swarm_scenario(seed: int) -> Scenario:
    """The scenario of a seed; in some, one robot talks."""
    scenario = scenario_of(seed)
    draws = random.Random(f"swarm talker {seed}")
    if draws.random() >= TALKER_SHARE:
        return scenario
    robot = draws.choice(scenario.ids)
    return load(scenario.model_dump(), [f"team.robots.{robot}.strategy={helpers_talker.POLICY}"])


class _Run:
    """The world, the robots, and what befalls them."""

    def __init__(self, seed: int, junk: bool, faults: bool, order: int, ahead: bool) -> None:
        self.scenario = swarm_scenario(seed)
        self.arena = build(self.scenario, self.scenario.seed)
        self.witness = Witness(self.arena, RUN)
        self.world = WorldCore(self.arena, RUN, record=self.witness.record)
        self.robots = {robot: self._robot(robot) for robot in self.arena.ids}
        # What strangers send must not change who is killed when.
        self.fate = random.Random(f"swarm fate {seed}") if faults else None
        self.strangers = random.Random(f"swarm junk {seed}") if junk else None
        self.ahead = ahead
        self.order = random.Random(f"swarm order {seed} {order}")
        draws = random.Random(f"swarm reckless {seed}")
        share = RECKLESS_SHARE if faults and draws.random() < RECKLESS_SHARE else 0.0
        self.reckless = {robot for robot in self.arena.ids if draws.random() < share}
        by_hand = random.Random(f"swarm by hand {seed}")
        self.by_hand = by_hand if faults and by_hand.random() < BY_HAND_SHARE else None
        self.flicker = random.Random(f"swarm flicker {seed}")
        self.faults: Counter[str] = Counter()
        self.back: dict[str, int] = {}
        self.frozen: dict[str, list[tuple[str, bytes]]] = {}

    def _robot(self, robot: str) -> RobotCore:
        return RobotCore(robot, RUN)

    def play(self) -> Result:
        """The run from its start to its end."""
        world = self.world
        for robot in self.arena.ids:
            self._hand_out(world.join(robot))
        asked = world.begin()
        # Ends: every round is a tick, and there are no more than ticks_max.
        for _ in range(self.scenario.ticks_max + 1):
            world.rounds.commit()
            self.witness.look(world, self.robots.values())
            if world.ended is not None:
                break
            if self.ahead:
                world.rounds.foresee()
            asked = self._round(asked)
        world.rounds.commit()
        assert world.ended is not None, "the run has not ended by ticks_max"
        self._hand_out(asked)
        result = world.rounds.result()
        self.witness.ended(result, self.robots.values())
        return result

    def _hand_out(self, messages: list[tuple[str, bytes]]) -> list[tuple[str, bytes]]:
        """Give messages to the robots they are for; returns what those that live say."""
        said = []
        for key, payload in messages:
            robot = parse_key(key).robot or ""
            if robot in self.frozen:
                self.frozen[robot].append((key, payload))
            elif robot not in self.back:
                said += self.robots[robot].receive(key, payload)
        return said

    def _round(self, asked: list[tuple[str, bytes]]) -> list[tuple[str, bytes]]:
        """One tick; returns what the world sends for the next."""
        world, tick = self.world, self.world.state.tick
        for robot in [r for r, due in self.back.items() if due <= tick]:
            del self.back[robot]
            self._bring_back(robot)
        struck = self._struck(tick)
        self._intervene()
        answers = [self._reckless(*said) for said in self._hand_out(self._poisoned(asked))]
        self.order.shuffle(answers)
        again = self._hand_out(world.rounds.unanswered()) if self.order.random() < ASK_AGAIN else []
        following: list[tuple[str, bytes]] = []
        for key, payload in answers:
            robot = parse_key(key).robot or ""
            if struck.get(robot) == 0:
                struck.pop(robot)
                following += self._strike(robot)
            if robot in struck:
                struck[robot] -= 1
            self._stray()
            if robot not in self.back:
                following += world.receive(key, payload)
        for robot in struck:
            following += self._strike(robot)
        self.faults["asked again"] += bool(again)
        for key, payload in again:
            assert world.receive(key, payload) == [], "what is answered twice counts once"
        # Others are for who looks on: events of rounds in which no robot was there.
        return [message for message in following if parse_key(message[0]).robot]

    def _intervene(self) -> None:
        """Somebody gives the run an event by hand, which it may refuse."""
        draws = self.by_hand
        if draws is None or draws.random() > BY_HAND_PER_TICK:
            return
        event = drawn_event(draws, self.arena.ids)
        if draws.random() < 0.3:
            event["tick"] = self.world.state.tick + draws.randint(0, 10)
        if event["kind"] not in ("move-target", "heal") and draws.random() < 0.7:
            event["ticks"] = draws.randint(1, 15)
        try:
            self.world.intervene(event)
        except InterventionRefused:
            self.faults["by hand, refused"] += 1
        else:
            self.faults[f"by hand {event['kind']}"] += 1

    def _reckless(self, key: str, payload: bytes) -> tuple[str, bytes]:
        """What a robot says, but that some command to run into the target, as fast as can be."""
        robot, channel = key.split("/")[-2:]
        if channel != "command" or robot not in self.reckless:
            return key, payload
        places = self.world.state.positions
        away = places[len(self.arena.ids)] - places[self.arena.ids.index(robot)]
        x, y = (RECKLESS * away).tolist()
        self.faults["reckless command"] += 1
        return key, encode(replace(decode(Command, payload, RUN), step=(x, y)), RUN)

    def _struck(self, tick: int) -> dict[str, int]:
        """Who is lost in this round, each after how many of its messages; some stay, always."""
        if self.fate is None:
            return {}
        struck = {}
        here = [r for r in self.arena.ids if r not in self.back and r not in self.world.rounds.lost]
        for robot in self.arena.ids:
            hit, after = self.fate.random() < FAULTS_PER_TICK, self.fate.randint(0, 2)
            if hit and robot in here:
                struck[robot] = after
        return struck

    def _strike(self, robot: str) -> list[tuple[str, bytes]]:
        """A robot dies or freezes, and the world notices."""
        assert self.fate is not None
        if self.world.ended is not None or robot in self.back:
            return []
        tick = self.world.state.tick
        self.witness.struck(robot, tick)
        self.back[robot] = tick + self.fate.randint(1, 20)
        if self.fate.random() < 0.5:
            self.frozen[robot] = []
        self.faults["freeze" if robot in self.frozen else "kill"] += 1
        following = self.world.leave(robot, DepartureCause.NO_ANSWER)
        if self.flicker.random() < FLICKER_SHARE and self.world.state.tick == tick:
            # It is back before the round in which it was lost is over.
            del self.back[robot]
            self._bring_back(robot)
            self.faults["back in the same round"] += 1
        return following

    def _bring_back(self, robot: str) -> None:
        """A robot that was killed is started again; one that was frozen says what it still had."""
        self.faults["return"] += 1
        if robot in self.frozen:
            late = self.frozen.pop(robot)
            for key, payload in late:
                for said in self.robots[robot].receive(key, payload):
                    assert self.world.receive(*said) == [], "a late answer counts for nothing"
        else:
            self.robots[robot] = self._robot(robot)
        assert self.world.join(robot) == [], "its setup comes with its next observation"
        self.witness.returned(robot, self.world.state.tick)

    def _poisoned(self, asked: list[tuple[str, bytes]]) -> list[tuple[str, bytes]]:
        """Observations with strangers' packets in their inboxes, and junk beside them."""
        draws = self.strangers
        if draws is None or draws.random() > JUNK_PER_TICK:
            return asked
        changed = []
        for key, payload in asked:
            if key.endswith("/observation"):
                body = msgpack.unpackb(payload)
                assert decode(Observation, payload, RUN).robot == body["robot"]
                body["inbox"].insert(draws.randint(0, len(body["inbox"])), junk_bytes(draws))
                self.faults["garbage in an inbox"] += 1
                changed.append((key, msgpack.packb(body)))
            else:
                changed.append((key, payload))
            robot = parse_key(key).robot or ""
            channel = draws.choice(("observation", "setup", "command", "end"))
            changed.append((robot_key(RUN, robot, channel), junk_bytes(draws)))
            self.faults["garbage to a robot"] += 1
        return changed

    def _stray(self) -> None:
        """A stranger sends the world something; nothing comes of it."""
        draws = self.strangers
        if draws is None or draws.random() > JUNK_PER_TICK:
            return
        robot = draws.choice((*self.arena.ids, "r77"))
        key = draws.choice(
            (
                robot_key(RUN, robot, "pose"),
                robot_key(RUN, robot, "command"),
                robot_key(RUN, robot, "observation"),
                robot_key("another", robot, "pose"),
                world_key(RUN, "state"),
                "elsewhere",
            )
        )
        self.faults["garbage to the world"] += 1
        before = sum(self.world.rounds.refused.values())
        assert self.world.receive(key, junk_bytes(draws)) == []
        assert sum(self.world.rounds.refused.values()) == before + 1


def junk_bytes(draws: random.Random) -> bytes:
    """Bytes that are no message: noise, another version, half a message, a map of nonsense."""
    kind = draws.randrange(4)
    if kind == 0:
        return draws.randbytes(draws.randint(0, JUNK_BYTES_MAX))
    if kind == 1:
        return bytes(msgpack.packb({"v": VERSION + 1, "run": RUN, "robot": "r1", "tick": 0}))
    if kind == 2:
        return bytes(msgpack.packb({"v": VERSION, "run": RUN, "robot": draws.randint(0, 9)}))
    return bytes(msgpack.packb([None, {"x": [1.0] * draws.randint(0, 9)}]))
