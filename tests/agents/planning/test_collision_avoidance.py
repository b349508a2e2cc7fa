"""Avoidance: what is safe stays safe in any scene, what is free stays as it is, pairs get past.

Scenes are discs; the scan is computed here by ray and circle. The rule asserted is the module's
own promise: never nearer than the clearance to a surface point (nor nearer than before where it is
broken already), never more than half of the free space towards a robot in sight.
"""

from math import atan2, cos, degrees, hypot, pi, sin

import pytest
from helpers_agents import RANGE_M, ring_of_rays, spread
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from encircle.agents.planning.collision_avoidance import TARGET_TOLERANCE_M, avoid
from encircle.protocol.parameters import Parameters

CHEAP = settings(max_examples=200, deadline=None, derandomize=True)
P = Parameters()
KEEP_M = P.radius_m + P.clearance_m
APART_M = 2 * P.radius_m + P.clearance_m
OPEN = (RANGE_M,) * 72
EPSILON_M = 1e-9

steps = st.builds(
    lambda length, angle: (length * cos(angle), length * sin(angle)),
    st.floats(0.0, P.step_m_max),
    st.floats(-pi, pi),
)
places = st.tuples(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))
obstacles = st.lists(st.tuples(places, st.floats(0.1, 1.5)), max_size=6)


def surface_points(scan):
    """What a scan shows, as points; rays that reach the range show nothing."""
    return [
        (far * cos(2 * pi * m / len(scan)), far * sin(2 * pi * m / len(scan)))
        for m, far in enumerate(scan)
        if far < RANGE_M
    ]


def assert_keeps_clear(step, points):
    for x, y in points:
        before, after = hypot(x, y), hypot(x - step[0], y - step[1])
        assert after >= min(before, KEEP_M) - EPSILON_M


def assert_takes_at_most_half(step, peers):
    for x, y in peers:
        distance = hypot(x, y)
        if distance > 0.0:
            towards = (x * step[0] + y * step[1]) / distance
            assert towards <= max(0.0, (distance - APART_M) / 2) + EPSILON_M


@CHEAP
@given(steps, obstacles, st.lists(places, max_size=4), st.none() | places)
def test_no_step_is_longer_than_wanted_or_closer_than_allowed(step, discs, peers, target):
    scene = [(x, y, r) for (x, y), r in discs if hypot(x, y) > r]
    movers = [(x, y, P.radius_m) for x, y in peers]
    if target is not None:
        movers.append((*target, P.target_radius_m))
    movers = [m for m in movers if hypot(m[0], m[1]) > m[2]]
    scan = ring_of_rays((0.0, 0.0), scene + movers, 72)
    safe = avoid(step, scan, peers, target, P)
    assert hypot(*safe) <= hypot(*step) + EPSILON_M
    assert_takes_at_most_half(safe, peers)
    # Points of the scan near a robot in sight or the target are those bodies, not walls.
    bodies = [(x, y, P.radius_m + TARGET_TOLERANCE_M) for x, y in peers]
    if target is not None:
        bodies.append((*target, P.target_radius_m + TARGET_TOLERANCE_M))
    walls = [
        (x, y)
        for x, y in surface_points(scan)
        if all(hypot(x - bx, y - by) > size for bx, by, size in bodies)
    ]
    assert_keeps_clear(safe, walls)


@CHEAP
@given(steps, places, st.lists(st.tuples(st.floats(0, 2 * pi), st.floats(1.7, 6.0)), max_size=5))
def test_an_unobstructed_step_is_not_changed(step, target, far_peers):
    peers = [(far * cos(bearing), far * sin(bearing)) for bearing, far in far_peers]
    assert avoid(step, OPEN, peers, target, P) == step
    scan = (KEEP_M + P.step_m_max + 1e-6,) * 24
    assert avoid(step, scan, peers, None, P) == step


def test_the_target_is_not_avoided():
    target = (1.05, 0.0)
    scan = ring_of_rays((0.0, 0.0), [(*target, P.target_radius_m)], 72)
    assert avoid((0.3, 0.0), scan, (), target, P) == (0.3, 0.0)


def test_a_wall_in_the_targets_place_is_avoided():
    scan = ring_of_rays((0.0, 0.0), [(1.05, 0.0, 0.5)], 72)
    safe = avoid((0.3, 0.0), scan, (), None, P)
    assert safe != (0.3, 0.0)
    assert_keeps_clear(safe, surface_points(scan))


def test_no_wish_to_move_is_no_motion_however_crowded():
    assert avoid((0.0, 0.0), (0.1,) * 24, [(0.1, 0.0)], None, P) == (0.0, 0.0)


def test_a_robot_boxed_in_stays():
    assert avoid((0.3, 0.0), (0.5,) * 72, (), None, P) == (0.0, 0.0)


def test_away_from_what_is_too_near_is_always_allowed():
    assert avoid((-0.3, 0.0), OPEN, [(0.9, 0.0)], None, P) == (-0.3, 0.0)
    scan = ring_of_rays((0.0, 0.0), [(0.9, 0.0, 0.5)], 72)
    assert avoid((-0.3, 0.0), scan, (), None, P) == (-0.3, 0.0)


