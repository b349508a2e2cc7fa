"""Runs read from a study's directory, and the published table."""

import json
import shutil
from contextlib import closing

import numpy as np
import pytest
from helpers_benchmark import CODE, filled_study

from encircle.benchmark import publish
from encircle.benchmark.outcomes import Outcomes
from encircle.benchmark.published import PUBLISHED, digest_of_runs, published, write_published
from encircle.benchmark.seeds import public_seeds
from encircle.benchmark.submission import write_table_page
from encircle.benchmark.tables import read_runs
from encircle.benchmark.tasks import POLICIES, submission_plan, tasks, tasks_digest
from encircle.runner.memory import run_in_memory
from encircle.studies.plan import StudyError
from encircle.studies.plan_files import load_plan
from encircle.studies.study_table import StudyTable
from encircle.world.arena.engine import build

BYTES_MAX = 300_000


def ticks_of(cell, seed):
    """A made capture tick; every third run has none."""
    return 0 if (cell + seed) % 3 == 0 else 1 + (7 * cell + seed) % 90


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """A directory with made runs of all policies on three public seeds, and its plan."""
    directory = tmp_path_factory.mktemp("study") / "s"
    plan = load_plan("benchmark", seeds="140001-140003")
    filled_study(directory, plan, ticks_of)
    return directory, plan


def test_runs_are_read_by_policy_task_and_seed(study):
    directory, plan = study
    runs = read_runs(directory)
    assert runs.outcomes.policies == plan.strategies
    assert runs.outcomes.tasks == tuple(task.name for task in tasks())
    assert runs.code == CODE["code"]
    for cell in range(0, len(plan.cells), 13):
        task, policy = plan.cells[cell]
        assert plan.levels(cell)["strategy"] == runs.outcomes.policies[policy]
        assert runs.outcomes.limit_ticks[task] == plan.scenario_of(cell).ticks_max
        for k, seed in enumerate(plan.seed_list):
            assert runs.outcomes.capture_ticks[policy, task, k] == ticks_of(cell, seed)
            assert runs.digests[policy, task, k] == f"{cell}-{seed}"


def test_a_failed_run_is_a_hunt_without_capture(tmp_path):
    plan = submission_plan("pursuit", "Joan", 1)
    filled_study(tmp_path / "s", plan, lambda _cell, _seed: 5, failed=[(3, plan.seed_list[0])])
    runs = read_runs(tmp_path / "s")
    assert runs.failed == 1
    assert np.argwhere(~runs.outcomes.captured).tolist() == [[0, 3, 0]]
    assert runs.outcomes.time_shares[0, 3, 0] == 1.0


def test_reading_writes_nothing(study):
    directory, _plan = study
    before = {path: path.stat().st_mtime_ns for path in directory.rglob("*")}
    read_runs(directory)
    assert {path: path.stat().st_mtime_ns for path in directory.rglob("*")} == before


def test_a_seed_without_all_its_runs_is_left_out(study, tmp_path):
    directory, plan = study
    copy = tmp_path / "copy"
    shutil.copytree(directory, copy)
    with closing(StudyTable(copy, load_plan("benchmark", seeds="140001-140004"), CODE)) as table:
        (row,) = table.read(cells=slice(0, 1)).to_pylist()[:1]
        table.append([{**row, "seed": 140_004}])
    assert read_runs(copy).outcomes.seeds == plan.seed_list


def test_seeds_that_a_later_call_has_added_count(study, tmp_path):
    """The plan beside the table stays that of the first call."""
    directory, plan = study
    copy = tmp_path / "copy"
    shutil.copytree(directory, copy)
    filled_study(copy, load_plan("benchmark", seeds="140004-140005"), ticks_of)
    assert read_runs(copy).outcomes.seeds == (*plan.seed_list, 140_004, 140_005)


@pytest.mark.parametrize(
    ("key", "value"), [("target.step_m_max", 0.01), ("ticks_max", 100_000), ("title", "mine")]
)
def test_runs_of_other_tasks_are_refused(study, tmp_path, key, value):
    directory, _plan = study
    copy = tmp_path / "copy"
    shutil.copytree(directory, copy)
    owner = json.loads((copy / "study.json").read_text())
    owner["plan"]["axes"][0]["arms"][0]["set"][key] = value
    (copy / "study.json").write_text(json.dumps(owner))
    with pytest.raises(StudyError, match="other tasks than benchmark 1"):
        read_runs(copy)


def test_runs_with_changes_beside_the_tasks_are_refused(tmp_path):
    plan = load_plan("benchmark", ["team.step_m_max=0.5"], "140001-140001")
    filled_study(tmp_path / "s", plan, ticks_of)
    with pytest.raises(StudyError, match="other tasks than benchmark 1"):
        read_runs(tmp_path / "s")


def test_a_directory_that_is_no_study_s_is_refused(tmp_path):
    with pytest.raises(StudyError, match="not a study's directory"):
        read_runs(tmp_path)


