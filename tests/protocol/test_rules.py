"""Every rule of docs/protocol.md for messages: what breaks one is refused, with its cause.

A rule stands here with the words of the page that make it and a message that breaks it, drawn anew
for each seed. Two nodes are in the same state; one of them gets that message. Then both get the
same sound messages, and go on alike but for what they count as refused. What each field may hold
for itself is in ``test_codec_refusals.py``.
"""

import random
from collections.abc import Callable
from dataclasses import replace
from math import inf, nan, nextafter, pi
from typing import Any, NamedTuple

import pytest
from helpers_agents import BODIES, TEAM, observation
from helpers_paths import DOCS
from helpers_real_time import EPOCH_US, by_clock
from helpers_real_time import RUN as CLOCKED
from helpers_world import RUN, answers, arena, begun, command, pose

from encircle.agents.brain.real_time_core import RealTimeRobotCore
from encircle.agents.brain.robot_core import RobotCore
from encircle.protocol.codec import BYTES_MAX, decode, encode
from encircle.protocol.keys import robot_key, world_key
from encircle.protocol.messages import CAUSE_CODE_MAX, Command, End, Observation, Setup
from encircle.protocol.wire.limits import REASON_MAX
from encircle.world.arena.engine import build
from encircle.world.channel.loss_causes import CAUSES
from encircle.world.coordinator.real_time_core import RealTimeWorldCore
from encircle.world.coordinator.world_core import WorldCore

PAGE = " ".join((DOCS / "protocol.md").read_text().split())
SEEDS = range(4)
TICK = 3
SETUP = Setup("r1", TEAM, 0.1, "xi-star", BODIES)
SEEN = observation("r1", TICK)
PEERS = [robot for robot in TEAM if robot != "r1"]
NAMES = "Names of runs and robots are 1 to 31 letters (A to Z, a to z), digits, `-` or `_`."
NO_NAMES = ("", "r 1", "x" * 32, "r1/r2", "\N{RIGHT-TO-LEFT OVERRIDE}1r", "*", "r\x1b[2J")


class Rule(NamedTuple):
    """``says``: the page's words. ``break_it(draws)``: key or channel, and message or payload."""

    says: str
    cause: str
    break_it: Callable[[random.Random], tuple[str, Any]]


def setup(says: str, cause: str, *changes: Callable[[random.Random], dict[str, Any]]) -> list[Rule]:
    return [Rule(says, cause, lambda d, c=c: ("setup", replace(SETUP, **c(d)))) for c in changes]


def seen(says: str, cause: str, *changes: Callable[[random.Random], dict[str, Any]]) -> list[Rule]:
    return [
        Rule(says, cause, lambda d, c=c: ("observation", replace(SEEN, **c(d)))) for c in changes
    ]


def end(says: str, cause: str, *ends: Callable[[random.Random], End]) -> list[Rule]:
    return [Rule(says, cause, lambda d, e=e: ("end", e(d))) for e in ends]


def without(names: dict[str, Any], name: str) -> dict[str, Any]:
    return {key: value for key, value in names.items() if key != name}


def rays(draws: random.Random, count: int, **wrong: float) -> dict[str, Any]:
    scan = [draws.uniform(0.0, BODIES["sensing_range_m"]) for _ in range(count)]
    if wrong:
        scan[draws.randrange(count)] = draws.choice(list(wrong.values()))
    return {"scan": tuple(scan)}


def sightings(*robots: str) -> dict[str, Any]:
    return {"seen": tuple((robot, 1.0, 2.0) for robot in robots)}


def disordered(draws: random.Random) -> list[str]:
    robots = draws.sample(PEERS, 2)
    return sorted(robots, reverse=True)


def text(draws: random.Random, size: int) -> str:
    return "".join(draws.choices("abc é", k=size))


