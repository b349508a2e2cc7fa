"""Measures of what bodies did: capture, ring, paths, effort, separation, contacts, angular gap.

All of it is taken from the truth, but for the effort, which is of what robots commanded. The target
is enclosed if the largest angular gap between neighbouring robots, seen from it, is below pi: then,
and only then, it lies inside the convex hull of the robots and cannot leave in a straight line
without passing between two of them.
"""

import numpy as np
from numpy.typing import NDArray

from encircle.measures.common import cached_per_log, in_unit, mean_or_nan, pairs
from encircle.runlog.runlog import NAN, Floats, RunLog
from encircle.world.arena.capture import encloses


@in_unit("1")
def captured(log: RunLog) -> float:
    """1 if the target was captured, else 0."""
    return float(log.captured)


@in_unit("tick")
def capture_tick(log: RunLog) -> float:
    """The tick of the capture, at which a run ends."""
    return float(log.ticks) if log.captured else NAN


@in_unit("s")
def capture_s(log: RunLog) -> float:
    """The time of the capture."""
    return capture_tick(log) * log.scenario.tick_s


@cached_per_log
def hunting(log: RunLog) -> NDArray[np.bool_]:
    """(T + 1, N) which robots take part at a tick; at the last, those of the round before."""
    if not log.ticks:
        return np.ones((1, log.count), bool)
    return np.concatenate([log.there, log.there[-1:]])


def _hunting_rays(log: RunLog) -> Floats:
    """(T + 1, N, 2) from the target to the robots; a lost one stands where another one does."""
    rays = log.robots - log.target[:, None]
    # That makes no gap smaller.
    another = np.take_along_axis(rays, hunting(log).argmax(axis=1)[:, None, None], axis=1)
    return np.asarray(np.where(hunting(log)[..., None], rays, another))


@cached_per_log
def gaps_rad(log: RunLog) -> Floats:
    """(T + 1,) largest angle about the target between neighbouring robots; 2 pi for one or none."""
    return largest_gaps_rad(_hunting_rays(log))


def largest_gaps_rad(rays: Floats) -> Floats:
    """(T,) largest angle in rad between neighbours of N >= 1 rays, (T, N, 2); 2 pi for one."""
    bearings = np.sort(np.arctan2(rays[..., 1], rays[..., 0]), axis=1)
    after = np.concatenate([bearings[:, 1:], bearings[:, :1] + 2.0 * np.pi], axis=1)
    gaps: Floats = (after - bearings).max(axis=1)
    return gaps


@cached_per_log
def enclosed(log: RunLog) -> NDArray[np.bool_]:
    """(T + 1,) whether the target is enclosed."""
    return encloses(_hunting_rays(log))


@cached_per_log
@in_unit("tick")
def ring_tick(log: RunLog) -> float:
    """The first tick with a ring: target enclosed, all robots within k1 rho of it (Sec. II-C)."""
    reach_m = log.parameters.near_factor * log.parameters.ring_radius_m
    rays = log.robots - log.target[:, None]
    near = rays[..., 0] ** 2 + rays[..., 1] ** 2 <= reach_m**2
    formed = (near | ~hunting(log)).all(axis=1) & enclosed(log)
    return float(formed.argmax()) if formed.any() else NAN


@in_unit("s")
def ring_s(log: RunLog) -> float:
    """The time at which there is a ring first."""
    return ring_tick(log) * log.scenario.tick_s


@in_unit("m")
def path_m_mean(log: RunLog) -> float:
    """Length of a robot's path, mean over robots."""
    return path_m_total(log) / log.count


@cached_per_log
@in_unit("m")
def path_m_total(log: RunLog) -> float:
    """Length of all robots' paths together."""
    moved = np.diff(log.robots, axis=0)
    return float(np.hypot(moved[..., 0], moved[..., 1]).sum())


@in_unit("m^2/s")
def effort_m2ps_mean(log: RunLog) -> float:
    """Integral of the squared commanded speed over time, mean over robots."""
    return float((log.steps * log.steps).sum()) / log.scenario.tick_s / log.count


@cached_per_log
def separations_m(log: RunLog) -> Floats:
    """(T + 1, N (N - 1) / 2) free distance between the surfaces of two robots."""
    first, second = pairs(log.count)
    away = log.robots[:, first] - log.robots[:, second]
    return np.hypot(away[..., 0], away[..., 1]) - 2.0 * log.scenario.team.radius_m


@in_unit("m")
def separation_robots_m_min(log: RunLog) -> float:
    """The least free distance between two robots."""
    return float(separations_m(log).min(initial=np.inf)) if log.count > 1 else NAN


@in_unit("m")
def separation_m_min(log: RunLog) -> float:
    """The least free distance between any two bodies of which one moves."""
    scenario = log.scenario
    rays = log.robots - log.target[:, None]
    touching_m = scenario.team.radius_m + scenario.target.radius_m
    least = [separations_m(log).min(initial=np.inf), np.hypot(rays[..., 0], rays[..., 1]).min()]
    least[1] -= touching_m
    radii = np.append(np.full(log.count, scenario.team.radius_m), scenario.target.radius_m)
    for obstacle in scenario.obstacles:
        away = log.positions - np.array(obstacle.position)
        least.append((np.hypot(away[..., 0], away[..., 1]) - radii).min() - obstacle.radius_m)
    return float(min(least))


@in_unit("1")
def contacts(log: RunLog) -> float:
    """Pairs of bodies that touched, summed over ticks."""
    return float(len(log.contacts))


@in_unit("1")
def collisions(log: RunLog) -> float:
    """Contacts of a robot with a robot or an obstacle, summed over ticks."""
    body, other = log.contacts[:, 1], log.contacts[:, 2]
    return float(((body < log.count) & (other != log.count)).sum())


@in_unit("rad")
def gap_rad_mean(log: RunLog) -> float:
    """The largest angular gap, mean over ticks."""
    return mean_or_nan(gaps_rad(log))


@in_unit("rad")
def gap_rad_final(log: RunLog) -> float:
    """The largest angular gap at the last tick."""
    return float(gaps_rad(log)[-1])


@in_unit("1")
def enclosed_share(log: RunLog) -> float:
    """The share of ticks at which the target is enclosed."""
    return mean_or_nan(enclosed(log))
