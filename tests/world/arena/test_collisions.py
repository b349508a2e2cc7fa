"""Solid bodies: never any overlap, nobody pushed, and the closed forms of simple meetings."""

from math import cos, dist, hypot, pi, sin, sqrt

import numpy as np
import pytest
from helpers_world import overlapping
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.world.arena.collisions import SKIN_M, kept_apart, move, pairs_in_reach
from encircle.world.arena.engine import quantised
from encircle.world.arena.sensing import geometry

HYPOTHESIS = {"deadline": None, "derandomize": True}
SUBSTEPS = 4000


def moved(positions, radii, steps):
    """Positions of all bodies after the moving ones made their steps, and who touched."""
    positions, radii = np.array(positions, float), np.array(radii, float)
    steps = np.array(steps, float).reshape(-1, 2)
    gaps = geometry(positions, radii, len(steps)).gaps
    after, touched = move(positions, radii, steps, gaps)
    return np.vstack([after, positions[len(steps) :]]), touched


def coordinates(limit):
    return st.tuples(st.floats(-limit, limit), st.floats(-limit, limit))


@st.composite
def arenas(draw, gap_m=SKIN_M):
    """Discs at least ``gap_m`` apart, on the quantum grid, and steps of the moving ones."""
    placed, radii = [], []
    for _ in range(draw(st.integers(2, 9))):
        radius = draw(st.sampled_from([0.25, 0.5, 1.0]))
        if placed and draw(st.booleans()):
            # Close to another body: as near as is allowed, or a little more.
            other = draw(st.integers(0, len(placed) - 1))
            turn, more = draw(st.floats(0, 2 * pi)), draw(st.sampled_from([0.0, 1e-6, 0.01, 0.2]))
            away = radius + radii[other] + gap_m + 2e-6 + more
            wanted = (placed[other][0] + away * cos(turn), placed[other][1] + away * sin(turn))
        else:
            wanted = draw(coordinates(3.0))
        place = tuple(quantised(np.array(wanted)).tolist())
        near = [
            hypot(place[0] - x, place[1] - y) < radius + r + gap_m
            for (x, y), r in zip(placed, radii, strict=True)
        ]
        if not any(near):
            placed.append(place)
            radii.append(radius)
    steps = draw(st.lists(coordinates(0.5), min_size=1, max_size=len(placed)))
    return placed, radii, steps


@settings(**HYPOTHESIS, max_examples=400)
@given(arena=arenas())
def test_bodies_never_overlap_after_a_move_and_none_goes_farther_than_its_step(arena):
    positions, radii, steps = arena
    after, _ = moved(positions, radii, steps)
    assert overlapping(quantised(after), np.array(radii), len(steps)) == []
    gone = np.hypot(*(after - np.array(positions))[: len(steps)].T)
    assert (gone <= np.hypot(*np.array(steps).T) + 1e-9).all()


@settings(**HYPOTHESIS, max_examples=200)
@given(arena=arenas(gap_m=0.0))
def test_bodies_that_begin_closer_than_the_skin_do_not_overlap_either(arena):
    positions, radii, steps = arena
    assert overlapping(np.array(positions), np.array(radii), len(positions)) == []
    after, _ = moved(positions, radii, steps)
    assert overlapping(quantised(after), np.array(radii), len(steps)) == []


@settings(**HYPOTHESIS, max_examples=200)
@given(arena=arenas(), turn=st.floats(0, 2 * pi))
def test_a_body_alone_within_reach_moves_exactly_its_step(arena, turn):
    positions, radii, _ = arena
    others = zip(positions[1:], radii[1:], strict=True)
    reach = min((dist(positions[0], p) - radii[0] - r for p, r in others), default=1.0)
    length = 0.9 * (reach - SKIN_M)
    step = np.array([length * cos(turn), length * sin(turn)])
    after, touched = moved(positions, radii, [step])
    assert after[0].tolist() == (np.array(positions[0]) + step).tolist()
    assert touched == []


