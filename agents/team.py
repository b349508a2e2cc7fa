"""The peer table: what one robot believes of where the others are, and how old that is.

An entry is the newest thing known of a peer: its own pose packet, or having been seen by this
robot's sensors. Late packets never overwrite newer knowledge. Which peers make up the team that is
planned for, and where stale ones are taken to be, is the staleness policy of ``Parameters``.
"""

from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

from protocol.messages import Point, Pose
from protocol.parameters import Parameters


class Peer(NamedTuple):
    """One entry: position in m and velocity in m/tick, as of a tick."""

    tick: int
    x: float
    y: float
    vx: float
    vy: float


class Team(NamedTuple):
    """The team as one robot plans it, in robot order and including itself.

    ``members``: indices into the whole team; ``own``: this robot's place among them;
    ``positions``: theirs, in m.
    """

    members: tuple[int, ...]
    own: int
    positions: tuple[Point, ...]


PeerTable: TypeAlias = tuple[Peer | None, ...]


def fold(
    peers: PeerTable,
    packets: Sequence[tuple[int, Pose]],
    seen: Sequence[tuple[int, Point]],
    tick: int,
    tick_s: float,
) -> PeerTable:
    """The table after hearing packets ``(index, pose)`` and seeing robots ``(index, position)``."""
    table = list(peers)
    for index, pose in packets:
        known = table[index]
        if known is None or pose.tick > known.tick:
            x, y = pose.position
            vx, vy = pose.velocity
            table[index] = Peer(pose.tick, x, y, vx * tick_s, vy * tick_s)
    for index, (x, y) in seen:
        known = table[index]
        if known is None:
            table[index] = Peer(tick, x, y, 0.0, 0.0)
        elif known.tick < tick:
            # Two sightings, or a packet and a sighting, give the mean velocity in between.
            age = tick - known.tick
            table[index] = Peer(tick, x, y, (x - known.x) / age, (y - known.y) / age)
    return tuple(table)


def team_of(peers: PeerTable, own: int, position: Point, tick: int, parameters: Parameters) -> Team:
    """The team to plan with at a tick: this robot and every peer that is young enough."""
    oldest = tick - parameters.peer_age_ticks_max
    extrapolate = parameters.peer_policy == "extrapolate"
    members, rows = [], []
    for index, peer in enumerate(peers):
        if index == own:
            members.append(index)
            rows.append(position)
        elif peer is not None and peer.tick >= oldest:
            members.append(index)
            if extrapolate:
                age = tick - peer.tick
                rows.append((peer.x + age * peer.vx, peer.y + age * peer.vy))
            else:
                rows.append((peer.x, peer.y))
    return Team(tuple(members), members.index(own), tuple(rows))
