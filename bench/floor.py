"""A hunt beside its floor, the assignments that its robots solve: ``python bench/floor.py``.

64 robots with seven prediction steps solve 448 assignments of 64 x 64 a tick, if each solves its
own. They do where detections are noisy; where all robots believe the same to the bit, one of them
solves seven for all (``encircle.agents.planning.best_ring``). All in processor time and in turns,
of which the quickest counts; with ``--peers`` beside MPE2's bare physics in turns as well.
"""

import argparse
import json
import subprocess
import time
from pathlib import Path
from typing import Any

import numpy as np
from scenarios import endless_hunt
from scipy.optimize import linear_sum_assignment

from encircle.agents.planning import assignment
from encircle.runner.memory import run_in_memory
from encircle.world.arena import engine
from encircle.world.loading.load import load

TICKS = 12
TURNS = 3
NOISE_M_STD = 0.05


def arena_of(robots: int, noise_m_std: float) -> engine.Arena:
    """The endless hunt, with detections that are exact or not."""
    scenario = endless_hunt(robots, TICKS) | {"sensing": {"noise_m_std": noise_m_std}}
    return engine.build(load(scenario), 1)


def costs_of_a_tick(robots: int) -> list[Any]:
    """The cost matrices of a whole tick in which each robot solves its own."""
    kept: list[Any] = []
    solve = assignment.batch_by_linear_assignment

    def noted(costs: Any) -> Any:
        kept.append(costs)
        return solve(costs)

    assignment.batch_by_linear_assignment = noted
    try:
        run_in_memory(arena_of(robots, NOISE_M_STD), "bench", print)
    finally:
        assignment.batch_by_linear_assignment = solve
    last = kept[-len(kept) // TICKS :]
    return [np.ascontiguousarray(costs[:, k]) for costs in last for k in range(costs.shape[1])]


def round_ms(arena: engine.Arena) -> float:
    """A round of a hunt: the lower quartile of its rounds."""
    marks: list[float] = []
    run_in_memory(arena, "bench", print, progress=lambda _: marks.append(time.process_time()))
    return 1e3 * float(np.quantile(np.diff(marks), 0.25))


def solved_ms(costs: list[Any]) -> float:
    """All the assignments of a tick, and nothing else."""
    begun = time.process_time()
    for matrix in costs:
        linear_sum_assignment(matrix)
    return 1e3 * (time.process_time() - begun)


def physics_ms(robots: int, peers: str) -> float:
    """A step of MPE2's physics."""
    script = str(Path(__file__).parent / "peers" / "mpe2_physics.py")
    done = subprocess.run([peers, script, str(robots), str(TICKS)], capture_output=True, check=True)
    return 1e3 / float(json.loads(done.stdout)["cpu_steps_per_s"])


def measure_floor(robots: int, peers: str | None = None, turns: int = TURNS) -> dict[str, Any]:
    """Milliseconds a round, and how many times quicker hunts are than floor and physics."""
    alike, own, costs = (
        arena_of(robots, 0.0),
        arena_of(robots, NOISE_M_STD),
        costs_of_a_tick(robots),
    )
    took: dict[str, list[float]] = {"alike": [], "own": [], "floor": [], "physics": []}
    for _ in range(turns):
        took["alike"].append(round_ms(alike))
        took["own"].append(round_ms(own))
        took["floor"].append(solved_ms(costs))
        if peers:
            took["physics"].append(physics_ms(robots, peers))
    alike_ms, own_ms, floor_ms = (min(took[name]) for name in ("alike", "own", "floor"))
    step_ms = min(took["physics"], default=None)
    return {
        "robots": robots,
        "assignments": len(costs),
        "alike_ms": alike_ms,
        "own_ms": own_ms,
        "floor_ms": floor_ms,
        "physics_ms": step_ms,
        "floor_over_alike": floor_ms / alike_ms,
        "floor_over_own": floor_ms / own_ms,
        "physics_over_alike": None if step_ms is None else step_ms / alike_ms,
        "physics_over_own": None if step_ms is None else step_ms / own_ms,
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="A hunt beside the assignments that it solves.")
    parser.add_argument("--robots", type=int, default=64)
    parser.add_argument("--peers", help="a Python that has mpe2")
    options = parser.parse_args()
    print(json.dumps(measure_floor(options.robots, options.peers), indent=2))
