"""Group chase: each of its three parts by hand, and the springs as gradients of their potential."""

from math import hypot, sqrt

import pytest
from helpers_agents import TICK_S, view_of
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from encircle.agents.estimation.kalman import Estimate
from encircle.agents.policies.group_chase import group_chase, soft_repulsion
from encircle.agents.policies.interface import Decision
from encircle.protocol.parameters import Parameters

P = Parameters()
CHEAP = settings(max_examples=100, deadline=None, derandomize=True)
coordinates = st.floats(-6.0, 6.0)
places = st.tuples(coordinates, coordinates)
NO_DRAG = {"chase_drag": 0.0, "spread_drag": 0.0}


def view(positions, own=0, target=(10.0, 0.0), velocity=(0.0, 0.0), steps=None):
    """A view of robots that made ``steps`` since the tick before, and of a moving target."""
    steps = steps or [(0.0, 0.0)] * len(positions)
    known = tuple((7, *place, *step) for place, step in zip(positions, steps, strict=True))
    seen = view_of(
        positions,
        own,
        target,
        lambda grid: pytest.fail("it predicts by the velocity alone"),
        last_step=steps[own],
        known=known,
        packets=(None,) * len(positions),
    )
    return seen._replace(target=Estimate(*target, *velocity, (1e-4, 0.0, 1.0)))


def step_of(seen, **parameters):
    memory, decision = group_chase(None, seen, **parameters)
    assert memory is None
    return decision.step


def test_a_target_far_ahead_is_chased_where_it_will_be():
    # 4 m away and 3 m/s fast the robot would need 4/3 s; the target makes 3 m in 1 s, aside.
    seen = view([(0.0, 0.0)], target=(4.0, 0.0), velocity=(0.0, 3.0))
    x, y = step_of(seen, predict_s=1.0, **NO_DRAG)
    assert (x, y) == pytest.approx((0.3 * 4.0 / 5.0, 0.3 * 3.0 / 5.0))
    x, y = step_of(seen, predict_s=60.0, **NO_DRAG)
    assert (x, y) == pytest.approx((0.3 / sqrt(2.0), 0.3 / sqrt(2.0)))


def test_drag_aligns_with_the_target_more_so_near_by():
    # At 2 m the target, at the robot's full speed along +y, adds 0.5 / 4 to a unit vector along +x.
    seen = view([(0.0, 0.0)], target=(2.0, 0.0), velocity=(0.0, 0.3 / TICK_S))
    x, y = step_of(seen, predict_s=0.0, chase_drag=0.5)
    assert y / x == pytest.approx(0.125)
    moving = view([(0.0, 0.0)], target=(2.0, 0.0), velocity=(0.0, 3.0), steps=[(0.0, 0.3)])
    assert step_of(moving, predict_s=0.0, chase_drag=0.5) == pytest.approx((0.3, 0.0))


def test_spread_is_a_unit_vector_away_from_the_nearer_ones():
    # Springs of 4 - 1 along +y and 4 - 2 along -y: away from the nearer one, whatever its strength.
    seen = view([(0.0, 0.0), (0.0, -1.0), (0.0, 2.0)], target=(50.0, 0.0))
    x, y = step_of(seen, spread=0.75, spread_m=4.0, near_m=0.0, **NO_DRAG)
    assert (x, y) == pytest.approx((0.3 * 0.8, 0.3 * 0.6))


def test_collisions_weigh_as_much_as_the_chase():
    seen = view([(0.0, 0.0), (0.0, -1.0)], target=(50.0, 0.0))
    x, y = step_of(seen, spread=0.0, near_m=1.5, **NO_DRAG)
    assert (x, y) == pytest.approx((0.3 / sqrt(2.0), 0.3 / sqrt(2.0)))


def test_drag_between_robots_aligns_their_velocities():
    # Out of each other's springs only the drag is left of spread, a unit vector along a velocity.
    seen = view([(0.0, 0.0), (0.0, 9.0)], target=(50.0, 0.0), steps=[(0.0, 0.0), (0.0, -0.2)])
    x, y = step_of(seen, spread=1.0, spread_m=5.0, chase_drag=0.0, spread_drag=0.1)
    assert (x, y) == pytest.approx((0.3 / sqrt(2.0), -0.3 / sqrt(2.0)))


@CHEAP
@given(own=places, others=st.lists(places, max_size=5), range_m=st.floats(0.5, 8.0))
def test_the_spring_is_minus_the_gradient_of_its_potential(own, others, range_m):
    assume(all(hypot(x - own[0], y - own[1]) > 0.01 for x, y in others))

    def potential(x, y):
        gaps = [max(0.0, range_m - hypot(x - ox, y - oy)) for ox, oy in others]
        return sum(gap * gap for gap in gaps) / 2.0

    h = 1e-5
    x, y = own
    slope_x = (potential(x + h, y) - potential(x - h, y)) / (2.0 * h)
    slope_y = (potential(x, y + h) - potential(x, y - h)) / (2.0 * h)
    force = soft_repulsion(own, others, range_m)
    assert force == pytest.approx((-slope_x, -slope_y), abs=1e-3)


@CHEAP
@given(positions=st.lists(places, min_size=1, max_size=6), target=places, own=st.integers(0, 5))
def test_it_goes_at_full_speed_and_never_too_near(positions, target, own):
    own %= len(positions)
    seen = view(positions, own, target, velocity=(1.0, -2.0))
    x, y = step_of(seen)
    assert hypot(x, y) <= 0.3 + 1e-9
    dx, dy = target[0] - positions[own][0], target[1] - positions[own][1]
    if 0.0 < hypot(dx, dy) <= P.stop_distance_m:
        assert x * dx + y * dy <= 1e-9


def test_without_an_estimate_it_searches():
    search = Decision("search", (0.1, 0.0), (3.0, 0.0))
    seen = view_of([(0.0, 0.0)], 0, None, lambda grid: pytest.fail("there is none"), search=search)
    assert group_chase(None, seen) == (None, search)