HEARING = [
    *setup(
        "`parameters` always holds the bodies: `radius_m`, `target_radius_m`, `step_m_max`",
        "malformed",
        lambda d: {"parameters": {}},
        *(lambda d, n=name: {"parameters": without(BODIES, n)} for name in BODIES),
    ),
    *setup(
        "list of at most 256 texts",
        "malformed",
        lambda d: {"team": tuple(f"r{k + 1}" for k in range(d.randint(257, 400)))},
    ),
    *setup(
        "all robots, each once, in robot order",
        "malformed",
        lambda d: {"team": (*TEAM, d.choice(TEAM))},
        lambda d: {"team": ("r1", "r1")},
    ),
    *setup(NAMES, "malformed", lambda d: {"team": (*TEAM, d.choice(NO_NAMES))}),
    *setup(
        "the robot this is for",
        "wrong-sender",
        lambda d: {"robot": d.choice(PEERS)},
        lambda d: {"robot": ""},
        lambda d: {"team": tuple(PEERS)},
    ),
    *setup("real above 0", "malformed", lambda d: {"tick_s": d.choice((0.0, -d.random()))}),
    *setup(
        "who carries poses: `world` (they come in the inbox) or `direct`",
        "malformed",
        lambda d: {"radio": d.choice(("", "World", "both"))},
    ),
    *setup(
        "an `answer_tick` before `first_tick`",
        "malformed",
        lambda d: {"first_tick": d.randint(5, 9), "answer_tick": d.randint(0, 4)},
    ),
    *setup(
        "refuse a setup with a strategy or a parameter that they do not know",
        "malformed",
        lambda d: {"strategy": text(d, 5)},
        lambda d: {"parameters": BODIES | {text(d, 5): 1.0}},
    ),
    *seen("the robot this is for", "wrong-sender", lambda d: {"robot": d.choice([*PEERS, "r9"])}),
    *seen(
        "0 at first, then one more each time",
        "out-of-turn",
        lambda d: {"tick": d.randrange(TICK), "heading_rad": 0.1},
        lambda d: {"tick": TICK + d.randint(1, 2**40)},
    ),
    *seen(
        "-pi to pi",
        "malformed",
        lambda d: {"heading_rad": d.choice((1, -1)) * nextafter(pi, 4.0)},
        lambda d: {"heading_rad": d.choice((1, -1)) * d.uniform(3.15, 100.0)},
    ),
    *seen(
        "M is 8 to 360",
        "malformed",
        lambda d: rays(d, d.choice((0, 1, 7))),
        lambda d: rays(d, d.choice((361, 4000))),
    ),
    *seen(
        "from 0 to the sensing range",
        "malformed",
        lambda d: rays(d, d.randint(8, 360), below=-1e-9, far_below=-100.0),
        lambda d: rays(d, d.randint(8, 360), beyond=6.0001, far_beyond=1e6),
    ),
    *seen(
        "in sight: id, x, y, with the error of `position`, each once, in robot order",
        "malformed",
        lambda d: sightings("r1"),
        lambda d: sightings("r1", "r2"),
        lambda d: sightings(d.choice(("r9", "", "target"))),
        lambda d: sightings(*["r3"] * d.randint(2, 5)),
        lambda d: sightings(*disordered(d)),
    ),
    *seen(
        "the other robots that have [left](#leaving-and-coming-back) and are not back, each once,",
        "malformed",
        lambda d: {"lost": ("r1",)},
        lambda d: {"lost": ("r2", d.choice(("r9", "")))},
        lambda d: {"lost": ("r2",) * d.randint(2, 256)},
        lambda d: {"lost": tuple(disordered(d))},
    ),
    *seen(
        "Unix time in us; null in lock-step, where no clock may show",
        "malformed",
        lambda d: {"sent_us": d.randrange(2**50)},
        lambda d: {"sent_us": 0, "tick": TICK + d.randint(0, 9)},
    ),
    *seen(
        "null if it lets everything through, and in lock-step",
        "malformed",
        lambda d: {"admitted": ()},
        lambda d: {"admitted": (("r2", d.randrange(9)),)},
    ),
    *seen("in lock-step null", "malformed", lambda d: {"answered": d.randrange(TICK)}),
    *end("the robot this is for", "wrong-sender", lambda d: End(d.choice(PEERS), 1, "ticks")),
    *end(
        "`captured`, `ticks` (the scenario's limit is reached), or `failed: ` and why",
        "malformed",
        lambda d: End("r1", TICK, text(d, 9)),
        lambda d: End("r1", TICK, d.choice(("", "Captured", "failed:", "failed"))),
    ),
    *end(
        f"at most {REASON_MAX} characters in all",
        "malformed",
        lambda d: End("r1", TICK, "failed: " + text(d, d.randint(193, 248))),
    ),
    *(
        Rule("longer than the limit of its kind", "oversized", lambda d, k=k, c=c: (c, b"\0" * k))
        for c, k in (
            ("setup", BYTES_MAX[Setup] + 1),
            ("observation", BYTES_MAX[Observation] + 1),
            ("end", BYTES_MAX[End] + 1),
        )
    ),
    Rule(
        "a channel that is not in the table of keys",
        "unknown-key",
        lambda d: (robot_key(RUN, "r1", d.choice(("about", "x", "*"))), SEEN),
    ),
    Rule(NAMES, "unknown-key", lambda d: (robot_key(RUN, d.choice(NO_NAMES), "end"), SEEN)),
    Rule(NAMES, "unknown-key", lambda d: (robot_key(d.choice(NO_NAMES), "r1", "end"), SEEN)),
    Rule(
        "`run` is not this run's name",
        "wrong-run",
        lambda d: (robot_key("another", "r1", "observation"), SEEN),
    ),
    Rule(
        "a channel that is a robot's own to send",
        "out-of-turn",
        lambda d: (d.choice(("pose", "command")), SEEN),
    ),
]

