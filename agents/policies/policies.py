"""Policies: from a robot's view of the hunt to where it wants to step.

A policy is any callable with the signature of ``Policy``. Those of other packages are found by
entry point, group ``encircle.strategies``; the name there is the name in a scenario
(``team.strategy``). Policies are pure: same view, same decision. The brain shortens the step to
what the robot can do and keeps it from collisions.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from math import copysign, hypot, sin, sqrt
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from encircle.agents.planning.assignment import assign, assign_with_hysteresis
from encircle.agents.planning.prediction_step import best_step
from encircle.agents.planning.ring import encirclement_points
from encircle.agents.planning.shrink import deviation, encloses, sides
from encircle.protocol.messages import Point
from encircle.protocol.parameters import Parameters
from encircle.protocol.plugins import STRATEGIES, Registry


class View(NamedTuple):
    """What a policy decides on: one robot's own, possibly stale, view.

    ``positions``: of the team's N members in m, robot order; ``own``: which of them is this robot,
    from 0; ``target``: the estimated target position in m; ``predict``: from a tuple of G
    prediction steps to predicted target positions (G, 2) in m, and what predicted them;
    ``previous_goal``: the encirclement point this robot headed for at the previous tick, in m, None
    if for none.
    """

    own: int
    positions: Sequence[Point]
    target: Point
    predict: Callable[[tuple[float, ...]], tuple[NDArray[np.float64], str]]
    parameters: Parameters
    previous_goal: Point | None = None


class Decision(NamedTuple):
    """What a policy wants: a step in m, and the reasons, for peers and for the record."""

    mode: str
    step: Point
    goal: Point
    xi: float | None = None
    point: int | None = None
    predictor: str | None = None


class Policy(Protocol):
    """From a view to a decision, without memory and without side effects."""

    def __call__(self, view: View) -> Decision:
        """Decide on the next step."""


def encircle_or_shrink(view: View, xi_grid: tuple[float, ...] | None = None) -> Decision:
    """The paper's approach: shrink if the ring is closed, else go to the point at xi*.

    ``xi_grid``: prediction steps to choose from, the parameters' own by default.
    """
    return _shrink(view) or _encircle(view, xi_grid or view.parameters.xi_grid)


def pursue(view: View) -> Decision:
    """Straight towards the target's estimated position, without any coordination."""
    return Decision("pursue", _close_in(view, 0.0), view.target)


def _encircle(view: View, xi_grid: tuple[float, ...]) -> Decision:
    parameters = view.parameters
    predicted, predictor = view.predict(xi_grid)
    points = encirclement_points(view.positions, view.target, predicted, parameters.ring_radius_m)
    team = np.array(view.positions)
    decision, distances = assign(team, points)
    best = best_step(distances, xi_grid, parameters.xi_weight) if len(xi_grid) > 1 else 0
    point = int(decision[best, view.own])
    if parameters.switch_gain_m > 0.0 and view.previous_goal is not None:
        gain_m = parameters.switch_gain_m
        point = assign_with_hysteresis(
            team, points[best], decision[best], view.own, view.previous_goal, gain_m
        )
    goal_x, goal_y = points[best, point].tolist()
    own_x, own_y = view.positions[view.own]
    step = (goal_x - own_x, goal_y - own_y)
    return Decision("encircle", step, (goal_x, goal_y), xi_grid[best], point, predictor)


def _shrink(view: View) -> Decision | None:
    """Eq. 4-7 once all are near and the ring is closed, as far as this robot can tell."""
    parameters = view.parameters
    target_x, target_y = view.target
    near = parameters.near_factor * parameters.ring_radius_m
    rays = []
    for x, y in view.positions:
        ray = (x - target_x, y - target_y)
        if hypot(*ray) > near:
            return None
        rays.append(ray)
    own_ray = rays.pop(view.own)
    angles = sides(own_ray, rays)
    if not encloses(angles, parameters.enclosure_rad, parameters.enclosure):
        return None
    beta = deviation(
        angles,
        len(view.positions),
        parameters.allowance_rad,
        parameters.deviation_gain,
        parameters.deviation_rad_max,
    )
    return Decision("shrink", _close_in(view, beta), view.target)


def _close_in(view: View, deviation_rad: float) -> Point:
    """A step towards the target, turned by a deviation; none inwards at the stop distance.

    The sideways part is at most half of what would put the robot midway between its neighbours.
    That matters only close by, where full steps would overshoot and swing for ever; Eq. 6-7 say
    nothing of step lengths.
    """
    parameters = view.parameters
    x, y = view.positions[view.own]
    dx, dy = view.target[0] - x, view.target[1] - y
    distance = hypot(dx, dy)
    if distance == 0.0:
        return (0.0, 0.0)
    imbalance_rad = abs(deviation_rad) / parameters.deviation_gain if deviation_rad else 0.0
    full = parameters.step_m_max
    aside = min(full * abs(sin(deviation_rad)), distance * imbalance_rad / 2.0)
    touching = parameters.radius_m + parameters.target_radius_m + parameters.clearance_m
    inward = 0.0
    if distance > parameters.stop_distance_m:
        inward = min(sqrt(full * full - aside * aside), distance - touching)
    turn = copysign(aside, deviation_rad)
    return (inward * dx - turn * dy) / distance, (inward * dy + turn * dx) / distance


xi_0 = partial(encircle_or_shrink, xi_grid=(0.0,))
xi_1 = partial(encircle_or_shrink, xi_grid=(1.0,))
xi_3 = partial(encircle_or_shrink, xi_grid=(3.0,))
BUILT_IN: dict[str, Policy] = {
    "xi-star": encircle_or_shrink,
    "xi-0": xi_0,
    "xi-1": xi_1,
    "xi-3": xi_3,
    "pursuit": pursue,
}
REGISTRY = Registry(STRATEGIES, BUILT_IN)


@lru_cache(maxsize=64)
def policy_named(name: str) -> Policy:
    """The policy of that name; errors as of ``Registry.named``."""
    policy: Policy = REGISTRY.named(name)
    return policy
