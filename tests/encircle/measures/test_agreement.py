"""Agreement on logs made by hand, and against its definition written out tick by tick."""

from dataclasses import replace
from math import hypot, isnan, nan, pi, sin

import numpy as np
import pytest
from helpers_measures import RING_M, SQUARE, scenario, standing
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.measures.agreement import AGREED_TICKS
from encircle.measures.registry import SHIPPED, measure

CHEAP = settings(max_examples=150, deadline=None, derandomize=True)
NAMES = SHIPPED["agreement"]
TICKS = 20


def found(log):
    return dict(zip(NAMES, measure(log, NAMES).values(), strict=True))


def test_robots_that_agree_from_the_start_need_nothing_for_it():
    assert found(standing(TICKS)) == dict(zip(NAMES, (1, 0, 0, 0, 0, 0, 0), strict=True))


def test_what_is_sent_from_the_first_point_to_the_tick_before_the_agreement_counts():
    goals, points = standing(TICKS).goals, standing(TICKS).points
    points[:3] = -1  # nobody knows the target
    points[3, 1:] = -1  # r1 finds it first
    goals[4:9, 0] = goals[4:9, 1]  # two hold one point, then r1 goes elsewhere
    sizes = np.full((TICKS, 4), 100)
    sizes[5, 2] = 0  # one is silent once
    parts = np.zeros((TICKS, 4, 3), np.int64)
    parts[:, :, 0], parts[:, :, 1] = 7, 30
    parts[5, 2] = 0
    log = standing(TICKS, goals=goals, points=points, sizes_bytes=sizes, parts_bytes=parts)
    assert found(log) == {
        "agreed": 1.0,
        "agreement_tick": 9.0,
        "agreement_s": pytest.approx(0.9),
        "negotiation_ticks": 6.0,
        "negotiation_messages": 6 * 4 - 1,
        "negotiation_bytes": 100 * (6 * 4 - 1),
        "negotiation_payload_bytes": 7 * (6 * 4 - 1),
    }


def test_two_that_change_places_again_and_again_do_not_agree_until_they_stop():
    goals = standing(TICKS).goals
    goals[2:13:2, [0, 1]] = goals[2:13:2, [1, 0]]
    log = standing(TICKS, goals=goals)
    assert found(log)["agreement_tick"] == 13.0
    # After the last change they may change again once five ticks have passed in peace.
    goals[13 + AGREED_TICKS :, [0, 1]] = goals[13 + AGREED_TICKS :, [1, 0]]
    assert found(standing(TICKS, goals=goals))["agreement_tick"] == 13.0
    goals[12 + AGREED_TICKS, [0, 1]] = goals[12 + AGREED_TICKS, [1, 0]]
    assert found(standing(TICKS, goals=goals))["agreement_tick"] == 12.0 + AGREED_TICKS


def test_closing_in_and_the_end_of_the_run_disturb_no_agreement():
    points = standing(TICKS).points
    points[:7, 3] = -1
    points[8:] = -1
    assert found(standing(TICKS, points=points))["agreement_tick"] == 7.0
    points[7:, 3] = -1
    assert found(standing(TICKS, points=points))["agreed"] == 0.0
    goals = standing(TICKS).goals
    goals[: TICKS - 1, 0] = goals[: TICKS - 1, 1]
    assert found(standing(TICKS, goals=goals))["agreement_tick"] == TICKS - 1


def test_without_an_agreement_there_is_no_time_of_it():
    goals = np.broadcast_to(SQUARE[0], (TICKS, 4, 2))
    never = found(standing(TICKS, goals=goals))
    assert never.pop("agreed") == 0.0
    assert all(isnan(value) for value in never.values())


def test_who_names_no_points_has_nothing_to_agree_about():
    alone = standing(TICKS, 1)
    one_of_four = standing(TICKS, points=np.array([0, -1, -1, -1]))
    for log in (standing(TICKS, points=-1), alone, one_of_four, standing(0)):
        assert all(isnan(value) for value in found(log).values())


def test_a_robot_that_is_lost_is_not_waited_for():
    there, points = np.full((TICKS, 4), True), standing(TICKS).points
    there[:, 2], points[:, 2] = False, -1
    assert found(standing(TICKS, there=there, points=points))["agreement_tick"] == 0.0
    assert found(standing(TICKS, points=points))["agreed"] == 0.0


def test_time_is_that_of_ticks():
    goals = standing(TICKS).goals
    goals[:8, 0] = goals[:8, 1]
    log = replace(standing(TICKS, goals=goals), scenario=scenario(4, tick_s=0.25))
    assert found(log)["agreement_s"] == pytest.approx(2.0)


def by_definition(log):
    """The first tick of agreement, as docs/measures.md says it, without the code's arrays."""
    apart_m, far_m = 2.0 * 0.5, RING_M * sin(pi / log.count)

    def holds(tick, robot):
        return log.points[tick, robot] >= 0

    def shared(tick):
        held = [log.goals[tick, k] for k in range(log.count) if holds(tick, k)]
        return any(
            hypot(*(one - other)) < apart_m for i, one in enumerate(held) for other in held[:i]
        )

    def switches(tick):
        both = [k for k in range(log.count) if holds(tick, k) and holds(tick - 1, k)]
        return any(hypot(*(log.goals[tick, k] - log.goals[tick - 1, k])) > far_m for k in both)

    for tick in range(log.ticks):
        after = range(tick + 1, min(tick + 5, log.ticks))
        if not all(holds(tick, k) for k in range(log.count)) or shared(tick):
            continue
        if not any(shared(later) or switches(later) for later in after):
            return tick
    return nan


@CHEAP
@given(st.integers(2, 4), st.integers(1, 14), st.integers(0, 2**32 - 1))
def test_the_first_agreement_is_that_of_the_definition(robots, ticks, seed):
    rng = np.random.default_rng(seed)
    plain = standing(ticks, robots)
    points = np.where(rng.random((ticks, robots)) < 0.1, -1, plain.points)
    goals = plain.goals
    for tick in range(ticks):
        if rng.random() < 0.5:
            goals[tick] = goals[tick, rng.permutation(robots)]
        if rng.random() < 0.3:
            goals[tick, 0] = goals[tick, 1]
        if tick and rng.random() < 0.6:
            goals[tick] = goals[tick - 1]
    log = standing(ticks, robots, points=points, goals=goals)
    assert measure(log, ["agreement_tick"])["agreement_tick"] == pytest.approx(
        by_definition(log), nan_ok=True
    )
