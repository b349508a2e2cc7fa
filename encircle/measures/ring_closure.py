"""Measures of the ring's closure: whether a target that runs straight ahead can still get away.

A robot occupies the headings within asin(lambda) + asin(r_c / d) of its bearing, seen from the
target (``encircle.agents.planning.occupied_angles``, where that is derived): lambda is its longest
step over the target's, r_c the distance at which it captures (``capture.stop_distance_m``), d that
of the centres. The ring is closed if all headings are occupied; the least slack is the least
overlap of two neighbours' angles, or, if negative, the width of the widest free range of headings.

All of it is taken from the truth. What this leaves out: bodies and obstacles in the way, the number
of robots that a capture needs, and that robots find out late where the target runs.
"""

from collections.abc import Sequence
from math import asin, inf, pi

import numpy as np

from encircle.agents.planning.occupied_angles import half_angle, least_slack
from encircle.measures.common import cached_per_log, in_unit, mean_or_nan
from encircle.measures.motion import hunting
from encircle.runlog.runlog import Floats, RunLog
from encircle.world.scenario.model import Scenario

TURN = 2.0 * pi


def speed_ratios(scenario: Scenario) -> list[float]:
    """(N,) each robot's longest step over the target's; infinite for a target that cannot move."""
    target_m = scenario.target.step_m_max
    steps_m = [scenario.parameters_of(robot)["step_m_max"] for robot in scenario.ids]
    return [step_m / target_m if target_m else inf for step_m in steps_m]


@cached_per_log
def slacks_rad(log: RunLog) -> Floats:
    """(T + 1,) the least slack at each tick; -2 pi while all robots are lost."""
    rays = log.robots - log.target[:, None]
    bearings = np.arctan2(rays[..., 1], rays[..., 0])
    distances_m = np.hypot(rays[..., 0], rays[..., 1])
    capture_m, ratios = log.scenario.capture.stop_distance_m, speed_ratios(log.scenario)
    least = least_slacks_rad(bearings, distances_m, ratios, capture_m)
    there = hunting(log)
    for row in np.flatnonzero(~there.all(axis=1)):
        robots = np.flatnonzero(there[row])
        least[row] = least_slack_rad(
            bearings[row, robots].tolist(),
            distances_m[row, robots].tolist(),
            [ratios[k] for k in robots],
            capture_m,
        )
    return least


def least_slacks_rad(
    bearings: Floats, distances_m: Floats, ratios: Sequence[float], capture_m: float
) -> Floats:
    """(T,) as ``least_slack_rad``, to the bit, at each tick, of (T, N) bearings and distances."""
    halves = _half_angles(distances_m, ratios, capture_m)
    turned = bearings % TURN
    order = turned.argsort(axis=1, kind="stable")
    turned = np.take_along_axis(turned, order, axis=1)
    halves = np.take_along_axis(halves, order, axis=1)
    upwards = _reaches(turned, halves)
    downwards = _reaches(-turned[:, ::-1], halves[:, ::-1])[:, ::-1]
    gaps = np.roll(turned, -1, axis=1) - turned
    gaps[:, -1] += TURN
    return np.asarray((upwards + np.roll(downwards, -1, axis=1) - gaps).min(axis=1))


def _half_angles(distances_m: Floats, ratios: Sequence[float], capture_m: float) -> Floats:
    """(T, N) as ``half_angle``; the arc sine is Python's, since numpy's differs in the last bit."""
    own = np.array([asin(min(ratio, 1.0)) for ratio in ratios])
    near = distances_m <= capture_m
    sines = np.where(near, 0.0, capture_m / np.where(near, 1.0, distances_m))
    reach = np.fromiter(map(asin, sines.ravel().tolist()), np.float64, sines.size)
    everywhere = near | (np.array(ratios) > 1.0)
    return np.where(everywhere, pi, own + reach.reshape(sines.shape))


def _reaches(bearings: Floats, halves: Floats) -> Floats:
    """(T, N) how far beyond each robot's bearing an angle reaches, ascending within one turn."""
    twice = np.concatenate([bearings, bearings + TURN], axis=1)
    farthest = np.maximum.accumulate(twice + np.tile(halves, 2), axis=1)
    return np.asarray((farthest - twice)[:, bearings.shape[1] :])


def least_slack_rad(
    bearings: Sequence[float],
    distances_m: Sequence[float],
    ratios: Sequence[float],
    capture_m: float,
) -> float:
    """The least slack of robots at these bearings in rad, distances and speed ratios, all (N,)."""
    halves = [
        half_angle(ratio, capture_m, distance_m)
        for ratio, distance_m in zip(ratios, distances_m, strict=True)
    ]
    return least_slack(bearings, halves)


@in_unit("1")
def closed_share(log: RunLog) -> float:
    """The share of ticks at which the ring is closed: robots occupy every heading."""
    return mean_or_nan(slacks_rad(log) >= 0.0)


@in_unit("rad")
def slack_rad_mean(log: RunLog) -> float:
    """The least slack of the occupied angles, mean over ticks."""
    return mean_or_nan(slacks_rad(log))


@in_unit("rad")
def slack_rad_final(log: RunLog) -> float:
    """The least slack of the occupied angles at the last tick."""
    return float(slacks_rad(log)[-1])
