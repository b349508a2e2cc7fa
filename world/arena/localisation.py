"""Errors of the robots' own positions: white noise, and a drift that grows.

The error of a robot at tick t is, along each axis,

    e(t) = n(t) + b(t),    n(t) ~ N(0, noise^2),    b(t) = b(t - 1) + drift sqrt(tick_s) w(t)

with w(t) ~ N(0, 1) and b(0) = 0: noise as of a positioning system, and a random walk (a Wiener
process sampled at the ticks, of variance drift^2 t tick_s) as of odometry, at a start that is known
exactly. All draws are independent, and a function of seed, robot and tick alone.

A robot's sensors measure relative to it. So whatever it is told of an instant, its own position,
the target's and those of robots in sight, is shifted by one error, in whole quanta: what lies
between them stays as it is. Headings are exact, and so are the directions of the scan's rays.
"""

from collections.abc import Sequence
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from encircle.protocol.messages import Point
from encircle.world.arena.dynamics import quantised
from encircle.world.random_streams import Purpose, normal_pairs
from encircle.world.scenario.model import Scenario

Floats = NDArray[np.float64]


def next_drift(scenario: Scenario, seed: int, tick: int, before: Floats | None) -> Floats | None:
    """(N, 2) the drift b at a tick in m, from that of the tick before; None if there is none.

    ``before`` is None at tick 0.
    """
    std = scenario.sensing.localisation_drift_m_per_sqrt_s
    if std == 0.0:
        return None
    count = len(scenario.ids)
    if before is None:
        return np.zeros((count, 2))
    walked = normal_pairs(seed, Purpose.LOCALISATION_DRIFT, tick, count)
    return before + std * sqrt(scenario.tick_s) * walked


def errors(scenario: Scenario, seed: int, tick: int, drift: Floats | None) -> Floats | None:
    """(N, 2) errors of the robots' positions at a tick in m, quantised; None if there are none.

    ``drift``: (N, 2) the drift at this tick, None without.
    """
    std = scenario.sensing.localisation_noise_m_std
    if std == 0.0:
        return None if drift is None else quantised(drift)
    noise = std * normal_pairs(seed, Purpose.LOCALISATION_NOISE, tick, len(scenario.ids))
    return quantised(noise if drift is None else noise + drift)


def shifted(
    targets: Sequence[Point], positions: Sequence[Point], errors: Floats
) -> tuple[list[Point], list[list[Point]]]:
    """Each robot's detection, and N times where all robots are as it is told, shifted by its error.

    ``targets``: what each detects, ``positions``: where they are, ``errors``: (N, 2); all in m.
    """
    detected = [(x + dx, y + dy) for (x, y), (dx, dy) in zip(targets, errors.tolist(), strict=True)]
    return detected, [[(x + dx, y + dy) for x, y in positions] for dx, dy in errors.tolist()]
