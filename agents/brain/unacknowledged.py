"""Receipts that a robot repeats in its commands until the world has acknowledged them.

Receipts are numbered in the order of reception. A command carries the oldest ones that are not
acknowledged, as many as it has room for; so the command of a tick acknowledges all receipts up to
the last that it carried.
"""

from collections import deque
from itertools import islice

from encircle.protocol.real_time import RECEIPT_WORDS, Receipt, ReceiptKind
from encircle.protocol.wire.limits import RECEIPTS_MAX

UNACKNOWLEDGED_MAX = 16_384
"""Receipts that are kept; as long as there are as many, the robot receives nothing."""
RECEIPTS_BYTES_MAX, RECEIPT_BYTES = 12 * 1024, 20
"""What a command has room for, and what a receipt takes at most besides its source's name."""


class UnacknowledgedReceipts:
    """The receipts of one robot in one participation. ``team``: the names that may be sources.

    ``carried_max``: how many receipts a command carries at most.
    """

    def __init__(self, team: tuple[str, ...]) -> None:
        self._receipts: deque[Receipt] = deque()
        self._acknowledged = 0
        # By the tick of a command, the number after the last receipt that it carried.
        self._ends: dict[int, int] = {}
        longest = max(len(name.encode()) for name in (*team, *RECEIPT_WORDS))
        self.carried_max = min(RECEIPTS_MAX, RECEIPTS_BYTES_MAX // (RECEIPT_BYTES + longest))

    def has_room(self, for_others: int = 0) -> bool:
        """Whether there is room for a further receipt, besides some for other messages."""
        return len(self._receipts) + for_others < UNACKNOWLEDGED_MAX

    def add_packet(self, sender: str, sequence: int, arrival_us: int) -> None:
        """A packet has been received."""
        self._receipts.append(Receipt(sender, sequence, arrival_us))

    def add_observation(self, kind: ReceiptKind, tick: int, arrival_us: int) -> None:
        """An observation has been answered or passed over."""
        self._receipts.append(Receipt.of_observation(kind, tick, arrival_us))

    def carried_by(self, tick: int) -> tuple[Receipt, ...]:
        """The receipts for the command of a tick."""
        receipts = tuple(islice(self._receipts, self.carried_max))
        self._ends[tick] = self._acknowledged + len(receipts)
        if len(self._ends) > UNACKNOWLEDGED_MAX:
            del self._ends[next(iter(self._ends))]
        return receipts

    def acknowledge(self, tick: int | None) -> None:
        """The world has the command of that tick, and so all that it carried; None: it has none."""
        end = self._ends.get(-1 if tick is None else tick, 0)
        while self._acknowledged < end:
            self._receipts.popleft()
            self._acknowledged += 1
        if end:
            self._ends = {
                later: later_end for later, later_end in self._ends.items() if later_end > end
            }
