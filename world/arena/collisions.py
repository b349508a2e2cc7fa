"""Solid bodies: discs that move at once and never overlap.

Every body moves along its step at constant speed during a tick. When two touch, each loses the part
of its motion that presses into the other (no body pushes another away; one that gives way may be
followed) and both slide on. So a robot in the target's way blocks it. Contacts are resolved in
order of time; if a knot of bodies takes more rounds than the limit, those that still press stop for
the rest of the tick.

``SKIN_M``, four quanta, is kept between touching bodies. Pressing of less than a quantum per tick
is let pass, since two neighbours can hand a body to and fro for ever, with less motion each time;
and positions are rounded afterwards. Both may use the skin up, so bodies that are down to half of
it are moved apart by what is missing. Should all this not do in some knot, ``kept_apart`` takes the
bodies that would overlap back to where they were.
"""

from collections.abc import Iterable
from math import hypot, sqrt

import numpy as np
from numpy.typing import NDArray

from encircle.protocol.messages import QUANTUM_M

SKIN_M = 4 * QUANTUM_M
PRESSING_M_MIN = QUANTUM_M
ROUNDS_PER_PAIR_MAX = 8


def move(
    positions: NDArray[np.float64],
    radii: NDArray[np.float64],
    steps: NDArray[np.float64],
    gaps: NDArray[np.float64],
) -> tuple[NDArray[np.float64], list[tuple[int, int]]]:
    """Move B bodies among O fixed ones; returns positions (B, 2) and the pairs that touched.

    ``positions`` (B + O, 2) and ``radii`` (B + O,) in m, moving bodies first; ``steps`` (B, 2);
    ``gaps`` (B, B + O): free distance between surfaces, infinite on the diagonal.
    """
    return moved(positions, radii, steps, pairs_in_reach(steps, gaps))


def pairs_in_reach(steps: NDArray[np.float64], gaps: NDArray[np.float64]) -> list[tuple[int, int]]:
    """The pairs that may come within the skin of each other by these steps; as ``move``.

    All others stay farther apart than that, also when positions have been rounded.
    """
    count = len(steps)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    closing = gaps - (lengths[:, None] + SKIN_M)
    closing[:, :count] -= lengths
    if closing.min() > 0.0:
        return []
    return [(i, k) for i, k in np.argwhere(closing <= 0.0).tolist() if i < k]


def moved(
    positions: NDArray[np.float64],
    radii: NDArray[np.float64],
    steps: NDArray[np.float64],
    pairs: Iterable[tuple[int, int]],
) -> tuple[NDArray[np.float64], list[tuple[int, int]]]:
    """As ``move``, for the ``pairs_in_reach``."""
    count = len(steps)
    after = positions[:count] + steps
    apart = {(i, k): float(radii[i] + radii[k]) + SKIN_M for i, k in pairs}
    touched: list[tuple[int, int]] = []
    for knot in knots(apart):
        involved = sorted({i for pair in knot for i in pair})
        current = {i: positions[i].tolist() for i in involved}
        motion = {i: steps[i].tolist() if i < count else [0.0, 0.0] for i in involved}
        touched += _resolve(current, motion, {pair: apart[pair] for pair in knot}, count)
        for i in involved:
            if i < count:
                after[i] = current[i]
    return after, sorted(touched)


def knots(pairs: Iterable[tuple[int, int]]) -> list[list[tuple[int, int]]]:
    """The pairs, grouped so that no body is in two groups."""
    groups: list[tuple[set[int], list[tuple[int, int]]]] = []
    for pair in pairs:
        joined, members = [pair], set(pair)
        for group in [g for g in groups if g[0] & members]:
            groups.remove(group)
            members |= group[0]
            joined = [*group[1], *joined]
        groups.append((members, joined))
    return [group for _, group in groups]


def kept_apart(
    before: NDArray[np.float64], after: NDArray[np.float64], radii: NDArray[np.float64], moving: int
) -> NDArray[np.float64]:
    """``after`` (B + O, 2) with every body that overlaps another taken back to ``before``.

    ``before`` must be free of overlaps; of the bodies the first ``moving`` may be taken back.
    """
    apart = radii + radii[:moving, None]
    apart[np.arange(moving), np.arange(moving)] = 0.0
    for _ in range(moving + 1):
        away = after - after[:moving, None]
        close = np.sqrt((away * away).sum(axis=2)) < apart
        if not close.any():
            return after
        overlapping = close.any(axis=1) | close.any(axis=0)[:moving]
        after = after.copy()
        after[:moving][overlapping] = before[:moving][overlapping]
    return before


