"""Hunts to export, and what of them is known from their messages alone."""

from functools import cache

from helpers_scene import RUN, hunted

from encircle.protocol.codec import decode
from encircle.protocol.messages import Radio, State
from encircle.world.recording.recording import Recording

CHANGES = (
    "channel.loss={model='bernoulli', rate=0.3}",
    "channel.delay={model='uniform', low_s=0.05, high_s=0.6}",
    "channel.duplication.rate=0.2",
    "sensing.noise_m_std=0.05",
    "events=[{kind='crash', tick=6, ticks=7, robot='r2'},"
    " {kind='silence', tick=3, ticks=9, robot='r1'}]",
    "ticks_max=24",
)


@cache
def lossy_hunt() -> Recording:
    """A hunt among obstacles with losses, delays, copies, a robot that is lost, one silent."""
    return hunted("sim2", CHANGES)[0]


def states_of(recording: Recording) -> list[State]:
    """The truth, tick by tick."""
    return [decode(State, payload, RUN) for _, _, payload in recording.of_channel("state")]


def radios_of(recording: Recording) -> list[Radio]:
    """The fates of packets, tick by tick."""
    return [decode(Radio, payload, RUN) for _, _, payload in recording.of_channel("radio")]
