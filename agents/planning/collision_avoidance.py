"""Collision avoidance from the range scan and the robots in sight.

A step is safe if it keeps the clearance from every surface point the scan shows, and if it takes at
most half of the free space towards each robot in sight: when both of a pair do so they cannot meet,
whatever each of them wants (the idea of buffered Voronoi cells, Zhou et al., 2017). Among headings
15 degrees apart, each with as long a step as is safe, the one that gets farthest in the wanted
direction is taken, of equals the one that turns least, counter-clockwise first; if none gets
anywhere, the first that is free to go full length, so that the robot slides past what blocks it.
The target is not avoided: it is there to be touched.
"""

from collections.abc import Sequence
from functools import lru_cache
from math import cos, hypot, pi, sin

from encircle.protocol.messages import Point
from encircle.protocol.parameters import Parameters

TURN_RAD = pi / 12
_ANGLES = (0.0, *(sign * k * TURN_RAD for k in range(1, 12) for sign in (1, -1)), pi)
TURNS = tuple((cos(angle), sin(angle)) for angle in _ANGLES)
"""Cosine and sine of the turns tried, in that order; the first is none at all."""
PROGRESS_MIN = 0.05
SHARE_MIN = 0.05
GAIN_MIN = 1e-9
"""Differences in progress below this are rounding noise and decide nothing."""
ROUNDING_M = 1e-12
TARGET_TOLERANCE_M = 0.3


@lru_cache(maxsize=16)
def ray_directions(count: int) -> tuple[Point, ...]:
    """Unit vectors of a scan's rays."""
    return tuple((cos(2 * pi * m / count), sin(2 * pi * m / count)) for m in range(count))


def avoid(
    step: Point,
    scan: Sequence[float],
    peers: Sequence[Point],
    target: Point | None,
    parameters: Parameters,
) -> Point:
    """The safe step nearest to the wanted one, or no step at all.

    ``scan``: distances in m; ``peers`` and ``target``: positions relative to the robot, in m.
    """
    length = hypot(*step)
    if length == 0.0:
        return step
    keep = parameters.radius_m + parameters.clearance_m
    reach = keep + length
    near = reach + parameters.radius_m + length
    peers = [(x, y) for x, y in peers if -near < x < near and -near < y < near]
    limits = _peer_limits(peers, length, parameters)
    walls = []
    if scan and min(scan) <= reach:
        walls = _surface_points(scan, reach, peers, target, parameters)
    if not walls and not limits:
        return step
    best, best_gain = (0.0, 0.0), PROGRESS_MIN
    way_out = None
    sx, sy = step
    for turn_cos, turn_sin in TURNS:
        if turn_cos <= best_gain + GAIN_MIN and best_gain > PROGRESS_MIN:
            break  # headings are in order of turning, and none gets farther than its cosine
        candidate = (turn_cos * sx - turn_sin * sy, turn_sin * sx + turn_cos * sy)
        share = _safe_share(candidate, walls, limits, keep)
        if share * turn_cos > best_gain + GAIN_MIN:
            best, best_gain = (share * candidate[0], share * candidate[1]), share * turn_cos
        elif share == 1.0 and way_out is None:
            way_out = candidate
    return best if best_gain > PROGRESS_MIN or way_out is None else way_out


def _surface_points(
    scan: Sequence[float],
    reach: float,
    peers: Sequence[Point],
    target: Point | None,
    parameters: Parameters,
) -> list[Point]:
    """Points of the scan within reach that belong to neither the target nor a robot in sight."""
    movers = [(x, y, parameters.radius_m + TARGET_TOLERANCE_M) for x, y in peers]
    if target is not None:
        movers.append((*target, parameters.target_radius_m + TARGET_TOLERANCE_M))
    points = []
    for distance, (cx, cy) in zip(scan, ray_directions(len(scan)), strict=True):
        if distance <= reach:
            x, y = distance * cx, distance * cy
            if all(hypot(x - mx, y - my) > size for mx, my, size in movers):
                points.append((x, y))
    return points


def _peer_limits(
    peers: Sequence[Point], length: float, parameters: Parameters
) -> list[tuple[float, float, float]]:
    """For each near robot the direction to it and how far this one may go towards it."""
    limits = []
    apart = 2.0 * parameters.radius_m + parameters.clearance_m
    for x, y in peers:
        distance = hypot(x, y)
        limit = max(0.0, (distance - apart) / 2.0)
        if limit < length and distance > 0.0:
            limits.append((x / distance, y / distance, limit))
    return limits


def _safe_share(
    step: Point, walls: list[Point], limits: list[tuple[float, float, float]], keep: float
) -> float:
    """How much of a step is safe, from 0 to 1."""
    sx, sy = step
    share = 1.0
    for nx, ny, limit in limits:
        towards = nx * sx + ny * sy
        if towards * share > limit + ROUNDING_M:
            share = limit / towards
    while walls and share > SHARE_MIN and not _is_clear(share * sx, share * sy, walls, keep):
        share /= 2.0
    return share if share > SHARE_MIN else 0.0


def _is_clear(x: float, y: float, walls: list[Point], keep: float) -> bool:
    """Whether a position keeps the clearance, or comes no nearer where it is too near already."""
    for wx, wy in walls:
        after = hypot(wx - x, wy - y)
        if after < keep and after < hypot(wx, wy):
            return False
    return True
