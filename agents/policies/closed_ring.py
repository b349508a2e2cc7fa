"""Encirclement of a faster target by occupied angles: spread in angle first, then close in.

Seen from the target, robot i stands at bearing beta_i and distance d_i. It cuts off the headings
within its half-angle h_i of that bearing (``encircle.agents.planning.occupied_angles``), and the
slack of the gap between neighbours i and j is h_i + h_j - (beta_j - beta_i). The ring is closed if
no slack is negative. Each robot

1. maximises the lesser of its own two slacks by moving in angle. With the capture distance left out
   all half-angles are asin(lambda), and that is midway between its neighbours: it turns about the
   target by half the difference of its two gaps;
2. spends what is left of the step inwards: of a step s with a aside, sqrt(s^2 - a^2);
3. while the ring is open, keeps off: no nearer than ``hold_m``, nor than the team's mean distance
   less ``lead_m``, so that the ring is closed before it is tight, and everywhere at once.

How much of a step may go aside decides hunts. Only the two robots at the ends of the gap that the
target runs into can bar its way; they may spend nearly all of it. The others have to come along and
spend ``behind_share``. From beyond ``far_m`` everybody spends less: a target that nobody sees any
more is lost. lambda follows from the target's mean speed of late, which a robot remembers. It says
nothing: of its peers only their places matter, and those are in every packet.

Source: occupied angles as a measure of how well a faster evader is enclosed are those of Fang,
Wang, Xie, Chen, "Cooperative Pursuit with Multi-Pursuer and One Faster Free-moving Evader" (arXiv
2001.04731). The law above is our own, not theirs. Its numbers were tuned on random starts 4 to 10 m
away, against targets that flee or that seek gaps, 0.9 to 1.3 times as fast as the robots. It knows
nothing of how a target behaves but that it moves.
"""

from collections.abc import Sequence
from functools import reduce
from math import atan2, cos, hypot, inf, pi, sin, sqrt
from operator import add
from typing import Annotated

from encircle.agents.planning.occupied_angles import Slack, half_angle, slacks
from encircle.agents.planning.stop_distance import kept_off
from encircle.agents.policies.interface import Decision, View
from encircle.protocol.parameters import Angle, LengthOrZero, Meaning, Range

FAR_SLOPE_PER_M = 0.06
SPEED_WEIGHT = 0.2
"""That of the newest speed in the mean of late."""

Share = Annotated[float, Range(0.0, 1.0)]


def closed_ring(
    memory: float | None,
    view: View,
    *,
    front_share: Annotated[
        Share, Meaning("Of a step, what may go aside in the target's way.")
    ] = 0.99,
    behind_share: Annotated[Share, Meaning("Of a step, what may go aside elsewhere.")] = 0.9,
    far_m: Annotated[LengthOrZero, Meaning("Beyond it less of a step goes aside.")] = 5.5,
    hold_m: Annotated[LengthOrZero, Meaning("No nearer than this while the ring is open.")] = 4.0,
    lead_m: Annotated[LengthOrZero, Meaning("Nor nearer than the team's mean less this.")] = 0.5,
    margin_rad: Annotated[Angle, Meaning("The least slack of a closed ring.")] = 0.2,
) -> tuple[float | None, Decision]:
    """Turn about the target to midway between the neighbours, and close in with the rest.

    ``memory``: the target's mean speed of late in m/s, None before anything is known of it.
    """
    target, parameters, own = view.target, view.parameters, view.own
    if target is None:
        assert view.search is not None, "without an estimate there is a search"
        return memory, view.search
    speed_mps = hypot(target.vx, target.vy)
    if memory is not None:
        speed_mps = memory + SPEED_WEIGHT * (speed_mps - memory)
    rays = [(x - target.x, y - target.y) for x, y in view.positions]
    bearings = [atan2(y, x) for x, y in rays]
    distances = [hypot(x, y) for x, y in rays]
    bearing, distance, full_m = bearings[own], distances[own], parameters.step_m_max
    full_mps = full_m / view.tick_s
    ratio = full_mps / speed_mps if speed_mps > 0.0 else inf
    halves = [half_angle(ratio, parameters.stop_distance_m, d) for d in distances]
    ring = slacks(bearings, halves)
    is_open = min(gap.slack_rad for gap in ring) < margin_rad
    ccw_rad, cw_rad = _gaps(own, bearings, ring)
    heading_rad = (atan2(target.vy, target.vx) - bearing) % (2.0 * pi)
    is_front = heading_rad < ccw_rad or heading_rad > 2.0 * pi - cw_rad
    share = front_share if is_front else behind_share
    aside_max = full_m * min(share, max(0.0, 1.0 - FAR_SLOPE_PER_M * (distance - far_m)))
    turn_rad = (ccw_rad - cw_rad) / 2.0
    aside = max(-aside_max, min(aside_max, distance * turn_rad))
    inward = sqrt(full_m * full_m - aside * aside)
    if is_open and distance > hold_m:
        # Not by sum(), whose rounding depends on Python's version.
        total_m = reduce(add, distances)
        nearest = max(hold_m, total_m / len(distances) - lead_m)
        inward = max(0.0, min(inward, distance - nearest))
    ux, uy = cos(bearing), sin(bearing)
    step = (-inward * ux - aside * uy, -inward * uy + aside * ux)
    step = kept_off(step, view.position, target.position, parameters)
    if not is_open:
        return speed_mps, Decision("shrink", step, target.position)
    wanted = bearing + turn_rad
    goal = (target.x + distance * cos(wanted), target.y + distance * sin(wanted))
    return speed_mps, Decision("encircle", step, goal)


def _gaps(own: int, bearings: Sequence[float], ring: Sequence[Slack]) -> tuple[float, float]:
    """The gaps in rad from this robot to its neighbours counter-clockwise and clockwise."""
    widths_rad = [(bearings[gap.before] - bearings[gap.after]) % (2.0 * pi) for gap in ring]
    if not any(widths_rad):
        # Whoever stands alone, or all in one line: one gap is the whole turn.
        widths_rad[-1] = 2.0 * pi
    ccw_rad = cw_rad = 0.0
    for gap, width_rad in zip(ring, widths_rad, strict=True):
        if gap.after == own:
            ccw_rad = width_rad
        if gap.before == own:
            cw_rad = width_rad
    return ccw_rad, cw_rad
