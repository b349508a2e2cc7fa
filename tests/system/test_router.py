"""The router as a process, what goes through it, and what is left when it was restarted."""

import json
import queue
import signal
import subprocess
import sys
import threading
import time
from contextlib import ExitStack

import pytest
from helpers_waiting import LONGEST_S, ample_s, completed, ended, taken, until

from encircle.protocol.keys import robot_key, world_key
from encircle.protocol.programs import router as router_program
from encircle.protocol.programs.router import END_S_MAX, Tokens
from encircle.protocol.zenoh import liveliness
from encircle.protocol.zenoh.connection import ZenohConnection
from encircle.protocol.zenoh.endpoints import Endpoints
from encircle.protocol.zenoh.liveliness import ROUTER_S_MAX
from encircle.runner.launch import free_endpoint

WORLD, R1, R2 = (
    world_key("t", "alive"),
    robot_key("t", "r1", "alive"),
    robot_key("t", "r2", "alive"),
)


class Router:
    """A router on a port of its own that can be stopped and started again."""

    def __init__(self, *options: str) -> None:
        self.endpoint = free_endpoint()
        self._options = options
        self.start()

    def start(self) -> None:
        command = [
            sys.executable,
            "-m",
            "encircle.protocol.programs.router",
            "--listen",
            self.endpoint,
        ]
        self.process = subprocess.Popen(
            [*command, *self._options], stderr=subprocess.PIPE, text=True
        )
        assert self.process.stderr is not None
        assert self.process.stderr.readline() == f"router: listening on {self.endpoint}\n"

    def end(self, number: signal.Signals) -> int:
        self.process.send_signal(number)
        return self.wait()

    def wait(self) -> int:
        return ended(self.process)

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        assert self.process.stderr is not None
        self.process.stderr.close()


@pytest.fixture
def closing():
    with ExitStack() as stack:
        yield stack


@pytest.fixture
def router(closing):
    made = Router()
    closing.callback(lambda: made.close())
    return made


def linked(router, closing, takes):
    link = ZenohConnection(Endpoints(connect=(router.endpoint,), connect_s_max=LONGEST_S), takes)
    closing.callback(link.close)
    return link


def watched(link, expression):
    seen = queue.Queue()
    link.watch(expression, lambda key, alive: seen.put((key, alive)))
    return seen


def changes(seen, count):
    return sorted(taken(seen) for _ in range(count))


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_it_ends_cleanly_when_asked_to(router, number):
    assert router.end(number) == 0
    assert router.process.stderr.read() == f"router: stopped by {number.name}\n"


def test_a_restarted_router_is_not_noticed_by_who_watches(router, closing, monkeypatch):
    """Tokens that come back are not told of; that others come later shows that all was seen."""
    monkeypatch.setattr("encircle.protocol.zenoh.liveliness.ROUTER_S_MAX", LONGEST_S)
    world = linked(router, closing, robot_key("t", "*", "*"))
    robot = linked(router, closing, robot_key("t", "r1", "*"))
    by_world, by_robot = watched(world, robot_key("t", "*", "alive")), watched(robot, WORLD)
    world.declare_alive(WORLD)
    robot.declare_alive(R1)
    assert (changes(by_world, 1), changes(by_robot, 1)) == ([(R1, True)], [(WORLD, True)])
    for number in (signal.SIGKILL, signal.SIGTERM):
        router.end(number)
        router.process.stderr.close()
        router.start()
    robot.declare_alive(R2)
    world.declare_alive(f"{WORLD}/again")
    assert changes(by_world, 1) == [(R2, True)]
    assert by_robot.empty()
    # Messages pass as before.
    key = robot_key("t", "r1", "setup")
    heard = threading.Thread(target=robot.receive, daemon=True)
    heard.start()

    def said():
        world.send(key, b"hello")
        return not heard.is_alive()

    until(said, "a message to come through")


def test_who_leaves_a_router_that_stays_is_told_of(router, closing):
    world = linked(router, closing, robot_key("t", "*", "*"))
    robot = linked(router, closing, robot_key("t", "r1", "*"))
    seen = watched(world, robot_key("t", "*", "alive"))
    robot.declare_alive(R1)
    assert changes(seen, 1) == [(R1, True)]
    robot.close()
    assert changes(seen, 1) == [(R1, False)]


def test_who_does_not_come_back_after_a_restart_is_told_of(router, closing, monkeypatch):
    # Zenoh tries for a connection once in a second or two; the router has to start before that.
    monkeypatch.setattr("encircle.protocol.zenoh.liveliness.ROUTER_S_MAX", 2.0 + 2.0 * ample_s())
    world = linked(router, closing, robot_key("t", "*", "*"))
    robots = [linked(router, closing, robot_key("t", robot, "*")) for robot in ("r1", "r2")]
    seen = watched(world, robot_key("t", "*", "alive"))
    robots[0].declare_alive(R1)
    robots[1].declare_alive(R2)
    assert changes(seen, 2) == [(R1, True), (R2, True)]
    router.end(signal.SIGKILL)
    router.process.stderr.close()
    robots[0].close()
    router.start()
    assert changes(seen, 1) == [(R1, False)]
    time.sleep(0.5)
    assert seen.empty()


