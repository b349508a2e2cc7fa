"""Hungarian consensus: robots spread what their ways would cost, and each solves the same problem.

Theory. DHBA, the decentralised Hungarian-based algorithm (Ismail, Sun, "Decentralized
Hungarian-based approach for fast and scalable task allocation", ICUAS 2017). Each robot knows its
own row of the cost matrix, the costs c_ij of its ways to all points j. Robots exchange the rows
that they know, and each solves the assignment problem for all,

    minimise the sum over i of c_(i, s(i)) over permutations s,

by the Hungarian algorithm, and takes its own part of the solution. On a connected network of
diameter D without loss all have all rows after D rounds. Equal matrices then have equal solutions,
the best there is, without a further word.

Rows in two numbers. A row of N costs is a function of the ray from the target to the robot, as
that robot sees it: c_ij = |ray_i - offset_j|, where the offsets from the target to the points are
the same for all (``negotiation.fixed_ring``). So a robot says its ray, and all that have heard it
know its whole row, whatever they themselves believe of the target. Ties break by robot order
(``encircle.agents.planning.assignment``).

Rows age. A robot renews its ray at ticks divisible by ``renew_ticks``, all robots at the same
ones. Between these the rays stand still, and D ticks after each renewal all solve the same problem
again; a larger ``renew_ticks`` gives more agreement on older positions. A late ray never replaces
a newer one. A robot that is lost leaves the problem at once for those that planned with it, and
``row_age_ticks_max`` after its last ray for those that knew of it through others (which must be
more than ``renew_ticks`` and the ways round); one that is back says a new ray. Of a robot that is
planned with but has said no ray the position that it is believed to be at counts, as in Algorithm
1.

Only who takes which point is agreed. The assignment is that for the ring around the target's
present position; xi* is Eq. 2-3's for it, and the robots shrink a closed ring as the paper has it.
The ring stands still in the world's directions, where Eq. 1 turns it to the robot farthest from
the target. In a hunt that was looked at, that turning ring ran away from a team that agreed: the
farthest robot was assigned the point next to it, and the ring, with that point, turned as it went.

With ``say_rows`` off the robots say nothing, and each solves the problem for where it believes the
others to be: implicit coordination on the same ring, to be compared with.

Source: Ismail, Sun, "Decentralized Hungarian-based approach" (ICUAS 2017).

Payload: ``rows``, for each robot [index, tick, x, y], the ray in mm.
"""

from typing import Annotated, Any

import numpy as np

from encircle.agents.planning.assignment import assign
from encircle.agents.policies.interface import Decision, View
from encircle.agents.policies.negotiation import (
    Entries,
    fixed_ring,
    head_for,
    millimetres,
    newest_entries,
    own_index,
    say_entries,
)
from encircle.agents.policies.paper import known_target, shrink
from encircle.protocol.parameters import Meaning, Range, Unit


def hungarian_consensus(
    memory: Entries | None,
    view: View,
    *,
    renew_ticks: Annotated[
        int,
        Range(1, 1000),
        Unit("ticks"),
        Meaning("Robots say where they are anew at ticks divisible by this."),
    ] = 5,
    row_age_ticks_max: Annotated[
        int,
        Range(1, 1000),
        Unit("ticks"),
        Meaning("What was said longer ago counts only if its robot is planned with."),
    ] = 20,
    say_rows: Annotated[
        bool,
        Meaning("Whether robots say rows; if not, each goes by where it believes all to be."),
    ] = True,
) -> tuple[Entries, Decision]:
    """Robots pass on where each says that it is, and all solve the same assignment (DHBA).

    The sum of their ways to the points of a ring is least, once all have heard of all.
    """
    own = own_index(view)
    rows = newest_entries(memory, view, "rows", 2, row_age_ticks_max) if say_rows else {}
    if view.search is not None:
        rows.pop(own, None)
        return rows, view.search._replace(say=_said(rows, view, say_rows))
    target_x, target_y = known_target(view)
    believed = {
        robot: (x - target_x, y - target_y)
        for robot, (x, y) in zip(view.members, view.positions, strict=True)
    }
    if own not in rows or view.tick % renew_ticks == 0:
        rows[own] = (view.tick, *map(millimetres, believed[own]))
    said = {robot: (x / 1000.0, y / 1000.0) for robot, (_, x, y) in rows.items()}
    rays = believed | said
    robots = sorted(rays)
    ring = fixed_ring(len(robots), view.parameters.ring_radius_m)
    assigned = assign(np.array([rays[robot] for robot in robots]), ring[None])[0][0].tolist()
    chosen = dict(zip(robots, assigned, strict=True))
    decision = shrink(view) or head_for(view, ring, chosen)
    return rows, decision._replace(say=_said(rows, view, say_rows))


def _said(rows: Entries, view: View, say_rows: bool) -> dict[str, Any] | None:
    return say_entries(rows, view, "rows") if say_rows else None