BY_CLOCK = [
    *(r for r in HEARING if "in lock-step" not in r.says and "each time" not in r.says),
    *seen(
        "Unix time in us; null in lock-step, where no clock may show",
        "malformed",
        lambda d: {"sent_us": None},
    ),
    *seen(
        "the tick of this robot's newest command that has come since its setup",
        "malformed",
        lambda d: {"answered": TICK + d.randint(0, 9)},
    ),
    *seen(
        "the packets, by sender and sequence, that the modelled radio lets through at this tick",
        "malformed",
        lambda d: {"admitted": (("r2", 0), (d.choice(("r1", "r9", "")), d.randrange(9)))},
    ),
    *seen("an empty `inbox`", "malformed", lambda d: {"inbox": (b"",)}),
]


def nested(depth: int) -> Any:
    value: Any = {}
    for _ in range(depth - 1):
        value = {"x": value}
    return value


SAYING = [
    Rule(
        "the sender's clock as it sent this, Unix time in us; null in lock-step",
        "malformed",
        lambda d: ("pose", pose("r1", 1, sent_us=d.randrange(2**50))),
    ),
    Rule(
        "null in lock-step; else when, by the robot's clock in us, the observation came",
        "malformed",
        lambda d: ("command", command("r1", 1, timing=(1, d.randrange(9), ()))),
    ),
    Rule(
        "`robot` is not the one in the key",
        "wrong-sender",
        lambda d: ("pose", pose(d.choice(PEERS), 1)),
    ),
    Rule(
        "`robot` is not the one in the key",
        "wrong-sender",
        lambda d: ("command", command(d.choice(["r9", *PEERS]), 1)),
    ),
    Rule(
        "a robot not in the team",
        "out-of-turn",
        lambda d: (robot_key(RUN, "r9", "pose"), pose("r9", 1)),
    ),
    Rule(
        "carrying its tick",
        "out-of-turn",
        lambda d: ("command", command("r1", d.choice((0, 2, 2**40)), published=d.random() < 0.5)),
    ),
    Rule("carrying its tick", "out-of-turn", lambda d: ("pose", pose("r1", d.choice((0, 2))))),
    Rule(
        "list of at most 16 [text, count, real, real]",
        "malformed",
        lambda d: ("pose", pose("r1", 1, relayed=(("r2", 0, 1.0, 1.0),) * d.randint(17, 30))),
    ),
    Rule(
        "nested 6 deep at most",
        "malformed",
        lambda d: ("pose", pose("r1", 1, say=nested(d.randint(7, 40)))),
    ),
    Rule(
        "at most 1,024 bytes",
        "malformed",
        lambda d: ("pose", pose("r1", 1, say={"x": b"x" * d.randint(1019, 2000)})),
    ),
    Rule(
        "a real that is not finite",
        "malformed",
        lambda d: ("pose", pose("r1", 1, say={"x": [d.choice((nan, inf, -inf))]})),
    ),
    Rule(
        "of magnitude up to 2^53 - 1",
        "malformed",
        lambda d: ("pose", pose("r1", 1, say={"x": d.choice((2**53, -(2**53), 2**64 - 1))})),
    ),
    Rule(
        "a name that is no text",
        "malformed",
        lambda d: ("pose", pose("r1", 1, say={"x": {d.choice((1, None, b"x")): 1}})),
    ),
    Rule(
        "list of at most 256 texts",
        "malformed",
        lambda d: ("command", command("r1", 1, team=("r1",) * 257)),
    ),
    Rule(
        "a channel that is the world's own to send",
        "out-of-turn",
        lambda d: (d.choice(("setup", "observation", "end")), b""),
    ),
    Rule("a channel that is the world's", "out-of-turn", lambda d: (world_key(RUN, "state"), b"")),
    Rule(NAMES, "unknown-key", lambda d: (robot_key(RUN, d.choice(NO_NAMES), "pose"), b"")),
    Rule("`run` is not this", "wrong-run", lambda d: (robot_key("x", "r1", "pose"), b"")),
    Rule("longer than", "oversized", lambda d: ("pose", b"\0" * 4097)),
    Rule("longer than", "oversized", lambda d: ("command", b"\0" * 16_385)),
]


