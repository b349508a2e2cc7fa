"""Runs in which the target moves and is detected exactly as the robots' filters have it.

So every filter that counts nothing twice is consistent, and what is not, is so by how it fuses.
"""

from dataclasses import replace

import numpy as np
from helpers_agents import TICK_S, pose
from numpy.typing import NDArray

from encircle.agents.estimation import kalman
from encircle.agents.estimation.kalman import Estimate, Track
from encircle.agents.teamwork import fusing
from encircle.protocol.messages import Pose
from encircle.protocol.parameters import Parameters

ALONE = "alone"
"""Nobody tells anything; the other ways are those of ``robot.detections``."""
EVERY_TICKS = 3
"""Each robot detects the target at every third tick, not all at the same."""
PARAMETERS = Parameters(acceleration_mps2_std=2.0, measurement_m_std=0.2)


def errors_of(
    way: str, seed: int, robots: int, ticks: int, loss: float = 0.0
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(ticks, robots) NEES, and (ticks, robots) squared errors of position in m^2, one run.

    What a robot tells at a tick the others hear at the next, or not with probability ``loss``. NaN
    before there is an estimate. Ways with one seed have the same target, detections and losses.
    """
    parameters = replace(PARAMETERS, detections="own" if way == ALONE else way)
    rng = np.random.default_rng(seed)
    true = np.stack([np.zeros(2), rng.normal(0.0, parameters.velocity_mps_std, 2)])
    push = np.array([TICK_S**2 / 2, TICK_S])
    tracks = [kalman.EMPTY_TRACK] * robots
    told: list[Pose] = []
    consistency, squares = np.full((2, ticks, robots), np.nan)
    for tick in range(ticks):
        noise = rng.normal(0.0, parameters.measurement_m_std, (robots, 2))
        arrives = rng.random((robots, robots)) >= loss
        places = (true[0] + noise).tolist()
        seen = {r: places[r] for r in range(robots) if (tick + r) % EVERY_TICKS == 0}
        for own in range(robots):
            heard = [(r, told[r]) for r in range(len(told)) if r != own and arrives[r, own]]
            tracks[own] = _next(
                tracks[own], seen.get(own), [] if way == ALONE else heard, own, tick, parameters
            )
            if (estimate := tracks[own].estimate) is not None:
                consistency[tick, own], squares[tick, own] = _nees_and_square(estimate, true)
        told = [_packet(r, tick, tracks[r], seen.get(r), parameters) for r in range(robots)]
        acceleration = rng.normal(0.0, parameters.acceleration_mps2_std, 2)
        true = np.stack([true[0] + TICK_S * true[1], true[1]]) + np.outer(push, acceleration)
    return consistency, squares


def _next(
    track: Track,
    seen: list[float] | None,
    heard: list[tuple[int, Pose]],
    own: int,
    tick: int,
    parameters: Parameters,
) -> Track:
    detections = [(p.tick, r, *p.detection) for r, p in heard if p.detection is not None]
    if seen is not None:
        detections.append((tick, own, seen[0], seen[1]))
    if parameters.detections in fusing.FUSIONS:
        return fusing.incorporate(track, detections, heard, own, tick, TICK_S, parameters)
    return kalman.incorporate(track, detections, tick, TICK_S, parameters)


def _packet(
    robot: int, tick: int, track: Track, seen: list[float] | None, parameters: Parameters
) -> Pose:
    packet = pose(f"r{robot + 1}", tick)
    if parameters.detections in fusing.FUSIONS:
        return replace(packet, estimate=fusing.estimate_to_tell(track))
    return replace(packet, detection=None if seen is None else (seen[0], seen[1]))


def _nees_and_square(estimate: Estimate, true: NDArray[np.float64]) -> tuple[float, float]:
    p00, p01, p11 = estimate.covariance
    off = np.array([estimate[:2], estimate[2:4]]) - true
    nees = float(np.sum(off * np.linalg.solve(np.array([[p00, p01], [p01, p11]]), off)))
    return nees, float(off[0] @ off[0])
