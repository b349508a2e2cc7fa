"""Keeping off the target: no robot closes in any more at the stop distance, and none presses.

``encircle.agents.planning.collision_avoidance`` leaves the target out, since it is there to be
touched. A robot that pressed into it would push nothing and only lose its own motion.
"""

from math import hypot

from encircle.protocol.messages import Point
from encircle.protocol.parameters import Parameters


def kept_off(step: Point, own: Point, target: Point, parameters: Parameters) -> Point:
    """A step in m without what of it leads too near to the target; sideways it stays as it is.

    ``own`` and ``target``: positions in m. Within ``stop_distance_m`` nothing leads inwards; from
    farther away no more does than leaves the clearance between the bodies.
    """
    dx, dy = target[0] - own[0], target[1] - own[1]
    distance = hypot(dx, dy)
    if distance == 0.0:
        return step
    inward = (step[0] * dx + step[1] * dy) / distance
    inward_max = 0.0
    if distance > parameters.stop_distance_m:
        touching = parameters.radius_m + parameters.target_radius_m + parameters.clearance_m
        inward_max = max(0.0, distance - touching)
    surplus = (inward - inward_max) / distance
    if surplus <= 0.0:
        return step
    return step[0] - surplus * dx, step[1] - surplus * dy
