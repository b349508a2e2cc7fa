"""Intents: each robot says which point it goes to, and gives way to who has priority.

Theory. The simplest protocol that uses messages: a claim and a right of way. Robots that come
first in robot order have priority. A robot goes to the nearest point that no robot with priority
has claimed, as far as it has heard, and says so. Each hears its peers directly: nothing is passed
on, no bids are compared, and nobody waits for an answer. It is the baseline between implicit
coordination, which says nothing of points, and an auction.

With costs that stand still and all robots in each other's range without loss, robot k (from 0) has
its point for good after k ticks, and the assignment is the serial dictatorship in robot order: the
first takes its nearest point, the second the nearest that is left, and so on. By induction: once
the robots before k have their points and have been heard, nothing that k hears changes any more.
Late, lost or reordered messages only delay this, since of each peer the newest packet counts; n -
1 ticks after the losses stop all is settled. Robots that cannot hear each other may keep one and
the same point: a claim goes one hop. The sum of ways can be worse than the auction's, by any
factor.

A claim stands until a robot with priority claims the same point, the number of robots planned with
changes, or it is ``reclaim_ticks`` old; then the robot chooses anew from where it is. A lost
robot's claim goes with it (``Parameters.peer_age_ticks_max``), and counts for a ring of its own
size alone.

The ring stands still in the world's directions, as in ``auction``; xi* is Eq. 2-3's, and the
robots shrink a closed ring as the paper has it.

Source: our own, as a baseline.

Payload: ``point`` and ``points``, the point claimed and how many there are.
"""

from math import hypot
from typing import Annotated, NamedTuple

from encircle.agents.policies.interface import Decision, Peer, View
from encircle.agents.policies.negotiation import fixed_ring, head_for, millimetres, own_index
from encircle.agents.policies.paper import known_target, shrink
from encircle.protocol.parameters import Meaning, Range, Unit


class Claim(NamedTuple):
    """A robot's claim: since when, of how many points, which."""

    tick: int
    points: int
    point: int


def intents(
    memory: Claim | None,
    view: View,
    *,
    reclaim_ticks: Annotated[
        int,
        Range(1, 1000),
        Unit("ticks"),
        Meaning("A claim of this age is made anew, at the distances of that tick."),
    ] = 5,
) -> tuple[Claim | None, Decision]:
    """Each robot says which point of a ring it goes to, and gives way to earlier robots' claims.

    A claim goes to those that hear it directly, and is not passed on.
    """
    if view.search is not None:
        return None, view.search
    own, count = own_index(view), len(view.members)
    claimed = _claimed(view, count)
    senior = {point for robot, point in claimed.items() if robot < own}
    if (
        memory is None
        or memory.points != count
        or memory.point in senior
        or view.tick - memory.tick >= reclaim_ticks
    ):
        memory = Claim(view.tick, count, _nearest(view, count, senior))
    ring = fixed_ring(count, view.parameters.ring_radius_m)
    decision = shrink(view) or head_for(view, ring, {**claimed, own: memory.point})
    return memory, decision._replace(say={"point": memory.point, "points": count})


def _claimed(view: View, count: int) -> dict[int, int]:
    """Each peer's point, if it has claimed one of a ring of ``count``, by index into the team."""
    others = [robot for robot in view.members if robot != own_index(view)]
    points = [_point_of(peer, count) for peer in view.peers]
    pairs = zip(others, points, strict=True)
    return {robot: point for robot, point in pairs if point is not None}


def _point_of(peer: Peer, count: int) -> int | None:
    said = peer.packet.say if peer.packet else {}
    point = said.get("point")
    # A peer may run another policy, and mean something else by it.
    if said.get("points") != count or type(point) is not int or not 0 <= point < count:
        return None
    return point


def _nearest(view: View, count: int, taken: set[int]) -> int:
    """The nearest point that is not taken, in whole millimetres; ties to the first."""
    (target_x, target_y), (x, y) = known_target(view), view.position
    dx, dy = target_x - x, target_y - y
    ring = fixed_ring(count, view.parameters.ring_radius_m).tolist()
    free = [j for j in range(count) if j not in taken]
    return min(free, key=lambda j: millimetres(hypot(dx + ring[j][0], dy + ring[j][1])))
