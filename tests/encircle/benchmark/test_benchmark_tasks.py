"""The benchmark's tasks: pinned, balanced, and each what its name says."""

from collections import Counter

import pytest

from encircle.benchmark.tasks import (
    POLICIES,
    VERSION,
    benchmark_tree,
    submission_plan,
    task_named,
    tasks,
    tasks_digest,
)
from encircle.studies.plan import StudyError
from encircle.studies.plan_files import load_plan

CHANNELS = {"perfect", "loss", "bursts", "rayleigh", "delay", "range", "partition"}
SCENES = {"sim1", "sim2", "sim3", "sim4", "sim5", "fast", "gap", "patrol", "many"}
PLAN = load_plan("benchmark")


def scenario(task):
    """The scenario of a task."""
    return PLAN.scenario_of(PLAN.axes[0].levels.index(task.name) * len(PLAN.strategies))


def test_the_tasks_of_version_1_never_change():
    # If this fails, scores can no longer be compared: raise VERSION, and publish a new table.
    assert (VERSION, tasks_digest()) == (1, "70f883953d6ca429")


def test_a_study_s_own_record_has_the_same_digest():
    assert tasks_digest(PLAN.model_dump(mode="json")) == tasks_digest()


def test_a_changed_task_has_another_digest():
    tree = benchmark_tree()
    tree["axes"][0]["arms"][3]["set"]["target.step_m_max"] += 0.001
    assert tasks_digest(tree) != tasks_digest()


def test_every_scene_channel_and_number_of_robots_has_several_tasks():
    for of, values, least in (
        ([task.scene for task in tasks()], SCENES, 2),
        ([task.channel for task in tasks()], CHANNELS, 3),
        ([task.robots for task in tasks()], set(range(3, 9)), 3),
    ):
        counts = Counter(of)
        assert set(counts) == values
        assert min(counts.values()) >= least


def test_all_shipped_policies_have_a_row():
    assert set(PLAN.strategies) == set(POLICIES)


@pytest.mark.parametrize("task", tasks(), ids=lambda task: task.name)
def test_a_task_has_the_robots_that_its_name_says(task):
    assert len(scenario(task).ids) == task.robots


def test_tasks_of_one_channel_have_the_same_channel():
    for name in CHANNELS:
        channels = [scenario(task).channel for task in tasks() if task.channel == name]
        assert all(channel == channels[0] for channel in channels)
    lost = [s for s in map(scenario, tasks()) if s.channel.loss.model == "bernoulli"]
    assert {s.channel.loss.rate for s in lost} == {0.6}
    late = [scenario(task) for task in tasks() if task.channel == "delay"]
    assert {s.channel.delay.mean_s for s in late} == {1.0}


def test_partitions_divide_the_whole_team_and_heal():
    for task in tasks():
        kinds = {event.kind: event for event in scenario(task).events}
        assert ("partition" in kinds) == ("heal" in kinds) == (task.channel == "partition")
        if task.channel == "partition":
            groups = [robot for group in kinds["partition"].groups for robot in group]
            assert sorted(groups) == sorted(scenario(task).ids)
            assert kinds["partition"].tick < kinds["heal"].tick < scenario(task).ticks_max


def test_tasks_of_one_scene_differ_in_speed_limit_team_and_channel_alone():
    free = {"ticks_max", "target.step_m_max", "team.robots", "team.positions", "channel.loss"}
    free |= {"channel.delay", "events"}
    arms = benchmark_tree()["axes"][0]["arms"]
    for scene in SCENES:
        sets = [arm["set"] for arm in arms if task_named(arm["name"]).scene == scene]
        fixed = [{k: v for k, v in given.items() if k not in free} for given in sets]
        assert all(one == fixed[0] for one in fixed)


def test_a_submission_has_all_tasks_and_both_kinds_of_seeds():
    plan = submission_plan("pursuit", "Joan", 3)
    assert plan.strategies == ("pursuit",)
    assert len(plan.cells) == len(tasks())
    assert len(plan.seed_list) == 6
    assert tasks_digest(plan.model_dump(mode="json")) == tasks_digest()


def test_a_submission_may_set_parameters_of_its_own_and_nothing_else():
    plan = submission_plan("auction", "Joan", 1, ["rebid_ticks=9"])
    assert plan.scenario_of(0).policy_parameters_of("r1")["rebid_ticks"] == 9
    with pytest.raises(StudyError, match="rebid_tick"):
        submission_plan("auction", "Joan", 1, ["rebid_tick=9"])
    with pytest.raises(StudyError, match="no-such-policy"):
        submission_plan("no-such-policy", "Joan", 1)
