"""A transmitter that takes its time: one queue per sender, first come, first served.

A packet is sent once for all its receivers. That takes the longer of 1 / ``packets_per_s`` and
its size / ``bytes_per_s``; before it go the packets that were there before. Waiting and sending
count as delay, also if the transmitter was idle: a packet has been sent when its last byte has.
One packet can be in transmission and ``queue_packets_max`` can wait; another is dropped. Nothing is
drawn.

Times are in ticks after the present tick. To go on by a tick is to subtract exactly 1, so that
nothing drifts however long a run is.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from encircle.world.scenario.channel_model import RateLimit

Floats = NDArray[np.float64]
SLACK_TICKS = 1e-9


class Transmitter(NamedTuple):
    """What each sender can do: time in ticks per packet and per byte, and how many may wait."""

    packet_ticks: float
    byte_ticks: float
    waiting_max: int


def build(limit: RateLimit, tick_s: float) -> Transmitter:
    """The transmitters of a channel."""
    return Transmitter(
        1.0 / (limit.packets_per_s * tick_s) if limit.packets_per_s is not None else 0.0,
        1.0 / (limit.bytes_per_s * tick_s) if limit.bytes_per_s is not None else 0.0,
        limit.queue_packets_max,
    )


def idle(transmitter: Transmitter, robots: int) -> Floats:
    """The queues before the first packet: (N, slots) ticks until each packet has left, 0 if free.

    A sender's packets are in no order in its slots; the one that was last sent leaves last.
    """
    return np.zeros((robots, transmitter.waiting_max + 1))


def send(
    transmitter: Transmitter,
    queues: Floats,
    sending: NDArray[np.bool_],
    sizes_bytes: NDArray[np.int64] | None,
) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """A tick later: the queues, (N,) ticks until each packet has left, and (N,) which are dropped.

    ``sending``: (N,) who has a packet; ``sizes_bytes``: (N,), needed where bytes take time. To be
    called at every tick.
    """
    queues = np.maximum(queues - 1.0, 0.0)
    # What leaves at a tick has left, though a third of a tick has no exact number.
    queues[queues < SLACK_TICKS] = 0.0
    takes: Floats | float = transmitter.packet_ticks
    if transmitter.byte_ticks > 0.0:
        assert sizes_bytes is not None, "a limit on bytes needs sizes"
        takes = np.maximum(takes, sizes_bytes * transmitter.byte_ticks)
    left = queues.max(axis=1) + takes
    taken = sending & (np.count_nonzero(queues, axis=1) <= transmitter.waiting_max)
    queues[taken, queues.argmin(axis=1)[taken]] = left[taken]
    return queues, left, sending & ~taken
