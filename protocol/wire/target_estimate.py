"""An estimate of the target as one robot tells it to the others, and which covariances are sound.

Position and velocity are of the tick of the packet. One 2 x 2 covariance serves both axes. A
covariance is sound if it can be inverted and used without loss of all digits, whoever sent it.
"""

from collections.abc import Callable
from math import ceil, frexp, ldexp
from typing import NamedTuple

from encircle.protocol.wire.field_types import Count, Real
from encircle.protocol.wire.limits import NUMBER_MAX

VARIANCE_MIN = 1e-12
"""Of a position in m^2 or a velocity in m^2/s^2: a micron, or a micron per second, squared."""
INDEPENDENT_SHARE_MIN = 1e-9
"""Least 1 - r^2, where r is the correlation of position and velocity."""
COVARIANCE_BITS = 26
"""Bits of a covariance's numbers on the wire: products of two of them are exact."""


class TargetEstimate(NamedTuple):
    """Where a robot believes the target to be, and how sure it is.

    ``detected_tick``: of the newest detection in it, by whomever. Position in m, velocity in m/s;
    variances of position (``p00``) and velocity (``p11``) along each axis, and their covariance.
    """

    detected_tick: Count
    x: Real
    y: Real
    vx: Real
    vy: Real
    p00: Real
    p01: Real
    p11: Real


def is_sound(covariance: tuple[float, float, float]) -> bool:
    """Whether a covariance is positive definite, in bounds, and far enough from singular."""
    p00, p01, p11 = covariance
    return (
        VARIANCE_MIN <= p00 < NUMBER_MAX
        and VARIANCE_MIN <= p11 < NUMBER_MAX
        and p00 * p11 - p01 * p01 >= INDEPENDENT_SHARE_MIN * p00 * p11
    )


def rounded_covariance(
    covariance: tuple[float, float, float],
) -> tuple[float, float, float]:
    """The covariance as it travels: variances rounded up, what is off the diagonal towards zero.

    So a positive definite one stays so. A last-bit difference between two machines' mathematical
    libraries then survives with a probability of about one in 10^8.
    """
    p00, p01, p11 = covariance
    return _whole(p00, ceil), _whole(p01, int), _whole(p11, ceil)


def _whole(value: float, whole: Callable[[float], int]) -> float:
    fraction, exponent = frexp(value)
    return ldexp(whole(ldexp(fraction, COVARIANCE_BITS)), exponent - COVARIANCE_BITS)
