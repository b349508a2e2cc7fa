"""What a cheaper assignment loses and saves: ``python bench/assignments.py``.

Hunts with ``robot.assignment`` = ``shortest`` and ``cyclic`` on the same seeds, so that both meet
the same starts and losses. The target flees, as fast as the robots are, and a third of the packets
is lost, so that no two robots believe quite the same.
"""

import argparse
import time
from typing import Any

import numpy as np

from encircle.agents.planning import best_ring
from encircle.agents.planning.cyclic_assignment import assign_in_cyclic_order
from encircle.runner.memory import run_in_memory
from encircle.statistics.comparisons import rate_difference
from encircle.world.arena import engine
from encircle.world.loading.load import load

ARMS = ("shortest", "cyclic")


def scenario(robots: int, assignment: str) -> dict[str, Any]:
    """A hunt that some seeds win and others lose."""
    return {
        "ticks_max": 250,
        "team": {
            "robots": robots,
            "placement": {"distance_m_min": 5.0, "distance_m_max": 8.0 + robots / 2.0},
            "sensing_range_m": 12.0,
        },
        "target": {"behaviour": "flee", "step_m_max": 0.3},
        "channel": {"loss": {"model": "bernoulli", "rate": 0.33}},
        "sensing": {"noise_m_std": 0.05},
        "robot": {"assignment": assignment},
    }


def hunt(robots: int, assignment: str, seed: int) -> tuple[bool, int, float]:
    """Whether it captured, when it ended, and milliseconds of processor time a round."""
    arena = engine.build(load(scenario(robots, assignment)), seed)
    begun = time.process_time()
    result = run_in_memory(arena, "bench", print)
    return result.captured, result.ticks, 1e3 * (time.process_time() - begun) / result.ticks


def gaps(robots: int, seeds: int) -> list[float]:
    """By what share cyclic ways are longer than the shortest, ring by ring, in hunts of those."""
    found: list[float] = []
    assign = best_ring.assign

    def both(team: Any, points: Any) -> Any:
        shortest = assign(team, points)
        _, cyclic = assign_in_cyclic_order(team, points, points.mean(axis=1))
        found.extend((cyclic.sum(axis=1) / shortest[1].sum(axis=1) - 1.0).tolist())
        return shortest

    best_ring.assign = both
    try:
        for seed in range(seeds):
            hunt(robots, "shortest", seed)
    finally:
        best_ring.assign = assign
    return found


def compared(robots: int, seeds: int) -> str:
    """One row of the table."""
    runs = {arm: [hunt(robots, arm, seed) for seed in range(seeds)] for arm in ARMS}
    captured = {arm: [run[0] for run in runs[arm]] for arm in ARMS}
    difference = rate_difference(captured["shortest"], captured["cyclic"]).mean
    both = [
        (a[1], b[1]) for a, b in zip(runs["shortest"], runs["cyclic"], strict=True) if a[0] and b[0]
    ]
    ticks = np.mean(both, axis=0) if both else (np.nan, np.nan)
    ms = {arm: np.median([run[2] for run in runs[arm]]) for arm in ARMS}
    excess = gaps(robots, min(seeds, 3))
    cells = (
        f"{robots} | {seeds}",
        f"{np.mean(captured['shortest']):.0%} | {np.mean(captured['cyclic']):.0%}",
        f"{difference.low:+.0%} to {difference.high:+.0%} | {ticks[0]:.0f} | {ticks[1]:.0f}",
        f"{np.mean(excess):.2%} | {np.quantile(excess, 0.95):.2%}",
        f"{ms['shortest']:.2f} | {ms['cyclic']:.2f}",
    )
    return f"| {' | '.join(cells)} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="Cyclic assignment beside the shortest.")
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--robots", type=int, nargs="+", default=[4, 8, 16, 64])
    options = parser.parse_args()
    print(
        "| robots | seeds | captured, shortest | cyclic | difference, 95 % | ticks, shortest "
        "| cyclic | longer, mean | 95 % of rings below | ms a round, shortest | cyclic |"
    )
    print("|---|" + "---|" * 10)
    for robots in options.robots:
        # Of large teams fewer: a hunt of 64 takes as long as a hundred hunts of 4.
        print(compared(robots, max(10, min(options.seeds, 1600 // robots))), flush=True)


if __name__ == "__main__":
    main()