@pytest.mark.parametrize("turn", [0.0, 0.4, 2.0, 4.5])
def test_bodies_that_part_or_pass_move_exactly_their_steps(turn):
    away = np.array([cos(turn), sin(turn)])
    aside = np.array([-away[1], away[0]])
    positions = np.array([[0.0, 0.0], away * 1.00001])
    steps = np.array([-0.3 * away, 0.3 * away + 0.1 * aside])
    after, touched = moved(positions, [0.5, 0.5], steps)
    np.testing.assert_allclose(after, positions + steps, atol=1e-12)
    assert touched == []


@settings(**HYPOTHESIS, max_examples=100)
@given(
    gap=st.floats(1e-3, 0.5),
    first=st.floats(0.0, 0.5),
    second=st.floats(0.0, 0.5),
    radii=st.tuples(st.floats(0.1, 2.0), st.floats(0.1, 2.0)),
    turn=st.floats(0, 2 * pi),
)
def test_two_that_meet_head_on_stop_at_contact(gap, first, second, radii, turn):
    ahead = np.array([cos(turn), sin(turn)])
    distance = sum(radii) + SKIN_M + gap
    positions = np.array([[0.0, 0.0], ahead * distance])
    after, touched = moved(positions, radii, [first * ahead, -second * ahead])
    share = min(1.0, gap / (first + second)) if first + second > 0.0 else 1.0
    np.testing.assert_allclose(after[0], share * first * ahead, atol=1e-8)
    np.testing.assert_allclose(after[1], (distance - share * second) * ahead, atol=1e-8)
    if abs(first + second - gap) > 1e-6:
        assert touched == ([(0, 1)] if first + second > gap else [])


@pytest.mark.parametrize("slant", [0.2, 0.7, 1.2, -0.9])
@pytest.mark.parametrize("turn", [0.0, 1.1, 3.9])
@pytest.mark.parametrize("gap", [0.0, 0.05, 0.2])
def test_a_body_blocked_by_a_fixed_one_slides_on_along_the_tangent(slant, turn, gap):
    # The obstacle is straight ahead of a body that comes along a line through both centres.
    ahead = np.array([cos(turn), sin(turn)])
    aside = np.array([-ahead[1], ahead[0]])
    radius = 1e6  # as good as a wall
    step = 0.3 * (cos(slant) * ahead + sin(slant) * aside)
    wall = ahead * (0.5 + radius + SKIN_M + gap)
    after, touched = moved([[0.0, 0.0], wall], [0.5, radius], [step])
    inward = min(gap, 0.3 * cos(slant))
    np.testing.assert_allclose(after[0], inward * ahead + 0.3 * sin(slant) * aside, atol=1e-6)
    assert touched == ([(0, 1)] if gap < 0.3 * cos(slant) else [])


def test_the_slide_keeps_the_part_of_the_step_along_the_tangent_at_the_point_of_contact():
    # From (0, 0) along +x towards a disc at (1.2, 0.6): closed form of line and circle.
    apart = 1.0 + SKIN_M
    reached = 1.2 - sqrt(apart**2 - 0.6**2)
    normal = np.array([1.2 - reached, 0.6]) / apart
    tangent = np.array([normal[1], -normal[0]])
    step = np.array([0.5, 0.0])
    contact = np.array([reached, 0.0])
    slide = (step - contact) @ tangent * tangent
    after, _ = moved([[0.0, 0.0], [1.2, 0.6]], [0.5, 0.5], [step])
    np.testing.assert_allclose(after[0], contact + slide, atol=1e-9)


@pytest.mark.parametrize("turn", [0.0, 0.9, 2.5])
def test_one_that_gives_way_is_followed_at_its_pace_and_not_pushed(turn):
    ahead = np.array([cos(turn), sin(turn)])
    positions = np.array([[0.0, 0.0], ahead * (1.0 + SKIN_M)])
    for order in (1, -1):
        after, touched = moved(
            positions[::order], [0.5, 0.5], np.array([0.3 * ahead, 0.1 * ahead])[::order]
        )
        np.testing.assert_allclose(after[::order], positions + 0.1 * ahead, atol=1e-8)
        assert touched == [(0, 1)]


