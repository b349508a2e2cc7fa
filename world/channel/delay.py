"""Delay: how long each packet of a tick takes, in seconds and in whole ticks.

Distributions are drawn by inverting their cumulative distribution, one uniform per packet, so that
two arms that differ in the delay's law or its parameters meet the same quantiles of it. *Normal* is
truncated at zero: the law of a normal variable with mean m and deviation s given that it is not
negative, so that the mean delay is m + s phi(m / s) / Phi(m / s), above m. *Gamma* and *lognormal*
are given by their own mean and deviation. A *trace* is met as
``encircle.world.channel.trace_playback`` says; where the recording lost a packet its row stands for
the delay of the packet received last before it, so that loss and delay of one recording stay in
step, while a resampled trace is drawn from the delays of received packets alone.

A packet is delivered at the first tick at or after its arrival, and at the next tick at the
earliest.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import get_args

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv, ndtr, ndtri

from encircle.world.channel.trace_playback import (
    Rows,
    laid_out,
    received,
    rows_per_link,
    without_gaps,
)
from encircle.world.random_streams import Purpose, block_ticks, link_block
from encircle.world.scenario.channel_model import Parts
from encircle.world.scenario.delay_models import (
    ConstantDelay,
    Delay,
    ExponentialDelay,
    GammaDelay,
    LognormalDelay,
    NormalDelay,
    UniformDelay,
)
from encircle.world.scenario.fields import Replay

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Quantile = Callable[[Floats, Floats, Floats], Floats]
TICKS_MAX = 1e9
SLACK_TICKS = 1e-9


def uniform(p: Floats, low_s: Floats, high_s: Floats) -> Floats:
    """Quantiles of the uniform distribution."""
    return low_s + (high_s - low_s) * p


def gamma(p: Floats, mean_s: Floats, std_s: Floats) -> Floats:
    """Quantiles of the gamma distribution."""
    shape, scale = (mean_s / std_s) ** 2, std_s**2 / mean_s
    return np.asarray(scale * gammaincinv(shape, p), np.float64)


def lognormal(p: Floats, mean_s: Floats, std_s: Floats) -> Floats:
    """Quantiles of the lognormal distribution."""
    variance = np.log1p((std_s / mean_s) ** 2)
    location, width = np.log(mean_s) - variance / 2, np.sqrt(variance)
    return np.asarray(np.exp(location + width * ndtri(p)), np.float64)


def normal(p: Floats, mean_s: Floats, std_s: Floats) -> Floats:
    """Quantiles of the normal distribution given that it is not negative."""
    # From the upper tail: 1 - F(x) = (1 - p) Phi(m / s), exact where p is near 1.
    above = (1.0 - p) * ndtr(mean_s / std_s)
    return np.maximum(0.0, mean_s - std_s * ndtri(above))


def exponential(p: Floats, mean_s: Floats, _: Floats) -> Floats:
    """Quantiles of the exponential distribution."""
    return -mean_s * np.log1p(-p)


QUANTILES: dict[str, Quantile] = {
    "uniform": uniform,
    "gamma": gamma,
    "lognormal": lognormal,
    "normal": normal,
    "exponential": exponential,
}


@dataclass(frozen=True, eq=False, slots=True)
class Delays:
    """A channel's delays per directed link, (N, N), and the purpose of their draws.

    ``fixed_s``: where nothing is drawn; ``laws``: links, quantiles and these links' parameters;
    ``sample``: sorted delays to draw from; ``rows``: delays to be met in their order.
    """

    seed: int
    robots: int
    purpose: Purpose
    tick_s: float
    fixed_s: Floats
    laws: tuple[tuple[NDArray[np.bool_], Quantile, Floats, Floats], ...]
    sample: Rows | None
    rows: Rows | None


def build(
    parts: Parts[Delay],
    ids: Sequence[str],
    tick_s: float,
    seed: int,
    purpose: Purpose = Purpose.DELAY,
) -> Delays:
    """The delays of a channel; those of copies are drawn, also from a trace."""
    count = len(ids)
    fixed_s, first, second = np.zeros((3, count, count))
    drawn: dict[str, NDArray[np.bool_]] = {}
    for _, links, delay in parts:
        if isinstance(delay, ConstantDelay):
            fixed_s[links] = delay.mean_s
        elif delay.model in QUANTILES and links.any():
            first[links], second[links] = _parameters(delay)
            drawn[delay.model] = links | drawn.get(delay.model, np.zeros_like(links))
    in_order = [] if purpose == Purpose.COPY_DELAY else ["repeat", "shifted"]
    replayed = rows_per_link(parts, ids, in_order)
    sampled = rows_per_link(parts, ids, [mode for mode in get_args(Replay) if mode not in in_order])
    return Delays(
        seed,
        count,
        purpose,
        tick_s,
        fixed_s,
        tuple(
            (links, QUANTILES[model], first[links], second[links])
            for model, links in sorted(drawn.items())
        ),
        laid_out([(k, received(values), "resample") for k, values, _ in sampled], count, seed),
        laid_out([(k, without_gaps(values), mode) for k, values, mode in replayed], count, seed),
    )


def _parameters(delay: Delay) -> tuple[float, float]:
    """A law's two parameters in s, as its function in ``QUANTILES`` takes them."""
    if isinstance(delay, UniformDelay):
        return delay.low_s, delay.high_s
    if isinstance(delay, ExponentialDelay):
        return delay.mean_s, 0.0
    assert isinstance(delay, GammaDelay | LognormalDelay | NormalDelay), "a law of QUANTILES"
    return delay.mean_s, delay.std_s


