"""The radio's part of a scenario: what can be said of loss, delay, duplication and rate.

One table each for loss and for delay names a model; the other keys are that model's, and one that
the model ignores is refused. What a key means for the packets stands with the stage that obeys it:
``encircle.world.channel.loss``, ``encircle.world.channel.delay``,
``encircle.world.channel.rate_limit``, ``encircle.world.channel.outages``.
"""

from collections.abc import Sequence
from typing import Annotated, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from encircle.world.scenario.fields import Length, Model, Probability, Seconds, Tick, Ticks

Replay = Literal["repeat", "shifted", "resample"]
Lost = Annotated[int, Field(ge=0, le=1)]
Rate = Annotated[float, Field(ge=1e-3, le=1e9, allow_inf_nan=False)]
WAITING_MAX = 1000


class LossRows(Model):
    """The rows of a loss trace that are for one directed link."""

    sender: str
    receiver: str
    values: tuple[Lost, ...]


class Loss(Model):
    """Loss of packets. For Gilbert-Elliott and bursts the probabilities are per tick of a link.

    A trace's ``values`` are for the links that have none of their own in ``links``; 1 is lost. In a
    file's place (``file``, see ``encircle.world.loading.trace_files``) a loaded scenario holds
    what was in it.
    """

    model: Literal[
        "none", "bernoulli", "gilbert-elliott", "burst", "distance", "range", "trace"
    ] = "none"
    rate: Probability = 0.0
    good_to_bad: Probability = 0.0
    bad_to_good: Probability = 1.0
    loss_good: Probability = 0.0
    loss_bad: Probability = 1.0
    burst_packets: Annotated[float, Field(ge=1.0, le=1e6)] | None = None
    midpoint_m: Length | None = None
    width_m: Annotated[float, Field(ge=1e-3, le=1e5)] | None = None
    cutoff_m: Length | None = None
    mode: Replay = "repeat"
    values: tuple[Lost, ...] | None = None
    links: tuple[LossRows, ...] = ()


class DelayRows(Model):
    """The rows of a delay trace that are for one directed link."""

    sender: str
    receiver: str
    values: tuple[Seconds | None, ...]


class Delay(Model):
    """Delay of packets in s; gamma and lognormal by mean and standard deviation.

    Normal is cut off at zero: ``mean_s`` and ``std_s`` are those before the cut. A trace's
    ``values`` are as for loss, with null where the recorded packet was lost.
    """

    model: Literal[
        "constant", "uniform", "gamma", "lognormal", "normal", "exponential", "trace"
    ] = "constant"
    mean_s: Seconds = 0.0
    std_s: Seconds = 0.0
    low_s: Seconds = 0.0
    high_s: Seconds = 0.0
    mode: Replay = "repeat"
    values: tuple[Seconds | None, ...] | None = None
    links: tuple[DelayRows, ...] = ()


class LinkOverride(Model):
    """Another loss or delay for the links from ``sender`` to ``receiver``; left out means any."""

    sender: str | None = None
    receiver: str | None = None
    loss: Loss | None = None
    delay: Delay | None = None


class Duplication(Model):
    """A packet that is not lost arrives a second time with probability ``rate``."""

    rate: Probability = 0.0


class RateLimit(Model):
    """How much a sender can put on the air; what cannot wait either is dropped."""

    packets_per_s: Rate | None = None
    bytes_per_s: Rate | None = None
    queue_packets_max: Annotated[int, Field(ge=0, le=WAITING_MAX)] = 10


class ChannelModel(Model):
    """The radio between the robots."""

    loss: Loss = Loss()
    delay: Delay = Delay()
    duplication: Duplication = Duplication()
    rate_limit: RateLimit | None = None
    order: Literal["kept", "free"] = "free"
    links: tuple[LinkOverride, ...] = ()


class Silence(Model):
    """A robot's radio is off, both ways, for packets sent from ``tick`` on for ``ticks`` ticks."""

    kind: Literal["silence"]
    tick: Tick
    ticks: Ticks
    robot: str


class Outage(Model):
    """The links from ``sender`` to ``receiver`` (left out means any) lose all that is sent then."""

    kind: Literal["outage"]
    tick: Tick
    ticks: Ticks
    sender: str | None = None
    receiver: str | None = None


class Partition(Model):
    """Nothing passes between robots of different ``groups``; who is in none talks to everyone."""

    kind: Literal["partition"]
    tick: Tick
    ticks: Ticks
    groups: tuple[tuple[str, ...], ...]


class Crash(Model):
    """A robot is lost at ``tick``; after ``ticks`` ticks it joins afresh, never if left out."""

    kind: Literal["crash"]
    tick: Tick
    robot: str
    ticks: Ticks | None = None


Part = TypeVar("Part", Loss, Delay)
Parts = list[tuple[str, NDArray[np.bool_], Part]]
"""A channel's tables of one sort: key, (N, N) of the links [sender, receiver] each is for, table.

Every link between two robots belongs to one; of a table that others override nothing may be left.
"""


def loss_parts(channel: ChannelModel, ids: Sequence[str]) -> Parts[Loss]:
    """Which loss applies to which links."""
    over = [link.loss for link in channel.links]
    return _parts("loss", channel.loss, over, channel.links, ids)


def delay_parts(channel: ChannelModel, ids: Sequence[str]) -> Parts[Delay]:
    """Which delay applies to which links."""
    over = [link.delay for link in channel.links]
    return _parts("delay", channel.delay, over, channel.links, ids)


def between(sender: str | None, receiver: str | None, ids: Sequence[str]) -> NDArray[np.bool_]:
    """(N, N) the links from a sender to a receiver, None meaning any; none if one is unknown."""
    sends = np.array([sender in (None, robot) for robot in ids], bool)
    hears = np.array([receiver in (None, robot) for robot in ids], bool)
    links: NDArray[np.bool_] = sends[:, None] & hears & ~np.eye(len(ids), dtype=bool)
    return links


def _parts(
    name: str,
    base: Part,
    over: Sequence[Part | None],
    links: Sequence[LinkOverride],
    ids: Sequence[str],
) -> Parts[Part]:
    places = np.full((len(ids), len(ids)), -1)
    tables: dict[int, tuple[str, Part]] = {-1: (f"channel.{name}", base)}
    for index, (link, table) in enumerate(zip(links, over, strict=True)):
        if table is not None:
            places[between(link.sender, link.receiver, ids)] = index
            tables[index] = (f"channel.links.{index}.{name}", table)
    links_of_all = between(None, None, ids)
    return [
        (key, links_of_all & (places == index), table) for index, (key, table) in tables.items()
    ]