def turns_towards(peer_m):
    """Turn and length of the step chosen towards a robot straight ahead, in all directions."""
    found = {}
    for bearing_deg in range(0, 360, 15):
        ux, uy = cos(bearing_deg * pi / 180), sin(bearing_deg * pi / 180)
        x, y = avoid((0.3 * ux, 0.3 * uy), OPEN, [(peer_m * ux, peer_m * uy)], None, P)
        turn = degrees(atan2(y * ux - x * uy, x * ux + y * uy))
        found[bearing_deg] = (round(turn, 6), round(hypot(x, y), 6))
    return found


@pytest.mark.parametrize("free_m", [0.04, 0.1, 0.2, 0.3])
def test_of_turns_that_get_equally_far_the_least_is_taken_in_any_direction(free_m):
    # Half the free space is gained straight ahead, and by every turn that still loses length.
    found = turns_towards(APART_M + free_m)
    assert {turn for turn, _ in found.values()} == {0.0}, found
    assert {length for _, length in found.values()} == {free_m / 2}


@pytest.mark.parametrize("free_m", [-0.05, 0.0, 0.01])
def test_a_robot_that_gets_no_nearer_slides_aside_counter_clockwise_in_any_direction(free_m):
    found = turns_towards(APART_M + free_m)
    assert set(found.values()) == {(90.0, 0.3)}, found


def test_two_robots_on_one_spot_can_leave_it():
    assert avoid((0.3, 0.0), OPEN, [(0.0, 0.0)], None, P) == (0.3, 0.0)


@CHEAP
@given(st.lists(st.tuples(places, steps), min_size=2, max_size=5), st.none() | places)
def test_robots_that_all_move_at_once_never_meet(robots, target):
    positions = [place for place, _ in robots]
    assume(spread(positions) >= APART_M)
    after = []
    for own, (place, step) in enumerate(robots):
        others = [p for k, p in enumerate(positions) if k != own]
        peers = [(x - place[0], y - place[1]) for x, y in others]
        scan = ring_of_rays(place, [(*other, P.radius_m) for other in others], 72)
        safe = avoid(step, scan, peers, target, P)
        after.append((place[0] + safe[0], place[1] + safe[1]))
    assert spread(after) >= APART_M - EPSILON_M


def walked(starts, goals, discs=(), ticks_max=200, sees_peers=True):
    """Let robots walk to their goals by full steps; asserts on the way, returns the tick."""
    positions = list(starts)
    for tick in range(ticks_max):
        wishes, moved = [], []
        for (x, y), (gx, gy) in zip(positions, goals, strict=True):
            scale = min(1.0, P.step_m_max / max(hypot(gx - x, gy - y), 1e-9))
            wishes.append(((gx - x) * scale, (gy - y) * scale))
        if all(hypot(*wish) < 0.05 for wish in wishes):
            return tick
        for own, (place, wish) in enumerate(zip(positions, wishes, strict=True)):
            others = [p for k, p in enumerate(positions) if k != own]
            scan = ring_of_rays(place, [*discs, *((*p, P.radius_m) for p in others)], 72)
            peers = [(x - place[0], y - place[1]) for x, y in others] if sees_peers else []
            safe = avoid(wish, scan, peers, None, P)
            moved.append((place[0] + safe[0], place[1] + safe[1]))
        positions = moved
        assert spread(positions) >= 2 * P.radius_m, f"collision at tick {tick}"
        for x, y in positions:
            for dx, dy, radius in discs:
                assert hypot(x - dx, y - dy) >= radius + P.radius_m, f"obstacle at tick {tick}"
    raise AssertionError(f"still under way after {ticks_max} ticks, at {positions}")


@pytest.mark.parametrize("bearing_deg", range(0, 180, 15))
def test_a_head_on_pair_does_not_collide_and_passes(bearing_deg):
    x, y = 5 * cos(bearing_deg * pi / 180), 5 * sin(bearing_deg * pi / 180)
    assert walked([(x, y), (-x, -y)], [(-x, -y), (x, y)]) < 60


@pytest.mark.parametrize("count", [3, 4])
def test_robots_that_cross_in_one_point_do_not_collide_and_get_through(count):
    starts = [(5 * cos(2 * pi * k / count), 5 * sin(2 * pi * k / count)) for k in range(count)]
    walked(starts, [(-x, -y) for x, y in starts])


def test_a_robot_walks_round_an_obstacle_in_its_way():
    assert walked([(-4.0, 0.1)], [(4.0, 0.0)], discs=[(0.0, 0.0, 1.0)]) < 60


@pytest.mark.parametrize("rays", [24, 72, 360])
def test_a_robot_turns_to_the_open_side_of_an_obstacle(rays):
    for side in (1.0, -1.0):
        scan = ring_of_rays((0.0, 0.0), [(1.1, 0.4 * side, 0.5)], rays)
        x, y = avoid((0.3, 0.0), scan, (), None, P)
        assert -pi / 2 < atan2(y * side, x) < 0.0, "past the obstacle on its open side, not back"
