"""How far another clock is from this one, and how sure that is.

A question and its answer carry four times: asked here (1), heard there (2), answered there (3),
heard here (4). With one-way delays d and e the remote clock is ahead by

    offset = ((t2 - t1) - (t4 - t3)) / 2 + (e - d) / 2,

and all that is known of d and e is that neither is negative and that together they are what the
round took, ``round_trip = (t4 - t1) - (t3 - t2)``. So the midpoint is wrong by at most half the
round trip, however unequal the two ways are (Mills, RFC 5905, section 8). Clocks also run at
different speeds, by at most ``DRIFT`` here. Then an exchange tells of another time only within
``DRIFT`` times the time in between, and of its own within as much of its own length. Of all
exchanges within ``WINDOW_US`` of a time the one with the smallest bound there is taken: it is the
quickest one, unless that is long ago.

A clock that is set anew during a run breaks this; ``is_steady`` says whether exchanges contradict
each other. Times are whole microseconds; reading one down to that costs another microsecond.
"""

from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

DRIFT = 1e-4
"""How much faster one clock may run than another: 100 us in a second, twice what crystals do."""
WINDOW_US = 60_000_000
READING_US = 1.0


class Exchange(NamedTuple):
    """The four times in us: the first and last by this clock, the other two by the remote one."""

    asked_us: int
    received_us: int
    answered_us: int
    arrival_us: int

    @property
    def round_trip_us(self) -> int:
        """How long question and answer were on their way together, as far as the clocks say."""
        return (self.arrival_us - self.asked_us) - (self.answered_us - self.received_us)

    @property
    def offset_us(self) -> float:
        """How far the remote clock is ahead, if both ways take equally long."""
        return ((self.received_us - self.asked_us) + (self.answered_us - self.arrival_us)) / 2

    @property
    def error_us(self) -> float:
        """By how much the offset may be wrong, at any time during the exchange.

        Half the true round trip; that of these times is wrong by the drift over the remote part of
        it, and the offset itself changes by the drift over the whole.
        """
        took_us = max(0, self.arrival_us - self.asked_us)
        return max(0, self.round_trip_us) / 2 + 1.5 * DRIFT * took_us + READING_US


class Offset(NamedTuple):
    """How far the remote clock is ahead of this one at some time; wrong by ``error_us`` at most."""

    offset_us: float
    error_us: float


class Offsets:
    """What some exchanges with one remote clock tell of its offset at any time."""

    def __init__(self, exchanges: Sequence[Exchange]) -> None:
        self.exchanges = sorted(exchanges, key=lambda exchange: exchange.arrival_us)
        self._arrival_us = [exchange.arrival_us for exchange in self.exchanges]
        self._before = _best_so_far(self.exchanges)
        backwards = _best_so_far(self.exchanges[::-1])
        self._after = backwards[::-1]

    def at(self, time_us: float) -> Offset | None:
        """The offset at a time by this clock; None without an exchange within ``WINDOW_US``."""
        after = bisect_right(self._arrival_us, time_us)
        candidates = [
            ranked[place]
            for ranked, place in (
                (self._before, after - 1),
                (self.exchanges, after - 1),
                (self.exchanges, after),
                (self._after, after),
            )
            if 0 <= place < len(ranked)
        ]
        found = [
            Offset(exchange.offset_us, _error_us(exchange, time_us))
            for exchange in candidates
            if _apart_us(exchange, time_us) <= WINDOW_US
        ]
        return min(found, key=lambda offset: offset.error_us, default=None)

    def of_remote(self, time_us: float) -> Offset | None:
        """As ``at``, for a time by the remote clock."""
        if not self.exchanges:
            return None
        # Good to within the drift and a round trip, which is near enough to choose an exchange.
        near = self.exchanges[0].offset_us
        found = self.at(time_us - near)
        return found and (self.at(time_us - found.offset_us) or found)

    @property
    def last(self) -> Offset | None:
        """The offset at the last exchange, None without any."""
        return self.at(self.exchanges[-1].arrival_us) if self.exchanges else None

    @property
    def is_steady(self) -> bool:
        """Whether neighbouring exchanges agree within their bounds: no clock was set anew."""
        known = self.exchanges
        return all(
            abs(a.offset_us - b.offset_us)
            <= a.error_us + b.error_us + DRIFT * max(0, b.arrival_us - a.arrival_us)
            for a, b in pairwise(known)
        )


def _best_so_far(exchanges: Sequence[Exchange]) -> list[Exchange]:
    """For each place the exchange up to there that tells most of that place's time."""
    best: list[Exchange] = []
    for exchange in exchanges:
        known = best[-1] if best else exchange
        time_us = exchange.arrival_us
        gone = _apart_us(known, time_us) > WINDOW_US
        best.append(
            exchange if gone or _error_us(exchange, time_us) <= _error_us(known, time_us) else known
        )
    return best


def _error_us(exchange: Exchange, time_us: float) -> float:
    return exchange.error_us + DRIFT * _apart_us(exchange, time_us)


def _apart_us(exchange: Exchange, time_us: float) -> float:
    """How long a time is before or after an exchange, 0 during it."""
    return max(0.0, exchange.asked_us - time_us, time_us - exchange.arrival_us)
