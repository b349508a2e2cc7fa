"""Single robots' weak radios: a shorter range, and loss of their own, on all links of a robot.

A link has two radios, its sender's and its receiver's. A packet passes if it is within the range of
both, and if neither loses it: with loss rates p and q it is lost with probability
1 - (1 - p)(1 - q), besides and independently of what the channel loses. The draws are this stage's
own, so that a weak radio loses more and never other packets of those that the channel loses.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from encircle.world.channel.loss_causes import Cause
from encircle.world.random_streams import Purpose, link_uniforms
from encircle.world.scenario.model import Scenario

Floats = NDArray[np.float64]


class RobotRadios(NamedTuple):
    """What robots' radios do to each link, (N, N); None is what no radio does.

    ``rate``: the probability of loss; ``range_m``: farther packets are lost.
    """

    seed: int
    rate: Floats | None
    range_m: Floats | None


def build(scenario: Scenario, seed: int) -> RobotRadios | None:
    """The radios of a scenario's robots, None if none is weaker than another."""
    radios = [scenario.override_of(robot) for robot in scenario.ids]
    passes = np.array([1.0 - own.loss_rate for own in radios])
    reach = [np.inf if own.radio_range_m is None else own.radio_range_m for own in radios]
    range_m = np.minimum.outer(reach, reach)
    rate = None if (passes == 1.0).all() else 1.0 - np.outer(passes, passes)
    if rate is None and np.isinf(range_m).all():
        return None
    return RobotRadios(seed, rate, range_m if np.isfinite(range_m).any() else None)


def with_losses(
    radios: RobotRadios, cause: NDArray[np.int64], tick: int, distances_m: Floats | None
) -> NDArray[np.int64]:
    """(N, N) the causes of loss of a tick's packets with those by robots' radios, 0 if one passes.

    ``cause``: those by the channel, which are named first but for the range; ``distances_m``:
    (N, N) between the robots, needed where a range is set.
    """
    if radios.rate is not None:
        draw = link_uniforms(radios.seed, Purpose.ROBOT_RADIO_LOSS, tick, len(cause))
        cause = np.where((cause == 0) & (draw < radios.rate), Cause.LOSS, cause)
    if radios.range_m is not None:
        assert distances_m is not None, "radios with a range need distances"
        cause = np.where(distances_m > radios.range_m, Cause.OUT_OF_RANGE, cause)
    return cause
