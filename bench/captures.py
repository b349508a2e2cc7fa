"""Large teams hunt over Zenoh to a capture: ``python bench/captures.py``.

64 robots as processes of their own and in four processes, 256 in two and in four. Each hunt is run
in memory as well, whose digest the one over Zenoh must have. So that many find room round the
target, the 256 are smaller than the robots of the paper.
"""

import time
from typing import Any

from scenarios import ordinary_hunt

from encircle.runner.hunts import run

HUNTS = ((64, 1), (64, 16), (256, 64), (256, 128))
"""Robots, and how many of them share a process."""
OF_256 = {"radius_m": 0.1, "sensing_range_m": 500.0}


def hunt_of(robots: int) -> dict[str, Any]:
    """An ordinary hunt; 256 robots are small, see each other, and take the cheaper assignment."""
    scenario = ordinary_hunt(robots)
    if robots > 64:
        scenario["team"] |= OF_256
        scenario["team"]["placement"]["distance_m_max"] = 30.0
        scenario |= {"robot": {"assignment": "cyclic"}, "capture": {"count": 12}}
    return scenario


def main() -> None:
    """Print a row for each hunt."""
    print("| robots | processes | ticks to the capture | wall time (s) | rounds/s |")
    print("|---|---|---|---|---|")
    for robots, together in HUNTS:
        scenario = hunt_of(robots)
        expected = run(scenario, link="memory").result
        begun_s = time.perf_counter()
        hunt = run(scenario, robots_per_process=together)
        wall_s = time.perf_counter() - begun_s
        assert expected.captured, expected
        assert hunt.result == expected, (hunt.result, expected)
        speed = hunt.result.ticks / hunt.timing["rounds_s"]
        row = (robots, robots // together, hunt.result.ticks, f"{wall_s:.1f}", f"{speed:.3g}")
        print(f"| {' | '.join(map(str, row))} |", flush=True)


if __name__ == "__main__":
    main()
