"""How targets behave: directions by brute force, and behaviours of other packages."""

import importlib
from importlib.metadata import entry_points
from itertools import groupby
from math import atan2, cos, dist, hypot, pi, remainder, sin

import numpy as np
import pytest
from helpers_world import arena, small
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from encircle.protocol.plugins import TARGETS
from encircle.world.arena.engine import advance, initial
from encircle.world.scenario.plugin_parameters import check_parameters
from encircle.world.targets.behaviours import (
    BUILT_IN,
    TargetView,
    behaviour_named,
    flee,
    gap,
    patrol,
    still,
    straight,
)

SETTINGS = settings(deadline=None, derandomize=True, max_examples=150)
STEP = 0.2
BEARINGS = st.floats(-pi, pi)
POLAR = st.tuples(BEARINGS, st.floats(1.1, 6.0))
FREE = (6.0,) * 24


def view(robots=(), scan=FREE, position=(1.0, -2.0), heading=0.3, tick=5):
    return TargetView(tick, position, heading, list(robots), scan, STEP, 0.5)


def around(polar, position=(1.0, -2.0)):
    return [(position[0] + d * cos(b), position[1] + d * sin(b)) for b, d in polar]


def turned(step, bearing):
    """How far a step points away from a bearing, in rad."""
    return abs(remainder(atan2(step[1], step[0]) - bearing, 2 * pi))


def ended_at(behaviour, **changes):
    """Memory and bearing of a step of full length."""
    memory, step = behaviour(None, view(**changes))
    assert hypot(*step) == pytest.approx(STEP)
    return memory, atan2(step[1], step[0])


@pytest.mark.parametrize("behaviour", [flee, gap])
@SETTINGS
@given(robot=POLAR)
def test_from_one_robot_it_goes_directly_away(behaviour, robot):
    _, bearing = ended_at(behaviour, robots=around([robot]))
    assert abs(remainder(bearing - robot[0] - pi, 2 * pi)) < 1e-9


@SETTINGS
@given(robots=st.lists(POLAR, min_size=2, max_size=6))
def test_fleeing_weighs_robots_by_the_inverse_square_of_their_distance(robots):
    away = -sum(np.array([cos(b), sin(b)]) / d**2 for b, d in robots)
    assume(hypot(*away) > 1e-3)
    _, bearing = ended_at(flee, robots=around(robots))
    assert abs(remainder(bearing - atan2(away[1], away[0]), 2 * pi)) < 1e-6


def test_between_two_equal_robots_it_goes_on_as_it_was_going():
    robots = around([(0.0, 2.0), (pi, 2.0)], position=(0.0, 0.0))
    _, bearing = ended_at(flee, robots=robots, position=(0.0, 0.0), heading=1.1)
    assert bearing == pytest.approx(1.1)


@SETTINGS
@given(robots=st.lists(POLAR, min_size=1, max_size=7))
def test_the_gap_it_heads_for_is_the_widest_and_it_heads_for_its_middle(robots):
    # The middle of the widest gap is the direction farthest in angle from every robot.
    _, bearing = ended_at(gap, robots=around(robots))
    directions = np.arange(0, 2 * pi, 1e-3)
    offsets = [np.abs(np.remainder(directions - b + pi, 2 * pi) - pi) for b, _ in robots]
    best = np.min(offsets, axis=0).max()
    own = min(abs(remainder(bearing - b, 2 * pi)) for b, _ in robots)
    assert own == pytest.approx(best, abs=2e-3)


@pytest.mark.parametrize("robots", [2, 3, 4, 6])
def test_of_gaps_equally_wide_it_takes_the_first_by_bearing_whatever_rounding_says(robots):
    width = 2 * pi / robots
    for first in np.random.default_rng(robots).uniform(-pi, -pi + width, 200):
        ring = [(first + k * width, 3.0) for k in range(robots)]
        _, bearing = ended_at(gap, robots=around(ring))
        assert bearing == pytest.approx(first + width / 2)


@pytest.mark.parametrize("behaviour", [flee, gap])
def test_it_stands_before_it_has_seen_a_robot_and_runs_on_after_losing_sight(behaviour):
    memory, step = behaviour(None, view())
    assert step == (0.0, 0.0)
    memory, seen = behaviour(memory, view(robots=around([(0.7, 3.0)])))
    memory, after = behaviour(memory, view(tick=6))
    assert after == pytest.approx(seen)
    assert behaviour(memory, view(tick=7))[1] == pytest.approx(seen)


