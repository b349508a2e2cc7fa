"""Delay of packets: what a scenario can say of it, a class for each model.

How delays are drawn, and what comes of them in ticks, is in ``encircle.world.channel.delay``.
"""

from typing import Annotated, Literal, get_args

from pydantic import BeforeValidator, Field

from encircle.world.scenario.fields import Model, PositiveSeconds, Replay, Seconds
from encircle.world.scenario.named_models import completed, models_by_name


class Delay(Model):
    """Delay of packets, by one of several models."""

    model: str


class ConstantDelay(Delay):
    """Every packet takes the same time."""

    model: Literal["constant"] = "constant"
    """The name of the model."""
    mean_s: Seconds = 0.0
    """How long a packet takes."""


class UniformDelay(Delay):
    """Delays are distributed evenly between two ends."""

    model: Literal["uniform"]
    """The name of the model."""
    low_s: Seconds = 0.0
    """The shortest delay."""
    high_s: Seconds = 0.0
    """The longest delay."""


class GammaDelay(Delay):
    """Delays have a gamma distribution."""

    model: Literal["gamma"]
    """The name of the model."""
    mean_s: PositiveSeconds
    """Mean of the delays."""
    std_s: PositiveSeconds
    """Standard deviation of the delays, from 1/1000 to 1000 times their mean."""


class LognormalDelay(Delay):
    """Delays have a lognormal distribution."""

    model: Literal["lognormal"]
    """The name of the model."""
    mean_s: PositiveSeconds
    """Mean of the delays."""
    std_s: PositiveSeconds
    """Standard deviation of the delays, from 1/1000 to 1000 times their mean."""


class NormalDelay(Delay):
    """Delays have a normal distribution that is cut off at zero."""

    model: Literal["normal"]
    """The name of the model."""
    mean_s: Seconds = 0.0
    """Mean before the cut; the delays' own mean is higher."""
    std_s: PositiveSeconds
    """Standard deviation before the cut."""


class ExponentialDelay(Delay):
    """Delays have an exponential distribution."""

    model: Literal["exponential"]
    """The name of the model."""
    mean_s: Seconds = 0.0
    """Mean of the delays; it must be given, and 0 is no delay."""


class DelayRows(Model):
    """The rows of a delay trace that are for one directed link."""

    sender: str
    """Id of the sending robot."""
    receiver: str
    """Id of the receiving robot."""
    values: tuple[Seconds | None, ...]
    """A row per tick: the delay, null where the recorded packet was lost."""


class TraceDelay(Delay):
    """Packets take as long as in a recording.

    In a file ``file`` can stand in the place of ``values`` and ``links``: the name of a ``.csv`` or
    ``.parquet`` file, whose rows are put in its place as the scenario is loaded.
    """

    model: Literal["trace"]
    """The name of the model."""
    mode: Replay = "repeat"
    """Which row a packet meets: rows in turn, in turn from a row of each link's own, or drawn."""
    values: tuple[Seconds | None, ...] | None = None
    """Rows for the links without rows of their own: delays, null where a packet was lost."""
    links: tuple[DelayRows, ...] = ()
    """Rows of single links."""


_Models = (
    ConstantDelay
    | UniformDelay
    | GammaDelay
    | LognormalDelay
    | NormalDelay
    | ExponentialDelay
    | TraceDelay
)
DELAY_MODELS = models_by_name(*get_args(_Models))
AnyDelay = Annotated[
    _Models, Field(discriminator="model"), BeforeValidator(completed("constant", DELAY_MODELS))
]