def test_a_router_that_is_gone_for_too_long_takes_all_with_it(router, closing, monkeypatch):
    assert ROUTER_S_MAX > 5.0
    monkeypatch.setattr("encircle.protocol.zenoh.liveliness.ROUTER_S_MAX", 0.3)
    world = linked(router, closing, robot_key("t", "*", "*"))
    robot = linked(router, closing, robot_key("t", "r1", "*"))
    seen = watched(robot, WORLD)
    world.declare_alive(WORLD)
    assert changes(seen, 1) == [(WORLD, True)]
    router.end(signal.SIGKILL)
    assert changes(seen, 1) == [(WORLD, False)]


def test_a_router_for_one_run_ends_when_all_of_it_have_gone(closing):
    router = Router("--for-run", "t")
    closing.callback(router.close)
    other = linked(router, closing, "x/*")
    other.declare_alive(world_key("another", "alive"))
    robot = linked(router, closing, robot_key("t", "r1", "*"))
    robot.declare_alive(R1)
    world = linked(router, closing, robot_key("t", "*", "*"))
    seen = watched(world, R1)
    world.declare_alive(WORLD)
    assert changes(seen, 1) == [(R1, True)]
    assert router.process.poll() is None
    world.close()
    robot.close()
    assert router.wait() == 0


def test_a_router_for_one_run_watches_it_before_it_says_that_it_listens(monkeypatch):
    """Whoever waits for that line may come and go within a tenth of a second."""

    class Listens(Exception):
        pass

    watched_then: list[str] = []
    keep = liveliness.subscribe_alive

    def subscribe(session, expression, tell):
        watched_then.append(expression)
        return keep(session, expression, tell)

    def say(_line):
        raise Listens

    monkeypatch.setattr(router_program, "subscribe_alive", subscribe)
    monkeypatch.setattr(router_program, "say_error", say)
    with pytest.raises(Listens):
        router_program.main(["--listen", free_endpoint(), "--for-run", "t"])
    assert watched_then == [WORLD, robot_key("t", "*", "alive")]


def test_when_a_run_is_over():
    tokens = Tokens()
    assert not tokens.over(100.0)
    tokens.change(R1, True, 0.0)
    tokens.change(R1, False, 1.0)
    assert not tokens.over(100.0), "the world has yet to come"
    for key in (WORLD, R1, R2):
        tokens.change(key, True, 2.0)
    tokens.change(WORLD, False, 3.0)
    tokens.change(R1, False, 3.0)
    assert not tokens.over(3.0 + END_S_MAX), "r2 may still have its end message to read"
    assert tokens.over(3.1 + END_S_MAX)
    tokens.change(R2, False, 3.1)
    assert tokens.over(3.1)
    tokens.change(WORLD, True, 3.2)
    assert not tokens.over(100.0), "the same run again"


def refused(*arguments):
    done = completed([sys.executable, "-m", "encircle.protocol.programs.router", *arguments])
    return done.returncode, done.stderr.splitlines()[-1]


def test_a_port_in_use_is_one_clear_line(router):
    status, said = refused("--listen", router.endpoint)
    assert status == 1
    assert said.startswith(f"router: cannot listen on {router.endpoint}: ")
    assert "Address already in use" in said


def test_it_listens_beyond_this_machine_only_when_asked_to():
    status, said = refused("--listen", "tcp/0.0.0.0:0")
    assert status == 2
    assert "listen = tcp/0.0.0.0:0: other machines may reach it" in said


def test_a_router_needs_no_more_than_a_configuration_file(tmp_path, closing):
    """As for a user's own: mode and endpoints are Zenoh's, in Zenoh's words."""
    endpoint = free_endpoint()
    path = tmp_path / "router.json5"
    path.write_text(f'{{ mode: "router", listen: {{ endpoints: {json.dumps([endpoint])} }} }}')
    process = subprocess.Popen(
        [sys.executable, "-m", "encircle.protocol.programs.router", "--zenoh-config", str(path)],
        stderr=subprocess.DEVNULL,
    )
    closing.callback(process.wait)
    closing.callback(process.kill)
    ends = []
    for name in ("a", "b"):
        access = Endpoints(connect=(endpoint,), connect_s_max=LONGEST_S)
        ends.append(ZenohConnection(access, f"t/{name}"))
        closing.callback(ends[-1].close)
    seen = watched(ends[0], "t/alive")
    ends[1].declare_alive("t/alive")
    assert changes(seen, 1) == [("t/alive", True)]
