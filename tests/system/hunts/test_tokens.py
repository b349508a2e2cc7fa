"""Liveliness tokens of strangers: one on an expression is nobody's, whatever it matches.

A token may be declared on ``**`` and then matches the key of every node. Zenoh tells of it by its
own expression, beside those that it matches, which come and go as if it were not there.
"""

import asyncio
import queue
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from functools import partial

import pytest
import zenoh
from helpers_agents import BODIES
from helpers_hosts import NodeProcess, wait_for_robots
from helpers_hunt import ROBOTS
from helpers_paths import STRANGER as STRANGER_FOLDER
from helpers_protocol_page import program
from helpers_security import Lab, free_endpoint
from helpers_waiting import LONGEST_S, taken, until

from encircle.agents.brain.robot_core import RobotCore
from encircle.agents.process.real_time import is_timed
from encircle.agents.process.robot_runs import RobotRuns
from encircle.agents.process.world_watch import RobotEnd, WorldWatch
from encircle.protocol.codec import encode
from encircle.protocol.errors import UnknownKey
from encircle.protocol.keys import robot_key, world_key
from encircle.protocol.messages import Observation, Setup
from encircle.protocol.programs.router import Tokens
from encircle.protocol.zenoh import liveliness as one_of_a_name
from encircle.protocol.zenoh.endpoints import Endpoints
from encircle.protocol.zenoh.liveliness import (
    NameInUse,
    alive_keys,
    check_name_free,
    is_alive,
    subscribe_alive,
)
from encircle.protocol.zenoh.session import open_session

STRANGER = STRANGER_FOLDER / "robot.py"
RUN = "faulty"
R1, WORLD = robot_key(RUN, "r1", "alive"), world_key(RUN, "alive")
WILD = (
    "**",
    "encircle/**",
    f"encircle/{RUN}/**",
    "encircle/*/robots/r1/alive",
    "encircle/*/world/alive",
    f"encircle/{RUN}/*/alive",
    f"encircle/{RUN}/robots/*/alive",
    f"encircle/{RUN}/robots/r$*/alive",
)


class Net:
    """A world, a robot and a stranger as bare sessions, reaching each other in one of the ways."""

    def __init__(self, way: str, closing: ExitStack, lab: Lab | None) -> None:
        self._closing, self._lab = closing, lab
        self._endpoint = free_endpoint("tls" if lab else "tcp")
        if way == "router":
            self._open("router", True)
        self.world = self._open("world", way == "direct")
        self.robot = self._open("r1", False)

    def stranger(self, name: str = "viewer") -> zenoh.Session:
        return self._open(name, False)

    def _open(self, name: str, listens: bool) -> zenoh.Session:
        mode = "router" if name == "router" else "peer" if listens else "client"
        identity = self._lab.identity(name) if self._lab else None
        ends = {"listen" if listens else "connect": (self._endpoint,)}
        access = Endpoints(**ends, mode=mode, identity=identity, connect_s_max=LONGEST_S)
        return self._closing.enter_context(open_session(access))


@pytest.fixture
def closing() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


@pytest.fixture(scope="module")
def lab(tmp_path_factory) -> Lab:
    return Lab(tmp_path_factory.mktemp("tokens"))


WAYS = pytest.mark.parametrize("way", ["direct", "router"])


def watched(session, expression):
    seen = queue.Queue()
    return seen, subscribe_alive(session, expression, lambda *change: seen.put(change))


def opened(endpoint) -> zenoh.Session:
    return open_session(Endpoints(connect=(endpoint,), connect_s_max=LONGEST_S))


@WAYS
def test_of_all_tokens_that_match_only_the_partys_own_is_told_of(way, closing, monkeypatch):
    monkeypatch.setattr(one_of_a_name, "LOOK_S_MAX", LONGEST_S)  # however slow this machine is
    net = Net(way, closing, None)
    stranger = net.stranger()
    early = [stranger.liveliness().declare_token(key) for key in WILD]
    until(lambda: is_there(net.world, "**") and is_there(net.robot, "**"), "the first token")
    seen = [watched(net.robot, WORLD), watched(net.world, robot_key(RUN, "*", "alive"))]
    for session, key in ((net.robot, WORLD), (net.world, R1)):
        assert not is_alive(session, key, LONGEST_S)
        check_name_free(session, key, "party", s_max=0.0)
    assert alive_keys(net.world, robot_key(RUN, "*", "alive"), LONGEST_S) == set()

    def go_through(withdrawn) -> None:
        """A robot and a world come and go, and are told of in between."""
        tokens = [
            net.world.liveliness().declare_token(WORLD),
            net.robot.liveliness().declare_token(R1),
        ]
        for (told, _), key in zip(seen, (WORLD, R1), strict=True):
            assert taken(told) == (key, True)
        for token in withdrawn:
            token.undeclare()
        # Zenoh may overlook a token in the moment after it was declared, and tell of it twice.
        until(lambda: alive_keys(stranger, f"encircle/{RUN}/**", LONGEST_S) == {WORLD, R1}, "both")
        for session, key in ((net.robot, WORLD), (net.world, R1)):
            until(partial(is_alive, session, key, LONGEST_S), key)
            until(partial(is_taken, session, key), "the name to be taken")
        for token in tokens:
            token.undeclare()
        for (told, _), key in zip(seen, (WORLD, R1), strict=True):
            while (change := taken(told)) == (key, True):
                pass
            assert change == (key, False)

    go_through([])  # while all are kept
    go_through(early)
    go_through([stranger.liveliness().declare_token(key) for key in WILD])


