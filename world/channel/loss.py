"""Loss: which packets of a tick the links lose by chance, by range or by a trace.

*Path loss*, with shadowing and fading, is in ``encircle.world.channel.path_loss``.

*Bernoulli*: each packet with probability ``rate``. *Distance*: with the logistic probability 1 / (1
+ exp(-(d - midpoint) / width)) of the distance d between the robots' centres as the packet is sent.
*Range*, and *distance* with a cut-off: everything farther than ``cutoff_m`` is lost. *Trace*: as
recorded (``encircle.world.channel.trace_playback``); a resampled trace is Bernoulli with the
trace's rate.

*Gilbert-Elliott* (Gilbert 1960, Elliott 1963): a two-state Markov chain per link, which loses with
one probability in its good state and with another in its bad one. The chain makes a step at every
tick, whether or not a packet is sent, so that its state depends on seed, link and tick alone; the
first state is drawn from the stationary distribution. *Burst* is the chain that loses nothing in
its good state and everything in its bad one, given by its rate p and the mean length b of bursts:
it leaves the bad state with 1 / b and the good one with p / (b (1 - p)). Independent losses of rate
p have b = 1 / (1 - p).

Bernoulli, distance, resampled traces and fades without memory compare one and the same draw with
their probability: two arms that differ in these models meet losses as alike as they can be.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from encircle.world.channel import path_loss
from encircle.world.channel.loss_causes import Cause
from encircle.world.channel.trace_playback import Rows, laid_out, rows_per_link
from encircle.world.random_streams import Purpose, link_uniforms
from encircle.world.scenario.channel_model import Parts
from encircle.world.scenario.loss_models import (
    BernoulliLoss,
    BurstLoss,
    DistanceLoss,
    GilbertElliottLoss,
    Loss,
    RangeLoss,
)

Floats = NDArray[np.float64]

CODES = {
    "none": Cause.LOSS,
    "bernoulli": Cause.LOSS,
    "gilbert-elliott": Cause.BURST_LOSS,
    "burst": Cause.BURST_LOSS,
    "distance": Cause.DISTANCE_LOSS,
    "range": Cause.OUT_OF_RANGE,
    "path-loss": Cause.WEAK_SIGNAL,
    "trace": Cause.TRACE_LOSS,
}


class Burst(NamedTuple):
    """Gilbert-Elliott probabilities per link; links without are never bad and never lose.

    ``certain``: whether each state loses all or nothing.
    """

    good_to_bad: Floats
    bad_to_good: Floats
    loss_good: Floats
    loss_bad: Floats
    certain: bool


class Falloff(NamedTuple):
    """Loss by distance: which links, and their midpoints and widths in m, all (N, N)."""

    links: NDArray[np.bool_]
    midpoint_m: Floats
    width_m: Floats


@dataclass(frozen=True, eq=False, slots=True)
class Losses:
    """A channel's losses per directed link, (N, N); None is what the channel has not.

    ``codes``: the cause under which a link's losses are counted.
    """

    seed: int
    robots: int
    codes: NDArray[np.int64]
    rate: Floats | None
    falloff: Falloff | None
    cutoff_m: Floats | None
    burst: Burst | None
    rows: Rows | None
    signals: path_loss.WeakSignals | None


class LossState(NamedTuple):
    """What losses remember: which links' chains are bad, and the signals; None without."""

    bad: NDArray[np.bool_] | None = None
    signals: path_loss.SignalState | None = None


def build(parts: Parts[Loss], ids: Sequence[str], tick_s: float, seed: int) -> Losses | None:
    """The losses of a channel, None if it loses nothing."""
    count = len(ids)
    codes, rate = np.zeros((count, count), np.int64), np.zeros((count, count))
    cutoff_m = np.full((count, count), np.inf)
    falloff = Falloff(np.zeros((count, count), bool), np.zeros_like(rate), np.ones_like(rate))
    for _, links, loss in parts:
        codes[links] = CODES[loss.model]
        if isinstance(loss, BernoulliLoss):
            rate[links] = loss.rate
        if isinstance(loss, DistanceLoss | RangeLoss) and loss.cutoff_m is not None:
            cutoff_m[links] = loss.cutoff_m
        if isinstance(loss, DistanceLoss):
            falloff.links[links] = True
            falloff.midpoint_m[links], falloff.width_m[links] = loss.midpoint_m, loss.width_m
    for links, values, _ in rows_per_link(parts, ids, ["resample"]):
        rate[links] = np.mean(np.array(values, float))
    replayed = [
        (links, [float(value or 0) for value in values], mode)
        for links, values, mode in rows_per_link(parts, ids, ["repeat", "shifted"])
    ]
    losses = Losses(
        seed,
        count,
        codes,
        rate if rate.any() else None,
        falloff if falloff.links.any() else None,
        cutoff_m if np.isfinite(cutoff_m).any() else None,
        _burst(parts, count),
        laid_out(replayed, count, seed),
        path_loss.build(parts, count, tick_s, seed),
    )
    stages = (*(losses.rate, losses.falloff, losses.cutoff_m), losses.burst, losses.rows)
    return None if all(s is None for s in (*stages, losses.signals)) else losses


