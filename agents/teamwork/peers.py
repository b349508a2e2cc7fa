"""The peer table: what one robot believes of where the others are, and how old that is.

An entry is the newest thing known of a peer: its own pose packet, or having been seen by this
robot's sensors. Late packets never overwrite newer knowledge. Which peers make up the team that is
planned for, and where stale ones are taken to be, is the staleness policy of ``Parameters``: a peer
is held where it was, or moved on by its velocity for as long as that is trusted, and in the end
left out. A peer that the world says is lost is left out at once, though its body may still be seen,
until it is no longer said to be, or has spoken since.
"""

from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

from encircle.protocol.messages import Point, Pose
from encircle.protocol.parameters import Parameters

Peer: TypeAlias = tuple[int, float, float, float, float]
"""One entry, ``(tick, x, y, vx, vy)``: position in m and velocity in m/tick, as of a tick."""

PeerTable: TypeAlias = tuple[Peer | None, ...]

Lost: TypeAlias = tuple[tuple[int, int, bool], ...]
"""The peers said to be lost: ``(index, tick at which that was said first, spoken since)``."""


class Team(NamedTuple):
    """The team as one robot plans it, in robot order and including itself.

    ``members``: indices into the whole team; ``own``: this robot's place among them;
    ``positions``: theirs, in m.
    """

    members: tuple[int, ...]
    own: int
    positions: tuple[Point, ...]


def incorporate(
    peers: PeerTable,
    packets: Sequence[tuple[int, Pose]],
    seen: Sequence[tuple[int, float, float]],
    tick: int,
    tick_s: float,
) -> PeerTable:
    """The table after hearing packets ``(index, pose)`` and seeing ``(index, x, y)``."""
    table = list(peers)
    for index, pose in packets:
        known = table[index]
        if known is None or pose.tick > known[0]:
            x, y = pose.position
            vx, vy = pose.velocity
            table[index] = (pose.tick, x, y, vx * tick_s, vy * tick_s)
    for index, x, y in seen:
        known = table[index]
        if known is None:
            table[index] = (tick, x, y, 0.0, 0.0)
        elif known[0] < tick:
            # Two sightings, or a packet and a sighting, give the mean velocity in between.
            age = tick - known[0]
            table[index] = (tick, x, y, (x - known[1]) / age, (y - known[2]) / age)
    return tuple(table)


def update_lost(
    lost: Lost, reported: Sequence[int], packets: Sequence[tuple[int, Pose]], tick: int
) -> Lost:
    """Who is lost after hearing that ``said`` are, and packets ``(index, pose)``."""
    before = {index: (since, spoken) for index, since, spoken in lost}
    after = []
    for index in reported:
        since, spoken = before.get(index, (tick, False))
        speaks = any(peer == index and pose.tick >= since for peer, pose in packets)
        after.append((index, since, spoken or speaks))
    return tuple(after)


def without_lost(peers: PeerTable, lost: Lost) -> PeerTable:
    """The table without the peers that are lost and have not spoken since."""
    if not lost:
        return peers
    silent = {index for index, _, spoken in lost if not spoken}
    return tuple([None if index in silent else peer for index, peer in enumerate(peers)])


def planning_team(
    peers: PeerTable, own: int, position: Point, tick: int, parameters: Parameters
) -> Team:
    """The team to plan with at a tick: this robot and every peer that is young enough."""
    table = list(peers)
    table[own] = (tick, *position, 0.0, 0.0)
    oldest = tick - parameters.peer_age_ticks_max
    members = tuple([i for i, peer in enumerate(table) if peer is not None and peer[0] >= oldest])
    if len(members) < len(table):
        table = [table[i] for i in members]
    positions = believed_positions(table, tick, parameters)  # type: ignore[arg-type]  # members are known
    return Team(members, members.index(own), positions)


def believed_positions(
    known: Sequence[Peer], tick: int, parameters: Parameters
) -> tuple[Point, ...]:
    """Where robots of whom this is known are taken to be at a tick, in m."""
    if parameters.peer_policy == "hold":
        return tuple([(x, y) for _, x, y, _, _ in known])
    trusted = parameters.extrapolate_ticks_max
    return tuple(
        [
            (x + (tick - t) * vx, y + (tick - t) * vy)
            if tick - t <= trusted
            else (x + trusted * vx, y + trusted * vy)
            for t, x, y, vx, vy in known
        ]
    )
