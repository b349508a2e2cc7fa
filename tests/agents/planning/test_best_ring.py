"""The ring at xi*, held against Algorithm 1 and Eq. 2-3 as printed, ring by ring."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.agents.planning import best_ring as module
from encircle.agents.planning.assignment import assign_by_enumeration, whole_quanta
from encircle.agents.planning.best_ring import best_ring
from encircle.agents.planning.ring import encirclement_points

GRID, WEIGHT, RADIUS_M = (0.0, 1.0, 2.5, 4.0), 0.15, 3.0
COORDINATES = st.floats(-30.0, 30.0)
POINTS = st.tuples(COORDINATES, COORDINATES)


@settings(max_examples=60, deadline=None)
@given(st.lists(POINTS, min_size=1, max_size=5), POINTS, POINTS)
def test_it_is_the_ring_of_the_smallest_weighted_variance(team, target, velocity):
    predictions = np.array(target) + np.outer(GRID, velocity)
    chosen = best_ring(team, target, predictions, GRID, WEIGHT, RADIUS_M)
    rings = encirclement_points(team, target, predictions, RADIUS_M)
    weighted, assigned = [], []
    for xi, points in zip(GRID, rings, strict=True):
        away = np.hypot(*np.moveaxis(np.array(team)[:, None] - points, -1, 0))
        assigned.append(assign_by_enumeration(whole_quanta(away))[0])
        microns = whole_quanta(away[range(len(team)), assigned[-1]])
        weighted.append(np.var(microns) * np.exp(WEIGHT * xi))
    assert weighted[chosen.xi_index] == pytest.approx(min(weighted), rel=1e-9, abs=1e-3)
    assert np.array_equal(chosen.points, rings[chosen.xi_index])
    assert tuple(chosen.assigned) == assigned[chosen.xi_index]


def test_equal_views_are_computed_once_and_others_each_for_itself(monkeypatch):
    computed = []

    def counted(*arguments):
        computed.append(arguments)
        return encirclement_points(*arguments)

    monkeypatch.setattr(module, "encirclement_points", counted)
    module._remembered.cache_clear()
    team = [(4.0, 0.0), (0.0, 5.0), (-3.0, 1.0)]
    predictions = np.array([(0.0, 0.0), (0.5, 0.0)])
    first = best_ring(team, (0.0, 0.0), predictions, GRID[:2], WEIGHT, RADIUS_M)
    again = best_ring(tuple(team), (0.0, 0.0), predictions.copy(), GRID[:2], WEIGHT, RADIUS_M)
    assert again is first
    assert len(computed) == 1
    for other in ([*team[:2], (-3.0, np.nextafter(1.0, 2.0))], [*team[:2], (-3.0, -0.0)]):
        best_ring(other, (0.0, 0.0), predictions, GRID[:2], WEIGHT, RADIUS_M)
    # Zero and minus zero are equal, and yet two arguments.
    best_ring([*team[:2], (-3.0, 0.0)], (0.0, 0.0), predictions, GRID[:2], WEIGHT, RADIUS_M)
    assert len(computed) == 4


def test_nobody_can_change_what_is_remembered():
    ring = best_ring([(1.0, 0.0)], (0.0, 0.0), np.zeros((1, 2)), (0.0,), WEIGHT, RADIUS_M)
    for array in (ring.points, ring.assigned):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1
