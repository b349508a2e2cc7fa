"""Loss of packets: what a scenario can say of it, a class for each model.

What a model does to packets is in ``encircle.world.channel.loss``.
"""

from typing import Annotated, Literal, get_args

from pydantic import BeforeValidator, Field

from encircle.protocol.parameters import Unit
from encircle.world.scenario.fields import (
    LENGTH_M_MAX,
    Length,
    Model,
    PositiveSeconds,
    Probability,
    Replay,
    Seconds,
)
from encircle.world.scenario.named_models import completed, models_by_name

BURST_PACKETS_MAX = 1e6
Lost = Annotated[int, Field(ge=0, le=1)]
Width = Annotated[float, Field(ge=1e-3, le=1e5), Unit("m")]
Reach = Annotated[float, Field(ge=1e-3, le=LENGTH_M_MAX), Unit("m")]
Exponent = Annotated[float, Field(ge=0.5, le=8.0)]
Decibels = Annotated[float, Field(ge=0.0, le=40.0), Unit("dB")]
BurstLength = Annotated[float, Field(ge=1.0, le=BURST_PACKETS_MAX), Unit("packets")]


class Loss(Model):
    """Loss of packets, by one of several models."""

    model: str


class NoLoss(Loss):
    """No packet is lost."""

    model: Literal["none"] = "none"
    """The name of the model."""


class BernoulliLoss(Loss):
    """Each packet is lost with the same probability, independently of all others."""

    model: Literal["bernoulli"]
    """The name of the model."""
    rate: Probability = 0.0
    """Probability that a packet is lost."""


class GilbertElliottLoss(Loss):
    """Each link is in a good or in a bad state, and loses with another probability in each.

    The state may change at every tick, whether or not a packet is sent.
    """

    model: Literal["gilbert-elliott"]
    """The name of the model."""
    good_to_bad: Probability = 0.0
    """Probability per tick that a link in the good state goes into the bad one."""
    bad_to_good: Probability = 1.0
    """Probability per tick that a link in the bad state goes into the good one."""
    loss_good: Probability = 0.0
    """Probability that a packet is lost in the good state."""
    loss_bad: Probability = 1.0
    """Probability that a packet is lost in the bad state."""


class BurstLoss(Loss):
    """Packets are lost in bursts of geometric length, and never between two bursts."""

    model: Literal["burst"]
    """The name of the model."""
    rate: Probability = 0.0
    """Share of packets that are lost overall; with bursts of b packets at most b / (b + 1)."""
    burst_packets: BurstLength
    """Mean length of a burst."""


class DistanceLoss(Loss):
    """A packet is lost with probability 1 / (1 + exp(-(d - midpoint) / width)) at distance d."""

    model: Literal["distance"]
    """The name of the model."""
    midpoint_m: Length
    """Distance between two robots at which every second packet is lost."""
    width_m: Width
    """How gradually loss grows with distance: from 27 % to 73 % within two widths."""
    cutoff_m: Length | None = None
    """Distance beyond which every packet is lost; none if left out."""


class RangeLoss(Loss):
    """Packets between robots that are too far apart are lost, and no others."""

    model: Literal["range"]
    """The name of the model."""
    cutoff_m: Length
    """Distance beyond which every packet is lost."""


class PathLoss(Loss):
    """A packet is lost if its signal is too weak: by distance, by shadowing and by fading.

    The mean ratio of signal to noise falls as d^-exponent and is just enough at ``range_m``. With
    Rayleigh fading, and without shadowing, a packet passes with probability
    exp(-(d / range_m)^exponent).
    """

    model: Literal["path-loss"]
    """The name of the model."""
    range_m: Reach
    """Distance at which the mean signal is just strong enough."""
    exponent: Exponent = 2.0
    """Path loss exponent: 2 in free space, up to 4 near the ground and behind walls, or more."""
    fading: Literal["rayleigh", "none"] = "rayleigh"
    """Whether the signal's power fades about its mean (``rayleigh``) or stays there (``none``)."""
    coherence_s: Seconds = 0.0
    """Time in which the correlation of a pair's gain falls to 1/e; 0: a fade for each packet. It
    means nothing without fading."""
    shadowing_db: Decibels = 0.0
    """Standard deviation of the log-normal shadowing, a draw per pair of robots."""
    shadowing_s: PositiveSeconds | None = None
    """Time in which the shadowing's correlation falls to 1/e; fixed for the run if left out."""


class LossRows(Model):
    """The rows of a loss trace that are for one directed link."""

    sender: str
    """Id of the sending robot."""
    receiver: str
    """Id of the receiving robot."""
    values: tuple[Lost, ...]
    """A row per tick: 1 where the packet is lost, 0 where it is not."""


class TraceLoss(Loss):
    """Packets are lost as in a recording.

    In a file ``file`` can stand in the place of ``values`` and ``links``: the name of a ``.csv`` or
    ``.parquet`` file, whose rows are put in its place as the scenario is loaded.
    """

    model: Literal["trace"]
    """The name of the model."""
    mode: Replay = "repeat"
    """Which row a packet meets: rows in turn, in turn from a row of each link's own, or drawn."""
    values: tuple[Lost, ...] | None = None
    """Rows for the links without rows of their own: 1 where a packet is lost, 0 where not."""
    links: tuple[LossRows, ...] = ()
    """Rows of single links."""


_Models = (
    NoLoss
    | BernoulliLoss
    | GilbertElliottLoss
    | BurstLoss
    | DistanceLoss
    | RangeLoss
    | PathLoss
    | TraceLoss
)
LOSS_MODELS = models_by_name(*get_args(_Models))
AnyLoss = Annotated[
    _Models, Field(discriminator="model"), BeforeValidator(completed("none", LOSS_MODELS))
]
