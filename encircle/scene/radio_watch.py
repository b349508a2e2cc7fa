"""What the radio has delivered so far: ages of information, and the share that arrives.

Fates come tick by tick, in order. What is kept is bounded by the packets in flight.
"""

from collections import deque
from collections.abc import Sequence

from encircle.protocol.messages import Radio
from encircle.scene.frame import DELIVERY_TICKS, Packet

NEVER = -1


class RadioWatch:
    """The radio of one run with ``count`` robots, as the packets' fates tell it.

    ``first_tick``: the first tick whose packets are known; what came before it is not.
    """

    def __init__(self, count: int) -> None:
        self.first_tick: int | None = None
        self._newest = [[NEVER] * count for _ in range(count)]
        self._in_flight: dict[int, list[tuple[int, int, int]]] = {}
        self._decided: deque[tuple[int, int, int]] = deque()

    def arrive(self, tick: int) -> None:
        """Deliver what is due by a tick."""
        for due in sorted(due for due in self._in_flight if due <= tick):
            for sent, sender, receiver in self._in_flight.pop(due):
                row = self._newest[receiver]
                row[sender] = max(row[sender], sent)

    def send(self, radio: Radio) -> tuple[Packet, ...]:
        """The packets of a tick, which are under way from now on, by sender and receiver."""
        tick, copies = radio.tick, radio.copies
        packets, delivered = [], 0
        for sender, row in enumerate(radio.fates):
            for receiver, due in enumerate(row):
                if due == 0:
                    continue
                copy_due = copies[sender][receiver] if copies else 0
                packets.append(Packet(sender, receiver, due, copy_due))
                delivered += due > 0 or copy_due > 0
                for arrival in (due, copy_due):
                    if arrival > 0:
                        flight = (tick, sender, receiver)
                        self._in_flight.setdefault(arrival, []).append(flight)
        self._decided.append((tick, len(packets), delivered))
        if self.first_tick is None:
            self.first_tick = tick
        return tuple(packets)

    def ages(self, tick: int) -> tuple[tuple[int, ...], ...]:
        """``ages[receiver][sender]`` at a tick in ticks, -1 if nothing has arrived, own 0."""
        return tuple([ages_of_row(own, row, tick) for own, row in enumerate(self._newest)])

    def delivery(self, tick: int) -> float | None:
        """The share delivered of the packets sent in the last ``DELIVERY_TICKS`` ticks."""
        while self._decided and self._decided[0][0] <= tick - DELIVERY_TICKS:
            self._decided.popleft()
        sent = sum(packets for _, packets, _ in self._decided)
        return sum(delivered for _, _, delivered in self._decided) / sent if sent else None


def ages_of_row(own: int, newest: Sequence[int], tick: int) -> tuple[int, ...]:
    """One robot's ages at a tick, from when the newest packet it has of each robot was sent."""
    return tuple(
        [
            0 if sender == own else NEVER if sent < 0 else tick - sent
            for sender, sent in enumerate(newest)
        ]
    )


def age_mean(
    ages: Sequence[Sequence[int]], there: Sequence[bool], tick: int, from_start: bool
) -> float | None:
    """The mean age of information over links whose two ends are there, None if there is none.

    Before the first delivery the age is counted from the tick before the first, as in
    ``encircle.measures.radio``; if that is not known (``from_start``), the link is left out.
    """
    known = [
        tick + 1 if age < 0 else age
        for receiver, row in enumerate(ages)
        for sender, age in enumerate(row)
        if sender != receiver and there[sender] and there[receiver] and (age >= 0 or from_start)
    ]
    return sum(known) / len(known) if known else None