@pytest.mark.parametrize("behaviour", [flee, gap])
@SETTINGS
@given(
    bearing=BEARINGS,
    scan=st.lists(st.sampled_from([0.6, 1.2, 1.6, 6.0]), min_size=8, max_size=36),
)
def test_it_takes_the_least_turn_that_leads_to_free_rays(behaviour, bearing, scan):
    _, step = behaviour(None, view(robots=around([(bearing + pi, 5.0)]), scan=tuple(scan)))
    rays, spacing = len(scan), 2 * pi / len(scan)

    def free(ray):
        return all(scan[(ray + side) % rays] >= 1.5 for side in (-1, 0, 1))

    went = atan2(step[1], step[0])
    if turned(step, bearing) < 1e-9:
        # Straight on: its ray is free, or nothing within 120 degrees of it is.
        nearest = round(bearing / spacing)
        within = range(-(rays // 3), rays // 3 + 1)
        assert free(nearest) or not any(free(nearest + k) for k in within)
    else:
        ray = round(went / spacing)
        assert abs(remainder(went - ray * spacing, 2 * pi)) < 1e-9
        assert free(ray)
        better = [abs(remainder(k * spacing - bearing, 2 * pi)) for k in range(rays) if free(k)]
        # Turns are counted in whole rays from the one nearest to the wanted heading.
        assert turned(step, bearing) <= min(better) + spacing


def test_no_obstacle_near_means_no_turn_and_the_range_is_a_parameter():
    scan = (2.5,) * 24
    wanted = view(robots=around([(pi, 5.0)]), scan=scan)
    assert flee(None, wanted)[1] == pytest.approx((STEP, 0.0))
    blocked = (2.5,) * 3 + (6.0,) * 18 + (2.5,) * 3
    _, step = flee(None, wanted._replace(scan=blocked), obstacle_range_m=3.0)
    assert turned(step, 0.0) == pytest.approx(4 * 2 * pi / 24)


def test_straight_keeps_its_first_heading_whatever_happens():
    memory, step = straight(None, view(heading=0.8))
    assert step == pytest.approx((STEP * cos(0.8), STEP * sin(0.8)))
    assert straight(memory, view(heading=2.0, robots=around([(0.8, 2.0)])))[1] == step


def test_still_stays():
    assert still(None, view(robots=around([(0.8, 2.0)]))) == (None, (0.0, 0.0))


def test_patrol_visits_its_waypoints_in_order_round_and_round():
    waypoints = [(2.0, 0.0), (2.0, 1.5), (-1.0, 0.5)]
    memory, place, visited = None, (0.0, 0.0), []
    for tick in range(120):
        memory, (dx, dy) = patrol(memory, view(position=place, tick=tick), waypoints=waypoints)
        assert hypot(dx, dy) <= STEP + 1e-12
        place = (place[0] + dx, place[1] + dy)
        visited += [k for k, waypoint in enumerate(waypoints) if dist(place, waypoint) < 1e-9]
    order = [k for k, _ in groupby(visited)]
    assert order[:7] == [0, 1, 2, 0, 1, 2, 0]


@pytest.mark.parametrize("name", BUILT_IN)
def test_a_behaviour_does_not_change_what_it_is_given_and_repeats_itself(name):
    parameters = {"waypoints": ((1.0, 1.0), (3.0, 3.0))} if name == "patrol" else {}
    given_view = view(robots=around([(0.5, 2.0), (2.5, 3.0)]))
    copy = given_view._replace(robots=list(given_view.robots))
    first = BUILT_IN[name](None, given_view, **parameters)
    assert given_view == copy
    assert BUILT_IN[name](None, given_view, **parameters) == first


@pytest.mark.parametrize("name", BUILT_IN)
def test_the_built_in_behaviours_are_the_declared_entry_points(name):
    declared = {e.name: e for e in entry_points(group=TARGETS)}
    assert behaviour_named(name) is BUILT_IN[name] is declared[name].load()


@pytest.mark.parametrize("name", ["sulk", "", "Flee"])
def test_an_unknown_behaviour_is_refused_with_the_known_ones(name):
    with pytest.raises(ValueError, match="unknown target behaviour") as caught:
        behaviour_named(name)
    assert all(known in str(caught.value) for known in BUILT_IN)


@pytest.mark.parametrize(
    ("behaviour", "parameters", "said"),
    [
        (still, {"speed": 1}, "speed"),
        (flee, {"obstacle_range": 1.0}, "obstacle_range"),
        (patrol, {}, "waypoints"),
        (patrol, {"waypoints": [(0, 0)], "loop": True}, "loop"),
        (flee, {"view": None}, "view"),
    ],
)
def test_parameters_a_behaviour_does_not_have_or_lacks_are_refused(behaviour, parameters, said):
    with pytest.raises(ValueError, match=said):
        check_parameters(behaviour, parameters)


def test_parameters_a_behaviour_has_are_accepted():
    check_parameters(flee, {"obstacle_range_m": 2.0})
    check_parameters(patrol, {"waypoints": [(0.0, 0.0)]})


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """A package with a behaviour of its own, as an installer would leave it."""
    (tmp_path / "strangers_targets.py").write_text(
        "def circle(memory, view, *, turn_rad):\n"
        "    from math import cos, sin\n"
        "    heading = (memory or 0.0) + turn_rad\n"
        "    return heading, (0.1 * cos(heading), 0.1 * sin(heading))\n"
    )
    info = tmp_path / "strangers_targets-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: strangers-targets\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        "[encircle.targets]\nstrangers-circle = strangers_targets:circle\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    importlib.invalidate_caches()
    yield "strangers-circle"
    behaviour_named.cache_clear()


def test_a_behaviour_of_another_package_is_found_checked_and_run(installed):
    changes = [f"target.behaviour={installed}", "target.parameters.turn_rad=0.5"]
    hunted = arena(*changes, "target.step_m_max=1.0")
    state = initial(hunted)
    x = y = 0.0
    for tick in range(5):
        state, _ = advance(hunted, state, np.zeros((4, 2)), [b""] * 4)
        x, y = x + 0.1 * cos(0.5 * (tick + 1)), y + 0.1 * sin(0.5 * (tick + 1))
        np.testing.assert_allclose(state.positions[4], [x, y], atol=1e-5)
    with pytest.raises(ValueError, match="turn_rad"):
        small(f"target.behaviour={installed}")
    with pytest.raises(ValueError, match=installed):
        behaviour_named("no-such-behaviour")
