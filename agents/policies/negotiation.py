"""What the policies that negotiate share: newest entries that spread, and the way to a point.

Each robot says a list of whole numbers about itself, an *entry*: (tick, values...). A packet
carries the sender's entry and the newest that it has of each other robot. Of two entries of one
robot the greater counts, which is the newer one; this merge is commutative, associative and
idempotent, so loss, delay, another order, duplicates and ways round cannot change what is known
once the newest entries have arrived (a last-writer-wins register per robot; in ACBBA, Johnson et
al. 2010: of two bids of one robot the newer time stamp counts). Over static links without loss,
all know an entry as many ticks after it was made as the network's diameter has links.

An entry of a robot goes when the robot is not planned with and its entry is older than a given
age. Who is *present*: whoever is planned with or has an entry. ``ENTRIES_MAX`` entries fit into a
packet for sure; a larger team says its own entry each time and the others in turn, packet by
packet.
"""

from collections.abc import Iterator, Mapping
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from encircle.agents.planning.prediction_step import best_step
from encircle.agents.policies.interface import Decision, View

Entry: TypeAlias = tuple[int, ...]
"""What a robot says of itself: a tick, then whole numbers whose meaning is the policy's."""

Entries: TypeAlias = Mapping[int, Entry]
"""The newest known entry of each robot, by its index into the team, in robot order."""

ENTRIES_MAX = 46
"""Entries in a packet: of two values and with the longest numbers, 22 bytes each, they stay below
1,024 bytes."""
MM_MAX = 2**31 - 1
"""The longest length that is said, in mm; longer ones are said to be this long."""


def own_index(view: View) -> int:
    """Index of this robot into the team."""
    return view.members[view.own]


def millimetres(length_m: float) -> int:
    """A length or coordinate in m in whole millimetres, at most ``MM_MAX`` in magnitude."""
    return max(-MM_MAX, min(MM_MAX, round(1000.0 * length_m)))


def newest_entries(
    known: Entries | None, view: View, key: str, values: int, age_ticks_max: int
) -> dict[int, Entry]:
    """The entries after what was heard at this tick under ``key``, each of ``values`` numbers.

    Nobody but a robot itself knows better what it has last said, so others' copies of this robot's
    own entry are passed over. So is what is no entry at all: a peer may run another policy.
    """
    own, newest = own_index(view), dict(known or {})
    for packet in view.heard:
        for robot, *rest in _entries_in(packet.say.get(key), 2 + values, view):
            entry = tuple(rest)
            if robot != own and entry > newest.get(robot, ()):
                newest[robot] = entry
    kept, oldest = set(view.members), view.tick - age_ticks_max
    return {r: newest[r] for r in sorted(newest) if r in kept or newest[r][0] >= oldest}


def _entries_in(said: Any, length: int, view: View) -> Iterator[tuple[int, ...]]:
    for entry in said if isinstance(said, tuple | list) else ():
        if (
            isinstance(entry, tuple | list)
            and len(entry) == length
            and all(type(number) is int for number in entry)
            and 0 <= entry[0] < len(view.team)
            and 0 <= entry[1] <= view.tick
            and all(abs(number) <= MM_MAX for number in entry[2:])
        ):
            yield tuple(entry)


def present(view: View, entries: Entries) -> list[int]:
    """Indices of the robots that are planned with or have an entry, in robot order."""
    return sorted({*view.members, *entries})


def say_entries(entries: Entries, view: View, key: str) -> dict[str, Any]:
    """The payload: all entries or, of a larger team, the own one and the others in turn."""
    own = own_index(view)
    robots = [robot for robot in entries if robot != own]
    room = ENTRIES_MAX - 1
    if len(robots) > room:
        start = view.tick // view.parameters.publish_every_ticks * room % len(robots)
        robots = [*robots[start:], *robots[:start]][:room]
    if own in entries:
        robots = [own, *robots]
    return {key: [[robot, *entries[robot]] for robot in robots]}


def fixed_ring(count: int, ring_radius_m: float) -> NDArray[np.float64]:
    """(count, 2) in m, from the ring's centre to its points, the first of them eastwards.

    Robots have different views of the target and of each other. That moves these points a little,
    but leaves to each index its bearing ``2 pi k / count``, so that index k means one place to all
    who see as many robots. (Eq. 1 turns its ring to the farthest robot, which two robots may see
    differently.)
    """
    bearings = 2.0 * np.pi * np.arange(count) / count
    ring: NDArray[np.float64] = np.column_stack((np.cos(bearings), np.sin(bearings)))
    return ring_radius_m * ring


def head_for(view: View, ring: NDArray[np.float64], chosen: Mapping[int, int]) -> Decision:
    """To this robot's chosen point of the ring at xi*, which Eq. 2-3 choose.

    ``ring``: (count, 2) from centre to points in m; ``chosen``: the points of robots by their index
    into the team, this one's among them. Eq. 2's variance is over the robots that are planned with
    and have a point.
    """
    grid = view.parameters.xi_grid
    predicted, predictor = view.predict(grid)
    going = [(k, chosen[robot]) for k, robot in enumerate(view.members) if robot in chosen]
    positions = np.array([view.positions[k] for k, _ in going])
    goals = predicted[:, None, :] + ring[[point for _, point in going]]
    distances = np.hypot(*np.moveaxis(goals - positions, -1, 0))
    best = best_step(distances, grid, view.parameters.xi_weight) if len(grid) > 1 else 0
    point = chosen[own_index(view)]
    goal_x, goal_y = (predicted[best] + ring[point]).tolist()
    x, y = view.position
    step = (goal_x - x, goal_y - y)
    return Decision("encircle", step, (goal_x, goal_y), grid[best], point, predictor)
