"""Voronoi pursuit: close in on the middle of the edge that one's cell shares with the target's.

The Voronoi cell of the target is where it is before any robot, were all equally fast. A robot at p
and the target at e share the part of their bisector that is no nearer to another robot,

    {q : |q - p| = |q - e| and |q - e| <= |q - p_j| for all other robots j}.

A robot that shares an edge of length L with middle m changes the area A of the target's cell by

    dA / dp = -(L / |p - e|) (m - p),

so that straight towards m is the direction in which the cell shrinks fastest, and the robots need
not agree on anything. One that shares no edge heads straight for the target.

Source: Huang, Zhang, Ding, Stipanovic, Tomlin, "Guaranteed decentralized pursuit-evasion in the
plane with multiple pursuers" (CDC 2011); Zhou and others, "Cooperative pursuit with Voronoi
partitions" (Automatica 72, 2016). There the arena is bounded, the target no faster than the robots,
and capture is by one robot. Here the plane is open, so an edge is cut off at ``bound_m`` from the
target; and in the end the robots have to be all around it, which this baseline does not aim at.
"""

from collections.abc import Sequence
from math import hypot, sqrt
from typing import Annotated

from encircle.agents.planning.stop_distance import kept_off
from encircle.agents.policies.interface import Decision, View
from encircle.protocol.messages import Point
from encircle.protocol.parameters import Length, Meaning


def voronoi(
    memory: None,
    view: View,
    *,
    bound_m: Annotated[Length, Meaning("Edges are cut off this far from the target.")] = 20.0,
) -> tuple[None, Decision]:
    """At full speed to the middle of the edge shared with the target, else straight at it."""
    if view.target is None:
        assert view.search is not None, "without an estimate there is a search"
        return memory, view.search
    own, target = view.position, view.target.position
    others = [p for robot, p in enumerate(view.positions) if robot != view.own]
    edge = shared_edge(own, target, others, bound_m)
    goal = target
    if edge is not None:
        (ax, ay), (bx, by) = edge
        goal = ((ax + bx) / 2.0, (ay + by) / 2.0)
    dx, dy = goal[0] - own[0], goal[1] - own[1]
    distance = hypot(dx, dy)
    if distance == 0.0:
        return memory, Decision("pursue", (0.0, 0.0), goal)
    share = view.parameters.step_m_max / distance
    step = kept_off((share * dx, share * dy), own, target, view.parameters)
    return memory, Decision("pursue", step, goal)


def shared_edge(
    own: Point, target: Point, others: Sequence[Point], bound_m: float
) -> tuple[Point, Point] | None:
    """The ends of the Voronoi edge between ``own`` and ``target`` in m, None if they share none.

    ``others``: the other robots' positions in m. Only what is within ``bound_m`` of the target
    counts. Ends come counter-clockwise as seen from the target.
    """
    ex, ey = target
    dx, dy = own[0] - ex, own[1] - ey
    distance = hypot(dx, dy)
    if distance == 0.0 or distance / 2.0 >= bound_m:
        return None
    # Points of the bisector, relative to the target: half of the ray to the robot, and s across it.
    hx, hy = dx / 2.0, dy / 2.0
    ax, ay = -dy / distance, dx / distance
    high = sqrt(bound_m * bound_m - distance * distance / 4.0)
    low = -high
    for x, y in others:
        # Nearer to the target than to q if 2 r.q <= |q|^2, which is linear in s.
        qx, qy = x - ex, y - ey
        across = 2.0 * (ax * qx + ay * qy)
        room = qx * qx + qy * qy - 2.0 * (hx * qx + hy * qy)
        if across > 0.0:
            high = min(high, room / across)
        elif across < 0.0:
            low = max(low, room / across)
        elif room < 0.0:
            return None
    if low >= high:
        return None
    start = (ex + hx + low * ax, ey + hy + low * ay)
    return start, (ex + hx + high * ax, ey + hy + high * ay)
