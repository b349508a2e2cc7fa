"""Where the time of a round over Zenoh goes: ``python bench/round_parts.py 4``.

First the work alone, in one process and with nothing to wait for: what the world's and one robot's
core take per round, codec included. Then the same work after something else has gone through the
processor's caches, before each half of a round, as other processes do between two messages. Then
the processor time per round of the real processes.
"""

import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from scenarios import endless_hunt

from encircle.agents.brain.robot_core import RobotCore
from encircle.runner.hunts import run
from encircle.world.arena import engine
from encircle.world.coordinator.world_core import WorldCore
from encircle.world.loading.load import load

TICKS_PER_S = 100  # of the kernel's accounting, in /proc
NAME = "bench"


ELSEWHERE = np.ones(8 * 1024 * 1024, dtype=np.uint8)
"""More than a core's own caches hold."""


def alone(robots: int, rounds: int, cold: bool = False) -> tuple[float, float]:
    """Microseconds of processor time per round of the world's core and of one robot's.

    ``cold``: whether the caches hold something else when either begins.
    """
    arena = engine.build(load(endless_hunt(robots, rounds)), 1)
    world = WorldCore(arena, NAME)
    cores = {robot: RobotCore(robot, NAME) for robot in arena.ids}
    for robot, core in cores.items():
        for key, payload in world.join(robot):
            core.receive(key, payload)
    asked, world_s, robots_s = world.begin(), 0.0, 0.0
    while world.ended is None:
        _elsewhere(cold)
        begun = time.thread_time()
        answers = [a for key, p in asked for a in cores[key.split("/")[3]].receive(key, p)]
        robots_s += time.thread_time() - begun
        _elsewhere(cold)
        begun = time.thread_time()
        asked = [message for key, p in answers for message in world.receive(key, p)]
        world.rounds.commit()
        world_s += time.thread_time() - begun
    return world_s / rounds * 1e6, robots_s / rounds / robots * 1e6


def _elsewhere(cold: bool) -> None:
    if cold:
        ELSEWHERE.sum()


def as_processes(robots: int, rounds: int) -> dict[str, float]:
    """Microseconds of processor time per round of each process, and of wall time."""
    pids: dict[str, int] = {}
    seen: dict[str, list[tuple[int, float]]] = {}

    def note(report: dict[str, Any]) -> None:
        pids.update(report.get("started", {}))
        for name, pid in pids.items() if report.get("tick", 0) > 50 else ():
            stat = Path(f"/proc/{pid}/stat")
            if stat.exists():
                fields = stat.read_text().rsplit(")", 1)[1].split()
                used_s = (int(fields[11]) + int(fields[12])) / TICKS_PER_S
                seen.setdefault(name, []).append((report["tick"], used_s))

    hunt = run(endless_hunt(robots, rounds), progress=note)
    found = {
        name: (marks[-1][1] - marks[0][1]) / (marks[-1][0] - marks[0][0]) * 1e6
        for name, marks in seen.items()
    }
    return {"wall": hunt.timing["rounds_s"] / hunt.result.ticks * 1e6, **found}


if __name__ == "__main__":
    team = int(sys.argv[1]) if len(sys.argv) > 1 else 4
    for how, cold in (("alone", False), ("alone, caches cold", True)):
        world_us, robot_us = alone(team, 2400 // team, cold)
        print(f"{how}: world {world_us:.0f} us, each robot {robot_us:.0f} us per round")
    for name, used_us in as_processes(team, 12_000 // team).items():
        print(f"as processes: {name} {used_us:.0f} us per round")
