"""The ring to head for: of the rings at all prediction steps the one at xi*, and who goes where.

This is Algorithm 1 and Eq. 1-3 put together, a pure function of where a robot believes its team and
the target to be. Robots in one process often believe exactly the same: where all see each other and
nothing is lost, every robot of the team does. What one has computed serves the others then, so a
result is remembered under the bytes of its arguments. Each robot still decides on its own view
alone, and where views differ, in the last bit if no more, each computes its own.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from encircle.agents.planning.assignment import assign
from encircle.agents.planning.cyclic_assignment import assign_in_cyclic_order
from encircle.agents.planning.prediction_step import best_step
from encircle.agents.planning.ring import encirclement_points
from encircle.protocol.messages import Point

REMEMBERED_MAX = 16
"""Results remembered: those of a tick are asked for one after the other, and none later."""


class Ring(NamedTuple):
    """A ring: ``xi_index`` into the grid, its points (N, 2) in m, and each robot's point (N,).

    Both arrays are read-only.
    """

    xi_index: int
    points: NDArray[np.float64]
    assigned: NDArray[np.intp]


def best_ring(
    team: Sequence[Point],
    target: Point,
    predictions: NDArray[np.float64],
    xi_grid: tuple[float, ...],
    xi_weight: float,
    ring_radius_m: float,
    assignment: str = "shortest",
) -> Ring:
    """The ring at xi* and the best assignment to it.

    ``team``: N positions in m; ``predictions``: (G, 2) in m, the target's at each of ``xi_grid``;
    ``assignment``: ``shortest``, or ``cyclic`` (``encircle.agents.planning.cyclic_assignment``).
    """
    # Bytes, since 0.0 and -0.0 are equal and do not give the same.
    bodies = np.array((*team, target)).tobytes()
    arguments = (xi_grid, xi_weight, ring_radius_m, assignment)
    return _remembered(bodies, predictions.tobytes(), *arguments)


@lru_cache(maxsize=REMEMBERED_MAX)
def _remembered(
    bodies: bytes,
    predictions: bytes,
    xi_grid: tuple[float, ...],
    xi_weight: float,
    ring_radius_m: float,
    assignment: str,
) -> Ring:
    """``bodies``: the team's positions, then the target's; else as ``best_ring``."""
    *team, target = [(x, y) for x, y in np.frombuffer(bodies).reshape(-1, 2).tolist()]
    centres = np.frombuffer(predictions).reshape(-1, 2)
    points = encirclement_points(team, target, centres, ring_radius_m)
    if assignment == "cyclic":
        assigned, distances = assign_in_cyclic_order(np.array(team), points, centres)
    else:
        assigned, distances = assign(np.array(team), points)
    best = best_step(distances, xi_grid, xi_weight) if len(xi_grid) > 1 else 0
    # Copies, so that the other rings need not be kept.
    ring = Ring(best, points[best].copy(), assigned[best].copy())
    ring.points.setflags(write=False)
    ring.assigned.setflags(write=False)
    return ring