def is_taken(session, key) -> bool:
    try:
        check_name_free(session, key, "party", s_max=0.0)
    except NameInUse:
        return True
    return False


def is_there(session, key):
    """Whether a token is, as Zenoh says it."""
    replies = session.liveliness().get(key, timeout=LONGEST_S)
    return any(str(reply.ok.key_expr) == key for reply in replies if reply.ok is not None)


@WAYS
def test_with_certificates_only_a_robots_own_expression_comes_through_and_is_not_told_of(
    way, lab, closing
):
    net = Net(way, closing, lab)
    seen = [watched(net.robot, WORLD), watched(net.world, robot_key(RUN, "*", "alive"))]
    tokens = [
        stranger.liveliness().declare_token(key)
        for stranger in (net.stranger("viewer"), net.stranger("r2"))
        for key in (*WILD, "encircle/*/robots/r2/alive")
    ]
    own = "encircle/*/robots/r2/alive"
    until(lambda: is_there(net.world, own), "the token that may be")
    replies = list(net.world.liveliness().get(robot_key(RUN, "*", "alive"), timeout=LONGEST_S))
    assert {str(reply.ok.key_expr) for reply in replies if reply.ok is not None} <= {own}
    for token in tokens:
        token.undeclare()
    _kept = (
        net.world.liveliness().declare_token(WORLD),
        net.robot.liveliness().declare_token(R1),
    )
    for (told, _), key in zip(seen, (WORLD, R1), strict=True):
        assert taken(told) == (key, True)


@pytest.mark.parametrize("how", ["--listen", "--connect"])
def test_a_hunt_goes_on_as_if_the_tokens_of_strangers_were_not_there(hunt, how, closing):
    if how == "--connect":
        hunt.start_router()
        stranger = closing.enter_context(opened(hunt.endpoint))
        kept = [stranger.liveliness().declare_token(key) for key in WILD]
        hunt.start_world(how)
    else:
        hunt.start_world(how)
        stranger = closing.enter_context(opened(hunt.endpoint))
        kept = [stranger.liveliness().declare_token(key) for key in WILD]
    for robot in ROBOTS:
        hunt.start_robot(robot)
    hunt.wait_for_ticks()
    for round_of in (kept, [stranger.liveliness().declare_token(key) for key in WILD]):
        for token in round_of:
            token.undeclare()
        # What everybody answers cannot have overtaken what was withdrawn before.
        assert len(list(stranger.get(f"encircle/{RUN}/**/about", timeout=LONGEST_S))) == 5
        hunt.wait_for_ticks()
    assert hunt.departures == []
    assert not any("gone" in node.said for node in hunt.robots.values())

    kept = [stranger.liveliness().declare_token(key) for key in WILD]
    hunt.robots["r1"].kill()
    hunt.wait_for(lambda seen: seen == [("r1", "lost: it is gone")])
    hunt.start_robot("r1")
    hunt.wait_for(lambda seen: seen[1:] == [("r1", "back")])
    hunt.wait_for_ticks()
    hunt.world.kill()
    for robot in ROBOTS:
        hunt.robots[robot].wait_until(lambda node: "is gone: standing still" in node.said)


def test_a_router_for_one_run_is_not_ended_by_tokens_that_are_none():
    tokens = Tokens()
    for key in (WORLD, R1):
        tokens.change(key, True, 0.0)
    with pytest.raises(UnknownKey):
        tokens.change("encircle/faulty/robots/\x1b[2J/alive", True, 0.0)
    assert tokens.alive == {WORLD, R1}
    assert not tokens.over(100.0)


def test_robots_written_from_the_page_alone_stay_as_well(hunt, closing, tmp_path):
    page = tmp_path / "page.py"
    page.write_text(program("A whole robot"))
    hunt.start_world()
    stranger = closing.enter_context(opened(hunt.endpoint))
    kept = [stranger.liveliness().declare_token(key) for key in WILD]
    for robot in ROBOTS[:2]:
        hunt.start_robot(robot)
    wait_for_robots(hunt.endpoint, RUN, 2)
    for robot, script in (("r3", STRANGER), ("r4", page)):
        command = [sys.executable, str(script), robot, RUN, hunt.endpoint]
        hunt.nodes.append(NodeProcess(command, tmp_path / robot, {}))
    hunt.wait_for_ticks()
    for token in kept:
        token.undeclare()
    assert len(list(stranger.get(f"encircle/{RUN}/**/about", timeout=LONGEST_S))) == 3
    hunt.wait_for_ticks()
    assert hunt.departures == []
    hunt.world.kill()
    assert hunt.nodes[-1].end() == 1