def test_what_is_published_is_read_back_the_same_and_written_the_same(study, tmp_path):
    directory, plan = study
    table = publish.from_study(directory, tmp_path / "a.csv.gz")
    again = published(tmp_path / "a.csv.gz")
    assert (again.outcomes.capture_ticks == table.outcomes.capture_ticks).all()
    assert (again.outcomes.limit_ticks == table.outcomes.limit_ticks).all()
    assert again.digests == table.digests
    assert again[2] == CODE["code"]
    cell = plan.cells.index((2, 1))
    by_hand = digest_of_runs([f"{cell}-{seed}" for seed in plan.seed_list])
    assert again.digests[plan.strategies[1], tasks()[2].name] == by_hand
    write_published(again, tmp_path / "b.csv.gz")
    assert (tmp_path / "a.csv.gz").read_bytes() == (tmp_path / "b.csv.gz").read_bytes()


def test_a_table_without_all_policies_is_not_published(tmp_path):
    plan = submission_plan("pursuit", "Joan", 1)
    filled_study(tmp_path / "s", plan, ticks_of)
    with pytest.raises(StudyError, match="policies without runs: auction"):
        publish.from_study(tmp_path / "s", tmp_path / "a.csv.gz")
    assert not (tmp_path / "a.csv.gz").exists()


def test_the_shipped_table_is_of_these_tasks_seeds_and_policies_and_small():
    outcomes = published().outcomes
    assert set(outcomes.policies) == set(POLICIES)
    assert outcomes.tasks == tuple(task.name for task in tasks())
    assert outcomes.seeds == public_seeds(len(outcomes.seeds))
    assert PUBLISHED.stat().st_size < BYTES_MAX
    assert (outcomes.capture_ticks <= outcomes.limit_ticks[:, None]).all()


def test_a_full_table_of_drawn_times_is_small_enough_to_ship(tmp_path):
    """Times that nothing compresses: uniform over 200 ticks, all captured."""
    rng = np.random.default_rng(0)
    shape = (len(POLICIES), len(tasks()), 100)
    outcomes = Outcomes(
        POLICIES,
        tuple(task.name for task in tasks()),
        public_seeds(),
        rng.integers(1, 201, shape),
        np.full(len(tasks()), 200),
    )
    digests = {(p, t): digest_of_runs([p, t]) for p in outcomes.policies for t in outcomes.tasks}
    write_published(publish.Published(outcomes, digests, "c0de"), tmp_path / "full.csv.gz")
    assert (tmp_path / "full.csv.gz").stat().st_size < BYTES_MAX


def test_a_table_of_other_tasks_is_refused(tmp_path, monkeypatch):
    write_published(published(), tmp_path / "t.csv.gz")
    monkeypatch.setattr("encircle.benchmark.published.tasks_digest", lambda: "0123")
    with pytest.raises(ValueError, match=f"tasks {tasks_digest()}, not of 1 and 0123"):
        published(tmp_path / "t.csv.gz")


def test_the_page_has_the_published_table():
    text = publish.PAGE.read_text(encoding="utf-8")
    assert publish.current(text) == text


def test_a_study_s_directory_gets_the_page_of_all_policies(study, tmp_path):
    directory = tmp_path / "copy"
    shutil.copytree(study[0], directory)
    answer = write_table_page(directory)
    plan = study[1]
    by_hand = {
        policy: np.mean(
            [
                ticks_of(cell, seed) > 0
                for cell in range(first, len(plan.cells), len(plan.strategies))
                for seed in plan.seed_list
            ]
        )
        for first, policy in enumerate(plan.strategies)
    }
    shown = {score["policy"]: score["score"] for score in answer["scores"]}
    assert shown == pytest.approx(by_hand)
    text = (directory / "benchmark.html").read_text(encoding="utf-8")
    assert "encircle study benchmark --seeds 140001-140003" in text


def test_a_study_on_other_seeds_gets_no_page(tmp_path):
    plan = load_plan("benchmark", seeds="1-1")
    filled_study(tmp_path / "s", plan, ticks_of)
    with pytest.raises(StudyError, match="no runs on the public seeds"):
        write_table_page(tmp_path / "s")


@pytest.mark.nightly
@pytest.mark.parametrize("policy", POLICIES)
def test_the_published_runs_come_out_the_same_again(policy):
    """Of each policy the runs of one task, another for each, by their digest."""
    table = published()
    place = POLICIES.index(policy)
    task = tasks()[2 * place + 1].name
    plan = load_plan("benchmark")
    cell = tasks_index(task) * len(plan.strategies) + plan.strategies.index(policy)
    results = [
        run_in_memory(build(plan.scenario_of(cell), seed), "study", print)
        for seed in table.outcomes.seeds
    ]
    assert digest_of_runs([r.digest for r in results]) == table.digests[policy, task]


def tasks_index(name):
    """Where a task stands."""
    return [task.name for task in tasks()].index(name)
