"""Measures of each robot: one number for each, where the team's measures have one for all.

In a study a robot's measure is a column named after measure and robot, ``path_m/r3``; of a whole
run ``breakdown`` gives all of them. A measure that exists of the team too has the same name and
means the same of one robot: of a link, its sender's in ``delivery_ratio``, its receiver's in
``received_share``, ``age_ticks_mean``, ``peer_error_m_mean`` and what else it knows of others.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from encircle.measures import choice, radio
from encircle.measures.common import (
    in_unit,
    links,
    links_there,
    of_each_robot,
    pairs,
)
from encircle.runlog.packet_parts import ESTIMATE, PAYLOAD, RELAYED
from encircle.runlog.runlog import LOST, Floats, RunLog


@of_each_robot
@in_unit("m")
def path_m(log: RunLog) -> Floats:
    """Length of the robot's path."""
    moved = np.diff(log.robots, axis=0)
    return np.asarray(np.hypot(moved[..., 0], moved[..., 1]).sum(axis=0))


@of_each_robot
@in_unit("m^2/s")
def effort_m2ps(log: RunLog) -> Floats:
    """Integral of the robot's squared commanded speed over time."""
    return np.asarray((log.steps * log.steps).sum(axis=(0, 2)) / log.scenario.tick_s)


def _mode_share(mode: str, log: RunLog) -> Floats:
    return _shares(log.modes == mode, np.ones(log.modes.shape, np.int64))


@of_each_robot
@in_unit("1")
def search_share(log: RunLog) -> Floats:
    """The share of the run's ticks at which the robot searches."""
    return _mode_share("search", log)


@of_each_robot
@in_unit("1")
def encircle_share(log: RunLog) -> Floats:
    """The share of the run's ticks at which the robot's mode is encircle."""
    return _mode_share("encircle", log)


@of_each_robot
@in_unit("1")
def shrink_share(log: RunLog) -> Floats:
    """The share of the run's ticks at which the robot's mode is shrink."""
    return _mode_share("shrink", log)


@of_each_robot
@in_unit("1")
def pursue_share(log: RunLog) -> Floats:
    """The share of the run's ticks at which the robot's mode is pursue."""
    return _mode_share("pursue", log)


@of_each_robot
@in_unit("1")
def lost_share(log: RunLog) -> Floats:
    """The share of the run's ticks at which the robot was lost."""
    return _mode_share(LOST, log)


@of_each_robot
@in_unit("1")
def messages_sent(log: RunLog) -> Floats:
    """Poses that the robot published."""
    return np.asarray((log.sizes_bytes > 0).sum(axis=0), np.float64)


@of_each_robot
@in_unit("B")
def sent_bytes(log: RunLog) -> Floats:
    """Bytes of the poses that the robot published."""
    return np.asarray(log.sizes_bytes.sum(axis=0), np.float64)


@of_each_robot
@in_unit("B")
def sent_bytes_payload(log: RunLog) -> Floats:
    """Bytes of what the robot's policy said."""
    return _part_bytes(log, PAYLOAD)


@of_each_robot
@in_unit("B")
def sent_bytes_relayed(log: RunLog) -> Floats:
    """Bytes of the detections that the robot relayed."""
    return _part_bytes(log, RELAYED)


@of_each_robot
@in_unit("B")
def sent_bytes_estimate(log: RunLog) -> Floats:
    """Bytes of the estimates of the target that the robot sent."""
    return _part_bytes(log, ESTIMATE)


def _part_bytes(log: RunLog, part: int) -> Floats:
    return np.asarray(log.parts_bytes[..., part].sum(axis=0), np.float64)


@of_each_robot
@in_unit("1")
def delivery_ratio(log: RunLog) -> Floats:
    """Packets of the robot that the radio delivers over those it sent."""
    return _link_shares(log, 2)


@of_each_robot
@in_unit("1")
def received_share(log: RunLog) -> Floats:
    """Packets to the robot that the radio delivers over those sent to it."""
    return _link_shares(log, 1)


def _link_shares(log: RunLog, over: int) -> Floats:
    """(N,) the share of packets that are delivered, summed over receivers (2) or senders (1)."""
    delivered = (log.due > 0) | (log.copies > 0)
    return _shares(delivered.sum(axis=over), (log.due != 0).sum(axis=over))


@of_each_robot
@in_unit("tick")
def age_ticks_mean(log: RunLog) -> Floats:
    """Age of information of the links to the robot, mean over links and ticks."""
    receivers = np.nonzero(links(log.count))[1]
    there = links_there(log)
    ages = np.where(there, radio.ages_ticks(log), 0)
    each = np.arange(log.count)[:, None] == receivers
    return _shares(ages @ each.T, there.astype(np.int64) @ each.T)


@of_each_robot
@in_unit("m")
def peer_error_m_mean(log: RunLog) -> Floats:
    """Error of the peer positions that the robot believes, mean over its peers and ticks."""
    off = log.believed - log.robots[: log.ticks, None]
    counted = log.there[:, :, None] & log.there[:, None, :] & log.members & links(log.count)
    errors = np.where(counted, np.hypot(off[..., 0], off[..., 1]), 0.0)
    return _shares(errors.sum(axis=2), counted.sum(axis=2))


@of_each_robot
@in_unit("m")
def target_error_m_rms(log: RunLog) -> Floats:
    """Error of the target position that the robot estimates, root mean square over ticks."""
    off = log.estimates[..., :2] - log.target[: log.ticks, None]
    squares = (off * off).sum(axis=2)
    known = ~np.isnan(squares)
    return np.asarray(np.sqrt(_shares(np.where(known, squares, 0.0), known)))


@of_each_robot
@in_unit("1")
def estimate_missing_share(log: RunLog) -> Floats:
    """The share of ticks at which the robot has no estimate of the target."""
    return _shares(np.isnan(log.estimates[..., 0]) & log.there, log.there)


@of_each_robot
@in_unit("1")
def conflict_share(log: RunLog) -> Floats:
    """The share of ticks at which another robot holds the robot's point, of those it has one."""
    shared = choice.shared_points(log)
    ends = np.arange(log.count)[:, None, None] == np.array(pairs(log.count))
    in_conflict = (shared.astype(np.int64) @ ends.any(axis=1).T) > 0
    return _shares(in_conflict, choice.encircling(log))


@of_each_robot
@in_unit("1")
def switches(log: RunLog) -> Floats:
    """The robot's changes of point, summed over ticks."""
    return np.asarray(choice.switched(log).sum(axis=0), np.float64)


def _shares(parts: NDArray[Any], wholes: NDArray[Any]) -> Floats:
    """(N,) sums of (T, N) over ticks, the first over the second, NaN where that is 0."""
    part, whole = parts.sum(axis=0), wholes.sum(axis=0)
    return np.asarray(np.divide(part, whole, out=np.full(len(whole), np.nan), where=whole > 0))
