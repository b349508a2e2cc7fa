"""Auction: robots bid for the encirclement points, and spread bids until all agree.

Theory. CBAA, the consensus-based auction algorithm (Choi, Brunet, How, "Consensus-Based
Decentralized Auctions for Robust Task Allocation", IEEE Transactions on Robotics 25(4), 2009, Sec.
III). Point j costs robot i c_ij (the paper's scores are -c_ij).

1. Auction. A robot without a point bids for the cheapest of those it would win,
       j* = argmin over j with (c_ij, i) < (y_j, z_j) of c_ij,
where y_j is the best bid known for point j and z_j its bidder; ties go to the first in robot
order. There is always one: n robots are present, and n - 1 others bid for one point each.
2. Consensus. What a robot knows of bids it sends, and takes over what is better from its peers. A
   robot that is outbid at its point is without one, and bids again.

Guarantees, for costs that stand still and messages over a connected network of diameter D without
loss: the assignment is the one of the sequential greedy algorithm (take the smallest of all c_ij,
strike out its row and column, repeat); no two robots hold one point after (n - 1) D rounds, and
all know all after n D (Theorem 1 there, with N_min = n: as many points as robots). Let robot r be
the r-th that the greedy algorithm serves, with point j_r. No earlier one ever bids for j_r, so r
can always have it, and bids for j_1, ..., j_r alone, whatever it has heard so far: r - 1 has its
point for good (r - 2) D rounds on at the latest, and r knows that D rounds later. Nothing in this
asks that messages come in order, once, or soon; when losses stop, n D more rounds suffice. With
scores L - c_ij >= 0 the sum of scores is at least half of the best one.

Costs. By ``distance``, c_ij = d_ij, the way, which is usual for robots. Then a robot that stands
at its point cannot be outbid; in a hunt that was looked at, the front was left to whoever was
farthest behind, and the fleeing target got away. By ``projection``, c_ij = -p_i . u_j for the
robot's position p_i from the target and the point's direction u_j: who stands out farthest in a
direction gets it, and who is near, and soon round, goes elsewhere. Since d_ij^2 = |p_i|^2 + rho^2 -
2 rho p_i . u_j, the least sum of these costs is the least sum of squared ways.

Asynchronous rules. Robots and target move, so bids change, also to worse. CBAA keeps one (bid,
winner) per point, of which the better counts; ACBBA (Johnson, Ponda, Choi, How, AIAA GNC 2010)
adds times and a table of rules. Here each robot's newest bid is kept instead, with its tick, and
y_j, z_j follow from these. The rules come to less: of two bids by one robot the newer counts, be
it the worse one; of two robots the better bid; a bid elsewhere takes the old one back, so nothing
has to be reset; and nobody else changes a robot's own bid.

Bids age: a robot bids anew when its bid is ``rebid_ticks`` old, for the best point that it would
win from where it is. Between these it changes only when outbid. When the number of robots present
changes, bids for a ring of another size count no more, and the auction begins again. A robot that
is lost leaves the ring at once for those that planned with it, and ``bid_age_ticks_max`` after its
last bid for those that knew of it through others (more than ``rebid_ticks`` and the ways round);
one that is back bids as if new, and its newer bid replaces the old one.

Only who takes which point is negotiated. The ring is ``negotiation.fixed_ring``, xi* is Eq. 2-3's
over the points that are bid for, and the robots shrink a closed ring as the paper has it.

Source: Choi, Brunet, How 2009 (CBAA), and Johnson, Ponda, Choi, How 2010 (ACBBA).

Payload: ``bids``, for each robot [index, tick, number of points, point, cost in mm].
"""

from collections.abc import Mapping
from math import hypot
from typing import Annotated, Literal, NamedTuple

from encircle.agents.policies.interface import Decision, View
from encircle.agents.policies.negotiation import (
    MM_MAX,
    Entries,
    fixed_ring,
    head_for,
    millimetres,
    newest_entries,
    own_index,
    present,
    say_entries,
)
from encircle.agents.policies.paper import known_target, shrink
from encircle.protocol.parameters import Meaning, Range, Unit

FREE = (MM_MAX + 1, 0)
"""The price of a point that nobody bids for."""


class Bid(NamedTuple):
    """A robot's bid at a tick: for a point of a ring of so many, what it costs it, in mm."""

    tick: int
    points: int
    point: int
    cost_mm: int


def auction(
    memory: Entries | None,
    view: View,
    *,
    cost: Annotated[
        Literal["projection", "distance"],
        Meaning("What bids are by: who stands out farthest that way, or who is nearest, gets it."),
    ] = "projection",
    rebid_ticks: Annotated[
        int, Range(1, 1000), Unit("ticks"), Meaning("A bid of this age is made anew.")
    ] = 5,
    bid_age_ticks_max: Annotated[
        int,
        Range(1, 1000),
        Unit("ticks"),
        Meaning("Older bids count only if their robot is planned with."),
    ] = 20,
) -> tuple[Entries, Decision]:
    """Robots bid for the points of a ring and pass bids on: a consensus-based auction (CBAA).

    Bids carry ticks, so that late and lost ones do no harm.
    """
    own = own_index(view)
    bids = newest_entries(memory, view, "bids", 3, bid_age_ticks_max)
    if view.search is not None:
        bids.pop(own, None)
        return bids, view.search._replace(say=say_entries(bids, view, "bids"))
    count = len(present(view, bids))
    valid = {r: b for r, b in bids.items() if b[1] == count and 0 <= b[2] < count}
    known = {robot: Bid(*bid) for robot, bid in valid.items()}
    prices: dict[int, tuple[int, int]] = {}
    for robot, bid in known.items():
        if robot != own:
            prices[bid.point] = min(prices.get(bid.point, FREE), (bid.cost_mm, robot))
    held = known.get(own)
    if (
        held is None
        or view.tick - held.tick >= rebid_ticks
        or (held.cost_mm, own) > prices.get(held.point, FREE)
    ):
        bids[own] = known[own] = _best_bid(view, count, prices, cost)
    ring = fixed_ring(count, view.parameters.ring_radius_m)
    chosen = {robot: bid.point for robot, bid in known.items()}
    decision = shrink(view) or head_for(view, ring, chosen)
    return bids, decision._replace(say=say_entries(bids, view, "bids"))


def _best_bid(view: View, count: int, prices: Mapping[int, tuple[int, int]], cost: str) -> Bid:
    """A bid for the cheapest of the points that this robot would win; ties to the first point."""
    own, (x, y), (target_x, target_y) = own_index(view), view.position, known_target(view)
    x, y = x - target_x, y - target_y
    radius_m = view.parameters.ring_radius_m
    ring = fixed_ring(count, radius_m).tolist()
    if cost == "distance":
        costs = [millimetres(hypot(x - ring_x, y - ring_y)) for ring_x, ring_y in ring]
    else:
        costs = [millimetres(-(x * ring_x + y * ring_y) / radius_m) for ring_x, ring_y in ring]
    winnable = [j for j in range(count) if (costs[j], own) < prices.get(j, FREE)]
    point = min(winnable, key=costs.__getitem__)
    return Bid(view.tick, count, point, costs[point])
