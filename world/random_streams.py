"""Random draws without a generator's memory: each is a function of (seed, purpose, tick, index).

numpy's Philox is counter-based: the key holds seed and purpose, the counter the tick, and the index
in the stream is the robot's or the link's. No draw depends on what was drawn before it, on which
process ran first, or on whether another stage of the channel is switched on. So two arms of a
comparison meet the same fates.
"""

from enum import IntEnum
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri


class Purpose(IntEnum):
    """What a draw is for. The numbers are part of what a seed means: never change one."""

    PLACEMENT = 1
    DETECTION_NOISE = 2
    LOSS = 3
    BURST_STATE = 4
    BURST_LOSS = 5
    DELAY = 6
    JITTER = 7
    TRACE_START = 8
    COPY = 9
    COPY_DELAY = 10
    ROBOT_RADIO_LOSS = 11
    LOCALISATION_NOISE = 12
    LOCALISATION_DRIFT = 13
    FADING = 14
    FADING_PHASE = 15
    SHADOWING = 16
    CONTENTION = 17


DRAW_MIN = 2.0**-53
"""A draw of 0 counts as this where the logarithm of 0 would be taken."""
BLOCK_TICKS_MAX = 64
BLOCK_DRAWS_MAX = 4096


def uniforms(seed: int, purpose: Purpose, tick: int, count: int) -> NDArray[np.float64]:
    """``count`` independent draws from [0, 1); draw k is the same for every ``count`` > k."""
    bits = np.random.Philox(
        key=np.array((seed, purpose), dtype=np.uint64),
        counter=np.array((0, 0, tick, 0), dtype=np.uint64),
    )
    return np.random.Generator(bits).random(count)


def normal_pairs(seed: int, purpose: Purpose, tick: int, count: int) -> NDArray[np.float64]:
    """(N, 2) standard normal draws, two a robot, the same for it in larger teams; read-only."""
    ticks = block_ticks(2 * count)
    drawn: NDArray[np.float64] = _normal_block(seed, purpose, tick // ticks, count)[tick % ticks]
    return drawn


@lru_cache(maxsize=64)
def _link_indices(robots: int) -> NDArray[np.intp]:
    """(N, N) indices of links in a stream, a pair's the same whatever N is (Szudzik's pairing)."""
    s, r = np.meshgrid(np.arange(robots), np.arange(robots), indexing="ij")
    return np.where(s < r, r * r + s, s * s + s + r)


def link_uniforms(seed: int, purpose: Purpose, tick: int, robots: int) -> NDArray[np.float64]:
    """(N, N) draws, one per directed link [sender, receiver]; read-only."""
    ticks = block_ticks(robots**2)
    drawn: NDArray[np.float64] = _link_block(seed, purpose, tick // ticks, robots)[tick % ticks]
    return drawn


def pair_uniforms(seed: int, purpose: Purpose, tick: int, robots: int) -> NDArray[np.float64]:
    """(N, N) draws, one per pair of robots: that of the link from its first to its second robot."""
    upper = np.triu(link_uniforms(seed, purpose, tick, robots))
    return upper + np.triu(upper, 1).T


def block_ticks(draws: int) -> int:
    """How many ticks of so many draws are worth making at once; says nothing of what they are."""
    return max(1, min(BLOCK_TICKS_MAX, BLOCK_DRAWS_MAX // draws))


def link_block(seed: int, purpose: Purpose, block: int, robots: int) -> NDArray[np.float64]:
    """(T, N, N) the draws of a block's T = ``block_ticks`` ticks, each as in ``uniforms``."""
    drawn = _block(seed, purpose, block, robots**2)[:, _link_indices(robots)]
    drawn.setflags(write=False)
    return drawn


@lru_cache(maxsize=16)
def _normal_block(seed: int, purpose: Purpose, block: int, count: int) -> NDArray[np.float64]:
    """(T, N, 2) standard normal draws of a block's ticks."""
    draws = _block(seed, purpose, block, 2 * count)
    drawn: NDArray[np.float64] = ndtri(np.maximum(draws, DRAW_MIN))
    drawn.setflags(write=False)
    return drawn.reshape(-1, count, 2)


def _block(seed: int, purpose: Purpose, block: int, count: int) -> NDArray[np.float64]:
    """(T, count) the draws of a block's ticks, each as in ``uniforms``."""
    ticks = block_ticks(count)
    # To make a generator costs as much as some hundred draws; to set its counter, far less.
    bits = np.random.Philox(key=np.array((seed, purpose), dtype=np.uint64))
    state, generator = bits.state, np.random.Generator(bits)
    draws = np.empty((ticks, count))
    for k in range(ticks):
        state["state"]["counter"][:] = (0, 0, block * ticks + k, 0)
        bits.state = state
        generator.random(out=draws[k])
    return draws


_link_block = lru_cache(maxsize=16)(link_block)
