"""What has come in at a tick: packets in order, the newest of each robot, all detections."""

from collections.abc import Mapping, Sequence
from functools import lru_cache
from math import copysign

from encircle.agents.estimation.kalman import Detection
from encircle.agents.teamwork.relaying import relayed_detections
from encircle.protocol.messages import Observation, Point, Pose

SHARED_MAX = 4096
"""Detections that robots in one process share: those of 16 ticks of the largest team."""


def in_order(packets: Sequence[Pose], indices: Mapping[str, int]) -> list[tuple[int, Pose]]:
    """The packets with their senders' indices, by tick, sender and sequence.

    Arrival order is never information.
    """
    received = [(indices[packet.robot], packet) for packet in packets]
    before = (-1, -1, -1)
    for index, packet in received:
        rank = (packet.tick, index, packet.sequence)
        if rank < before:
            received.sort(key=lambda entry: (entry[1].tick, entry[0], entry[1].sequence))
            break
        before = rank
    return received


def newest_packets(
    packets: tuple[Pose | None, ...], received: Sequence[tuple[int, Pose]], tick: int
) -> tuple[Pose | None, ...]:
    """The newest packet of each robot, after these: ``(index, packet)``, oldest first."""
    newest = list(packets)
    if received[0][1].tick == tick - 1:
        # None is late, so each is newer than what was known.
        for index, packet in received:
            newest[index] = packet
        return tuple(newest)
    for index, packet in received:
        known = newest[index]
        if (
            known is None
            or packet.tick > known.tick
            or (packet.tick == known.tick and packet.sequence > known.sequence)
        ):
            newest[index] = packet
    return tuple(newest)


def _detection_in(packet: Pose, sender: int, position: Point) -> Detection:
    """The detection in a packet: one object for all robots in a process, each of which keeps it."""
    # Zero and minus zero are equal, and yet two detections.
    signs = tuple([copysign(1.0, value) for value in position]) if 0.0 in position else ()
    return _detection(packet.tick, sender, position, signs)


@lru_cache(maxsize=SHARED_MAX)
def _detection(tick: int, origin: int, position: Point, _signs: tuple[float, ...]) -> Detection:
    return (tick, origin, *position)


def detections_of(
    observation: Observation,
    own: int,
    received: Sequence[tuple[int, Pose]],
    indices: Mapping[str, int],
) -> list[Detection]:
    """Every detection that reached this robot at this tick, its own included."""
    tick = observation.tick
    collected, relaying = [], []
    for index, packet in received:
        if packet.detection is not None and packet.tick < tick:
            collected.append(_detection_in(packet, index, packet.detection))
        if packet.relayed:
            relaying.append(packet)
    if relaying:
        # Of one origin and tick the last counts: the origin's own packet, not one that relays it.
        collected = relayed_detections(relaying, tick, own, indices) + collected
    if observation.target is not None:
        collected.append((tick, own, *observation.target))
    return collected
