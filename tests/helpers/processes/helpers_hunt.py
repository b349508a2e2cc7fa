"""A hunt whose nodes a test starts by hand, as processes to which something can happen."""

import json
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from helpers_commands import ours
from helpers_hosts import NodeProcess
from helpers_waiting import ample_s

from encircle.runner.launch import free_endpoint

ROBOTS = ("r1", "r2", "r3", "r4")

LONG: dict[str, Any] = {
    "ticks_max": 400,
    "team": {"robots": 4, "sensing_range_m": 500.0},
    "target": {
        "behaviour": "patrol",
        "parameters": {"waypoints": [[60, 0], [60, 60], [0, 60], [0, 0]]},
        "step_m_max": 0.5,
    },
}
"""The target is faster than the robots, so that there is time for things to happen."""

ENDLESS = LONG | {"ticks_max": 1_000_000}

SOME_TICKS = 20


class Hunt:
    """A world and its robots, each started by hand, on an endpoint of their own."""

    def __init__(self, folder: Path, scenario: dict[str, Any]) -> None:
        self.folder, self.out = folder, folder / "run"
        self.endpoint = free_endpoint()
        self.nodes: list[NodeProcess] = []
        self.scenario = folder / "scenario.json"
        self.scenario.write_text(json.dumps(scenario))
        self.robots: dict[str, NodeProcess] = {}
        self.limits: tuple[str, ...] = ()

    def lose_the_silent(self) -> str:
        """Have robots lost that do not answer for longer than any that can; what is said then."""
        answer_s = f"{ample_s():g}"
        self.limits = ("--answer-timeout", answer_s)
        return f"lost: no answer for {answer_s} s"

    def start(self, *arguments: str) -> NodeProcess:
        return self.start_as(arguments[0], *ours(*arguments)[1:])

    def start_as(self, name: str, *arguments: str) -> NodeProcess:
        log = self.folder / f"{len(self.nodes)}-{name}"
        node = NodeProcess([sys.executable, *arguments, "--run", "faulty"], log, {})
        self.nodes.append(node)
        return node

    def start_world(self, how: str = "--listen") -> None:
        where = (how, self.endpoint, "--out", str(self.out))
        self.world = self.start("world", str(self.scenario), *where, *self.limits)

    def start_router(self) -> NodeProcess:
        command = ("-m", "encircle.protocol.programs.router", "--listen", self.endpoint)
        node = NodeProcess(
            [sys.executable, *command], self.folder / f"{len(self.nodes)}-router", {}
        )
        self.nodes.append(node)
        node.wait_for_listening()
        return node

    def start_robot(self, robot: str, *options: str) -> NodeProcess:
        node = self.start("agents", robot, "--connect", self.endpoint, *options)
        self.robots[robot] = node
        return node

    def start_all(self, *options: str) -> None:
        self.start_world()
        for robot in ROBOTS:
            self.start_robot(robot, *options)

    @property
    def tick(self) -> int:
        return max((r["tick"] for r in self.world.reports() if "tick" in r), default=-1)

    @property
    def departures(self) -> list[tuple[str, str]]:
        """What became of robots so far, without the ticks."""
        found = [r["departure"] for r in self.world.reports() if "departure" in r]
        return [(robot, what) for _, robot, what in found]

    def wait_for_ticks(self) -> None:
        """Until the run has gone on a little."""
        self.world.wait_for_tick(self.tick + SOME_TICKS)

    def wait_for(self, happened: Callable[[list[tuple[str, str]]], bool]) -> None:
        self.world.wait_until(lambda _world: happened(self.departures))

    def signal(self, robot: str, number: signal.Signals) -> None:
        os.kill(self.robots[robot].pid, number)

    def close(self) -> None:
        for node in self.nodes:
            node.kill()
