"""How far another clock is from this one, and how sure that is.

A question and its answer give four times: the question leaves here (t1) and arrives there (t2), the
answer leaves there (t3) and arrives here (t4). If the question is under way for d and the answer
for e, the remote clock is ahead by

    offset = ((t2 - t1) - (t4 - t3)) / 2 + (e - d) / 2.

Neither d nor e is negative, and their sum is the round trip, ``(t4 - t1) - (t3 - t2)``; nothing
else is known of them. So the first term alone is wrong by at most half the round trip, however much
d and e differ (Mills, RFC 5905, section 8). Clocks also run at different speeds; the difference is
assumed to be at most ``DRIFT``. Therefore the bound of an exchange grows by ``DRIFT`` times the
time between the exchange and the time that is asked about, and by ``DRIFT`` times the length of the
exchange. Of all exchanges within ``WINDOW_US`` of a time the one with the smallest bound there is
used: the one with the shortest round trip, unless it was long ago.

All this is wrong if a clock is set during a run; ``is_steady`` says whether exchanges contradict
each other. Times are whole microseconds; this rounding adds one microsecond to a bound.
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
        """How long question and answer were under way in sum, as far as the clocks say."""
        return (self.arrival_us - self.asked_us) - (self.answered_us - self.received_us)

    @property
    def offset_us(self) -> float:
        """How far the remote clock is ahead, if question and answer were under way equally long."""
        return ((self.received_us - self.asked_us) + (self.answered_us - self.arrival_us)) / 2

    @property
    def error_us(self) -> float:
        """By how much the offset may be wrong, at any time during the exchange.

        Half the true round trip; that of these times is wrong by the drift over the remote part of
        it, and the offset itself changes by the drift over the whole.
        """
        length_us = max(0, self.arrival_us - self.asked_us)
        return max(0, self.round_trip_us) / 2 + 1.5 * DRIFT * length_us + READING_US


class Offset(NamedTuple):
    """How far the remote clock is ahead of this one at some time; wrong by ``error_us`` at most."""

    offset_us: float
    error_us: float


class Offsets:
    """The offset of one remote clock at any time, from some exchanges with it."""

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
            exchanges[index]
            for exchanges, index in (
                (self._before, after - 1),
                (self.exchanges, after - 1),
                (self.exchanges, after),
                (self._after, after),
            )
            if 0 <= index < len(exchanges)
        ]
        offsets = [
            Offset(exchange.offset_us, _error_us(exchange, time_us))
            for exchange in candidates
            if _distance_us(exchange, time_us) <= WINDOW_US
        ]
        return min(offsets, key=lambda offset: offset.error_us, default=None)

    def of_remote(self, time_us: float) -> Offset | None:
        """As ``at``, for a time by the remote clock."""
        if not self.exchanges:
            return None
        # Wrong by the drift and a round trip at most, which is enough to choose an exchange.
        approximate_us = self.exchanges[0].offset_us
        offset = self.at(time_us - approximate_us)
        return offset and (self.at(time_us - offset.offset_us) or offset)

    @property
    def last(self) -> Offset | None:
        """The offset at the last exchange, None without any."""
        return self.at(self.exchanges[-1].arrival_us) if self.exchanges else None

    @property
    def is_steady(self) -> bool:
        """Whether neighbouring exchanges agree within their bounds: no clock was set."""
        return all(
            abs(a.offset_us - b.offset_us)
            <= a.error_us + b.error_us + DRIFT * max(0, b.arrival_us - a.arrival_us)
            for a, b in pairwise(self.exchanges)
        )


def _best_so_far(exchanges: Sequence[Exchange]) -> list[Exchange]:
    """For each exchange the one up to it that has the smallest bound at its time."""
    best: list[Exchange] = []
    for exchange in exchanges:
        previous = best[-1] if best else exchange
        time_us = exchange.arrival_us
        is_too_old = _distance_us(previous, time_us) > WINDOW_US
        is_better = _error_us(exchange, time_us) <= _error_us(previous, time_us)
        best.append(exchange if is_too_old or is_better else previous)
    return best


def _error_us(exchange: Exchange, time_us: float) -> float:
    return exchange.error_us + DRIFT * _distance_us(exchange, time_us)


def _distance_us(exchange: Exchange, time_us: float) -> float:
    """How long a time is before or after an exchange, 0 during it."""
    return max(0.0, exchange.asked_us - time_us, time_us - exchange.arrival_us)
