"""The numbers of one tick, by the functions that measures use for a whole run."""

from collections.abc import Mapping, Sequence
from math import atan2, hypot

import numpy as np

from encircle.measures.choice import holding_one_point
from encircle.measures.motion import largest_gaps_rad
from encircle.measures.ring_closure import least_slack_rad, speed_ratios
from encircle.protocol.messages import Command, State
from encircle.runlog.runlog import NOWHERE
from encircle.world.scenario.model import Scenario

FULL_TURN_RAD = 2.0 * np.pi


class TruthValues:
    """Distances, gap and slack at a tick, from the truth."""

    def __init__(self, scenario: Scenario) -> None:
        self._ratios = speed_ratios(scenario)
        self._capture_m = scenario.capture.stop_distance_m

    def distances_m(self, state: State) -> tuple[float, ...]:
        """(N,) from each robot's centre to the target's."""
        return tuple([hypot(x, y) for x, y in _rays(state)])

    def gap_rad(self, state: State, there: Sequence[bool]) -> float:
        """The largest angle between neighbours among the robots that are there."""
        rays = [ray for ray, is_there in zip(_rays(state), there, strict=True) if is_there]
        return float(largest_gaps_rad(np.array([rays]))[0]) if rays else FULL_TURN_RAD

    def slack_rad(self, state: State, there: Sequence[bool]) -> float | None:
        """The least slack of the occupied angles, None if no robot is there."""
        rays = _rays(state)
        robots = [robot for robot, is_there in enumerate(there) if is_there]
        if not robots:
            return None
        return least_slack_rad(
            [atan2(rays[k][1], rays[k][0]) for k in robots],
            [hypot(*rays[k]) for k in robots],
            [self._ratios[k] for k in robots],
            self._capture_m,
        )


def conflicts(commands: Mapping[str, Command], radius_m: float) -> int:
    """Pairs of robots that hold one encirclement point."""
    encircling = [c.goal for c in commands.values() if c.point is not None and c.goal is not None]
    if len(encircling) < 2:
        return 0
    goals = np.array([[goal or NOWHERE for goal in encircling]])
    return int(holding_one_point(goals, np.ones(goals.shape[:2], bool), radius_m).sum())


def _rays(state: State) -> list[tuple[float, float]]:
    target_x, target_y = state.target
    return [(x - target_x, y - target_y) for x, y in state.robots]
