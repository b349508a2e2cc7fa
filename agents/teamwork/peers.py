"""The peer table: what one robot believes of where the others are, and how old that is.

An entry is the newest thing known of a peer: its own pose packet, or having been seen by this
robot's sensors. Late packets never overwrite newer knowledge. ``Parameters`` decide which peers
are in the planning team, and where peers with old positions are assumed to be: a peer stays where
it was, or moves on by its velocity for as long as that is trusted, and is left out in the end. A
peer that the world reports as lost is left out at once, though its body may still be seen, until it
is no longer reported or has sent a packet since.
"""

from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

from encircle.protocol.messages import Point, Pose
from encircle.protocol.parameters import Parameters

Peer: TypeAlias = tuple[int, float, float, float, float]
"""One entry, ``(tick, x, y, vx, vy)``: position in m and velocity in m/tick, as of a tick."""

PeerTable: TypeAlias = tuple[Peer | None, ...]

Lost: TypeAlias = tuple[tuple[int, int, bool], ...]
"""The peers reported lost: ``(index, tick of the first report, has sent a packet since)``."""


class Team(NamedTuple):
    """The team as one robot plans it, in robot order and including itself.

    ``members``: indices into the whole team; ``own``: this robot's index among them;
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
    """The table after receiving packets ``(index, pose)`` and seeing ``(index, x, y)``."""
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
    """Who is lost, after ``reported`` peers were, and packets ``(index, pose)`` were received."""
    before = {index: (since, has_sent) for index, since, has_sent in lost}
    after = []
    for index in reported:
        since, has_sent = before.get(index, (tick, False))
        sends = any(peer == index and pose.tick >= since for peer, pose in packets)
        after.append((index, since, has_sent or sends))
    return tuple(after)


def without_lost(peers: PeerTable, lost: Lost) -> PeerTable:
    """The table without the peers that are lost and have sent no packet since."""
    if not lost:
        return peers
    silent = {index for index, _, has_sent in lost if not has_sent}
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
    """The positions in m at which robots are assumed to be at a tick, from what is known."""
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
