"""The spiral against Archimedes' closed form: evenly spaced arms, full speed, robots spread out."""

from dataclasses import replace
from math import atan2, hypot, pi

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.agents.planning.search import Search, search_goal
from encircle.protocol.parameters import Parameters

CHEAP = settings(max_examples=50, deadline=None, derandomize=True)
P = Parameters()
START = Search(2.0, -1.0, 10)


def polar(tick, own=0, size=4, parameters=P, start=START):
    x, y = search_goal(start, tick, own, size, parameters)
    return hypot(x - start.x, y - start.y), atan2(y - start.y, x - start.x)


@pytest.mark.parametrize("tick", [10, 11, 500])
def test_holding_still_means_the_place_where_the_search_began(tick):
    hold = replace(P, search="hold")
    assert search_goal(START, tick, 1, 4, hold) == (2.0, -1.0)


@pytest.mark.parametrize("size", [1, 2, 3, 5, 8])
@pytest.mark.parametrize("tick", [10, 47, 300])
def test_robots_that_search_from_one_place_head_into_evenly_spread_directions(size, tick):
    radius, first = polar(tick, 0, size)
    for own in range(size):
        far, bearing = polar(tick, own, size)
        assert far == pytest.approx(radius)
        turned = (bearing - first) % (2 * pi)
        assert turned == pytest.approx(2 * pi * own / size % (2 * pi), abs=1e-9)


def test_the_arms_are_one_and_a_half_sensing_ranges_apart():
    # On Archimedes' spiral the radius grows by one arm spacing per turn, all along.
    turned, before, at_turns = 0.0, None, {}
    for tick in range(10, 4000):
        radius, bearing = polar(tick)
        if before is not None:
            turned += (bearing - before) % (2 * pi)
        else:
            turned = bearing % (2 * pi)
        before = bearing
        at_turns[tick] = (turned, radius)
    for turns, radius in at_turns.values():
        assert radius == pytest.approx(1.5 * P.sensing_range_m * turns / (2 * pi), rel=1e-9)
    assert turned > 4 * pi, "the spiral must have gone round more than once"


@CHEAP
@given(st.integers(10, 2000))
def test_the_goal_runs_ahead_at_full_speed_once_the_first_turn_is_done(elapsed):
    tick = START.tick + 600 + elapsed
    a, b = (search_goal(START, t, 1, 4, P) for t in (tick, tick + 1))
    assert hypot(b[0] - a[0], b[1] - a[1]) == pytest.approx(P.step_m_max, rel=0.02)


@CHEAP
@given(st.integers(0, 3000), st.integers(0, 7))
def test_the_goal_moves_outwards_for_ever_and_never_stands_still(elapsed, own):
    near, _ = polar(START.tick + elapsed, own, 8)
    far, _ = polar(START.tick + elapsed + 1, own, 8)
    assert far > near > 0.0


def test_only_the_time_since_the_search_began_matters():
    later = START._replace(tick=110)
    assert search_goal(START, 25, 2, 4, P) == search_goal(later, 125, 2, 4, P)
