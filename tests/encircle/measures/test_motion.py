"""Measures of motion against closed forms: squares, circles, straight lines."""

from dataclasses import replace
from math import cos, hypot, isnan, pi, sin, sqrt

import numpy as np
import pytest
from helpers_measures import RING_M, SQUARE, polygon, scenario, standing

from encircle.measures import motion


def placed(*rows):
    """Positions (T + 1, N + 1, 2) of robots with the target at the origin."""
    return np.array([[*robots, (0.0, 0.0)] for robots in rows])


def test_the_capture_is_at_the_last_tick_and_undefined_without_one():
    held = standing(7, captured=True)
    assert (motion.captured(held), motion.capture_tick(held)) == (1.0, 7.0)
    assert motion.capture_s(held) == pytest.approx(0.7)
    free = standing(7)
    assert motion.captured(free) == 0.0
    assert isnan(motion.capture_tick(free))
    assert isnan(motion.capture_s(free))


@pytest.mark.parametrize("robots", [2, 3, 5, 8])
def test_the_gap_of_a_regular_polygon_is_its_share_of_the_circle(robots):
    turned = polygon(robots) @ np.array([[cos(2.9), sin(2.9)], [-sin(2.9), cos(2.9)]])
    log = standing(1, robots, positions=placed(turned, turned))
    assert motion.gap_rad_mean(log) == pytest.approx(2 * pi / robots)
    assert motion.gap_rad_final(log) == pytest.approx(2 * pi / robots)


def test_the_gap_of_one_robot_is_the_whole_circle():
    log = standing(3, 1)
    assert motion.gap_rad_mean(log) == pytest.approx(2 * pi)
    assert motion.enclosed_share(log) == 0.0
    assert isnan(motion.ring_tick(log))


def test_the_target_is_enclosed_if_it_lies_inside_the_robots_hull():
    # Barycentric coordinates of the origin tell the same of three robots, another way.
    rng = np.random.default_rng(3)
    rows = rng.uniform(-5.0, 5.0, (200, 3, 2))
    log = standing(199, 3, positions=placed(*rows))
    weights = np.linalg.solve(
        np.concatenate([rows.transpose(0, 2, 1), np.ones((200, 1, 3))], axis=1),
        np.array([[0.0], [0.0], [1.0]]),
    )
    inside = (weights[..., 0] > 0.0).all(axis=1)
    assert 20 < inside.sum() < 180
    assert motion.enclosed(log).tolist() == inside.tolist()
    assert motion.enclosed_share(log) == pytest.approx(inside.mean())


def test_robots_on_opposite_sides_of_the_target_do_not_enclose_it_whatever_their_bearing():
    rng = np.random.default_rng(4)
    ray, other = rng.integers(-(2**22), 2**22, (2, 500, 2)) / 2**20
    log = standing(499, 3, positions=placed(*np.stack([ray, -2.0 * ray, other], axis=1)))
    np.testing.assert_allclose(np.maximum(motion.gaps_rad(log), pi), motion.gaps_rad(log))
    assert not motion.enclosed(log).any()


def test_the_gap_at_the_end_is_that_of_the_last_tick_and_the_mean_is_over_all():
    half = ((4.0, 0.0), (0.0, 4.0), (-4.0, 0.0), (-4.0, 1.0))
    log = standing(3, positions=placed(SQUARE, SQUARE, SQUARE, half))
    assert motion.gap_rad_final(log) == pytest.approx(pi)
    assert motion.gap_rad_mean(log) == pytest.approx((3 * pi / 2 + pi) / 4)
    assert motion.enclosed_share(log) == 0.75


def test_the_ring_has_formed_once_all_are_near_and_around():
    far = [(1.6 * x, 1.6 * y) for x, y in SQUARE]  # 6.4 m away, k1 rho is 6 m
    aside = [(abs(x), y) for x, y in SQUARE]
    log = standing(3, positions=placed(far, aside, SQUARE, far))
    assert motion.ring_tick(log) == 2.0
    assert motion.ring_s(log) == pytest.approx(0.2)
    assert isnan(motion.ring_tick(replace(log, positions=placed(far, aside, aside, far))))


def test_a_robot_at_the_edge_of_the_vicinity_is_near():
    edge = [(1.5 * x, 1.5 * y) for x, y in SQUARE]
    assert motion.ring_tick(standing(0, positions=placed(edge))) == 0.0
    wide = scenario(4, robot={"near_factor": 1.49})
    assert isnan(motion.ring_tick(standing(0, positions=placed(edge), scenario=wide)))