def seconds(delays: Delays, tick: int) -> Floats:
    """(N, N) how long each link's packet of a tick takes, in s; read-only."""
    block, row = _block_and_row(delays, tick)
    taken: Floats = _block(delays, block)[0][row]
    return taken


def ticks(delays: Delays, tick: int) -> Ints:
    """(N, N) the same in whole ticks until delivery; read-only."""
    block, row = _block_and_row(delays, tick)
    taken: Ints = _block(delays, block)[1][row]
    return taken


def whole_ticks(delay_s: Floats, tick_s: float, waited_ticks: Floats | float = 0.0) -> Ints:
    """Whole ticks until delivery: the first tick at or after arrival, and never the same tick.

    ``waited_ticks``: how long the packet waited before it was sent.
    """
    # A delay of exactly k ticks must not become k + 1 because tick_s is not a binary fraction.
    taken = np.ceil(delay_s / tick_s + waited_ticks - SLACK_TICKS)
    return np.minimum(np.maximum(taken, 1.0), TICKS_MAX).astype(np.int64)


def _block_and_row(delays: Delays, tick: int) -> tuple[int, int]:
    """In which block a tick's delays are, and where in it."""
    steady = not delays.laws and delays.sample is None and delays.rows is None
    return (0, 0) if steady else divmod(tick, block_ticks(delays.robots**2))


@lru_cache(maxsize=16)
def _block(delays: Delays, block: int) -> tuple[Floats, Ints]:
    """(T, N, N) the delays of a block of ticks, in s and in ticks: inverting is slow one by one."""
    count, many = delays.robots, block_ticks(delays.robots**2)
    taken = np.repeat(delays.fixed_s[None], many, axis=0)
    if delays.laws or delays.sample is not None:
        draws = link_block(delays.seed, delays.purpose, block, count)
        for links, quantile, first, second in delays.laws:
            taken[:, links] = quantile(draws[:, links], first, second)
        if delays.sample is not None:
            links = delays.sample.links
            taken[:, links] = delays.sample.by(draws)[:, links]
    if delays.rows is not None:
        links = delays.rows.links
        at = block * many + np.arange(many)
        taken[:, links] = delays.rows.at(at[:, None, None])[:, links]
    whole = whole_ticks(taken, delays.tick_s)
    taken.setflags(write=False)
    whole.setflags(write=False)
    return taken, whole
