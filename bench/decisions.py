"""One robot's decision time, beside what it cannot do without and beside Algorithm 1 as printed."""

import time
from collections.abc import Callable
from statistics import median
from typing import Any

import numpy as np
from scenarios import endless_hunt
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from encircle.agents.brain import brain
from encircle.agents.estimation.spline import extrapolate
from encircle.agents.planning.assignment import algorithm_1, whole_quanta
from encircle.agents.planning.ring import encirclement_points
from encircle.runner.memory import run_in_memory
from encircle.world.arena import engine
from encircle.world.loading.load import load

TICKS = 80
SETTLED_TICK = 40
LITERAL_ROBOTS_MAX = 8


def recorded_steps(robots: int) -> list[tuple[Any, ...]]:
    """Arguments of every brain step of the first robot, once the hunt has settled."""
    kept: list[tuple[Any, ...]] = []
    step = brain.step

    def noted(*arguments: Any) -> Any:
        if arguments[3].own == 0 and arguments[1].tick >= SETTLED_TICK:
            kept.append(arguments)
        return step(*arguments)

    brain.step = noted
    try:
        arena = engine.build(load(endless_hunt(robots, TICKS)), 1)
        run_in_memory(arena, "bench", print)
    finally:
        brain.step = step
    return kept


def per_call_us(action: Callable[[Any], object], cases: list[Any], repeats: int) -> float:
    """Median over repeats of the mean time per case, in microseconds."""
    took = []
    for _ in range(repeats):
        begun = time.perf_counter()
        for case in cases:
            action(case)
        took.append((time.perf_counter() - begun) / len(cases) * 1e6)
    return median(took)


def rings_of(arguments: tuple[Any, ...]) -> tuple[Any, Any]:
    """The team positions (N, 2) and encirclement points (G, N, 2) of a recorded step, in m."""
    _, observation, _, config = arguments
    after, _ = brain.step(*arguments)
    mates = brain.team.planning_team(
        after.peers, config.own, observation.position, observation.tick, config.parameters
    )
    estimate = after.track.estimate
    predicted, _ = extrapolate(
        after.track, config.tick_s, config.parameters, config.parameters.xi_grid
    )
    target = (estimate.x, estimate.y)
    points = encirclement_points(
        mates.positions, target, predicted, config.parameters.ring_radius_m
    )
    return np.array(mates.positions), points


def bare(case: tuple[Any, Any]) -> None:
    """One distance matrix and one assignment per prediction step, and nothing else."""
    team, rings = case
    for points in rings:
        linear_sum_assignment(cdist(team, points))


def literal(case: tuple[Any, Any]) -> None:
    """Algorithm 1 as printed, for the first robot and every prediction step."""
    team, rings = case
    for points in rings:
        algorithm_1(whole_quanta(cdist(team, points)), 0)


def measure(robots: int) -> dict[str, Any]:
    """Decision time for a team of this size, and its comparisons, in microseconds."""
    steps = recorded_steps(robots)
    cases = [rings_of(arguments) for arguments in steps]
    per_call_us(lambda a: brain.step(*a), steps, 2)
    decision, floor = [], []
    for _ in range(9):  # taken in turns, so that both meet the same machine
        decision.append(per_call_us(lambda a: brain.step(*a), steps, 3))
        floor.append(per_call_us(bare, cases, 3))
    row = {
        "robots": robots,
        "decision_us": median(decision),
        "bare_us": median(floor),
        "ratio": median(d / f for d, f in zip(decision, floor, strict=True)),
        "literal_us": None,
    }
    if robots <= LITERAL_ROBOTS_MAX:
        few = cases[:5] if robots <= 4 else cases[:1]
        row["literal_us"] = per_call_us(literal, few, 1)
    return row
