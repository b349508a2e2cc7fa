"""The omniscient planner: what it must reach, what nobody can, and that only the truth matters."""

from math import hypot

import pytest

from encircle.planner import omniscient
from encircle.planner.omniscient import LAWS, reach
from encircle.planner.table import rows
from encircle.studies.plan_files import load_plan
from encircle.world.loading.load import load

AROUND = [[6.0, 0.0], [-3.0, 5.0], [-3.0, -5.0]]


def scenario(ticks_max=120, **tables):
    return load({"ticks_max": ticks_max, **tables}, [])


def test_a_target_that_stands_is_reached_no_earlier_than_by_the_straight_way():
    hunt = scenario(team={"positions": AROUND}, target={"behaviour": "still"})
    reached = reach(hunt, 1)
    straight = max(hypot(*place) for place in AROUND) - 1.3
    assert reached.candidate == 0
    assert reached.capture_tick >= straight / 0.3
    assert reached.capture_tick <= 2.0 * straight / 0.3


def test_nobody_reaches_a_target_that_runs_away_straight_and_as_fast():
    behind = {"positions": [[-3.0, 0.0], [-4.0, 2.0], [-4.0, -2.0]]}
    hunt = scenario(50, team=behind, target={"behaviour": "straight", "step_m_max": 0.3})
    assert reach(hunt, 1, len(LAWS) + 4) == (None, None)


def test_only_the_truth_matters_and_the_same_is_reached_again():
    plain = {"robots": 4}
    fast = {"step_m_max": 0.36}
    wanted = reach(scenario(team=plain, target=fast), 3, 8)
    bad = scenario(
        team={**plain, "strategy": "pursuit"},
        target=fast,
        sensing={"noise_m_std": 0.5},
        channel={"loss": {"model": "bernoulli", "rate": 0.9}},
    )
    assert reach(bad, 3, 8) == wanted
    assert reach(scenario(team=plain, target=fast), 3, 8) == wanted


def test_more_candidates_reach_what_fewer_do(monkeypatch):
    hunt = scenario(team={"robots": 4}, target={"step_m_max": 0.39})
    few = [reach(hunt, seed, 2) for seed in range(1, 6)]
    more = [reach(hunt, seed, 9) for seed in range(1, 6)]
    for one, other in zip(few, more, strict=True):
        assert one.candidate is None or one == other
    assert sum(r.candidate is not None for r in more) > sum(r.candidate is not None for r in few)


def test_openings_are_each_robot_s_own_and_depend_on_seed_and_number():
    parameters = (omniscient.Parameters(),) * 5
    drawn = {omniscient._candidate(k, seed, parameters).openings for k in (6, 7) for seed in (1, 2)}
    assert len(drawn) == 4
    for openings in drawn:
        assert len(set(openings)) > 1
        for opening in openings:
            assert 0 <= opening.ticks < omniscient.OPENING_TICKS_MAX
            assert hypot(*opening.step) == pytest.approx(0.3) or opening.step == (0.0, 0.0)


def test_a_study_s_policies_and_radios_are_one_row_to_it():
    plan = load_plan("faster-target").model_copy(update={"seeds": (1,)})
    told = []
    table = rows(plan, 1, 1, told.append)
    assert [row.seeds for row in table] == [1] * (7 * 5)
    assert set(table[0].levels) == {"speed_ratio", "robots"}
    assert told[-1] == len(table)
