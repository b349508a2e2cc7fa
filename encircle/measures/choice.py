"""Measures of how well robots that decide alone decide together: conflicts, switches, regret.

A robot encircles at a tick if its command names an encirclement point. Points are compared by where
they are, never by number: each robot counts from its own reference, and two robots may hold
different rings to be the ring.

Regret is what a team pays for not knowing the truth. The omniscient team holds the ring about the
target's true position at xi = 0 (Eq. 1, from true positions) and takes the assignment with the
least total distance. Of the real team each robot claims the point of that ring nearest to its goal;
a point claimed by several goes to one of them and the others take points that nobody claimed, by
the assignment that is cheapest for the team. What this costs more than the omniscient assignment is
the regret in m. It is at least 0, since it compares with the best of all assignments.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from encircle.agents.planning.assignment import whole_quanta
from encircle.measures.common import cached_per_log, in_unit, mean_or_nan, pairs
from encircle.runlog.runlog import NAN, Floats, RunLog


@cached_per_log
def encircling(log: RunLog) -> NDArray[np.bool_]:
    """(T, N) whether a robot encircles."""
    return np.asarray((log.points >= 0) & ~np.isnan(log.goals[..., 0]))


@cached_per_log
def several(log: RunLog) -> NDArray[np.bool_]:
    """(T,) whether two or more robots encircle."""
    return np.asarray(encircling(log).sum(axis=1) >= 2)


@cached_per_log
def shared_points(log: RunLog) -> NDArray[np.bool_]:
    """(T, N (N - 1) / 2) whether the two robots of each pair hold one point.

    One point: goals nearer than a body's diameter, where two could not both stand.
    """
    return holding_one_point(log.goals, encircling(log), log.scenario.team.radius_m)


def holding_one_point(
    goals: Floats, encircles: NDArray[np.bool_], radius_m: float
) -> NDArray[np.bool_]:
    """(T, N (N - 1) / 2) as ``shared_points``, of (T, N, 2) goals in m and (T, N) who encircles."""
    first, second = pairs(goals.shape[1])
    away = goals[:, first] - goals[:, second]
    near = np.hypot(away[..., 0], away[..., 1]) < 2.0 * radius_m
    return np.asarray(encircles[:, first] & encircles[:, second] & near)


@cached_per_log
def conflicts(log: RunLog) -> NDArray[np.int64]:
    """(S,) pairs of robots that hold one point, at each tick with two or more encircling."""
    return np.asarray(shared_points(log).sum(axis=1)[several(log)])


@in_unit("tick")
def conflict_ticks(log: RunLog) -> float:
    """Ticks at which two robots hold one point."""
    return float((conflicts(log) > 0).sum()) if several(log).any() else NAN


@in_unit("1")
def conflict_share(log: RunLog) -> float:
    """The share of ticks with two or more encircling at which two hold one point."""
    return mean_or_nan(conflicts(log) > 0)


@in_unit("1")
def conflict_pairs_mean(log: RunLog) -> float:
    """Pairs that hold one point, mean over ticks with two or more encircling."""
    return mean_or_nan(conflicts(log))


@cached_per_log
def switch_chances(log: RunLog) -> NDArray[np.bool_]:
    """(T - 1, N) whether a robot encircles at a tick, the first left out, and the one before."""
    return np.asarray(encircling(log)[1:] & encircling(log)[:-1])


@cached_per_log
def switched(log: RunLog) -> NDArray[np.bool_]:
    """(T - 1, N) whether a robot that encircles has changed its point since the tick before.

    It has if its goal, relative to its estimate of the target, jumped further than half the way to
    the next point of its ring: ``rho sin(pi / M)`` in a team of M. Without the other point of a
    ring, M = 1, there is nothing to change to.
    """
    offsets = log.goals - log.estimates[..., :2]
    jumps = np.diff(offsets, axis=0)
    sizes = log.members[1:].sum(axis=2)
    half_way_m = log.parameters.ring_radius_m * np.sin(np.pi / np.maximum(sizes, 2))
    jumped = (np.hypot(jumps[..., 0], jumps[..., 1]) > half_way_m) & (sizes > 1)
    return np.asarray(jumped & switch_chances(log))


@in_unit("1")
def switches(log: RunLog) -> float:
    """Changes of point, summed over robots and ticks."""
    return float(switched(log).sum())


@in_unit("1")
def switch_share(log: RunLog) -> float:
    """The share of changes among all chances: a robot encircling at two ticks in a row."""
    return mean_or_nan(switched(log)[switch_chances(log)])


@cached_per_log
def xi_spreads(log: RunLog) -> Floats:
    """(S,) largest less smallest xi, at each tick at which two or more have chosen one."""
    choosing = encircling(log) & ~np.isnan(log.xi)
    rows = choosing.sum(axis=1) >= 2
    xi, choosing = log.xi[rows], choosing[rows]
    high = np.where(choosing, xi, -np.inf).max(axis=1)
    return np.asarray(high - np.where(choosing, xi, np.inf).min(axis=1))


@in_unit("1")
def xi_disagreement_share(log: RunLog) -> float:
    """The share of ticks with two or more encircling at which not all have the same xi."""
    return mean_or_nan(xi_spreads(log) > 0.0)


@in_unit("tick")
def xi_spread_ticks_mean(log: RunLog) -> float:
    """Largest less smallest xi, mean over ticks with two or more encircling."""
    return mean_or_nan(xi_spreads(log))


@cached_per_log
def regrets_m(log: RunLog) -> Floats:
    """(R,) regret at each tick at which all robots encircle."""
    rows = np.flatnonzero(encircling(log).all(axis=1))
    ring = true_rings(log)[rows]
    return regrets_of(_distances(log.robots[rows], ring), _distances(log.goals[rows], ring))


def regrets_of(costs: Floats, misses: Floats) -> Floats:
    """(R,) regret in m; ``costs`` and ``misses``: (R, N, N) from robots and goals to points."""
    claims = misses.argmin(axis=2)
    ranked = np.sort(claims, axis=1)
    taken = claims.copy()
    for row in np.flatnonzero((ranked[:, 1:] == ranked[:, :-1]).any(axis=1)):
        taken[row] = _completed(costs[row], claims[row])
    best = np.array([linear_sum_assignment(table)[1] for table in costs], np.intp)
    paid, least = (
        np.take_along_axis(costs, points.reshape(*claims.shape, 1), axis=2).sum(axis=(1, 2))
        for points in (taken, best)
    )
    # The same sum in another order may come out a rounding error lower.
    return np.asarray(np.maximum(paid - least, 0.0))


def _completed(costs: Floats, claims: NDArray[np.intp]) -> NDArray[np.intp]:
    """(N,) the cheapest assignment in which every claimed point goes to one that claims it."""
    allowed = np.ones_like(costs, bool)
    allowed[:, claims] = False
    allowed[np.arange(len(claims)), claims] = True
    return np.asarray(linear_sum_assignment(np.where(allowed, costs, np.inf))[1])


@cached_per_log
def true_rings(log: RunLog) -> Floats:
    """(T, N, 2) the ring of Eq. 1 about the target at xi = 0, all from the truth.

    Robots are equally far as in ``encircle.agents.planning.ring``, in whole microns.
    """
    centres = log.target[: log.ticks]
    rays = log.robots[: log.ticks] - centres[:, None]
    farthest = whole_quanta(np.sqrt((rays * rays).sum(axis=2))).argmax(axis=1)[:, None]
    ray = np.take_along_axis(rays, farthest[..., None], axis=1)[:, 0]
    bearing = np.arctan2(ray[:, 1], ray[:, 0])[:, None]
    bearings = bearing + 2.0 * np.pi * np.arange(log.count) / log.count
    turned = np.stack([np.cos(bearings), np.sin(bearings)], axis=-1)
    return np.asarray(centres[:, None] + log.parameters.ring_radius_m * turned)


def _distances(positions: Floats, ring: Floats) -> Floats:
    """(R, N, N) from each position to each point of the ring."""
    away = positions[:, :, None] - ring[:, None]
    return np.hypot(away[..., 0], away[..., 1])


@in_unit("m")
def regret_m_mean(log: RunLog) -> float:
    """Regret, mean over ticks at which all robots encircle."""
    return mean_or_nan(regrets_m(log))


@in_unit("1")
def regret_defined_share(log: RunLog) -> float:
    """The share of ticks at which all robots encircle, and so regret is defined."""
    return mean_or_nan(np.asarray(encircling(log).all(axis=1)))
