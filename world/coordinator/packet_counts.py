"""Counts of a run's packets by what became of them, and of their delays."""

from collections import Counter
from typing import NamedTuple

import numpy as np

from encircle.world.arena.engine import ArenaState
from encircle.world.channel import channel as radio


class PacketTotals(NamedTuple):
    """Packets of a run so far: sent and copied together are lost, delivered and in flight.

    ``lost``: by cause. ``delay_ticks_mean``: of the first copy of each that is not lost, None
    without any.
    """

    sent: int
    copied: int
    lost: dict[str, int]
    delivered: int
    in_flight: int
    delay_ticks_mean: float | None


class PacketCounts:
    """The counts of one run, which grow with every tick."""

    def __init__(self) -> None:
        self._sent = 0
        self._copied = 0
        self._arrivals = 0
        self._delays_ticks = 0
        self._lost: Counter[int] = Counter()

    def add(self, tick: int, fates: radio.Fates) -> None:
        """Count the packets of a tick by their fates."""
        self._sent += int(np.count_nonzero(fates.due))
        if fates.due.min() < 0:
            self._lost.update((-fates.due[fates.due < 0]).tolist())
        first = fates.due
        if fates.copies is not None:
            self._copied += int(np.count_nonzero(fates.copies))
            first = np.where(fates.copies > 0, np.minimum(first, fates.copies), first)
        arrivals = first[first > 0]
        self._arrivals += arrivals.size
        self._delays_ticks += int(arrivals.sum()) - tick * arrivals.size

    def totals(self, state: ArenaState) -> PacketTotals:
        """The totals of a run that has come to this state."""
        lost = {radio.CAUSES[code]: number for code, number in sorted(self._lost.items())}
        undelivered = radio.in_flight(state.channel_state)
        # What is due at the last tick has arrived, though no robot is asked any more.
        arrived = radio.deliver(state.channel_state, state.tick)[1]
        in_flight = undelivered - sum(int(flight.links.sum()) for flight in arrived)
        return PacketTotals(
            self._sent,
            self._copied,
            lost,
            self._sent + self._copied - sum(lost.values()) - in_flight,
            in_flight,
            self._delays_ticks / self._arrivals if self._arrivals else None,
        )
