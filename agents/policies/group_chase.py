"""Group chase: predicted pursuit, with soft repulsion that spreads the chasers around the prey.

A robot at x_i with velocity v_i, the target at x_e with v_e; s is the robot's full speed, B its
diameter. Each robot adds three unit vectors, N(.) = . / |.|, and goes that way at full speed:

    chase     N( r / |r| + c_e (B / |x_e - x_i|)^2 (v_e - v_i) / s ),   r = x_e + v_e T - x_i
    spread    N( sum_j (R - d_ij)+ (x_i - x_j) / d_ij + c_r (B / d_ij)^2 (v_j - v_i) / s )
    collision N( sum_j (D - d_ij)+ (x_i - x_j) / d_ij )

    step = s N( chase + ``spread`` spread + collision )

The chase is towards where the target will be after T = min(|x_e - x_i| / s, ``predict_s``), the
time to get to where it is now, and its viscous part aligns the robot's velocity with the target's,
more so near by. Spread is a soft spring between robots nearer than R = ``spread_m``, with a viscous
part of its own; it makes a group that goes after one target surround it. Both springs are minus the
gradients of the potential sum_j (R - d_ij)+^2 / 2. The collision term acts within D = ``near_m``.

Source: Janosov, Viragh, Vasarhelyi, Vicsek, "Group chasing tactics: how to catch a faster prey",
New J. Phys. 19 (2017) 053003, arXiv 1701.00284. The terms are those of its chasers as public
re-implementations have them. There a chaser alone captures, a much faster prey, in a closed arena.
Delay, noise and limited acceleration, parts of its model of flight, are the world's business here,
and there is no wall, so no term for it. Lengths and speeds in the drag are in bodies and in full
speeds, which makes c_e and c_r plain numbers. All numbers are our own, tuned coarsely for captures.
"""

from collections.abc import Iterable
from math import hypot
from typing import Annotated

from encircle.agents.planning.stop_distance import kept_off
from encircle.agents.policies.interface import Decision, View
from encircle.protocol.messages import Point
from encircle.protocol.parameters import LengthOrZero, Meaning, Range, Unit

Seconds = Annotated[float, Range(0.0, 60.0), Unit("s")]
Weight = Annotated[float, Range(0.0, 100.0)]


def group_chase(
    memory: None,
    view: View,
    *,
    predict_s: Annotated[Seconds, Meaning("The target is predicted no farther ahead.")] = 3.0,
    spread: Annotated[Weight, Meaning("The weight of spread against that of chase.")] = 0.5,
    spread_m: Annotated[LengthOrZero, Meaning("Robots nearer than this repel each other.")] = 9.0,
    near_m: Annotated[LengthOrZero, Meaning("Robots nearer than this avoid each other.")] = 1.2,
    chase_drag: Annotated[Weight, Meaning("c_e, alignment with the target.")] = 0.1,
    spread_drag: Annotated[Weight, Meaning("c_r, alignment with the other robots.")] = 0.1,
) -> tuple[None, Decision]:
    """The sum of chase, spread and collision, at full speed."""
    target, parameters = view.target, view.parameters
    if target is None:
        assert view.search is not None, "without an estimate there is a search"
        return memory, view.search
    own, full_m, peers = view.position, parameters.step_m_max, view.peers
    body_m = 2.0 * parameters.radius_m
    full_mps = full_m / view.tick_s
    velocity = (view.last_step[0] / full_m, view.last_step[1] / full_m)
    gap_m = hypot(target.x - own[0], target.y - own[1])
    ahead_s = min(gap_m / full_mps, predict_s)
    goal = (target.x + ahead_s * target.vx, target.y + ahead_s * target.vy)
    chase_x, chase_y = _unit(goal[0] - own[0], goal[1] - own[1])
    drag_x, drag_y = _drag(
        velocity, (target.vx / full_mps, target.vy / full_mps), gap_m, body_m, chase_drag
    )
    chase = _unit(chase_x + drag_x, chase_y + drag_y)
    places = [peer.position for peer in peers]
    spread_x, spread_y = soft_repulsion(own, places, spread_m)
    for peer in peers:
        distance = hypot(peer.position[0] - own[0], peer.position[1] - own[1])
        theirs = (peer.velocity[0] / full_mps, peer.velocity[1] / full_mps)
        drag_x, drag_y = _drag(velocity, theirs, distance, body_m, spread_drag)
        spread_x, spread_y = spread_x + drag_x, spread_y + drag_y
    apart = _unit(spread_x, spread_y)
    collision = _unit(*soft_repulsion(own, places, near_m))
    x, y = _unit(
        chase[0] + spread * apart[0] + collision[0], chase[1] + spread * apart[1] + collision[1]
    )
    step = kept_off((full_m * x, full_m * y), own, target.position, parameters)
    return memory, Decision("pursue", step, goal)


def soft_repulsion(own: Point, others: Iterable[Point], range_m: float) -> Point:
    """The sum of (R - d)+ away from each of the others, in m; none from one at the same place."""
    x = y = 0.0
    for other_x, other_y in others:
        dx, dy = own[0] - other_x, own[1] - other_y
        distance = hypot(dx, dy)
        if 0.0 < distance < range_m:
            x += (range_m - distance) * dx / distance
            y += (range_m - distance) * dy / distance
    return x, y


def _drag(velocity: Point, theirs: Point, distance_m: float, body_m: float, drag: float) -> Point:
    """The viscous part: what aligns ``velocity`` with ``theirs``, both in full speeds."""
    strength = (body_m / max(distance_m, body_m)) ** 2 * drag
    return strength * (theirs[0] - velocity[0]), strength * (theirs[1] - velocity[1])


def _unit(x: float, y: float) -> Point:
    length = hypot(x, y)
    return (x / length, y / length) if length > 0.0 else (0.0, 0.0)
