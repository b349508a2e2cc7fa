"""Who goes to which encirclement point in cyclic order: cheap, and almost the shortest.

Seen from the ring's centre, robots in the order of their bearings go to the ring's points in the
order of theirs, counter-clockwise, beginning at one of the N. Of these N assignments the one is
taken whose squared angles between robots and points have the smallest sum. That is the smallest of
all N!, since on a circle no convex cost of the angle gains by robots that pass each other (Delon,
Salomon and Sobolevski 2010, *Fast transport optimization for Monge costs on the circle*). It takes
a sorting, N log N, where ``assign`` takes up to N^3.

Left out are the robots' distances from the centre: Algorithm 1 wants the shortest way in total, and
this is longer by some thousandths while all are outside the ring, by more where some are inside it
(docs/policies.md). Bearings count in whole 2^-30 turns, whose sums are exact: rounding noise must
not decide. Of equal bearings the first robot in robot order comes first, of two beginnings equally
good the later.
"""

import numpy as np
from numpy.typing import NDArray

TURN = 2.0**30


def assign_in_cyclic_order(
    team: NDArray[np.float64], points: NDArray[np.float64], centres: NDArray[np.float64]
) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Assign N robots to N points of each of G rings.

    ``team``: (N, 2), ``points``: (G, N, 2), equally spaced counter-clockwise about ``centres``
    (G, 2), all in m. Returns each robot's point (G, N) and its distance to it (G, N) in m.
    """
    rings, count, _ = points.shape
    bearings = _turns(team - centres[:, None]) - _turns(points[:, :1] - centres[:, None])
    bearings %= TURN
    order = bearings.argsort(axis=1, kind="stable")
    # The mean of robot k's bearing less point k's, in steps from point to point, to the nearest.
    first = np.floor(bearings.sum(axis=1) / TURN - 0.5 * count + 1.0).astype(np.intp)
    each = np.arange(rings)[:, None]
    choice = np.empty((rings, count), np.intp)
    choice[each, order] = (np.arange(count) + first[:, None]) % count
    away = points[each, choice] - team
    return choice, np.sqrt(away[..., 0] * away[..., 0] + away[..., 1] * away[..., 1])


def _turns(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Bearings of vectors (..., 2) in whole 2^-30 turns, held in doubles."""
    return np.rint(np.arctan2(vectors[..., 1], vectors[..., 0]) * (TURN / (2.0 * np.pi)))
