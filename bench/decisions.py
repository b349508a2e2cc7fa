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
from encircle.agents.brain.robot_core import RobotCore
from encircle.agents.estimation.spline import extrapolate
from encircle.agents.planning.assignment import algorithm_1, whole_quanta
from encircle.agents.planning.ring import encirclement_points
from encircle.protocol.messages import Observation
from encircle.runner.memory import run_in_memory
from encircle.world.arena import engine
from encircle.world.loading.load import load

TICKS = 80
SETTLED_TICK = 40
LITERAL_ROBOTS_MAX = 8


def recorded_steps(robots: int) -> list[tuple[Any, ...]]:
    """Arguments of every brain step of the first robot, once the hunt has settled."""
    kept: list[tuple[Any, ...]] = []
    begin = RobotCore._begin

    def noted(core: RobotCore, observation: Observation) -> Any:
        state, packets, config = begin(core, observation)
        if config.own == 0 and observation.tick >= SETTLED_TICK:
            kept.append((state, observation, packets, config))
        return state, packets, config

    RobotCore._begin = noted
    try:
        arena = engine.build(load(endless_hunt(robots, TICKS)), 1)
        run_in_memory(arena, "bench", print)
    finally:
        RobotCore._begin = begin
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
