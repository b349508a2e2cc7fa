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
from math import inf

import numpy as np

from encircle.agents.planning.occupied_angles import half_angle, least_slack
from encircle.measures.common import cached_per_log, in_unit, mean_or_nan
from encircle.measures.motion import hunting
from encircle.runlog.runlog import Floats, RunLog
from encircle.world.scenario.model import Scenario


def speed_ratios(scenario: Scenario) -> list[float]:
    """(N,) each robot's longest step over the target's; infinite for a target that cannot move."""
    target_m = scenario.target.step_m_max
    steps_m = [scenario.parameters_of(robot)["step_m_max"] for robot in scenario.ids]
    return [step_m / target_m if target_m else inf for step_m in steps_m]


@cached_per_log
def slacks_rad(log: RunLog) -> Floats:
    """(T + 1,) the least slack at each tick; -2 pi while all robots are lost."""
    rays = log.robots - log.target[:, None]
    bearings = np.arctan2(rays[..., 1], rays[..., 0]).tolist()
    distances_m = np.hypot(rays[..., 0], rays[..., 1]).tolist()
    capture_m, ratios = log.scenario.capture.stop_distance_m, speed_ratios(log.scenario)
    least = []
    for row, taking_part in enumerate(hunting(log).tolist()):
        robots = [robot for robot, there in enumerate(taking_part) if there]
        least.append(
            least_slack_rad(
                [bearings[row][k] for k in robots],
                [distances_m[row][k] for k in robots],
                [ratios[k] for k in robots],
                capture_m,
            )
        )
    return np.array(least)


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
