"""Contention: packets that robots send in the same tick are lost to each other.

ALOHA (Abramson 1970; Roberts 1975 for slots): packets of length T begin at random times. One passes
if no other begins within T of it, before or after; in slots of length T, if no other takes its
slot. With other packets as a Poisson process that offers G packets per T, the probabilities are
exp(-2 G) and exp(-G).

Here G is counted, per link and tick: the packets that robots other than the sender really sent at
this tick and that the receiver can hear, times T / tick. The receiver's own packet counts too,
since a radio that sends hears nothing. What waits at a rate limit counts at the tick at which the
transmitter got it; what finds no room, and what a silent radio does not send, does not count. Each
link has a draw of its own. Nothing is remembered.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from encircle.world.random_streams import Purpose, link_uniforms
from encircle.world.scenario.channel_model import VULNERABLE_PACKETS, Contention

Floats = NDArray[np.float64]


class SharedAir(NamedTuple):
    """``vulnerable``: of a tick, in which another packet hits one; ``range_m``: None is any."""

    seed: int
    vulnerable: float
    range_m: float | None


def build(contention: Contention, tick_s: float, seed: int) -> SharedAir:
    """The contention of a channel."""
    packets = VULNERABLE_PACKETS[contention.access]
    return SharedAir(seed, packets * contention.packet_s / tick_s, contention.range_m)


def lost(
    air: SharedAir, tick: int, on_air: NDArray[np.bool_], distances_m: Floats | None
) -> NDArray[np.bool_]:
    """(N, N) which packets are lost to others.

    ``on_air``: (N,) who sends; ``distances_m``: (N, N), needed where there is a range.
    """
    count = len(on_air)
    heard = np.repeat(on_air[:, None], count, axis=1)
    if air.range_m is not None:
        assert distances_m is not None, "contention within a range needs distances"
        heard = heard & (distances_m <= air.range_m)
    others = np.count_nonzero(heard, axis=0) - heard
    chance = -np.expm1(-air.vulnerable * others)
    hit: NDArray[np.bool_] = link_uniforms(air.seed, Purpose.CONTENTION, tick, count) < chance
    return hit
