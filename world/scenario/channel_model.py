"""The radio's part of a scenario: loss, delay, duplication, rate, single links and outages.

What a key means for the packets stands with the stage that obeys it:
``encircle.world.channel.loss``, ``encircle.world.channel.delay``,
``encircle.world.channel.rate_limit``, ``encircle.world.channel.outages``,
``encircle.world.channel.contention``. Events that change the radio from a tick on are in
``encircle.world.scenario.channel_events``.
"""

from collections.abc import Sequence
from typing import Annotated, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from encircle.protocol.parameters import Unit
from encircle.world.scenario.delay_models import AnyDelay, ConstantDelay, Delay
from encircle.world.scenario.fields import Length, Model, Probability, Tick, Ticks
from encircle.world.scenario.loss_models import AnyLoss, Loss, NoLoss

WAITING_MAX = 1000
PacketRate = Annotated[float, Field(ge=1e-3, le=1e9, allow_inf_nan=False), Unit("packets/s")]
AirTime = Annotated[float, Field(gt=0.0, le=60.0, allow_inf_nan=False), Unit("s")]
ByteRate = Annotated[float, Field(ge=1e-3, le=1e9, allow_inf_nan=False), Unit("B/s")]


class LinkOverride(Model):
    """Another loss or delay for some links; of several for one link the last counts."""

    sender: str | None = None
    """Id of the sending robot; any if left out."""
    receiver: str | None = None
    """Id of the receiving robot; any if left out."""
    loss: AnyLoss | None = None
    """Loss on these links; as on the others if left out."""
    delay: AnyDelay | None = None
    """Delay on these links; as on the others if left out."""


class Duplication(Model):
    """A packet that is not lost may arrive a second time, after a delay of its own."""

    rate: Probability = 0.0
    """Probability that a packet arrives twice."""


class RateLimit(Model):
    """How much a sender can put on the air; ``packets_per_s``, ``bytes_per_s`` or both are given.

    A packet takes the longer of the two times to be sent, and waits for those before it.
    """

    packets_per_s: PacketRate | None = None
    """Packets that a sender can send; no limit if left out."""
    bytes_per_s: ByteRate | None = None
    """Bytes that a sender can send; no limit if left out."""
    queue_packets_max: Annotated[int, Field(ge=0, le=WAITING_MAX), Unit("packets")] = 10
    """Packets that can wait at a sender; what cannot wait either is dropped."""


VULNERABLE_PACKETS = {"slotted-aloha": 1.0, "aloha": 2.0}
"""How long a packet can be hit, in lengths of a packet."""


class Contention(Model):
    """Packets of one tick are lost to each other, the more of them the more are sent.

    Of the packets that other robots than the sender send in a tick, those count that come from
    within ``range_m`` of the receiver, and the receiver's own, since a radio that sends hears
    nothing. G is their number times ``packet_s``, in ticks.
    """

    access: Literal["slotted-aloha", "aloha"] = "aloha"
    """Packets begin at slots of their length and pass with probability exp(-G), or at any time and
    pass with exp(-2 G)."""
    packet_s: AirTime
    """How long a packet is on the air."""
    range_m: Length | None = None
    """How far a robot's packets disturb others; everywhere if left out."""


class ChannelModel(Model):
    """The radio between the robots.

    In a file ``profile`` can stand beside these keys: the name of a real link, whose loss, delay,
    rate limit and contention are put in its place as the scenario is loaded. What the file itself
    says counts before it.
    """

    loss: AnyLoss = NoLoss()
    """Loss of packets, by one of several models; a table without ``model`` is ``none``."""
    delay: AnyDelay = ConstantDelay()
    """Delay of packets, by one of several models; a table without ``model`` is ``constant``."""
    duplication: Duplication = Duplication()
    """Packets that arrive twice."""
    rate_limit: RateLimit | None = None
    """How much a sender can put on the air; no limit if left out."""
    contention: Contention | None = None
    """Packets that are lost to others on the air at the same time; none if left out."""
    order: Literal["kept", "free"] = "free"
    """Whether packets of a link may overtake each other (``free``) or not (``kept``)."""
    links: tuple[LinkOverride, ...] = ()
    """Links whose loss or delay is another."""


class Silence(Model):
    """A robot's radio is off, both ways, for packets sent in these ticks."""

    kind: Literal["silence"]
    """The kind of event."""
    tick: Tick
    """The first tick."""
    ticks: Ticks | None = None
    """For how long; until it is healed if left out."""
    robot: str
    """Id of the robot."""


class Outage(Model):
    """Some links lose every packet sent in these ticks."""

    kind: Literal["outage"]
    """The kind of event."""
    tick: Tick
    """The first tick."""
    ticks: Ticks | None = None
    """For how long; until it is healed if left out."""
    sender: str | None = None
    """Id of the sending robot; any if left out."""
    receiver: str | None = None
    """Id of the receiving robot; any if left out."""


class Partition(Model):
    """Nothing passes between robots of different groups; who is in none talks to everyone."""

    kind: Literal["partition"]
    """The kind of event."""
    tick: Tick
    """The first tick."""
    ticks: Ticks | None = None
    """For how long; until it is healed if left out."""
    groups: tuple[tuple[str, ...], ...]
    """Ids of the robots of each group; two groups or more."""


class Crash(Model):
    """A robot is lost, and knows nothing of what was before if it comes back."""

    kind: Literal["crash"]
    """The kind of event."""
    tick: Tick
    """The first tick at which it is lost."""
    robot: str
    """Id of the robot."""
    ticks: Ticks | None = None
    """For how long; it never comes back if left out."""


Part = TypeVar("Part", Loss, Delay)
Parts = list[tuple[str, NDArray[np.bool_], Part]]
"""A channel's tables of loss or of delay: key, (N, N) links [sender, receiver] it is for, table.

Every link between two robots belongs to exactly one. A table that others override everywhere has no
links.
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
    is_sender = np.array([sender in (None, robot) for robot in ids], bool)
    is_receiver = np.array([receiver in (None, robot) for robot in ids], bool)
    links: NDArray[np.bool_] = is_sender[:, None] & is_receiver & ~np.eye(len(ids), dtype=bool)
    return links


def _parts(
    name: str,
    base: Part,
    over: Sequence[Part | None],
    links: Sequence[LinkOverride],
    ids: Sequence[str],
) -> Parts[Part]:
    table_of_link = np.full((len(ids), len(ids)), -1)
    tables: dict[int, tuple[str, Part]] = {-1: (f"channel.{name}", base)}
    for index, (link, table) in enumerate(zip(links, over, strict=True)):
        if table is not None:
            table_of_link[between(link.sender, link.receiver, ids)] = index
            tables[index] = (f"channel.links.{index}.{name}", table)
    links_of_all = between(None, None, ids)
    return [
        (key, links_of_all & (table_of_link == index), table)
        for index, (key, table) in tables.items()
    ]
