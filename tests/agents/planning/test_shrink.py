"""Eq. 4-7: angles against closed forms, beta against Eq. 6 written out in degrees, and the drift.

The last part asserts what the deviation is for: every robot of any formation moves into the larger
of its two gaps, or not sideways at all.
"""

from math import atan2, cos, degrees, hypot, pi, radians, sin

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from encircle.agents.planning.shrink import deviation, encloses, sides, turned

CHEAP = settings(max_examples=200, deadline=None, derandomize=True)
SOUTH = (0.0, -4.0)  # a robot here faces north: east of it is right, west of it is left


def ray(bearing_deg, distance=4.0):
    """A ray from the target, its bearing counted counter-clockwise from the robot at SOUTH."""
    bearing = radians(bearing_deg - 90.0)
    return distance * cos(bearing), distance * sin(bearing)


def at(*bearings_deg):
    return sides(SOUTH, [ray(bearing) for bearing in bearings_deg])


def in_degrees(angles):
    return [degrees(angle) for angle in angles[:4]]


def test_the_robot_to_the_east_is_on_the_right_of_one_that_faces_north():
    angles = sides(SOUTH, [(4.0, 0.0)])
    assert (angles.left_count, angles.right_count) == (0, 1)
    assert angles.right_min == pytest.approx(pi / 2)


@pytest.mark.parametrize("bearing", [1, 45, 89, 90, 91, 120, 135, 179])
def test_angles_beyond_90_degrees_are_not_folded(bearing):
    assert at(bearing).right_min == pytest.approx(radians(bearing))
    assert at(-bearing).left_min == pytest.approx(radians(bearing))


def test_smallest_and_largest_angles_of_both_sides_are_found():
    angles = at(30, -20, 170, 100, -150)
    assert in_degrees(angles) == pytest.approx([20, 150, 30, 170])
    assert (angles.left_count, angles.right_count) == (2, 3)


def test_a_side_without_robots_counts_as_zero_and_says_that_it_is_empty():
    angles = at(40, 100)
    assert (angles.left_min, angles.left_max, angles.left_count) == (0.0, 0.0, 0)
    assert sides(SOUTH, []).right_count == 0


@pytest.mark.parametrize(
    ("bearings", "widest"),
    [((), 360), ((90,), 270), ((180,), 180), ((90, 180, -90), 90), ((10, 20, -10), 330)],
)
def test_the_widest_gap_is_that_of_the_whole_ring(bearings, widest):
    assert degrees(at(*bearings).widest) == pytest.approx(widest)


@CHEAP
@given(
    st.lists(st.integers(-179, 179).filter(lambda b: b != 0), min_size=1, max_size=7),
    st.floats(-pi, pi),
    st.data(),
)
def test_neither_rotating_everything_nor_distances_change_the_angles(bearings, turn, data):
    far = st.floats(0.5, 9.0)
    rays = [turned(ray(bearing, data.draw(far)), turn) for bearing in bearings]
    angles = sides(turned(SOUTH, turn), rays)
    assert in_degrees(angles) == pytest.approx(in_degrees(at(*bearings)), abs=1e-6)
    assert angles[4:6] == at(*bearings)[4:6]


def test_the_three_readings_of_the_enclosure_test():
    angles = at(100, 30, -50, -120)
    for reading, value_deg in (("printed", 100 + 50), ("span", 100 + 120), ("gap", 360 - 140)):
        assert encloses(angles, radians(value_deg - 0.01), reading)
        assert not encloses(angles, radians(value_deg + 0.01), reading)


def test_robots_all_on_one_side_do_not_enclose():
    angles = at(10, 60, 90)
    for reading in ("printed", "span", "gap"):
        assert not encloses(angles, 1.1 * pi, reading)


def beta_by_equation_6(left_deg, right_deg, count, w_deg, k2):
    """Eq. 6 in degrees, with its sign, from the angles to the two neighbours."""
    low, high = 360 / count - w_deg, 360 / count + w_deg
    large, small = max(left_deg, right_deg), min(left_deg, right_deg)
    if large > high and small < high:
        size = k2 * (large - high)
    elif small < low and low <= large <= high:
        size = k2 * (low - small)
    else:
        size = 0.0
    return -size if left_deg < right_deg else size


