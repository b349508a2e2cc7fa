"""The radio: what happens to each pose packet on each directed link.

A composition of stages, evaluated for all links of a tick at once: a scheduled silence, loss
(Bernoulli or Gilbert-Elliott), then delay (constant, uniform, gamma or lognormal) with order kept
or not. Every draw is a function of seed, stage, tick and link (``world.draws``), so a packet's fate
depends on (seed, sender, receiver, sequence) alone. Distributions are drawn by inverting their
cumulative distribution, one uniform per packet.

Gilbert-Elliott: a two-state Markov chain per link, stepped once per packet; the first state is
drawn from the chain's stationary distribution.
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv, ndtri

from world.draws import Purpose, link_uniforms
from world.scenario import Delay, Loss, Scenario

CAUSES = {1: "loss", 2: "burst-loss", 3: "sender-silent", 4: "receiver-silent"}
"""Why a packet was lost, by the code that stands negated in the fates."""
TICKS_MAX = 1e9
LOSS, BURST_LOSS, SENDER_SILENT, RECEIVER_SILENT = CAUSES

Floats = NDArray[np.float64]


class Channel(NamedTuple):
    """A scenario's channel, laid out per directed link; arrays are (N, N) [sender, receiver]."""

    seed: int
    robots: int
    loss: Floats | None
    burst: "Burst | None"
    fixed_ticks: NDArray[np.int64]
    drawn: tuple[tuple[NDArray[np.bool_], Callable[[Floats], Floats]], ...]
    tick_s: float
    in_order: bool
    rated: bool = False
    """Whether the size of packets matters."""


class Burst(NamedTuple):
    """Gilbert-Elliott probabilities per link; links without are never bad and never lose."""

    good_to_bad: Floats
    bad_to_good: Floats
    loss_good: Floats
    loss_bad: Floats


class Flight(NamedTuple):
    """Packets of one tick that arrive together: (N, N) whether [sender, receiver] has one."""

    sent_tick: int
    links: NDArray[np.bool_]


class Sending(NamedTuple):
    """What the robots put on the radio at a tick.

    ``sizes_bytes``: (N,) of each robot's packet, 0 where there is none; None if all send and size
    does not matter. ``distances_m``: (N, N) between robots. ``silent``: (N,) whose radio is off.
    """

    tick: int
    sizes_bytes: NDArray[np.int64] | None = None
    distances_m: Floats | None = None
    silent: NDArray[np.bool_] | None = None


class Fates(NamedTuple):
    """What becomes of a tick's packets: ``due`` and ``copies`` as in ``protocol.messages.Radio``.

    ``copies`` is None where the radio makes none.
    """

    due: NDArray[np.int64]
    copies: NDArray[np.int64] | None


class ChannelState(NamedTuple):
    """What the radio remembers: bad links, newest due ticks per link, and packets by due tick."""

    bad: NDArray[np.bool_] | None
    last_due: NDArray[np.int64] | None
    flights: Mapping[int, tuple[Flight, ...]]


def build(scenario: Scenario, seed: int) -> Channel:
    """The channel of a scenario, overrides of single links applied."""
    ids = scenario.ids
    count = len(ids)
    losses: list[list[Loss]] = [[scenario.channel.loss] * count for _ in ids]
    delays: list[list[Delay]] = [[scenario.channel.delay] * count for _ in ids]
    for link in scenario.channel.links:
        for s in [ids.index(link.sender)] if link.sender else range(count):
            for r in [ids.index(link.receiver)] if link.receiver else range(count):
                losses[s][r] = link.loss or losses[s][r]
                delays[s][r] = link.delay or delays[s][r]

    def table(name: str, model: str) -> Floats:
        return np.array(
            [[getattr(x, name) if x.model == model else 0.0 for x in row] for row in losses]
        )

    burst = Burst(
        *(
            table(name, "gilbert-elliott")
            for name in ("good_to_bad", "bad_to_good", "loss_good", "loss_bad")
        )
    )
    loss = table("rate", "bernoulli")
    fixed = np.array([[d.mean_s if d.model == "constant" else 0.0 for d in row] for row in delays])
    models = {d for row in delays for d in row if d.model != "constant"}
    return Channel(
        seed,
        count,
        loss if loss.any() else None,
        burst if burst.good_to_bad.any() or burst.loss_good.any() else None,
        delay_ticks(fixed, scenario.tick_s),
        tuple(
            (np.array([[d == model for d in row] for row in delays]), quantile(model))
            for model in sorted(models, key=repr)
        ),
        scenario.tick_s,
        scenario.channel.order == "kept",
    )


