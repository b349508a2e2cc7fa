"""Measures of each robot: by hand, and as parts of the team's measures."""

import json
from math import isnan, nan

import numpy as np
import pytest
from helpers_measures import SQUARE, random_log, scenario, standing
from helpers_plugins import forget, make_importable, put_there
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.measures.breakdown import breakdown, breakdown_rows
from encircle.measures.registry import ROBOT_MEASURES, measure, measure_named
from encircle.protocol.plugins import PluginFailed
from encircle.studies.plan import StudyError
from encircle.studies.plan_files import load_plan
from encircle.studies.running import run_seed
from encircle.studies.tasks import Task
from encircle.world.loading.load import load

CHEAP = settings(max_examples=80, deadline=None, derandomize=True)
TICKS = 10
MODULE = """
from encircle.measures.common import in_unit, of_each_robot


@of_each_robot
@in_unit("m")
def start_m(log):
    \"\"\"Distance of the robot's start from the origin.\"\"\"
    return (log.robots[0] ** 2).sum(axis=1) ** 0.5


@of_each_robot
def too_few(log):
    return [1.0]
"""


def each(log, name):
    """A measure of every robot of the log."""
    return list(measure(log, [f"{name}/{robot}" for robot in log.scenario.ids]).values())


def test_each_measure_says_what_it_is():
    for name in ROBOT_MEASURES:
        shown = measure_named(f"{name}/r2")
        assert shown.name == f"{name}/r2"
        assert shown.description.endswith(".")
        assert ROBOT_MEASURES[name].of_each_robot


def test_way_effort_and_what_was_sent_by_hand():
    positions = standing(TICKS).positions
    positions[3:, 1] += (3.0, 4.0)
    steps, sizes = np.zeros((TICKS, 4, 2)), np.full((TICKS, 4), 100)
    steps[:, 2] = (0.3, 0.4)
    sizes[5:, 3] = 0
    parts = np.zeros((TICKS, 4, 3), np.int64)
    parts[:, 1] = (1, 2, 3)
    log = standing(TICKS, positions=positions, steps=steps, sizes_bytes=sizes, parts_bytes=parts)
    assert each(log, "path_m") == [0.0, 5.0, 0.0, 0.0]
    assert each(log, "effort_m2ps") == pytest.approx([0.0, 0.0, 0.25 * TICKS / 0.1, 0.0])
    assert each(log, "messages_sent") == [TICKS, TICKS, TICKS, 5.0]
    assert each(log, "sent_bytes") == [1000.0, 1000.0, 1000.0, 500.0]
    for part, factor in (("payload", 1), ("relayed", 2), ("estimate", 3)):
        assert each(log, f"sent_bytes_{part}") == [0.0, factor * TICKS, 0.0, 0.0]


def test_modes_are_shares_of_the_run():
    modes = np.full((TICKS, 4), "encircle", dtype="<U8")
    modes[6:, 0], modes[:3, 1], modes[:, 2], modes[9:, 3] = "shrink", "search", "pursue", "lost"
    log = standing(TICKS, modes=modes)
    assert each(log, "encircle_share") == pytest.approx([0.6, 0.7, 0.0, 0.9])
    assert each(log, "shrink_share") == pytest.approx([0.4, 0.0, 0.0, 0.0])
    assert each(log, "search_share") == pytest.approx([0.0, 0.3, 0.0, 0.0])
    assert each(log, "pursue_share") == pytest.approx([0.0, 0.0, 1.0, 0.0])
    assert each(log, "lost_share") == pytest.approx([0.0, 0.0, 0.0, 0.1])
    assert [robot["modes"] for robot in breakdown(log)] == [
        {"encircle": 0.6, "shrink": 0.4},
        {"encircle": 0.7, "search": 0.3},
        {"pursue": 1.0},
        {"encircle": 0.9, "lost": 0.1},
    ]


def test_a_link_belongs_to_its_sender_or_to_its_receiver():
    due = standing(TICKS).due
    due[:, 0, 1:] = -1  # nobody hears r1
    due[:, 3, 2] = -1  # r3 does not hear r4 either
    log = standing(TICKS, due=due)
    assert each(log, "delivery_ratio") == pytest.approx([0.0, 1.0, 1.0, 2 / 3])
    assert each(log, "received_share") == pytest.approx([1.0, 2 / 3, 1 / 3, 2 / 3])
    dead = (TICKS + 1) / 2  # of a link over which nothing comes, 1 to T
    expected = [1.0, (dead + 2) / 3, (2 * dead + 1) / 3, (dead + 2) / 3]
    assert each(log, "age_ticks_mean") == pytest.approx(expected)


def test_a_belief_is_of_the_robot_that_has_it():
    believed, estimates = standing(TICKS).believed, standing(TICKS).estimates
    believed[:, 0, 1] += (0.0, 0.9)
    believed[:, 1, 2:] = nan
    estimates[:, 2, 0], estimates[:4, 3] = 2.0, nan
    log = standing(TICKS, believed=believed, estimates=estimates)
    assert each(log, "peer_error_m_mean") == pytest.approx([0.3, 0.0, 0.0, 0.0])
    assert each(log, "target_error_m_rms") == pytest.approx([0.0, 0.0, 2.0, 0.0])
    assert each(log, "estimate_missing_share") == pytest.approx([0.0, 0.0, 0.0, 0.4])


def test_conflicts_and_switches_are_of_those_who_have_them():
    goals, points = standing(TICKS).goals, standing(TICKS).points
    goals[:5, 0] = SQUARE[1]
    points[5:, 1], points[:, 3] = -1, -1
    log = standing(TICKS, goals=goals, points=points)
    assert each(log, "conflict_share") == pytest.approx([0.5, 1.0, 0.0, nan], nan_ok=True)
    assert each(log, "switches") == [1.0, 0.0, 0.0, 0.0]