def test_a_robot_in_its_way_blocks_the_target_and_is_not_moved():
    after, touched = moved([[1.2, 0.0], [0.0, 0.0]], [0.5, 0.5], [[0.0, 0.0], [0.39, 0.0]])
    np.testing.assert_allclose(after, [[1.2, 0.0], [0.2 - SKIN_M, 0.0]], atol=1e-9)
    assert touched == [(0, 1)]


def finely_stepped(positions, radii, steps):
    """Two bodies in small steps of time: each keeps no more speed towards the other than that
    one gives way. A follower's own speed never counts as giving way of the one it follows."""
    places = [np.array(p, float) for p in positions]
    speeds = [np.array(s, float) for s in steps]
    touched = False
    for _ in range(SUBSTEPS):
        between = places[1] - places[0]
        distance = np.hypot(*between)
        if distance <= sum(radii) + SKIN_M:
            normal = between / distance
            first, second = speeds[0] @ normal, speeds[1] @ normal
            if first - second > 1e-9:
                touched = True
                speeds[0] = speeds[0] + (min(first, max(second, 0.0)) - first) * normal
                speeds[1] = speeds[1] + (max(second, min(first, 0.0)) - second) * normal
        places = [p + v / SUBSTEPS for p, v in zip(places, speeds, strict=True)]
    return places, touched


@settings(**HYPOTHESIS, max_examples=25)
@given(
    turn=st.floats(0, 2 * pi),
    gap=st.floats(1e-3, 0.3),
    radii=st.tuples(st.sampled_from([0.3, 0.5]), st.sampled_from([0.5, 2.0])),
    steps=st.tuples(coordinates(0.5), coordinates(0.5)),
)
def test_two_bodies_go_where_fine_steps_of_time_take_them(turn, gap, radii, steps):
    distance = sum(radii) + SKIN_M + gap
    positions = np.array([[0.0, 0.0], [distance * cos(turn), distance * sin(turn)]])
    expected, _ = finely_stepped(positions, radii, steps)
    after, _ = moved(positions, radii, steps)
    # Before it notices a contact, the oracle is at most one of its steps too deep.
    np.testing.assert_allclose(after, expected, atol=8.0 * sqrt(2.0) / SUBSTEPS)


def hexagons(rings, spacing):
    """Centres of a dense pack around the origin."""
    rows = range(-rings, rings + 1)
    return np.array(
        [
            (spacing * (a + b / 2), spacing * b * sqrt(3) / 2)
            for a in rows
            for b in rows
            if abs(a + b) <= rings
        ]
    )


@pytest.mark.parametrize("spacing", [1.00001, 1.02, 1.2])
@pytest.mark.parametrize("heading", ["inward", "outward", "swirl", "random"])
def test_a_dense_pack_terminates_without_overlap(spacing, heading):
    places = quantised(hexagons(3, spacing))
    draws = np.random.default_rng(1).uniform(-0.3, 0.3, places.shape)
    steps = {
        "inward": -0.3 * places,
        "outward": 0.1 * places,
        "swirl": 0.2 * places[:, ::-1] * [-1, 1],
        "random": draws,
    }[heading]
    radii = np.full(len(places), 0.5)
    after, _ = moved(places, radii, steps)
    assert overlapping(quantised(after), radii, len(places)) == []
    gone, allowed = np.hypot(*(after - places).T), np.hypot(*steps.T)
    assert (gone <= allowed + 1e-9).all()


def notch(half_angle):
    """Two fixed discs that a body at the origin touches, at half_angle either side of +x."""
    apart = 1.0 + SKIN_M
    return [[apart * cos(half_angle), side * apart * sin(half_angle)] for side in (1, -1)]


