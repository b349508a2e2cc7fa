"""Measures of what robots believe: where their peers are, where the target is, and how sure.

The normalised estimation error squared is e' P^-1 e for the error e of an estimate with covariance
P (Bar-Shalom, Li, Kirubarajan, "Estimation with Applications to Tracking and Navigation", 2001,
Sec. 5.4). For a consistent filter with Gaussian errors it is chi-square with as many degrees of
freedom as the state has components: here four, position and velocity of two axes, which share one
2 x 2 covariance. Above the band the filter believes itself better than it is; below, worse.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv

from encircle.measures.common import (
    cached_per_log,
    in_unit,
    links,
    links_there,
    mean_or_nan,
    percentile_or_nan,
    rms_or_nan,
)
from encircle.runlog.runlog import NAN, Floats, RunLog

STATES = 4
BAND_SHARE = 0.95
NEES_BAND = tuple(
    2.0 * float(gammaincinv(STATES / 2, 0.5 + side * BAND_SHARE / 2)) for side in (-1.0, 1.0)
)
"""Quantiles of chi-square with ``STATES`` degrees of freedom that hold ``BAND_SHARE`` of it."""


@cached_per_log
def peer_errors_m(log: RunLog) -> Floats:
    """(P,) distance between where a robot takes a peer of its team to be and where that is."""
    off = log.believed - log.robots[: log.ticks, None]
    errors = np.hypot(off[..., 0], off[..., 1])[:, links(log.count)]
    return np.asarray(errors[links_there(log) & ~np.isnan(errors)])


@in_unit("m")
def peer_error_m_mean(log: RunLog) -> float:
    """Error of believed peer positions, mean over robots, their peers and ticks."""
    return mean_or_nan(peer_errors_m(log))


@in_unit("m")
def peer_error_m_p95(log: RunLog) -> float:
    """Error of believed peer positions, 95th percentile."""
    return percentile_or_nan(peer_errors_m(log), 95.0)


@in_unit("m")
def peer_error_m_rms(log: RunLog) -> float:
    """Error of believed peer positions, root mean square."""
    return rms_or_nan(peer_errors_m(log))


@in_unit("1")
def peer_missing_share(log: RunLog) -> float:
    """The share of peers, over robots and ticks, that a robot leaves out of its team."""
    possible = int(links_there(log).sum())
    return 1.0 - len(peer_errors_m(log)) / possible if possible else NAN


@cached_per_log
def _errors(log: RunLog) -> Floats:
    """(T, N, 2) estimated less true position of the target in m, NaN without an estimate."""
    return np.asarray(log.estimates[..., :2] - log.target[: log.ticks, None])


@in_unit("m")
def target_error_m_rms(log: RunLog) -> float:
    """Error of the estimated target position, root mean square over robots and ticks."""
    off = _errors(log)
    squares = off[..., 0] ** 2 + off[..., 1] ** 2
    return float(np.sqrt(mean_or_nan(squares[~np.isnan(squares)])))


@in_unit("1")
def estimate_missing_share(log: RunLog) -> float:
    """The share of robots and ticks without an estimate of the target."""
    return mean_or_nan(np.isnan(log.estimates[..., 0])[log.there])


@cached_per_log
def target_velocity_mps(log: RunLog) -> Floats:
    """(T, 2) displacement of the target since the tick before, per second.

    NaN at tick 0 and where it was moved by hand.
    """
    velocity = np.full((log.ticks, 2), NAN)
    velocity[1:] = np.diff(log.target[: log.ticks], axis=0) / log.scenario.tick_s
    velocity[[tick for tick in log.moved_by_hand if tick < log.ticks]] = NAN
    return velocity


@cached_per_log
def nees(log: RunLog) -> Floats:
    """(E,) normalised estimation error squared of each robot at each tick with an estimate."""
    position = _errors(log)
    velocity = log.estimates[..., 2:] - target_velocity_mps(log)[:, None]
    p00, p01, p11 = np.moveaxis(log.covariances, -1, 0)
    determinant = p00 * p11 - p01 * p01
    squares = (
        p11 * (position * position).sum(axis=-1)
        - 2.0 * p01 * (position * velocity).sum(axis=-1)
        + p00 * (velocity * velocity).sum(axis=-1)
    )
    defined: NDArray[np.bool_] = ~np.isnan(squares) & (determinant > 0.0)
    return np.asarray(squares[defined] / determinant[defined])


@in_unit("1")
def nees_mean(log: RunLog) -> float:
    """Normalised estimation error squared, mean over robots and ticks; 4 if consistent."""
    return mean_or_nan(nees(log))


@in_unit("1")
def nees_in_band_share(log: RunLog) -> float:
    """The share of robots and ticks with it in the 95 % band; 0.95 if consistent."""
    low, high = NEES_BAND
    return mean_or_nan((nees(log) >= low) & (nees(log) <= high))
