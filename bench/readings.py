"""The open readings of the paper, measured: how often and how soon the target is captured.

    python bench/readings.py

Every row is the same 100 hunts from random starts, with the fleeing target of simulation 1 (step
0.2 m, 300 ticks at most) and one or two values changed. Starts depend on the seed alone, so rows of
one table are paired. Rates carry Wilson's 95 % interval; the median tick is that of the captures.
"""

import argparse
import os
import time
from collections.abc import Sequence
from math import pi
from statistics import median
from typing import NamedTuple, TypeAlias

from rich.console import Console
from rich.table import Table
from scenarios import ordinary_hunt
from scipy.stats import binomtest

from encircle.progress import Progress
from encircle.runner.memory import run_in_memory
from encircle.runner.process_pool import in_order
from encircle.world.arena import engine
from encircle.world.coordinator.world_core import WorldCore
from encircle.world.loading.load import load

HUNTS = 100
WORKERS = 2
CHUNK_HUNTS = 10
ENCLOSURES = {
    "printed": (0.5, 0.7, 0.9, 1.0, 1.1, 1.25),
    "span": (1.0, 1.1, 1.2, 1.3),
    "gap": (1.0, 1.1, 1.2, 1.3),
}
"""Thresholds theta_th in units of pi, for each reading of the enclosure test."""
CAPS = (2, 3, 4)
ALLOWANCES = (24, 12, 6)
TEAMS = (5, 6, 8, 12, 16)
GEOMETRIC_COUNT = 7
"""Robots of radius 0.5 m that touch each other all around a circle of radius 1.3 m."""
DELAY_S = 0.3

Case: TypeAlias = tuple[int, tuple[str, ...]]
"""Robots of the team, and what is changed in the scenario as ``key=value``."""


class Outcome(NamedTuple):
    """What came of one hunt. ``close``: the most robots ever within the stop distance at once."""

    captured: bool
    tick: int
    close: int


Outcomes: TypeAlias = dict[Case, list[Outcome]]


def hunt(job: tuple[Case, int]) -> Outcome:
    """One hunt of a case from the random start of a seed."""
    (robots, changes), seed = job
    scenario = load(ordinary_hunt(robots), changes)
    stop_m = scenario.capture.stop_distance_m
    close = 0

    def note(world: WorldCore) -> None:
        nonlocal close
        distances = world.state.geometry.distances[:robots, robots]
        close = max(close, int((distances <= stop_m).sum()))

    result = run_in_memory(engine.build(scenario, seed), "bench", print, None, note)
    # The last tick is not told: no robot is asked any more.
    at_end = sum(distance <= stop_m for distance in result.distances_m)
    return Outcome(result.captured, result.ticks, max(close, at_end))


def enclosure_case(reading: str, threshold_pi: float) -> Case:
    """(a) A reading of the enclosure test with its threshold in units of pi."""
    return 4, (f"robot.enclosure={reading}", f"robot.enclosure_rad={threshold_pi * pi!r}")


def deviation_case(cap: int, allowance: int) -> Case:
    """(b) A cap on beta and an allowance w, both as fractions of pi."""
    return 4, (f"robot.deviation_rad_max={pi / cap!r}", f"robot.allowance_rad={pi / allowance!r}")


def count_case(robots: int, geometric: bool) -> Case:
    """(c) A team with the default capture count, or with what fits in theory."""
    return robots, (f"capture.count={min(robots, GEOMETRIC_COUNT)}",) if geometric else ()


def peer_case(policy: str, delay_s: float) -> Case:
    """(d) A policy for stale peers, with every packet late by the same time."""
    return 4, (f"robot.peer_policy={policy}", f"channel.delay.mean_s={delay_s}")


def measure(cases: Sequence[Case], hunts: int) -> Outcomes:
    """Run every case from the same starts."""
    unique = list(dict.fromkeys(cases))
    seeds = range(1, hunts + 1)
    jobs = [(case, seed) for case in unique for seed in seeds]
    with Progress("readings", "hunts") as tell:
        found = in_order(hunt, jobs, WORKERS, CHUNK_HUNTS, tell)
    return {case: found[k * hunts : (k + 1) * hunts] for k, case in enumerate(unique)}


def cells(outcomes: Sequence[Outcome]) -> tuple[str, str]:
    """Rate of capture with its interval in percent, and median tick of the captures."""
    ticks = [outcome.tick for outcome in outcomes if outcome.captured]
    interval = binomtest(len(ticks), len(outcomes)).proportion_ci(method="wilson")
    low, high = 100.0 * interval.low, 100.0 * interval.high
    rate = f"{100.0 * len(ticks) / len(outcomes):.0f} [{low:.0f}, {high:.0f}]"
    return rate, f"{median(ticks):g}" if ticks else "-"


def show(title: str, heads: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """One table on the terminal."""
    table = Table(title=title, title_justify="left")
    for head in (*heads, "captured %", "median tick"):
        table.add_column(head, justify="right")
    for row in rows:
        table.add_row(*row)
    Console(width=110).print(table)


def main() -> None:
    """Measure everything and print the tables."""
    parser = argparse.ArgumentParser(description="Measure the open readings of the paper.")
    parser.add_argument("--hunts", type=int, default=HUNTS, help="random starts per row")
    hunts: int = parser.parse_args().hunts
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    begun = time.perf_counter()
    enclosures = {(r, t): enclosure_case(r, t) for r, all_t in ENCLOSURES.items() for t in all_t}
    deviations = {(c, w): deviation_case(c, w) for c in CAPS for w in ALLOWANCES}
    # With five robots both counts are all of them.
    counts = {(n, g): count_case(n, g) for n in TEAMS for g in (False, True) if n > 5 or not g}
    peers = {(p, d): peer_case(p, d) for d in (0.0, DELAY_S) for p in ("hold", "extrapolate")}
    tables = (enclosures, deviations, counts, peers)
    found = measure([case for table in tables for case in table.values()], hunts)
    show(
        f"(a) enclosure test, {hunts} hunts of four robots",
        ("reading", "theta_th / pi"),
        [(r, f"{t:g}", *cells(found[case])) for (r, t), case in enclosures.items()],
    )
    show(
        f"(b) deviation, {hunts} hunts of four robots",
        ("cap on beta", "w"),
        [(f"pi/{c}", f"pi/{w}", *cells(found[case])) for (c, w), case in deviations.items()],
    )
    show(
        f"(c) capture count, {hunts} hunts",
        ("robots", "count", "most within D_stop"),
        [
            (
                f"{n}",
                f"{load(ordinary_hunt(n), case[1]).capture_count}",
                f"{max(outcome.close for outcome in found[case])}",
                *cells(found[case]),
            )
            for (n, _), case in counts.items()
        ],
    )
    show(
        f"(d) stale peers, {hunts} hunts of four robots",
        ("delay s", "policy"),
        [(f"{d:g}", p, *cells(found[case])) for (p, d), case in peers.items()],
    )
    print(f"{time.perf_counter() - begun:.0f} s")


if __name__ == "__main__":
    main()
