"""Robots that share a process, on a connection in memory: who is asked answers, and nobody else."""

import threading
from functools import partial

from helpers_agents import BODIES, observation
from helpers_waiting import joined, taken

from encircle.agents.process.robot_host import RobotHost
from encircle.agents.process.robot_runs import RobotRuns
from encircle.protocol.codec import decode, encode
from encircle.protocol.connections import MemoryHub
from encircle.protocol.keys import robot_key
from encircle.protocol.messages import Command, End, Setup

RUN = "run"
TEAM = ("r1", "r2", "r3")


class Shared:
    """Robots in one process and what a world hears of them."""

    def __init__(self, *robots: str, rejoins: bool = False) -> None:
        hub = MemoryHub()
        self.world = hub.connection([f"encircle/{RUN}/"])
        self.connection = hub.connection([robot_key(RUN, robot, "") for robot in robots])
        self.said: list[str] = []
        self.runs = {robot: RobotRuns(robot, RUN, self.said.append, rejoins) for robot in robots}
        self.finished: dict[str, BaseException | None] = {}
        finish = {robot: partial(self.finished.__setitem__, robot) for robot in robots}
        self.host = RobotHost(self.runs, self.connection, finish)
        self.thread = threading.Thread(target=self.host.answer, daemon=True)
        self.thread.start()

    def tell(self, robot, channel, message) -> None:
        self.world.send(robot_key(RUN, robot, channel), encode(message, RUN))

    def set_up(self, robot) -> None:
        self.tell(robot, "setup", Setup(robot, TEAM, 0.1, "xi-star", BODIES))

    def answers(self, count: int) -> set[tuple[str, int]]:
        """Robot and tick of so many commands; poses come before them."""
        found = set()
        while len(found) < count:
            key, payload = taken(self.world.inbox)
            if key.endswith("/command"):
                command = decode(Command, payload, RUN)
                found.add((command.robot, command.tick))
        return found

    def close(self) -> None:
        self.connection.close()
        joined(self.thread)


def test_each_answers_what_it_is_asked():
    shared = Shared("r1", "r2")
    for robot in ("r1", "r2"):
        shared.set_up(robot)
    for tick in range(3):
        for robot in ("r2", "r1"):
            shared.tell(robot, "observation", observation(robot, tick))
        assert shared.answers(2) == {("r1", tick), ("r2", tick)}
    shared.close()
    assert shared.finished == {"r1": None, "r2": None}


def test_robots_that_stay_take_part_in_run_after_run():
    shared = Shared("r1", "r2", rejoins=True)
    for run in (1, 2):
        for robot in ("r1", "r2"):
            shared.set_up(robot)
            shared.tell(robot, "observation", observation(robot, 0))
        assert shared.answers(2) == {("r1", 0), ("r2", 0)}
        for robot in ("r1", "r2"):
            shared.tell(robot, "end", End(robot, 1, "captured"))
        # It is asked in order, so this comes after the ends.
        shared.set_up("r1")
        shared.tell("r1", "observation", observation("r1", 0))
        assert shared.answers(1) == {("r1", 0)}
        assert [runs.completed for runs in shared.runs.values()] == [run, run]
    shared.close()


def test_an_error_of_ours_in_one_robot_leaves_the_others_alone(monkeypatch):
    shared = Shared("r1", "r2")
    error = ZeroDivisionError("in the core of r1")

    def fail(_key, _payload):
        raise error

    monkeypatch.setattr(shared.runs["r1"].core, "receive", fail)
    for robot in ("r1", "r2"):
        shared.set_up(robot)
        shared.tell(robot, "observation", observation(robot, 0))
    assert shared.answers(1) == {("r2", 0)}
    assert shared.finished == {"r1": error}
    shared.close()


def test_when_all_have_ended_the_thread_ends():
    shared = Shared("r1", "r2")
    for robot in ("r1", "r2"):
        shared.tell(robot, "end", End(robot, 1, "captured"))
    joined(shared.thread)
    assert shared.finished == {"r1": None, "r2": None}


def test_what_is_for_nobody_here_is_passed_over():
    shared = Shared("r1", "r2")
    shared.host.drop("r1")
    shared.set_up("r1")
    shared.set_up("r2")
    shared.tell("r2", "observation", observation("r2", 0))
    assert shared.answers(1) == {("r2", 0)}
    shared.close()