def stopping(draws: random.Random, **changes: Any) -> Command:
    still = command("r1", 1, mode="stop", published=False, timing=(1, 2, ()))
    return replace(still, **changes)


PACED = [
    *(r for r in SAYING if "lock-step" not in r.says and "its tick" not in r.says),
    Rule(
        "not later than that of the robot's newest command",
        "out-of-turn",
        lambda d: ("command", command("r1", d.choice((0, 1)), timing=(1, 2, ()))),
    ),
    Rule(
        "or later than the world's",
        "out-of-turn",
        lambda d: ("command", command("r1", d.choice((3, 2**40)), timing=(1, 2, ()))),
    ),
    Rule(
        "The world refuses one that is not higher than those before it",
        "out-of-turn",
        lambda d: ("pose", pose("r1", 2, sequence=d.choice((0, 1)), sent_us=1)),
    ),
    Rule(
        "an order to stand still, mode `stop`, for the tick of the newest command",
        "out-of-turn",
        lambda d: ("command", stopping(d, step=(d.uniform(0.01, 0.3), 0.0))),
    ),
    Rule(
        "an order to stand still, mode `stop`, for the tick of the newest command",
        "out-of-turn",
        lambda d: ("command", stopping(d, published=True)),
    ),
]


def cases(rules: list[Rule]) -> Any:
    numbered = [pytest.param(rule, id=f"{k}-{rule.says[:30]}") for k, rule in enumerate(rules)]
    return pytest.mark.parametrize("rule", numbered)


def broken(rule: Rule, seed: int, run: str, sharpen: Any = lambda m: m) -> tuple[str, bytes]:
    where, said = rule.break_it(random.Random(seed))
    payload = said if isinstance(said, bytes) else encode(sharpen(said), run)
    key = where.replace(RUN, run) if "/" in where else robot_key(run, "r1", where)
    return key, payload


@cases([*HEARING, *BY_CLOCK, *SAYING, *PACED])
def test_the_page_says_so(rule):
    assert rule.says in PAGE


class Robot:
    """In lock-step, having answered the ticks before ``TICK``."""

    def __init__(self) -> None:
        self.core = RobotCore("r1", RUN)
        self.tell("setup", SETUP)
        for tick in range(TICK):
            self.tell("observation", observation("r1", tick, target=(4.0, 0.1 * tick)))

    def tell(self, channel: str, message: Any) -> list[tuple[str, bytes]]:
        return self.core.receive(robot_key(RUN, "r1", channel), encode(message, RUN))

    def goes_on(self) -> list[Any]:
        said = [self.tell("observation", replace(SEEN, tick=TICK + k)) for k in range(3)]
        told = [replace(decode(Command, x[-1][1], RUN), refused={}) for x in said]
        self.tell("end", End("r1", TICK, "ticks"))
        return [*told, *(x[0] for x in said), self.core.ended, self.core.setup, self.core.accepted]


@cases(HEARING)
def test_a_robot_refuses_what_breaks_a_rule_and_goes_on_as_if_it_had_not_come(rule):
    for seed in SEEDS:
        robot, other = Robot(), Robot()
        assert robot.core.receive(*broken(rule, seed, RUN)) == []
        assert robot.core.refused == {rule.cause: 1}
        assert robot.goes_on() == other.goes_on()


class RobotByClock:
    def __init__(self) -> None:
        self.core = RobotCore("r1", CLOCKED)
        setup = replace(SETUP, radio="direct")
        self.core.receive(robot_key(CLOCKED, "r1", "setup"), encode(setup, CLOCKED))
        self.timed = RealTimeRobotCore(self.core)
        for tick in range(TICK):
            self.answer(observation("r1", tick))

    def answer(self, seen: Observation) -> list[Any]:
        payload = encode(by_the_clock(seen), CLOCKED)
        self.timed.take(seen.tick, robot_key(CLOCKED, "r1", "observation"), payload)
        action = self.timed.decide()
        said = self.timed.messages(action, 99)
        return [replace(decode(Command, said[-1][1], CLOCKED), refused={}), said[:-1]]

    def goes_on(self) -> list[Any]:
        told = [self.answer(replace(SEEN, tick=TICK + k)) for k in range(3)]
        counted = {name: self.core.refused[name] for name in ("missed", "passed-over")}
        return [told, counted, self.core.ended, self.core.setup, self.core.accepted]


