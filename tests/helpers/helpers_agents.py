"""Builders of messages and roles, and a ring of rays, for the tests of the robot's modules."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import cos, hypot, inf, pi, sin, sqrt
from typing import Any

from encircle.agents.brain.brain import Action, BrainState, RobotConfig, initial, step
from encircle.agents.estimation.kalman import Estimate
from encircle.agents.policies.interface import Policy, Predict, View
from encircle.agents.policies.paper import xi_star
from encircle.protocol.messages import Command, Observation, Point, Pose
from encircle.protocol.parameters import Parameters

TEAM = ("r1", "r2", "r3", "r4")
TICK_S = 0.1
RANGE_M = 6.0
BODIES = {
    "radius_m": 0.5,
    "target_radius_m": 0.5,
    "step_m_max": 0.3,
    "sensing_range_m": RANGE_M,
    "stop_distance_m": 1.3,
}
"""What every setup tells."""


def observation(
    robot: str = "r1",
    tick: int = 0,
    position: Point = (0.0, 0.0),
    target: Point | None = None,
    scan: tuple[float, ...] = (RANGE_M,) * 24,
    seen: tuple[tuple[str, float, float], ...] = (),
    inbox: tuple[bytes, ...] = (),
) -> Observation:
    """An observation with nothing in it but what is given."""
    return Observation(robot, tick, position, 0.0, target, scan, seen, inbox)


def pose(
    robot: str = "r2",
    tick: int = 0,
    position: Point = (5.0, 5.0),
    velocity: Point = (0.0, 0.0),
    detection: Point | None = None,
    relayed: tuple[tuple[str, int, float, float], ...] = (),
) -> Pose:
    """A pose packet, its sequence number its tick, as robots send them."""
    return Pose(robot, tick, tick, position, velocity, detection, "encircle", 0.0, 0, relayed)


def view_of(
    positions: Sequence[Point],
    own: int,
    target: Point | None,
    predict: Predict,
    parameters: Parameters = Parameters(),  # noqa: B008  # it is frozen
    previous_goal: Point | None = None,
    **others: Any,
) -> View:
    """What a policy sees of robots at these positions, all of which it plans with."""
    team = tuple(f"r{k + 1}" for k in range(len(positions)))
    others = {
        "known": tuple([(7, x, y, 0.0, 0.0) for x, y in positions]),
        "packets": (None,) * len(positions),
        **others,
    }
    estimate = None if target is None else Estimate(*target, 0.0, 0.0, (1e-4, 0.0, 1.0))
    return View(
        others.pop("tick", 7),
        TICK_S,
        team[own],
        team,
        positions[own],
        own,
        tuple(positions),
        estimate,
        predict,
        parameters,
        previous_goal,
        members=tuple(range(len(positions))),
        **others,
    )


def config(
    strategy: Policy = xi_star,
    robot: str = "r1",
    team: tuple[str, ...] = TEAM,
    **changed: object,
) -> RobotConfig:
    """A robot's role, with some parameters changed."""
    parameters = replace(Parameters(), **changed)  # type: ignore[arg-type]
    return RobotConfig(robot, team, TICK_S, strategy, parameters)


def run_brain(
    part: RobotConfig,
    observations: Sequence[Observation],
    packets: Callable[[int], list[Pose]] | None,
) -> tuple[BrainState, list[Command]]:
    """Step a fresh brain through observations; ``packets`` gives the inbox of each tick."""
    state, actions = run_actions(part, observations, packets)
    return state, [action.command for action in actions]


def run_actions(
    part: RobotConfig,
    observations: Sequence[Observation],
    packets: Callable[[int], list[Pose]] | None = None,
) -> tuple[BrainState, list[Action]]:
    """As ``run_brain``, with the packets sent."""
    state, actions = initial(part), []
    for seen in observations:
        state, action = step(state, seen, packets(seen.tick) if packets else [], part)
        actions.append(action)
    return state, actions


def ring_of_rays(
    centre: Point, discs: Sequence[tuple[float, float, float]], rays: int, range_m: float = RANGE_M
) -> tuple[float, ...]:
    """Distance from ``centre`` to the nearest disc ``(x, y, radius)`` along each ray."""
    found = []
    for m in range(rays):
        ux, uy = cos(2 * pi * m / rays), sin(2 * pi * m / rays)
        nearest = inf
        for x, y, radius in discs:
            dx, dy = x - centre[0], y - centre[1]
            along, aside = dx * ux + dy * uy, dx * uy - dy * ux
            if abs(aside) <= radius and along > 0.0:
                nearest = min(nearest, along - sqrt(radius**2 - aside**2))
        found.append(min(nearest, range_m))
    return tuple(found)


def spread(positions: Sequence[Point]) -> float:
    """The smallest distance between any two of these positions."""
    return min(
        (
            hypot(a[0] - b[0], a[1] - b[1])
            for i, a in enumerate(positions)
            for b in positions[i + 1 :]
        ),
        default=inf,
    )
