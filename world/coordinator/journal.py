"""The account of a run: the digest of all that happens, what is to be recorded of it, and counts.

Nobody waits for it: what happens is noted at once, and worked off when there is time (``settle``).
"""

import hashlib
from collections import Counter
from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np

from encircle.world.arena.engine import ArenaState
from encircle.world.channel import channel as radio
from encircle.world.channel.delay_means import RequestedDelay, requested_delay
from encircle.world.coordinator.result import Result
from encircle.world.scenario.model import Scenario

Outgoing = list[tuple[str, bytes]]
Record = Callable[[int, str, bytes], None]


class Journal:
    """What is told of one run of a scenario in the end. ``header``: what its digest begins with."""

    def __init__(self, scenario: Scenario, header: str) -> None:
        self.pending: list[tuple[int, list[bytes], Outgoing]] = []
        self.digest = hashlib.blake2b(header.encode(), digest_size=16)
        self._scenario = scenario
        self._packets_sent = 0
        self._packets_copied = 0
        self._delays = 0
        self._delays_ticks = 0
        self._lost: Counter[int] = Counter()
        self._contacts = 0

    def note(self, tick: int, digested: list[bytes], messages: Outgoing) -> None:
        """Note parts for the digest, and messages sent at a tick, for ``settle``."""
        self.pending.append((tick, digested, messages))

    def commit(self, record: Record | None, viewer_key: str) -> Outgoing:
        """Digest and record what was noted since the last call; returns what is on a key."""
        shown: Outgoing = []
        for tick, digested, recorded in self.pending:
            for part in digested:
                self.digest.update(part)
            for key, payload in recorded:
                if record is not None:
                    record(tick, key, payload)
                if key == viewer_key:
                    shown.append((key, payload))
        self.pending.clear()
        return shown

    def count(self, tick: int, fates: radio.Fates, contacts: int) -> None:
        """Count the packets of a tick by their fates, and the contacts that came of it."""
        self._packets_sent += int(np.count_nonzero(fates.due))
        if fates.due.min() < 0:
            self._lost.update((-fates.due[fates.due < 0]).tolist())
        first = fates.due
        if fates.copies is not None:
            self._packets_copied += int(np.count_nonzero(fates.copies))
            first = np.where(fates.copies > 0, np.minimum(first, fates.copies), first)
        arrivals = first[first > 0]
        self._delays += arrivals.size
        self._delays_ticks += int(arrivals.sum()) - tick * arrivals.size
        self._contacts += contacts

    def result(
        self,
        state: ArenaState,
        count: int,
        ended: str | None,
        refused: Counter[str],
        departures: Sequence[tuple[int, str, str]],
    ) -> Result:
        """What came of a run of ``count`` robots, so far if it has not ended."""
        lost = {radio.CAUSES[code]: number for code, number in sorted(self._lost.items())}
        flying = radio.in_flight(state.channel_state)
        # What is due at the last tick has arrived, though no robot is asked any more.
        unread = radio.deliver(state.channel_state, state.tick)[1]
        in_flight = flying - sum(int(flight.links.sum()) for flight in unread)
        return Result(
            state.captured,
            state.tick if state.captured else None,
            state.tick,
            ended or "running",
            tuple(state.geometry.distances[:count, count].tolist()),
            self._packets_sent,
            lost,
            self._packets_copied,
            self._packets_sent + self._packets_copied - sum(lost.values()) - in_flight,
            in_flight,
            self._requested_delay.model,
            self._requested_delay.s_mean,
            self._delay_s_mean(),
            self._contacts,
            dict(sorted(refused.items())),
            self.digest.copy().hexdigest(),
            tuple(departures),
        )

    @cached_property
    def _requested_delay(self) -> RequestedDelay:
        return requested_delay(self._scenario.channel, self._scenario.ids)

    def _delay_s_mean(self) -> float | None:
        if not self._delays or self._scenario.radio == "direct":
            return None
        return self._delays_ticks / self._delays * self._scenario.tick_s