def by_the_clock(message: Any) -> Any:
    """As a world by the clock says it."""
    if isinstance(message, Setup):
        return message if message.radio != "world" else replace(message, radio="direct")
    return replace(message, sent_us=7) if isinstance(message, Observation) else message


@cases(BY_CLOCK)
def test_a_robot_by_the_clock_refuses_what_breaks_a_rule(rule):
    clock_shows = by_the_clock if "no clock may show" not in rule.says else lambda m: m
    for seed in SEEDS:
        robot, other = RobotByClock(), RobotByClock()
        robot.timed.take(9, *broken(rule, seed, CLOCKED, clock_shows))
        assert robot.core.refused == {rule.cause: 1}
        assert robot.goes_on() == other.goes_on()


def test_admission_by_the_modelled_radio_is_for_robots_that_hear_each_other_alone():
    core = RobotCore("r1", RUN)
    core.receive(robot_key(RUN, "r1", "setup"), encode(SETUP, RUN))
    timed = RealTimeRobotCore(core)
    seen = replace(observation("r1", 0), sent_us=1, admitted=())
    timed.take(1, robot_key(RUN, "r1", "observation"), encode(seen, RUN))
    assert core.refused == {"malformed": 1}
    assert timed.decide() is None


def world() -> WorldCore:
    core = begun(WorldCore(arena(), RUN))
    for key, payload in answers(core):
        core.receive(key, payload)
    return core


@cases(SAYING)
def test_the_world_refuses_what_breaks_a_rule_and_the_run_is_the_same(rule):
    for seed in SEEDS:
        core, other = world(), world()
        assert core.receive(*broken(rule, seed, RUN)) == []
        assert core.rounds.refused == {rule.cause: 1}
        for each in (core, other):
            while each.ended is None:
                for key, payload in answers(each):
                    each.receive(key, payload)
        assert replace(core.rounds.result(), refused={}) == other.rounds.result()


@pytest.mark.parametrize("published", [True, False])
def test_an_answer_given_already_and_a_pose_that_was_not_announced_are_out_of_turn(published):
    core = world()
    core.receive(
        robot_key(RUN, "r1", "command"), encode(command("r1", 1, published=published), RUN)
    )
    again = [command("r1", 1, published=not published), command("r1", 1, published=published)]
    for said in again:
        core.receive(robot_key(RUN, "r1", "command"), encode(said, RUN))
    if not published:
        core.receive(robot_key(RUN, "r1", "pose"), encode(pose("r1", 1), RUN))
    assert core.rounds.refused == {"out-of-turn": 2 + (not published)}


def paced() -> RealTimeWorldCore:
    core = RealTimeWorldCore(build(by_clock("radio=direct"), 1), CLOCKED)
    for robot in core.arena.ids:
        core.join(robot)
    core.now_us = EPOCH_US
    core.begin()
    for tick in range(2):
        goes_by(core, tick)
    return core


def goes_by(core: RealTimeWorldCore, tick: int) -> None:
    for robot in core.arena.ids:
        said = command(robot, tick, (0.1, 0.0), timing=(1, 2, ()))
        packet = pose(robot, tick, sent_us=1)
        core.take(robot_key(CLOCKED, robot, "pose"), encode(packet, CLOCKED), EPOCH_US)
        core.take(robot_key(CLOCKED, robot, "command"), encode(said, CLOCKED), EPOCH_US)
    core.end_tick(EPOCH_US)


@cases(PACED)
def test_a_world_by_the_clock_refuses_what_breaks_a_rule(rule):
    for seed in SEEDS:
        core, other = paced(), paced()
        core.take(*broken(rule, seed, CLOCKED), EPOCH_US)
        assert core.rounds.refused == {rule.cause: 1}
        for each in (core, other):
            for tick in range(2, 5):
                goes_by(each, tick)
        assert replace(core.rounds.result(), refused={}) == other.rounds.result()
        assert core.answers.counts == other.answers.counts


def test_the_codes_of_causes_are_those_that_a_radio_may_tell():
    assert sorted(CAUSES) == list(range(1, CAUSE_CODE_MAX + 1))
