"""How long packets take on average: as a scenario asks for it, and as it comes out in whole ticks.

A packet with delay D is delivered at the first tick at or after its arrival, and at the next tick
at the earliest: after max(1, ceil(D / h)) ticks of length h. The mean of a whole number is the sum
of its tail probabilities, so that the mean delay that comes of it is

    h E[max(1, ceil(D / h))] = h (1 + sum over k = 1, 2, ... of P(D > k h)),

at least h, and never less than the mean of D itself nor more than h above it. That is for a packet
alone: waiting for a transmitter or for earlier packets adds to it, a copy that comes first takes
from it. For a trace both means are over its rows as packets meet them, none of which is lost.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincc, ndtr

from encircle.world.channel.delay import whole_ticks
from encircle.world.channel.trace_playback import received, rows_per_link, without_gaps
from encircle.world.scenario.channel_model import ChannelModel, delay_parts
from encircle.world.scenario.delay_models import (
    ConstantDelay,
    Delay,
    ExponentialDelay,
    GammaDelay,
    LognormalDelay,
    NormalDelay,
    TraceDelay,
    UniformDelay,
)
from encircle.world.scenario.fields import Replay

Floats = NDArray[np.float64]
TERMS_MAX = 100_000
TERMS_AT_ONCE = 1000
TERM_MIN = 1e-15
"""Where the sum over ticks ends: there, or where its terms are below this."""


class RequestedDelay(NamedTuple):
    """What a scenario asks of its radio: the models' names, and the mean delay over its links."""

    model: str
    s_mean: float


def requested_delay(channel: ChannelModel, ids: Sequence[str]) -> RequestedDelay:
    """The delay that a channel asks for; of links with delays of their own the mean over links."""
    pieces = list(_by_link(channel, ids)) or [(1, channel.delay)]
    names = dict.fromkeys(delay.model for _, delay in pieces)
    counts, means_s = zip(*((links, mean_s(delay)) for links, delay in pieces), strict=True)
    # About the first, so that the mean of equal ones is their value to the last bit.
    apart_s = np.average(np.array(means_s) - means_s[0], weights=counts)
    return RequestedDelay(" and ".join(names), float(means_s[0] + apart_s))


def mean_s(delay: Delay) -> float:
    """Mean of a model's delays in s, before they are rounded up to ticks."""
    match delay:
        case TraceDelay():
            return float(np.mean(_rows_s(delay)))
        case UniformDelay():
            return (delay.low_s + delay.high_s) / 2.0
        case NormalDelay():
            ratio = delay.mean_s / delay.std_s
            density = np.exp(-(ratio**2) / 2.0) / np.sqrt(2.0 * np.pi)
            return float(delay.mean_s + delay.std_s * density / ndtr(ratio))
        case ConstantDelay() | ExponentialDelay() | GammaDelay() | LognormalDelay():
            return delay.mean_s
    raise AssertionError(f"no mean for {type(delay).__name__}")


def delivered_s_mean(delay: Delay, tick_s: float) -> float:
    """Mean delay in s that comes of a model at ticks of a length, for a packet alone.

    What is delayed by more than ``TERMS_MAX`` ticks counts as that.
    """
    if isinstance(delay, ConstantDelay | TraceDelay):
        return tick_s * float(np.mean(whole_ticks(_rows_s(delay), tick_s)))
    ticks = 1.0
    for first in range(1, TERMS_MAX, TERMS_AT_ONCE):
        terms = _beyond(delay, tick_s * np.arange(first, first + TERMS_AT_ONCE, dtype=np.float64))
        ticks += float(terms.sum())
        if terms[-1] < TERM_MIN:
            break
    return tick_s * ticks


def _rows_s(delay: ConstantDelay | TraceDelay) -> Floats:
    """The delays that packets meet, each as often as the others."""
    if isinstance(delay, ConstantDelay):
        return np.array([delay.mean_s])
    met = received if delay.mode == "resample" else without_gaps
    own = [link.values for link in delay.links]
    values = [met(list(rows)) for rows in (delay.values, *own) if rows is not None]
    return np.concatenate(values)


def _beyond(delay: Delay, at_s: Floats) -> Floats:
    """P(D > x) for times x > 0, of the models that are drawn from a distribution."""
    match delay:
        case UniformDelay(low_s=low, high_s=high):
            return _beyond_uniform(low, high, at_s)
        case GammaDelay(mean_s=mean, std_s=std):
            return np.asarray(gammaincc((mean / std) ** 2, at_s * mean / std**2))
        case LognormalDelay(mean_s=mean, std_s=std):
            return _beyond_lognormal(mean, std, at_s)
        case NormalDelay(mean_s=mean, std_s=std):
            return np.asarray(ndtr((mean - at_s) / std) / ndtr(mean / std))
        case ExponentialDelay(mean_s=mean):
            return np.exp(-at_s / mean) if mean else np.zeros_like(at_s)
    raise AssertionError(f"no distribution for {type(delay).__name__}")


def _beyond_uniform(low_s: float, high_s: float, at_s: Floats) -> Floats:
    if low_s == high_s:
        return (at_s < low_s).astype(float)
    return np.clip((high_s - at_s) / (high_s - low_s), 0.0, 1.0)


def _beyond_lognormal(mean_s: float, std_s: float, at_s: Floats) -> Floats:
    variance = np.log1p((std_s / mean_s) ** 2)
    location = np.log(mean_s) - variance / 2.0
    return np.asarray(ndtr((location - np.log(at_s)) / np.sqrt(variance)))


def _by_link(channel: ChannelModel, ids: Sequence[str]) -> Iterator[tuple[int, Delay]]:
    """How many links each delay of a channel is for, none left out; a trace's rows one by one."""
    parts = delay_parts(channel, ids)
    for _, links, delay in parts:
        if not isinstance(delay, TraceDelay) and links.any():
            yield int(links.sum()), delay
    for links, values, mode in rows_per_link(parts, ids, get_args(Replay)):
        rows = TraceDelay.model_construct(model="trace", mode=mode, values=tuple(values))
        yield int(links.sum()), rows