def _resolve(
    current: dict[int, list[float]],
    motion: dict[int, list[float]],
    apart: dict[tuple[int, int], float],
    moving: int,
) -> list[tuple[int, int]]:
    """Advance ``current`` by ``motion`` over one tick, contact by contact; returns who touched."""
    left = 1.0
    wanted = {i: tuple(step) for i, step in motion.items()}
    touched: set[tuple[int, int]] = set()
    sliding = ROUNDS_PER_PAIR_MAX * (len(apart) + 1)
    # Once the rounds of sliding are used up each further one stops a body that still moves.
    for turn in range(sliding + len(motion)):
        first, when = None, left
        for pair, distance in apart.items():
            time = _contact_time(current, motion, pair, distance)
            if time < when:
                first, when = pair, time
        for i, (vx, vy) in motion.items():
            current[i][0] += when * vx
            current[i][1] += when * vy
        left -= when
        if first is None:
            break
        touched.add(first)
        if turn < sliding:
            _stop_pressing(
                current, motion, wanted, first, _missing(current, first, apart[first]), moving
            )
        else:
            for i in first:
                motion[i] = [0.0, 0.0]
    return sorted(touched)


def _contact_time(
    current: dict[int, list[float]],
    motion: dict[int, list[float]],
    pair: tuple[int, int],
    distance: float,
) -> float:
    """When the two come within ``distance`` while approaching, in ticks; infinite if never."""
    (ax, ay), (bx, by) = current[pair[0]], current[pair[1]]
    (au, av), (bu, bv) = motion[pair[0]], motion[pair[1]]
    x, y, u, v = bx - ax, by - ay, bu - au, bv - av
    inward = x * u + y * v
    missing = _missing(current, pair, distance)
    if missing > 0.0:
        return 0.0 if inward < missing * distance / 2.0 else float("inf")
    if inward >= -PRESSING_M_MIN * distance:
        return float("inf")
    excess = x * x + y * y - distance * distance
    if excess <= 0.0:
        return 0.0
    speed_squared = u * u + v * v
    root = inward * inward - speed_squared * excess
    if root <= 0.0:
        return float("inf")
    return excess / (sqrt(root) - inward)


def _missing(current: dict[int, list[float]], pair: tuple[int, int], distance: float) -> float:
    """By how much two bodies are closer than ``distance``; 0 while half of the skin is left."""
    (ax, ay), (bx, by) = current[pair[0]], current[pair[1]]
    missing = distance - hypot(bx - ax, by - ay)
    return missing if missing > SKIN_M / 2.0 else 0.0


def _stop_pressing(
    current: dict[int, list[float]],
    motion: dict[int, list[float]],
    wanted: dict[int, tuple[float, ...]],
    pair: tuple[int, int],
    missing: float,
    moving: int,
) -> None:
    """Take from both the motion with which they press into each other; restore the skin."""
    (ax, ay), (bx, by) = current[pair[0]], current[pair[1]]
    distance = hypot(bx - ax, by - ay)
    nx, ny = (bx - ax) / distance, (by - ay) / distance
    a, b = motion[pair[0]], motion[pair[1]]
    towards, away = a[0] * nx + a[1] * ny, b[0] * nx + b[1] * ny
    # A body follows one that moves away from it, as fast as that one; bodies that press both stop.
    shared = away if away > 0.0 else towards if towards < 0.0 else 0.0
    back = missing / 2.0 if pair[1] < moving else missing
    for i, along, after, restored in (
        (pair[0], towards, min(towards, shared), -back),
        (pair[1], away, max(away, shared), missing - back),
    ):
        velocity = motion[i]
        if along != after:
            velocity[0] += (after - along) * nx
            velocity[1] += (after - along) * ny
            if velocity[0] * wanted[i][0] + velocity[1] * wanted[i][1] < 0.0:
                # Between two obstacles the contacts in turn would send it backwards. It stops.
                velocity[0] = velocity[1] = 0.0
        velocity[0] += restored * nx
        velocity[1] += restored * ny
