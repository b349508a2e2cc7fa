"""The radio: what happens to each pose packet on each directed link.

A composition of stages, evaluated for all links of a tick at once:

1. ``encircle.world.channel.rate_limit``: a transmitter where packets wait if there is room;
2. ``encircle.world.channel.outages``: scheduled outages and partitions, and radios that are silent;
3. ``encircle.world.channel.loss``: loss by chance, by distance, or as in a trace; and
   ``encircle.world.channel.robot_radios``: single robots whose radio is weak;
4. ``encircle.world.channel.delay``: how long it takes, order kept or not;
5. ``encircle.world.channel.contention``: packets that are lost to others of the same tick;
6. duplication: a packet that is not lost arrives a second time with a probability, the copy with a
   delay of its own.

Events can put another loss, delay or range in place of stages 3 and 4 for some ticks
(``encircle.world.channel.changes``).

Every draw is a function of seed, purpose, tick and link (``encircle.world.random_streams``), and
every stage makes its draws whatever the others do. So what loss would take, and how long a packet
would be on its way, is the same with any other stage on or off, and a packet's fate depends on
(seed, sender, receiver, sequence) alone; the sequence is the tick. Three stages look at more than
that because that is what they are: loss by distance at where the robots are, the rate limit at what
the sender sent before, contention at who else sends. What is remembered per link (the state of a
Gilbert-Elliott chain, a fading gain) goes on at every tick, sent or not; the order of packets is
remembered of those that were sent and arrive.

**Precedence.** Of several causes that apply to one packet the first of these is named:
sender-silent, receiver-silent, partition, outage, queue-full, out-of-range, the link's loss by
chance or trace (a link has one), loss by a weak radio, and then contention. That is from the
certain to the random: what is scheduled, what the senders make of it, where the robots are, chance;
what contention takes would have arrived without it. A packet that is cut off or lost has taken its
time at the transmitter all the same; one of a silent sender has not.

**Order.** With order kept a packet is held back until those sent before it on its link have
arrived. A copy is held back until its packet has arrived, and holds back nothing: later packets do
not wait for copies, so that duplication delays nobody.
"""

from collections.abc import Mapping
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from encircle.world.channel import (
    changes,
    contention,
    delay,
    loss,
    outages,
    rate_limit,
    robot_radios,
)
from encircle.world.channel.loss_causes import CAUSES, Cause
from encircle.world.random_streams import Purpose, link_uniforms
from encircle.world.scenario.channel_model import delay_parts, loss_parts
from encircle.world.scenario.model import Scenario