class Timers:
    """The timers of an event loop whose times come when a test says so."""

    def __init__(self) -> None:
        self._waiting: list[tuple[float, asyncio.Event, Callable[[], None]]] = []

    def call_later(self, delay_s, call, *arguments):
        cancelled = asyncio.Event()
        cancelled.cancel = cancelled.set
        self._waiting.append((delay_s, cancelled, partial(call, *arguments)))
        return cancelled

    def fire(self, delay_s_max: float = LONGEST_S) -> None:
        """All that wait now, once; those alone that wait no longer than that."""
        waiting, self._waiting = self._waiting, []
        for delay_s, cancelled, call in waiting:
            if delay_s > delay_s_max:
                self._waiting.append((delay_s, cancelled, call))
            elif not cancelled.is_set():
                call()


class World:
    """What a robot hears of a world, without one: messages as they would come."""

    def __init__(self, world_s_max: float = LONGEST_S) -> None:
        self.said: list[str] = []
        self.runs = RobotRuns("r1", RUN, self.said.append, rejoins=False)
        self.end = RobotEnd()
        self.watch = WorldWatch(
            self.runs, self.end, self.said.append, "the world", LONGEST_S, world_s_max
        )
        self.timers = Timers()
        self.watch._loop = self.timers
        self.tick = 0
        setup = Setup("r1", ("r1", "r2"), 0.1, "xi-star", BODIES)
        assert self.runs.core.receive(robot_key(RUN, "r1", "setup"), encode(setup, RUN)) == []

    def ask(self, payload: bytes | None = None) -> None:
        seen = Observation("r1", self.tick, (0.0, 0.0), 0.0, None, (6.0,) * 8, (), ())
        key = robot_key(RUN, "r1", "observation")
        if self.runs.core.receive(key, payload or encode(seen, RUN)):
            self.tick += 1

    def ask_again(self, payload: bytes | None = None) -> None:
        self.ask(payload)
        self.timers.fire()


def test_a_world_without_a_token_that_is_heard_is_there_and_one_that_is_not_is_gone():
    async def live() -> None:
        world = World()
        world.watch.world_changed(False)
        for _ in range(20):
            world.ask_again()
        assert world.said == []
        # What anybody may send is no word of the world's.
        world.ask_again(b"garbage")
        assert "is gone" in world.said[0]
        world.ask_again()
        assert "is back" in world.said[1]
        assert len(world.said) == 2
        world.watch.cancel()

    asyncio.run(live())


def test_what_anybody_may_send_does_not_keep_a_robot_waiting_for_a_world_for_ever():
    async def live() -> str:
        world = World()
        world.runs.core.setup = world.runs.core.config = None
        world.watch.await_admission()
        world.ask_again(b"garbage")
        return world.end.reason.result()

    assert "did not take this robot in" in asyncio.run(live())


@pytest.mark.parametrize("world_s_max", [LONGEST_S / 2.0, LONGEST_S * 2.0])
def test_a_robot_that_comes_as_the_run_ends_waits_as_long_as_ever_to_be_taken_in(world_s_max):
    async def live() -> tuple[list[str], str]:
        world = World(world_s_max)
        world.runs.core.setup = world.runs.core.config = None
        world.watch.await_admission()
        world.watch.world_changed(False)
        for _ in range(3):
            world.timers.fire(LONGEST_S / 2.0)
        assert not world.end.reason.done()
        world.timers.fire()
        return world.said, world.end.reason.result()

    said, reason = asyncio.run(live())
    assert said == ["the world is gone: waiting for one to take this robot in"]
    assert "did not take this robot in" in reason


@pytest.mark.parametrize("of_run", ["*", "another"])
def test_a_message_for_many_runs_does_not_tell_a_robot_that_its_world_goes_by_the_clock(of_run):
    core = RobotCore("r1", RUN)
    setup = Setup("r1", ("r1", "r2"), 0.1, "xi-star", BODIES)
    core.receive(robot_key(RUN, "r1", "setup"), encode(setup, RUN))
    seen = Observation("r1", 0, (0.0, 0.0), 0.0, None, (6.0,) * 8, (), (), sent_us=1)
    payload = encode(seen, RUN)
    assert is_timed(core, robot_key(of_run, "r1", "observation"), payload) is None
    assert is_timed(core, robot_key(RUN, "r1", "observation"), payload) is True
