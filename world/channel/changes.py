"""Changes of the radio by the scenario's events: another loss, delay or range in some ticks.

*Loss*: all links lose as Bernoulli does with one rate, whatever the channel's own models are, and
by the same draws, so that what is lost at a tick is what a channel of that rate loses. *Delay*: all
packets take one time, copies too. *Range*: the cut-off of the loss in force becomes another, or it
gets one. Everything else of the channel stays: single weak radios, the rate limit, contention,
duplication, cuts.

The channel's own chains and gains go on unseen, and no draw depends on what happened before. So
packets that are sent in no change's ticks have the fates that they have without any event, unless a
stage looks at what was sent before (the rate limit, the order of packets).
"""

from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from encircle.world.channel import delay, loss
from encircle.world.channel.loss_causes import Cause
from encircle.world.scenario.channel_events import (
    Change,
    DelayChange,
    LossChange,
    RangeChange,
    last_and_one,
)
from encircle.world.scenario.channel_model import between
from encircle.world.scenario.delay_models import ConstantDelay


@dataclass(frozen=True, eq=False, slots=True)
class Changes:
    """The changes of a run. ``ticks``: at which one begins or ends, ascending.

    ``events``: the changes, those that count before others last. ``losses``, ``delays``: the
    channel's own.
    """

    ticks: tuple[int, ...]
    events: tuple[Change, ...]
    ids: tuple[str, ...]
    losses: loss.Losses | None
    delays: delay.Delays


class Stages(NamedTuple):
    """What stands in place of the channel's own stages at a tick.

    ``losses``: the channel's own, which go on remembering, with the cut-off in force; ``instead``:
    what loses in their place, None if they do themselves; ``delays``: None for the channel's own.
    """

    losses: loss.Losses | None
    instead: loss.Losses | None
    delays: delay.Delays | None


def build(
    events: Iterable[object],
    ids: Sequence[str],
    losses: loss.Losses | None,
    delays: delay.Delays,
) -> Changes | None:
    """The changes among a scenario's events, None if there are none."""
    found = _changes_of(events)
    if not found:
        return None
    ticks = sorted({tick for e in found for tick in (e.tick, last_and_one(e))})
    return Changes(tuple(ticks), tuple(found), tuple(ids), losses, delays)


def at(changes: Changes, tick: int) -> Stages | None:
    """What is in force at a tick; None for the channel as it is."""
    return _between_changes(changes, bisect_right(changes.ticks, tick))


@lru_cache(maxsize=16)
def _between_changes(changes: Changes, index: int) -> Stages | None:
    tick = changes.ticks[index - 1] if index else -1
    rate, delay_s, range_m = in_force(changes.events, tick)
    if rate is None and delay_s is None and range_m is None:
        return None
    losses, instead = changes.losses, None
    if rate is not None or (losses is None and range_m is not None):
        instead = _bernoulli(changes, 0.0 if rate is None else rate, range_m)
    elif losses is not None and range_m is not None:
        losses = replace(losses, cutoff_m=_everywhere(changes, range_m))
    return Stages(losses, instead, None if delay_s is None else _constant(changes, delay_s))


def _changes_of(events: Iterable[object]) -> list[Change]:
    """The changes among events, as they begin; those of one tick in the scenario's order."""
    found = [e for e in events if isinstance(e, LossChange | DelayChange | RangeChange)]
    return sorted(found, key=lambda event: event.tick)


def in_force(
    events: Iterable[object], tick: int
) -> tuple[float | None, float | None, float | None]:
    """Rate, delay in s and range in m that events have put in force at a tick, None for the own."""
    rate = delay_s = range_m = None
    for event in _changes_of(events):
        if not event.tick <= tick < last_and_one(event):
            continue
        if isinstance(event, LossChange):
            rate = event.rate
        elif isinstance(event, DelayChange):
            delay_s = event.delay_s
        else:
            range_m = event.range_m
    return rate, delay_s, range_m


def _everywhere(changes: Changes, value: float) -> loss.Floats:
    """(N, N) one value for all links."""
    return np.full((len(changes.ids), len(changes.ids)), value)


def _bernoulli(changes: Changes, rate: float, range_m: float | None) -> loss.Losses:
    """Losses of one rate on all links, beyond a range certain; also of rate 0."""
    return loss.Losses(
        seed=changes.delays.seed,
        robots=len(changes.ids),
        codes=np.full((len(changes.ids), len(changes.ids)), int(Cause.LOSS), np.int64),
        rate=_everywhere(changes, rate) if rate > 0.0 else None,
        falloff=None,
        cutoff_m=None if range_m is None else _everywhere(changes, range_m),
        burst=None,
        rows=None,
        signals=None,
    )


def _constant(changes: Changes, delay_s: float) -> delay.Delays:
    """One delay on all links; nothing is drawn, so that it is that of copies as well."""
    own, links = changes.delays, between(None, None, changes.ids)
    law = ConstantDelay(model="constant", mean_s=delay_s)
    return delay.build([("", links, law)], changes.ids, own.tick_s, own.seed)