def first_state(losses: Losses | None) -> LossState:
    """What losses remember before the first packet."""
    if losses is None:
        return LossState()
    signals = None if losses.signals is None else path_loss.first_state(losses.signals)
    if losses.burst is None:
        return LossState(None, signals)
    chance = losses.burst.good_to_bad + losses.burst.bad_to_good
    stationary = losses.burst.good_to_bad / np.where(chance > 0.0, chance, 1.0)
    draw = _draw(losses, Purpose.BURST_STATE, path_loss.FIRST_STATE_TICK)
    return LossState(draw < stationary, signals)


def lost(
    losses: Losses, state: LossState, tick: int, distances_m: Floats | None
) -> tuple[LossState, NDArray[np.int64]]:
    """What is remembered of a tick, and (N, N) the cause of each packet's loss, 0 if it passes.

    ``state``: that of the tick before; ``distances_m``: (N, N) between the robots, needed where
    loss depends on them.
    """
    gone = np.zeros((losses.robots, losses.robots), bool)
    bad, signals = state
    chance = losses.rate
    if losses.falloff is not None:
        assert distances_m is not None, "loss by distance needs distances"
        far = expit((distances_m - losses.falloff.midpoint_m) / losses.falloff.width_m)
        chance = np.where(losses.falloff.links, far, 0.0 if chance is None else chance)
    if losses.signals is not None and signals is not None:
        assert distances_m is not None, "path loss needs distances"
        signals, weak = path_loss.chances(losses.signals, signals, tick, distances_m)
        chance = np.where(losses.signals.links, weak, 0.0 if chance is None else chance)
    if chance is not None:
        gone = _draw(losses, Purpose.LOSS, tick) < chance
    if losses.burst is not None and bad is not None:
        draw = _draw(losses, Purpose.BURST_STATE, tick)
        bad = np.where(bad, draw >= losses.burst.bad_to_good, draw < losses.burst.good_to_bad)
        chance = np.where(bad, losses.burst.loss_bad, losses.burst.loss_good)
        # Every draw is below 1 and none below 0, so that certain losses need no draw.
        gone |= chance > (0.0 if losses.burst.certain else _draw(losses, Purpose.BURST_LOSS, tick))
    if losses.rows is not None:
        gone |= losses.rows.links & (losses.rows.at(tick) > 0.0)
    cause = np.where(gone, losses.codes, 0)
    if losses.cutoff_m is not None:
        assert distances_m is not None, "loss by range needs distances"
        cause[distances_m > losses.cutoff_m] = Cause.OUT_OF_RANGE
    return LossState(bad, signals), cause


def _burst(parts: Parts[Loss], count: int) -> Burst | None:
    tables = np.zeros((4, count, count))
    for _, links, loss in parts:
        if isinstance(loss, GilbertElliottLoss):
            chances = (loss.good_to_bad, loss.bad_to_good, loss.loss_good, loss.loss_bad)
            tables[:, links] = np.array(chances)[:, None]
        elif isinstance(loss, BurstLoss):
            leaves = 1.0 / loss.burst_packets
            enters = min(1.0, loss.rate * leaves / (1.0 - loss.rate))
            tables[:, links] = np.array((enters, leaves, 0.0, 1.0))[:, None]
    if not (tables[0].any() or tables[2].any()):
        return None
    certain = bool(np.isin(tables[2:], (0.0, 1.0)).all())
    return Burst(tables[0], tables[1], tables[2], tables[3], certain)


def _draw(losses: Losses, purpose: Purpose, tick: int) -> Floats:
    return link_uniforms(losses.seed, purpose, tick, losses.robots)
