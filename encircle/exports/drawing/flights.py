"""Packets on their way, tick by tick: which piece of its link a packet covers between two ticks.

A packet that arrives on time covers its link between one tick and the next. A late one is on its
way for several ticks, and covers a part of the link in each. A lost one ends on the way, at the
share of its link that the palette gives to its cause: where it was lost the channel does not know.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from encircle.exports.drawing.shapes import Point
from encircle.scene.frame import Frame, Packet
from encircle.scene.palette import ARRIVED, LATE, LOST, UNKNOWN_LOSS, PacketStyle

ON_TIME, DELAYED = "arrived", "late"
"""Fates of packets that arrive; that of one that is lost is the name of the cause."""


def fate_of(packet: Packet, tick: int, causes: Sequence[str]) -> str:
    """``arrived``, ``late``, or why it was lost: the fate of a packet sent at a tick."""
    if packet.due < 0:
        return causes[-packet.due]
    return ON_TIME if packet.due <= tick + 1 else DELAYED


def style_of(fate: str) -> PacketStyle:
    """How packets of a fate look."""
    return {ON_TIME: ARRIVED, DELAYED: LATE}.get(fate) or LOST.get(fate, UNKNOWN_LOSS)


@dataclass(frozen=True, slots=True)
class Leg:
    """The piece of a link, from ``start`` to ``end`` in m, that a packet covers after a tick."""

    start: Point
    end: Point
    fate: str


@dataclass(frozen=True, slots=True)
class _Flight:
    packet: Packet
    sent: int
    origin: Point


class Flights:
    """The packets that are on their way; takes frames in the order of their ticks."""

    def __init__(self, causes: Sequence[str]) -> None:
        self._causes = tuple(causes)
        self._late: list[_Flight] = []

    def take(self, frame: Frame) -> tuple[Leg, ...]:
        """The legs that begin at the frame's tick; none at the tick at which a run ends."""
        tick, robots = frame.tick, frame.robots
        sent = [_Flight(p, tick, robots[p.sender]) for p in frame.packets]
        under_way = [f for f in self._late if f.packet.due > tick]
        self._late = under_way + [f for f in sent if f.packet.due > tick + 1]
        return tuple(self._leg(f, robots[f.packet.receiver], tick) for f in [*under_way, *sent])

    def _leg(self, flight: _Flight, goal: Point, tick: int) -> Leg:
        fate = fate_of(flight.packet, flight.sent, self._causes)
        if flight.packet.due < 0:
            end = _between(flight.origin, goal, style_of(fate).reach)
            return Leg(flight.origin, end, fate)
        ticks, begun = flight.packet.due - flight.sent, tick - flight.sent
        start = _between(flight.origin, goal, begun / ticks)
        return Leg(start, _between(flight.origin, goal, (begun + 1) / ticks), fate)


def _between(start: Point, end: Point, share: float) -> Point:
    return (start[0] + share * (end[0] - start[0]), start[1] + share * (end[1] - start[1]))
