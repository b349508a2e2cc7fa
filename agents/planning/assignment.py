"""Who goes to which encirclement point: Algorithm 1, as printed and as run.

``algorithm_1`` is the paper's text, N! permutations and all: the reference and the oracle of the
tests. ``assign`` does the same by linear assignment, for every prediction step at once.

Ties. Algorithm 1 keeps the first permutation it meets, and each robot starts its enumeration with
its own point, so two robots may break one tie differently and claim one point. All robots must
agree, so here every robot takes the permutation that Algorithm 1 finds for the *first* robot of the
team: of the shortest, the lexicographically smallest in robot order. Two sums count as equal if
they are so in whole microns (``QUANTA_PER_M``), since rounding noise must not decide.

Up to ``ENUMERATED_MAX`` robots all permutations are summed by one matrix product, exact in whole
microns, and the first of the shortest is taken. For larger teams the rule is carried by the costs
themselves: each distance is shifted left and the low bits hold the point's number, the first
robot's in the highest bits. Sums of up to 8 km stay below 2**53, so scipy's double arithmetic is
exact. The low bits hold the whole rule up to seven robots; beyond that only for as many leading
robots as fit, and what is left is broken by scipy's own fixed order.

The paper assigns anew at every step, so a robot between two points may turn back and forth as the
ring turns and news comes late. ``assign_with_hysteresis`` is a remedy, by request. Each robot
decides for itself, so while one keeps its point another may be assigned it.
"""

from functools import lru_cache
from itertools import permutations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from encircle.protocol.messages import QUANTA_PER_M, Point

ENUMERATED_MAX = 5
TIE_BITS = 20
AT_ONCE_MAX = 100
"""For larger teams the costs of all rings at once leave the cache: ring by ring is quicker."""


def algorithm_1(costs: NDArray[np.float64], own: int) -> tuple[int, float]:
    """Algorithm 1 for robot ``own``, literally: its point and the minimal sum of costs.

    ``costs``: (N, N), robot n's distance to point q in [n, q]. Lines are the paper's.
    """
    count = len(costs)
    minimum = float(sum(costs[n, n] for n in range(count)))  # 11
    chosen = own  # 12
    others = [n for n in range(count) if n != own]
    for k in range(count):  # 13
        rest = [q for q in range(count) if q != k]  # 14, 15
        for permutation in permutations(rest):  # 16, 22
            total = costs[own, k] + sum(
                costs[n, q] for n, q in zip(others, permutation, strict=True)
            )
            if total < minimum:  # 18
                minimum, chosen = float(total), k  # 19, 20
    return chosen, minimum


def assign_by_enumeration(costs: NDArray[np.float64]) -> tuple[tuple[int, ...], float]:
    """The permutation that ``algorithm_1`` finds for the first robot, whole, and its sum."""
    count = len(costs)
    best, minimum = tuple(range(count)), float(sum(costs[n, n] for n in range(count)))
    for permutation in permutations(range(count)):
        total = float(sum(costs[n, q] for n, q in enumerate(permutation)))
        if total < minimum:
            best, minimum = permutation, total
    return best, minimum


def whole_quanta(distances: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distances in m as whole numbers of ``QUANTUM_M``, held in doubles."""
    return np.rint(distances * QUANTA_PER_M)


@lru_cache(maxsize=256)
def _tie_break_bits(count: int) -> NDArray[np.float64]:
    """(N, 1, N) low bits that make the lexicographically smallest win, see above."""
    leading = 0
    while leading < count and count ** (leading + 1) <= 2**TIE_BITS:
        leading += 1
    place_values = np.zeros(count)
    place_values[:leading] = float(count) ** np.arange(leading - 1, -1, -1)
    return place_values[:, None, None] * np.arange(count)


@lru_cache(maxsize=ENUMERATED_MAX + 1)
def _permutations(count: int) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """All N! permutations in lexicographic order, (N!, N), and what sums their costs, (N * N, N!).

    Costs are in order of robot, then point.
    """
    every = np.array(list(permutations(range(count))), np.intp)
    sums = np.zeros((count * count, len(every)))
    for robot in range(count):
        sums[robot * count + every[:, robot], np.arange(len(every))] = 1.0
    return every, sums


def assign(
    team: NDArray[np.float64], points: NDArray[np.float64]
) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Assign N robots to N points for each of G rings.

    ``team``: (N, 2) and ``points``: (G, N, 2) in m. Returns each robot's point (G, N) and its
    distance to it (G, N) in m.
    """
    rings, count, _ = points.shape
    if rings > 1 and count > AT_ONCE_MAX:
        each = [assign(team, ring[None]) for ring in points]
        return np.concatenate([part[0] for part in each]), np.concatenate([p[1] for p in each])
    # [robot, ring, point]
    distances = cdist(team, points.reshape(rings * count, 2)).reshape(count, rings, count)
    costs = whole_quanta(distances)
    choose = batch_by_enumeration if count <= ENUMERATED_MAX else batch_by_linear_assignment
    choice = choose(costs)
    return choice, distances[_index_range(count), _index_range(rings)[:, None], choice]


def batch_by_enumeration(costs: NDArray[np.float64]) -> NDArray[np.intp]:
    """(G, N) each robot's point, for ``costs`` (N, G, N) of robot, ring and point: enumeration."""
    count, rings, _ = costs.shape
    every, sums = _permutations(count)
    totals = costs.transpose(1, 0, 2).reshape(rings, count * count) @ sums
    chosen: NDArray[np.intp] = every[totals.argmin(axis=1)]
    return chosen


def batch_by_linear_assignment(costs: NDArray[np.float64]) -> NDArray[np.intp]:
    """The same by linear assignment, for any N."""
    count, rings, _ = costs.shape
    costs = costs * 2.0**TIE_BITS
    costs += _tie_break_bits(count)
    choice = np.empty((rings, count), np.intp)
    for ring in range(rings):
        choice[ring] = linear_sum_assignment(costs[:, ring])[1]
    return choice


def assign_with_hysteresis(
    team: NDArray[np.float64],
    points: NDArray[np.float64],
    assigned: NDArray[np.intp],
    own: int,
    previous: Point,
    gain_m: float,
) -> int:
    """The point robot ``own`` goes to if it changes its mind only for a gain.

    It keeps the point nearest to ``previous`` (of those equally near in whole microns the first)
    unless the best assignment is shorter, in total, than the best of those in which it keeps it by
    more than ``gain_m``. ``team`` and ``points``: (N, 2) in m; ``assigned``: (N,), the best one.
    """
    chosen = int(assigned[own])
    kept = int(whole_quanta(cdist([previous], points)[0]).argmin())
    if kept == chosen:
        return chosen
    costs = whole_quanta(cdist(team, points))
    best = costs[_index_range(len(team)), assigned].sum()
    others = np.delete(np.delete(costs, own, axis=0), kept, axis=1)
    best_keeping = costs[own, kept] + others[linear_sum_assignment(others)].sum()
    return chosen if best_keeping - best > gain_m * QUANTA_PER_M else kept


@lru_cache(maxsize=256)
def _index_range(count: int) -> NDArray[np.intp]:
    return np.arange(count)