__all__ = ["CAUSES", "Cause", "Channel", "ChannelState", "Fates", "Flight", "Sending"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Channel(NamedTuple):
    """A scenario's channel: its stages, None where it has none."""

    seed: int
    robots: int
    transmitter: rate_limit.Transmitter | None
    outages: outages.Outages | None
    losses: loss.Losses | None
    radios: robot_radios.RobotRadios | None
    air: contention.SharedAir | None
    delays: delay.Delays
    in_order: bool
    copies: "Copies | None"
    rated: bool
    """Whether the size of packets matters."""
    changes: changes.Changes | None


class Copies(NamedTuple):
    """Duplication: the probability of a copy, and how long copies take."""

    rate: float
    delays: delay.Delays


class Flight(NamedTuple):
    """Packets of one tick that arrive together: (N, N) whether [sender, receiver] has one."""

    sent_tick: int
    links: NDArray[np.bool_]


class Sending(NamedTuple):
    """What the robots put on the radio at a tick.

    ``sizes_bytes``: (N,) of each robot's packet, 0 where there is none; None if all send and size
    does not matter. ``distances_m``: (N, N) between robots; None if loss does not depend on it.
    ``silent``: (N,) whose radio is off.
    """

    tick: int
    sizes_bytes: Ints | None = None
    distances_m: Floats | None = None
    silent: NDArray[np.bool_] | None = None


class Fates(NamedTuple):
    """What becomes of a tick's packets: ``due`` and ``copies`` as in ``protocol.messages.Radio``.

    ``copies`` is None where the radio makes none.
    """

    due: Ints
    copies: Ints | None


class ChannelState(NamedTuple):
    """What the radio remembers.

    What losses do, each link's newest due tick, the transmitters' queues, and the packets in flight
    by due tick.
    """

    losses: loss.LossState
    last_due: Ints | None
    queues: Floats | None
    flights: Mapping[int, tuple[Flight, ...]]


def build(scenario: Scenario, seed: int) -> Channel:
    """The channel of a scenario, overrides of single links applied."""
    ids, model, tick_s = scenario.ids, scenario.channel, scenario.tick_s
    limit, delays = model.rate_limit, delay_parts(model, ids)
    channel = Channel(
        seed,
        len(ids),
        rate_limit.build(limit, tick_s) if limit is not None else None,
        None,
        loss.build(loss_parts(model, ids), ids, tick_s, seed),
        robot_radios.build(scenario, seed),
        contention.build(model.contention, tick_s, seed) if model.contention is not None else None,
        delay.build(delays, ids, tick_s, seed),
        model.order == "kept",
        Copies(model.duplication.rate, delay.build(delays, ids, tick_s, seed, Purpose.COPY_DELAY))
        if model.duplication.rate > 0.0
        else None,
        limit is not None and limit.bytes_per_s is not None,
        None,
    )
    return with_events(channel, scenario)


def with_events(channel: Channel, scenario: Scenario) -> Channel:
    """The same channel, with the events of a scenario that differs from its own in these alone."""
    events, ids = scenario.events, scenario.ids
    return channel._replace(
        outages=outages.build(events, ids),
        changes=changes.build(events, ids, channel.losses, channel.delays),
    )


def initial(channel: Channel) -> ChannelState:
    """The radio before the first tick."""
    count = channel.robots
    return ChannelState(
        loss.first_state(channel.losses),
        np.zeros((count, count), np.int64) if channel.in_order else None,
        rate_limit.idle(channel.transmitter, count) if channel.transmitter is not None else None,
        {},
    )


def transmit(channel: Channel, state: ChannelState, sending: Sending) -> tuple[ChannelState, Fates]:
    """Put the robots' packets of a tick on the radio; to be called once for every tick."""
    tick, sizes = sending.tick, sending.sizes_bytes
    losses, last, queues, left = state.losses, state.last_due, state.queues, None
    instead = None
    if channel.changes is not None and (now := changes.at(channel.changes, tick)) is not None:
        channel, instead = _changed(channel, now), now.instead
    if channel.losses is not None:
        losses, cause = loss.lost(channel.losses, losses, tick, sending.distances_m)
    else:
        cause = np.zeros((channel.robots, channel.robots), np.int64)
    if instead is not None:
        _, cause = loss.lost(instead, loss.LossState(), tick, sending.distances_m)
    if channel.radios is not None:
        cause = robot_radios.with_losses(channel.radios, cause, tick, sending.distances_m)
    if channel.transmitter is not None or channel.air is not None:
        queues, left, cause = _sent(channel, queues, sending, cause)
    # From here on a weightier cause overwrites a lighter one.
    if channel.outages is not None and (cut := outages.at(channel.outages, tick)) is not None:
        np.copyto(cause, cut[1], where=cut[0])
    if sending.silent is not None:
        cause[:, sending.silent] = Cause.RECEIVER_SILENT
        cause[sending.silent] = Cause.SENDER_SILENT
    due = tick + _taken(channel.delays, tick, left)
    if last is not None:
        due = np.maximum(due, last)
    fates = np.where(cause == 0, due, -cause)
    fates[_diagonal(channel.robots)] = 0
    if sizes is not None:
        fates[sizes == 0] = 0
    if last is not None:
        last = np.where(fates > 0, due, last)
    flights, copies = _launched(state.flights, fates, tick), None
    if channel.copies is not None:
        copies = _copied(channel, channel.copies, tick, fates, left)
        flights = _launched(flights, copies, tick)
    return ChannelState(losses, last, queues, flights), Fates(fates, copies)


def deliver(state: ChannelState, tick: int) -> tuple[ChannelState, tuple[Flight, ...]]:
    """Take what is due at a tick off the radio, in the order in which it was sent."""
    if tick not in state.flights:
        return state, ()
    flights = dict(state.flights)
    due = flights.pop(tick)
    return state._replace(flights=flights), due


def in_flight(state: ChannelState) -> int:
    """How many packets are in flight."""
    return sum(int(f.links.sum()) for flights in state.flights.values() for f in flights)


def _changed(channel: Channel, now: changes.Stages) -> Channel:
    """The channel with what is in force instead of its own."""
    if now.delays is None:
        return channel._replace(losses=now.losses)
    copies = None if channel.copies is None else channel.copies._replace(delays=now.delays)
    return channel._replace(losses=now.losses, delays=now.delays, copies=copies)


def _sent(
    channel: Channel, queues: Floats | None, sending: Sending, cause: Ints
) -> tuple[Floats | None, Floats | None, Ints]:
    """The queues, (N,) ticks until packets have left, and the causes with those of the senders.

    ``cause``: (N, N) what the links lose, which contention does not take again.
    """
    sizes, left, dropped = sending.sizes_bytes, None, np.zeros(channel.robots, bool)
    on_air = np.ones(channel.robots, bool) if sizes is None else sizes > 0
    if sending.silent is not None:
        on_air &= ~sending.silent
    if channel.transmitter is not None and queues is not None:
        queues, left, dropped = rate_limit.send(channel.transmitter, queues, on_air, sizes)
    if channel.air is not None:
        on_air = on_air & ~dropped
        hit = contention.lost(channel.air, sending.tick, on_air, sending.distances_m)
        cause = np.where(hit & (cause == 0), Cause.CONTENTION, cause)
    cause[dropped] = Cause.QUEUE_FULL
    return queues, left, cause


def _taken(delays: delay.Delays, tick: int, left_ticks: Floats | None) -> Ints:
    """(N, N) ticks until delivery of packets that take ``left_ticks``, (N,), to leave."""
    if left_ticks is None:
        return delay.ticks(delays, tick)
    return delay.whole_ticks(delay.seconds(delays, tick), delays.tick_s, left_ticks[:, None])


def _copied(
    channel: Channel, copies: Copies, tick: int, fates: Ints, left_ticks: Floats | None
) -> Ints:
    """(N, N) when the copies of a tick's packets arrive, 0 where there are none."""
    chance = link_uniforms(channel.seed, Purpose.COPY, tick, channel.robots)
    due = tick + _taken(copies.delays, tick, left_ticks)
    if channel.in_order:
        due = np.maximum(due, fates)
    return np.where((fates > 0) & (chance < copies.rate), due, 0)


@lru_cache(maxsize=64)
def _diagonal(count: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    return np.arange(count), np.arange(count)


def _launched(
    flights: Mapping[int, tuple[Flight, ...]], fates: NDArray[np.int64], tick: int
) -> dict[int, tuple[Flight, ...]]:
    """``flights`` and what was sent at ``tick``."""
    launched = dict(flights)
    arrivals = fates[fates > 0]
    if len(arrivals) == 0:
        return launched
    first, last = int(arrivals.min()), int(arrivals.max())
    for due in (first,) if first == last else sorted(set(arrivals.tolist())):
        launched[due] = (*launched.get(due, ()), Flight(tick, fates == due))
    return launched