@CHEAP
@given(st.integers(0, 9), st.integers(1, 5), st.integers(0, 2**32 - 1))
def test_robots_add_up_to_the_team(ticks, robots, seed):
    log = random_log(ticks, robots, seed)
    team = measure(log)
    for name, of_team in (
        ("path_m", "path_m_total"),
        ("messages_sent", "messages_sent"),
        ("sent_bytes", "sent_bytes"),
        ("sent_bytes_payload", "sent_bytes_payload"),
        ("switches", "switches"),
    ):
        assert sum(each(log, name)) == pytest.approx(team[of_team]), name
    assert np.mean(each(log, "effort_m2ps")) == pytest.approx(team["effort_m2ps_mean"])
    # Everyone takes part in every round, so that means over links are means of means.
    for name in ("age_ticks_mean", "estimate_missing_share"):
        assert np.mean(each(log, name)) == pytest.approx(team[name], nan_ok=True), name
    squares = np.square(each(log, "target_error_m_rms"))
    known = 1.0 - np.array(each(log, "estimate_missing_share"))
    if np.nansum(known) > 0:
        total = np.nansum(squares * known) / np.nansum(known)
        assert np.sqrt(total) == pytest.approx(team["target_error_m_rms"])
    if team["delivery_ratio"] == 0.0 or isnan(team["delivery_ratio"]):
        assert np.nansum(each(log, "received_share")) == 0.0
    json.dumps(breakdown(log), allow_nan=False)


def test_the_breakdown_has_all_of_each_robot_and_its_table_a_column_for_each():
    log = standing(TICKS, points=-1)
    robots = breakdown(log)
    assert [robot["robot"] for robot in robots] == ["r1", "r2", "r3", "r4"]
    assert all(set(ROBOT_MEASURES) < set(robot) for robot in robots)
    assert robots[0]["policy"] == "xi-star"
    assert robots[0]["conflict_share"] is None
    team = {"count": 4, "r2": {"strategy": "pursuit"}}
    mixed = breakdown(standing(TICKS, scenario=scenario(team={"robots": team})))
    assert [robot["policy"] for robot in mixed] == ["xi-star", "pursuit", "xi-star", "xi-star"]
    rows = {name: values for name, _, *values in breakdown_rows(robots)}
    assert rows["policy"] == ["xi-star"] * 4
    assert rows["ticks in encircle"] == ["1"] * 4
    assert rows["conflict_share"] == ["-"] * 4
    assert rows["sent_bytes"] == ["1000"] * 4


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("path_m", "is of each robot: name one, such as path_m/r1"),
        ("path_n/r1", "unknown measure of each robot (did you mean 'path_m'?); known are: path_m,"),
        ("captured/r1", "unknown measure of each robot; known are: path_m, "),
        ("path_m/1", "unknown measure"),
        ("path_m/r0", "unknown measure"),
    ],
)
def test_a_name_that_is_of_no_robot_is_refused(name, reason):
    with pytest.raises(ValueError, match="measure") as caught:
        measure(standing(1), [name])
    assert str(caught.value).startswith(f"measure '{name}': {reason}")
    with pytest.raises(StudyError) as caught:
        load_plan({"scenario": "sim1", "measures": [name]})
    assert f"measures: '{name}': {reason}" in str(caught.value)


def test_a_study_has_columns_of_robots_and_nan_where_a_team_is_too_small():
    axis = {"name": "robots", "key": "team.robots", "values": [3, 4]}
    base = {"ticks_max": 3, "team": {"robots": 3}}
    names = ["path_m/r3", "path_m/r4"]
    plan = load_plan({"scenario": base, "axes": [axis], "measures": names})
    assert plan.plugins == ()
    rows = [
        run_seed(Task(cell, {}, "", (1,), plan.measure_names), plan.scenario_of(cell), 1, ("", ""))
        for cell in range(2)
    ]
    assert [row["failed"] for row in rows] == ["", ""]
    assert rows[0]["path_m/r3"] > 0.0
    assert isnan(rows[0]["path_m/r4"])
    assert rows[1]["path_m/r4"] > 0.0
    with pytest.raises(StudyError, match=r"measures: 'path_m/r5': no cell has a robot r5"):
        load_plan({"scenario": base, "axes": [axis], "measures": ["path_m/r5"]})


def test_a_measure_of_each_robot_of_another_package(tmp_path, monkeypatch):
    entries = [f"measures {name} = lengths:{name}" for name in ("start_m", "too_few")]
    make_importable(put_there(tmp_path, {"lengths.py": MODULE}, entries), monkeypatch)
    log = standing(2)
    assert measure(log, ["start_m/r2"]) == {"start_m/r2": pytest.approx(4.0)}
    assert isnan(measure(log, ["start_m/r9"])["start_m/r9"])
    assert measure_named("start_m/r2").unit == "m"
    with pytest.raises(ValueError, match=r"'start_m': is of each robot: name one, such as"):
        measure(log, ["start_m"])
    with pytest.raises(PluginFailed, match=r"'too_few' \(.*answered \[1.0\]: must be 4 numbers"):
        measure(log, ["too_few/r1"])
    plan = load_plan({"scenario": "sim1", "measures": ["start_m/r1"]})
    assert plan.plugins == (("encircle.measures", "start_m"),)
    row = run_seed(
        Task(0, {}, "", (1,), ("start_m/r1",)), load("sim1", ["ticks_max=2"]), 1, ("", "")
    )
    assert row["start_m/r1"] > 0.0
    measure_named.cache_clear()
    forget(tmp_path)
