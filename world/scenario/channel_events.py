"""Events that change the radio from a tick on, and when an event that cuts links is over.

*Changes* put another loss, delay or range in place of the scenario's own. Of several of one kind
that are going on, the one that began last counts; of those that began at one tick, the last in the
scenario's order. *Cuts* (silence, outage, partition) add up. They end after their ``ticks``, or
when a *heal* comes, whichever is earlier.

What a change means for packets is in ``encircle.world.channel.changes``.
"""

from collections.abc import Iterable
from typing import Literal, NamedTuple, TypeAlias

from encircle.world.scenario.channel_model import Outage, Partition, Silence
from encircle.world.scenario.fields import Length, Model, Probability, Seconds, Tick, Ticks

NEVER = 2**62
"""The tick after the last of an event that goes on to the end of the run."""


class LossChange(Model):
    """Every link loses packets sent in these ticks with one probability, independently.

    It stands in place of ``channel.loss`` and of every loss under ``channel.links``.
    """

    kind: Literal["loss"]
    """The kind of event."""
    tick: Tick
    """The first tick."""
    ticks: Ticks | None = None
    """For how long; to the end of the run if left out. A later such event counts meanwhile."""
    rate: Probability | None = None
    """Probability that a packet is lost; the scenario's own loss if left out."""


class DelayChange(Model):
    """Every packet sent in these ticks takes one and the same time.

    It stands in place of ``channel.delay`` and of every delay under ``channel.links``.
    """

    kind: Literal["delay"]
    """The kind of event."""
    tick: Tick
    """The first tick."""
    ticks: Ticks | None = None
    """For how long; to the end of the run if left out. A later such event counts meanwhile."""
    delay_s: Seconds | None = None
    """How long a packet takes; the scenario's own delay if left out."""


class RangeChange(Model):
    """Packets sent in these ticks over more than a distance are lost.

    That comes on top of the loss in force, and stands in place of its ``cutoff_m``, if it has one.
    """

    kind: Literal["range"]
    """The kind of event."""
    tick: Tick
    """The first tick."""
    ticks: Ticks | None = None
    """For how long; to the end of the run if left out. A later such event counts meanwhile."""
    range_m: Length | None = None
    """The distance between two robots' centres; the scenario's own range if left out."""


class Heal(Model):
    """Silences, outages and partitions that are going on end.

    So do those of the same tick that stand before it.
    """

    kind: Literal["heal"]
    """The kind of event."""
    tick: Tick
    """The first tick at which they are over."""


Cut: TypeAlias = Silence | Outage | Partition
Change: TypeAlias = LossChange | DelayChange | RangeChange


class CutSpan(NamedTuple):
    """A cut, its first tick, and the tick after its last, ``NEVER`` if it does not end."""

    cut: Cut
    first: int
    after: int


def cut_spans(events: Iterable[object]) -> list[CutSpan]:
    """The cuts among a scenario's events, in its order, with when they begin and end.

    One that is healed at its first tick is left out.
    """
    listed = list(events)
    heals = sorted((e.tick, k) for k, e in enumerate(listed) if isinstance(e, Heal))
    spans = []
    for k, event in enumerate(listed):
        if isinstance(event, Silence | Outage | Partition):
            healed = next((tick for tick, at in heals if (tick, at) > (event.tick, k)), NEVER)
            after = min(healed, last_and_one(event))
            if after > event.tick:
                spans.append(CutSpan(event, event.tick, after))
    return spans


def last_and_one(event: Cut | Change) -> int:
    """The tick after the last that an event itself names, ``NEVER`` if it names none."""
    return NEVER if event.ticks is None else event.tick + event.ticks