@CHEAP
@given(st.integers(-179, -1), st.integers(1, 179), st.integers(2, 9), st.integers(0, 40))
def test_beta_is_that_of_equation_6_with_the_papers_sign(left, right, count, w):
    beta = deviation(at(left, right), count, radians(w), 2.0, 100.0)
    expected = beta_by_equation_6(-left, right, count, w, 2.0)
    on_the_edge = 360 / count - w in (-left, right) or 360 / count + w in (-left, right)
    assume(not on_the_edge)
    assert degrees(beta) == pytest.approx(expected, abs=1e-6)


def test_beta_is_negative_when_the_left_neighbour_is_the_nearer_one():
    assert degrees(deviation(at(-30, 101), 4, radians(10), 2.0, pi)) == pytest.approx(-2.0)
    assert degrees(deviation(at(-101, 30), 4, radians(10), 2.0, pi)) == pytest.approx(2.0)


def test_equation_6_jumps_where_the_larger_angle_leaves_the_allowance():
    # As printed: just inside the allowance the smaller angle counts, just outside the larger one.
    assert degrees(deviation(at(-30, 99), 4, radians(10), 2.0, pi)) == pytest.approx(-100.0)
    assert degrees(deviation(at(-30, 101), 4, radians(10), 2.0, pi)) == pytest.approx(-2.0)


def test_beta_is_zero_for_an_even_ring_and_for_a_robot_alone():
    assert deviation(at(90, -90, 180), 4, radians(15), 2.0, pi) == 0.0
    assert deviation(at(), 1, radians(15), 2.0, pi) == 0.0


def test_beta_is_capped_in_magnitude_and_keeps_its_sign():
    assert deviation(at(-10, 170), 4, radians(15), 2.0, 0.5) == -0.5
    assert deviation(at(-170, 10), 4, radians(15), 2.0, 0.5) == 0.5


@pytest.mark.parametrize(
    ("bearings", "left", "right"), [((20, 60), 300, 20), ((-20, -60), 20, 300)]
)
def test_with_an_empty_side_the_neighbour_that_way_is_the_farthest_on_the_other(
    bearings, left, right
):
    beta = deviation(at(*bearings), 3, radians(15), 2.0, 100.0)
    assert degrees(beta) == pytest.approx(beta_by_equation_6(left, right, 3, 15, 2.0))


@CHEAP
@given(st.floats(-pi, pi), st.floats(-pi, pi))
def test_a_direction_is_turned_counter_clockwise_as_equation_7_says(bearing, angle):
    x, y = turned((cos(bearing), sin(bearing)), angle)
    assert (x, y) == pytest.approx((cos(bearing + angle), sin(bearing + angle)), abs=1e-12)


@CHEAP
@given(
    st.lists(st.floats(-pi, pi), min_size=2, max_size=8),
    st.tuples(st.floats(-20, 20), st.floats(-20, 20)),
    st.floats(0.0, 0.6),
)
def test_turning_by_beta_moves_every_robot_into_the_larger_of_its_gaps(bearings, target, w):
    """Literal Eq. 7: a small step along the turned direction, phi before and after."""
    robots = [(target[0] + 4 * cos(b), target[1] + 4 * sin(b)) for b in bearings]
    for own, bearing in enumerate(bearings):
        others = [b for k, b in enumerate(bearings) if k != own]
        ahead = min((b - bearing) % (2 * pi) for b in others)
        behind = min((bearing - b) % (2 * pi) for b in others)
        assume(min(ahead, behind) > 1e-6 and abs(ahead - behind) > 1e-6)
        rays = [(x - target[0], y - target[1]) for x, y in robots]
        own_ray = rays.pop(own)
        beta = deviation(sides(own_ray, rays), len(bearings), w, 2.0, pi / 3)
        inwards = (-own_ray[0] / 4, -own_ray[1] / 4)
        dx, dy = turned(inwards, beta)
        x, y = own_ray[0] + 0.01 * dx, own_ray[1] + 0.01 * dy
        phi_change = (atan2(y, x) - bearing + pi) % (2 * pi) - pi
        assert hypot(x, y) < 4.0
        if abs(beta) < 1e-9:
            assert phi_change == pytest.approx(0.0, abs=1e-9)
        else:
            assert (phi_change > 0) == (ahead > behind)