@pytest.mark.parametrize("half_angle", [pi / 6 + 0.01, 0.65, 0.75, 0.8, 1.2])
def test_a_body_that_presses_straight_into_a_notch_stands(half_angle):
    # The discs do not overlap each other: they are at least 60 degrees apart. What is left of a
    # motion when neither contact may be pressed into is nothing, to whichever one looks first.
    after, touched = moved([[0.0, 0.0], *notch(half_angle)], [0.5] * 3, [[0.3, 0.0]])
    np.testing.assert_allclose(after[0], [0.0, 0.0], atol=4 * SKIN_M)
    assert touched == [(0, 1), (0, 2)]


@pytest.mark.parametrize("half_angle", [0.8, 1.2, 1.5])
def test_a_wedged_body_does_not_keep_another_from_sliding_on_in_the_same_tick(half_angle):
    other, slide = [5.0, 0.0], [5.0 + 0.2 * cos(0.9) * cos(0.9), 0.2 * cos(0.9) * sin(0.9)]
    wall = [5.0 + (1.0 + SKIN_M) * sin(0.9), -(1.0 + SKIN_M) * cos(0.9)]
    bodies = [[0.0, 0.0], other, *notch(half_angle), wall]
    after, _ = moved(bodies, [0.5] * 5, [[0.3, 0.0], [0.2, 0.0]])
    np.testing.assert_allclose(after[0], [0.0, 0.0], atol=4 * SKIN_M)
    np.testing.assert_allclose(after[1], slide, atol=4 * SKIN_M)


def test_the_order_of_two_bodies_does_not_matter():
    positions, steps = [[0.0, 0.0], [1.1, 0.3]], [[0.3, 0.1], [-0.2, 0.05]]
    after, _ = moved(positions, [0.5, 0.5], steps)
    swapped, _ = moved(positions[::-1], [0.5, 0.5], steps[::-1])
    np.testing.assert_allclose(swapped[::-1], after, atol=1e-12)


@settings(**HYPOTHESIS, max_examples=150)
@given(arena=arenas(), shrink=st.floats(0.0, 1.2))
def test_bodies_that_would_overlap_are_kept_where_they_were_and_the_others_go_on(arena, shrink):
    positions, radii, steps = arena
    before, sizes, moving = np.array(positions), np.array(radii), len(steps)
    wanted = before.copy()
    wanted[:moving] = quantised(shrink * before[:moving])
    after = kept_apart(before, wanted, sizes, moving)
    assert overlapping(after, sizes, moving) == []
    stayed, went = (after == before).all(axis=1), (after == wanted).all(axis=1)
    assert (stayed | went).all()
    if not overlapping(wanted, sizes, moving):
        assert went.all()
    # Who stayed without wishing to would overlap somebody, as all wished or as they went.
    for body in np.flatnonzero(~went):
        for places in (wanted, after):
            tried = places.copy()
            tried[body] = wanted[body]
            if any(body in pair for pair in overlapping(tried, sizes, moving)):
                break
        else:
            raise AssertionError(f"body {body} was kept back for nothing")


@given(st.integers(0, 2**31), st.floats(0.5, 3.0))
@settings(deadline=None, derandomize=True, max_examples=100)
def test_what_is_out_of_reach_never_needs_to_be_kept_apart(seed, spread_m):
    """Also after rounding to quanta, which takes up part of the skin."""
    rng = np.random.default_rng(seed)
    positions = quantised(rng.uniform(-spread_m, spread_m, (6, 2)))
    radii, steps = np.full(6, 0.1), rng.uniform(-0.4, 0.4, (4, 2))
    gaps = geometry(positions, radii, 4).gaps
    pairs = pairs_in_reach(steps, gaps)
    after = positions.copy()
    after[:4] = quantised(positions[:4] + steps)
    apart = geometry(after, radii, 4).gaps
    for i in range(4):
        for k in range(i + 1, 6):
            assert (i, k) in pairs or apart[i, k] > 0.0
    assert (gaps.min() > 2.0 * 0.4 * 2.0**0.5 + SKIN_M) <= (not pairs)
