"""What only runs in real time put into a command: receipts, times of the robot's clock, counts.

A robot counts in ``Command.refused``, beside what it has refused, the observations that it has
passed over because a newer one was there, those that never came, and packets from its peers for
which it had no room. From the first two the world can tell a command that was lost on its way from
one that was never given.

Commands may be lost, and are so when the network is at its worst. Therefore a robot keeps a receipt
for each message that it has received, in the order of reception, and repeats it in every command
until an observation says that one of these commands has arrived (``Observation.answered``). So the
world knows of everything that the robot received before the newest receipt that the world has. The
receipt of an observation has, in the place of a sender, a word that says whether the robot answered
it or passed it over; it stands after the receipts of packets that the robot had received by then.
"""

from enum import Enum, StrEnum
from functools import partial
from typing import Annotated, Any, NamedTuple

from encircle.protocol.wire.field_types import CheckedBy, Count, Items, Text
from encircle.protocol.wire.limits import COUNT_MAX, RECEIPTS_MAX, TEXT_MAX


class ReceptionCount(StrEnum):
    """Counts in ``Command.refused`` that are no refusals."""

    PASSED_OVER = "passed-over"
    MISSED = "missed"
    OVERHEARD = "overheard"


class ReceiptKind(Enum):
    """What a receipt is for."""

    PACKET = "a packet of a peer"
    ANSWERED = "an observation that the robot answered"
    PASSED_OVER = "an observation that the robot passed over for a newer one"


_WORD_OF = {ReceiptKind.ANSWERED: "world", ReceiptKind.PASSED_OVER: "passed-over"}
_KIND_OF = {word: kind for kind, word in _WORD_OF.items()}
RECEIPT_WORDS = tuple(_KIND_OF)
"""What a receipt of an observation has on the wire in the place of a sender."""


class Receipt(NamedTuple):
    """A robot's note that a message has arrived.

    ``source`` is the sender of a packet, or one of ``RECEIPT_WORDS``; ``number`` the packet's
    sequence or the observation's tick; ``arrival_us`` a time by the robot's clock.
    """

    source: Text
    number: Count
    arrival_us: Count

    @classmethod
    def of_observation(cls, kind: ReceiptKind, tick: int, arrival_us: int) -> "Receipt":
        """The receipt of an observation, which was answered or passed over."""
        return cls(_WORD_OF[kind], tick, arrival_us)

    @property
    def kind(self) -> ReceiptKind:
        """What it is for."""
        return _KIND_OF.get(self.source, ReceiptKind.PACKET)


_RECEIPT_OF = partial(tuple.__new__, Receipt)  # as Receipt._make, without its own check of length


def _check_receipts(value: Any) -> tuple[Receipt, ...]:
    """As follows from the annotation; a command may carry hundreds."""
    if type(value) is not tuple:
        raise ValueError("a list")
    if len(value) > RECEIPTS_MAX:
        raise ValueError(f"a list of at most {RECEIPTS_MAX} receipts")
    for item in value:
        if type(item) is not tuple or len(item) != 3:
            raise ValueError("made of a sender, a number and a time in us each")
        source, number, arrival_us = item
        if not (
            type(source) is str
            and type(number) is type(arrival_us) is int
            and 0 <= number <= COUNT_MAX
            and 0 <= arrival_us <= COUNT_MAX
            and len(source) <= TEXT_MAX
        ):
            raise ValueError("made of a sender, a number and a time in us each")
    return tuple(map(_RECEIPT_OF, value))


class Timing(NamedTuple):
    """Times of a command by its robot's clock, and receipts, oldest first.

    ``observation_us``: when the observation came that it answers; ``sent_us``: when it was sent.
    """

    observation_us: Count
    sent_us: Count
    receipts: Annotated[tuple[Receipt, ...], Items(RECEIPTS_MAX), CheckedBy(_check_receipts)]