def delay_ticks(delay_s: Floats, tick_s: float) -> NDArray[np.int64]:
    """Whole ticks until delivery: the first tick at or after arrival, and never the same tick."""
    # A delay of exactly k ticks must not become k + 1 because tick_s is not a binary fraction.
    ticks = np.ceil(delay_s / tick_s - 1e-9)
    return np.clip(ticks, 1.0, TICKS_MAX).astype(np.int64)


def quantile(delay: Delay) -> Callable[[Floats], Floats]:
    """The inverse cumulative distribution of a delay model: probability to seconds."""
    mean, spread = delay.mean_s, delay.std_s
    if delay.model == "uniform":
        low, high = delay.low_s, delay.high_s
        return lambda p: low + (high - low) * p
    if delay.model == "gamma":
        shape, scale = (mean / spread) ** 2, spread**2 / mean
        return lambda p: np.asarray(scale * gammaincinv(shape, p), np.float64)
    assert delay.model == "lognormal", delay.model
    variance = np.log1p((spread / mean) ** 2)
    location, width = np.log(mean) - variance / 2, np.sqrt(variance)

    def lognormal(p: Floats) -> Floats:
        return np.asarray(np.exp(location + width * ndtri(p)), np.float64)

    return lognormal


def initial(channel: Channel) -> ChannelState:
    """The radio before the first tick."""
    bad = None
    if channel.burst is not None:
        chance = channel.burst.good_to_bad + channel.burst.bad_to_good
        stationary = channel.burst.good_to_bad / np.where(chance > 0.0, chance, 1.0)
        # Tick 0 of BURST_STATE is the first packet's own transition; the start is drawn apart.
        bad = _draw(channel, Purpose.BURST_STATE, 2**63) < stationary
    last = np.zeros((channel.robots, channel.robots), np.int64) if channel.in_order else None
    return ChannelState(bad, last, {})


def transmit(channel: Channel, state: ChannelState, sending: Sending) -> tuple[ChannelState, Fates]:
    """Put every robot's packet of a tick on the radio."""
    tick, silent = sending.tick, sending.silent
    cause = np.zeros((channel.robots, channel.robots), np.int64)
    bad = state.bad
    if channel.loss is not None:
        cause[_draw(channel, Purpose.LOSS, tick) < channel.loss] = LOSS
    if channel.burst is not None and bad is not None:
        draw = _draw(channel, Purpose.BURST_STATE, tick)
        bad = np.where(bad, draw >= channel.burst.bad_to_good, draw < channel.burst.good_to_bad)
        chance = np.where(bad, channel.burst.loss_bad, channel.burst.loss_good)
        cause[_draw(channel, Purpose.BURST_LOSS, tick) < chance] = BURST_LOSS
    if silent is not None and silent.any():
        cause[:, silent] = RECEIVER_SILENT
        cause[silent, :] = SENDER_SILENT
    due = tick + channel.fixed_ticks
    if channel.drawn:
        draw = _draw(channel, Purpose.DELAY, tick)
        for links, delay in channel.drawn:
            due[links] = tick + delay_ticks(delay(draw[links]), channel.tick_s)
    last = state.last_due
    if last is not None:
        due = np.maximum(due, last)
        last = np.where(cause == 0, due, last)
    fates = np.where(cause == 0, due, -cause)
    fates[np.diag_indices(channel.robots)] = 0
    if sending.sizes_bytes is not None:
        fates[sending.sizes_bytes == 0] = 0
    return ChannelState(bad, last, _launched(state.flights, fates, tick)), Fates(fates, None)


def deliver(state: ChannelState, tick: int) -> tuple[ChannelState, tuple[Flight, ...]]:
    """Take what is due at a tick off the radio, in the order in which it was sent."""
    if tick not in state.flights:
        return state, ()
    flights = dict(state.flights)
    due = flights.pop(tick)
    return state._replace(flights=flights), due


def in_flight(state: ChannelState) -> int:
    """How many packets are on their way."""
    return sum(int(f.links.sum()) for flights in state.flights.values() for f in flights)


def _draw(channel: Channel, purpose: Purpose, tick: int) -> Floats:
    return link_uniforms(channel.seed, purpose, tick, channel.robots)


def _launched(
    flights: Mapping[int, tuple[Flight, ...]], fates: NDArray[np.int64], tick: int
) -> dict[int, tuple[Flight, ...]]:
    """``flights`` and what was sent at ``tick``."""
    launched = dict(flights)
    arrivals = fates[fates > 0]
    if len(arrivals) == 0:
        return launched
    first, last = int(arrivals.min()), int(arrivals.max())
    for due in (first,) if first == last else np.unique(arrivals).tolist():
        launched[due] = (*launched.get(due, ()), Flight(tick, fates == due))
    return launched