def test_who_stands_makes_no_way_and_no_effort():
    log = standing(20)
    assert motion.path_m_total(log) == 0.0
    assert motion.path_m_mean(log) == 0.0
    assert motion.effort_m2ps_mean(log) == 0.0


def test_the_path_of_the_robots_is_summed_and_that_of_the_target_is_not():
    positions = np.zeros((4, 5, 2))
    positions[:, 1] = [[0.0, 0.0], [3.0, 4.0], [3.0, 4.0], [0.0, 0.0]]
    positions[:, 4] = [[0.0, 0.0], [9.0, 0.0], [0.0, 0.0], [9.0, 0.0]]
    log = standing(3, positions=positions)
    assert motion.path_m_total(log) == pytest.approx(10.0)
    assert motion.path_m_mean(log) == pytest.approx(2.5)


def test_on_a_circle_the_path_is_the_arc_as_a_polygon():
    turns = np.exp(2j * pi * np.arange(101) / 100)
    places = np.array(SQUARE) @ [1, 1j] * turns[:, None]
    rows = np.stack([places.real, places.imag], axis=-1)
    log = standing(100, positions=placed(*rows))
    assert motion.path_m_mean(log) == pytest.approx(100 * 2 * RING_M * sin(pi / 100))


def test_the_effort_is_the_integral_of_the_squared_speed():
    # At 2 m/s for 30 ticks of 0.1 s: 4 m^2/s^2 times 3 s, for one robot of four.
    steps = np.zeros((30, 4, 2))
    steps[:, 2] = (0.2 / sqrt(2), -0.2 / sqrt(2))
    log = standing(30, steps=steps)
    assert motion.effort_m2ps_mean(log) == pytest.approx(12.0 / 4)
    slower = scenario(4, tick_s=0.2)
    assert motion.effort_m2ps_mean(replace(log, scenario=slower)) == pytest.approx(6.0 / 4)


def test_separations_are_between_surfaces_and_least_over_ticks():
    nearer = ((4.0, 0.0), (3.0, 2.0), (-4.0, 0.0), (0.0, -3.5))
    log = standing(2, positions=placed(SQUARE, nearer, SQUARE))
    assert motion.separation_robots_m_min(log) == pytest.approx(hypot(1.0, 2.0) - 1.0)
    touching = replace(log, positions=placed(SQUARE, SQUARE, [(1.125, 0.0), *SQUARE[1:]]))
    assert motion.separation_m_min(touching) == pytest.approx(0.125)
    assert motion.separation_robots_m_min(touching) == pytest.approx(hypot(1.125, 4.0) - 1.0)


def test_obstacles_count_as_bodies_and_so_does_the_target_beside_them():
    discs = [
        {"position": [5.0, 4.0], "radius_m": 1.25},
        {"position": [0.0, 2.5], "radius_m": 0.75},
    ]
    log = standing(1, scenario=scenario(4, obstacles=discs))
    # The robot in the north is 1.5 m from the second disc's centre, the target 2.5 m.
    assert motion.separation_m_min(log) == pytest.approx(1.5 - 0.75 - 0.5)
    away = np.array([*SQUARE, (0.0, 1.0)])
    away[1] = (-9.0, 9.0)
    assert motion.separation_m_min(replace(log, positions=np.array([away]))) == pytest.approx(0.25)


def test_an_overlap_is_negative():
    close = ((4.0, 0.0), (4.0, 0.75), (-4.0, 0.0), (0.0, -4.0))
    log = standing(0, positions=placed(close))
    assert motion.separation_robots_m_min(log) == pytest.approx(-0.25)
    assert motion.separation_m_min(log) == pytest.approx(-0.25)


def test_one_robot_has_no_other_to_keep_from():
    log = standing(2, 1)
    assert isnan(motion.separation_robots_m_min(log))
    assert motion.separation_m_min(log) == pytest.approx(RING_M - 1.0)


def test_contacts_with_the_target_are_no_collisions():
    # Bodies 0 to 3 are robots, 4 is the target, 5 an obstacle.
    touched = [(1, 0, 1), (1, 0, 4), (2, 3, 5), (2, 4, 5), (3, 3, 4), (3, 2, 3)]
    log = standing(4, contacts=touched)
    assert motion.contacts(log) == 6.0
    assert motion.collisions(log) == 3.0
    assert motion.collisions(standing(4)) == motion.contacts(standing(4)) == 0.0
