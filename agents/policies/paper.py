"""The paper's policies: encircle, then shrink; and the target pursued without coordination.

Each robot picks its encirclement point by Algorithm 1 on its own view, and says nothing: what the
others will do is what they would do on that view (implicit coordination). Once the ring is closed
the robots shrink it (Eq. 4-7). ``docs/paper.md`` has how the paper is read.

Source: *A Multi-Robot Cooperative Hunting Approach Based on Dynamic Prediction of Target Motion*.
"""

from math import copysign, hypot, sin, sqrt

import numpy as np

from encircle.agents.planning.assignment import assign_with_hysteresis
from encircle.agents.planning.best_ring import best_ring
from encircle.agents.planning.shrink import deviation, encloses, sides
from encircle.agents.policies.interface import Decision, View
from encircle.protocol.messages import Point


def xi_star(memory: None, view: View) -> tuple[None, Decision]:
    """The paper's approach: shrink if the ring is closed, else go to the point at xi*."""
    return memory, view.search or shrink(view) or encircle(view, view.parameters.xi_grid)


def xi_0(memory: None, view: View) -> tuple[None, Decision]:
    """As ``xi_star``, but around where the target is."""
    return memory, view.search or shrink(view) or encircle(view, (0.0,))


def xi_1(memory: None, view: View) -> tuple[None, Decision]:
    """As ``xi_star``, but around where the target is predicted to be a tick later."""
    return memory, view.search or shrink(view) or encircle(view, (1.0,))


def xi_3(memory: None, view: View) -> tuple[None, Decision]:
    """As ``xi_star``, but around where the target is predicted to be three ticks later."""
    return memory, view.search or shrink(view) or encircle(view, (3.0,))


def pursue(memory: None, view: View) -> tuple[None, Decision]:
    """Straight towards the target's estimated position, without any coordination.

    Source: our own, as a baseline.
    """
    return memory, view.search or Decision("pursue", close_in(view, 0.0), known_target(view))


def known_target(view: View) -> Point:
    """Where the target is believed to be, in m; there must be an estimate of it."""
    assert view.target is not None, "without an estimate there is no point to head for"
    return view.target.position


def encircle(view: View, xi_grid: tuple[float, ...]) -> Decision:
    """Algorithm 1: the encirclement point that the best assignment at xi* gives this robot.

    ``xi_grid``: prediction steps to choose from, in ticks.
    """
    parameters, target = view.parameters, known_target(view)
    predicted, predictor = view.predict(xi_grid)
    best, points, assigned = best_ring(
        *(view.positions, target, predicted, xi_grid),
        *(parameters.xi_weight, parameters.ring_radius_m, parameters.assignment),
    )
    point = int(assigned[view.own])
    if parameters.switch_gain_m > 0.0 and view.previous_goal is not None:
        gain_m = parameters.switch_gain_m
        point = assign_with_hysteresis(
            np.array(view.positions), points, assigned, view.own, view.previous_goal, gain_m
        )
    goal_x, goal_y = points[point].tolist()
    own_x, own_y = view.positions[view.own]
    step = (goal_x - own_x, goal_y - own_y)
    return Decision("encircle", step, (goal_x, goal_y), xi_grid[best], point, predictor)


def shrink(view: View) -> Decision | None:
    """Eq. 4-7 once all are near and the ring is closed, as far as this robot can tell."""
    parameters = view.parameters
    target = view.target
    assert target is not None, "without an estimate there is no ring to close"
    target_x, target_y = target.x, target.y
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
    return Decision("shrink", close_in(view, beta), (target_x, target_y))


def close_in(view: View, deviation_rad: float) -> Point:
    """A step towards the target, turned by a deviation; none inwards at the stop distance.

    The sideways part is at most half of what would put the robot midway between its neighbours.
    That matters only close by, where full steps would overshoot and swing for ever; Eq. 6-7 say
    nothing of step lengths.
    """
    parameters = view.parameters
    x, y = view.positions[view.own]
    target = view.target
    assert target is not None, "without an estimate there is nothing to close in on"
    dx, dy = target.x - x, target.y - y
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
