"""Keeping off the target: never nearer than it may be, and nothing taken away that may stay."""

from math import hypot

from hypothesis import assume, given, settings
from hypothesis import strategies as st

from encircle.agents.planning.stop_distance import kept_off
from encircle.protocol.parameters import Parameters

P = Parameters()
CHEAP = settings(max_examples=100, deadline=None, derandomize=True)
lengths = st.floats(-8.0, 8.0)
places = st.tuples(lengths, lengths)
steps = st.tuples(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3))


@CHEAP
@given(own=places, target=places, step=steps)
def test_a_step_only_loses_what_leads_too_near(own, target, step):
    dx, dy = target[0] - own[0], target[1] - own[1]
    distance = hypot(dx, dy)
    assume(distance > 1e-3)
    kept = kept_off(step, own, target, P)
    inward, inward_before = ((x * dx + y * dy) / distance for x, y in (kept, step))
    across, across_before = ((x * dy - y * dx) / distance for x, y in (kept, step))
    assert abs(across - across_before) < 1e-9
    assert inward <= inward_before + 1e-9
    if inward < inward_before - 1e-9:
        at_most = 0.0 if distance <= P.stop_distance_m else max(0.0, distance - 1.08)
        assert abs(inward - at_most) < 1e-9


def test_within_the_stop_distance_none_closes_in_but_all_may_leave():
    assert kept_off((0.3, 0.1), (0.0, 0.0), (1.25, 0.0), P) == (0.0, 0.1)
    assert kept_off((-0.3, 0.1), (0.0, 0.0), (1.25, 0.0), P) == (-0.3, 0.1)


def test_a_robot_on_the_target_is_left_alone():
    assert kept_off((0.3, 0.1), (1.0, 1.0), (1.0, 1.0), P) == (0.3, 0.1)
