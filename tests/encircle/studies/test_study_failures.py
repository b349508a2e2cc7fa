"""Failed runs of a study: the others go on; failed ones are reported, counted and repeated."""

import json
import re
import shutil
import sys
from contextlib import closing
from pathlib import Path

import helpers_plugins as plugins
import numpy as np
import pytest
from helpers_waiting import completed

import encircle
from encircle.studies.report.report import write_report
from encircle.studies.summary import summarise

SOURCE = '''
import os
from encircle import Decision


def moody(memory, view):
    """Fails with some starts and not with others, unless a file says otherwise."""
    x, y = view.positions[view.own]
    cheerful = os.path.exists(os.environ.get("CHEERFUL", ""))
    if view.robot == "r1" and int(abs(x) * 1e4) % 10 == 0 and not cheerful:
        raise ValueError("not in the mood")
    goal = view.target.position if view.target else (x, y)
    return memory, Decision("moody", (goal[0] - x, goal[1] - y), goal)


def never(memory, view):
    raise ValueError("never")


def interrupts(memory, view):
    raise KeyboardInterrupt
'''


@pytest.fixture(autouse=True)
def forked_workers():
    """The policy's mood stands in the environment, which only fresh interpreters take over."""


@pytest.fixture(autouse=True, scope="module")
def installed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("plugins")
    entries = ["strategies moody = moods:moody", "strategies never = moods:never"]
    entries += ["strategies interrupts = moods:interrupts"]
    plugins.put_there(folder, {"moods.py": SOURCE}, entries)
    with pytest.MonkeyPatch.context() as monkeypatch:
        plugins.make_importable(folder, monkeypatch)
        monkeypatch.setenv("CHEERFUL", str(folder / "cheerful"))
        yield folder
    plugins.forget(folder)


def tree(*strategies, seeds=8):
    return {
        "name": "moods",
        "scenario": "sim1",
        "seeds": seeds,
        "strategies": ["pursuit", *strategies],
        "set": {"ticks_max": 4, "team.jitter_m": 0.25},
        "measures": ["captured", "path_m_mean"],
    }


def failing(frame):
    return {(row.strategy, row.seed) for row in frame.itertuples() if row.failed}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    study_run = encircle.study(tree("moody"), tmp_path_factory.mktemp("made") / "t")
    assert study_run.run(workers=2) == 16
    return study_run


@pytest.fixture
def study(made, tmp_path):
    """A study in a directory of its own for every test."""
    shutil.copytree(made.directory, tmp_path / "t")
    return encircle.study(tree("moody"), tmp_path / "t")


def table_of(study):
    with closing(study.open()) as table:
        return table.read().to_pandas(), table.failed.copy(), table.complete_seeds


def test_the_others_go_on_and_the_failed_ones_stand_as_failed(study):
    frame, failed, whole = table_of(study)
    assert len(frame) == 16
    bad = frame[frame.failed != ""]
    assert 0 < len(bad) < 8
    assert set(bad.strategy) == {"moody"}
    assert failed.sum() == len(bad)
    assert set(whole) == set(range(1, 9)) - set(bad.seed)
    assert bad.captured.isna().all()
    assert bad.path_m_mean.isna().all()
    assert not frame[frame.failed == ""].captured.isna().any()
    for row in bad.itertuples():
        assert re.match(
            r"policy 'moody' \(moods:moody of strangers 1\.0\) failed in robot r1 at tick \d:"
            r" ValueError: not in the mood; traceback in ",
            row.failed,
        )
        text = Path(row.failed.split("; traceback in ")[1]).read_text()
        assert "moods.py" in text


def test_the_same_call_tries_failed_runs_again_and_only_those(study, installed):
    before, failed, _ = table_of(study)
    assert study.run(workers=1) == failed.sum()
    again, failed_again, _ = table_of(study)
    assert failing(again) == failing(before)
    assert len(again) == 16
    (installed / "cheerful").write_text("")
    assert study.run(workers=1) == failed_again.sum()
    after, none, _ = table_of(study)
    assert not none.any()
    assert failing(after) == set()
    good = before.failed == ""
    assert after[good].equals(before[good])
    assert study.run(workers=1) == 0
    (installed / "cheerful").unlink()


def test_over_zenoh_the_same_runs_fail_with_the_same_words(study, tmp_path):
    over = encircle.study(tree("moody", seeds=4), tmp_path / "z")
    over.run(link="zenoh")
    frame, _, _ = table_of(over)
    memory, _, _ = table_of(study)
    memory = memory[memory.seed <= 4].reset_index(drop=True)
    assert failing(frame)
    apart = ["wall_s", "failed"]
    assert frame.drop(columns=apart).equals(memory.drop(columns=apart))
    failures = [[f.split("; traceback")[0] for f in one.failed] for one in (frame, memory)]
    assert failures[0] == failures[1]


def test_statistics_are_of_the_seeds_that_failed_nowhere(study, tmp_path):
    frame, _, whole = table_of(study)
    with closing(study.open()) as table:
        summary = summarise(study.plan, table)
        page = write_report(study.plan, table, study.directory, "again", summary=summary)
        page = page.read_text()
    complete = frame[frame.seed.isin(whole)]
    for cell in summary.cells:
        rows = complete[complete.cell == cell.cell]
        assert cell.runs == len(whole) == len(rows)
        assert cell.means["path_m_mean"].value == pytest.approx(rows.path_m_mean.mean())
    assert summary.captured.shape == (2, len(whole))
    assert not np.isnan(summary.ticks).any()
    count = len(frame) - (frame.failed == "").sum()
    assert f"{count} of 16 runs failed." in page
    assert "not in the mood" in page
    assert "Failed runs" in page


def test_from_python_a_warning_counts_them(study):
    with pytest.warns(RuntimeWarning, match=r"of 16 runs failed: see the column 'failed'"):
        frame = study.table()
    assert failing(frame)


def started(tmp_path, *failures, **study):
    text = json.dumps(study)
    path = tmp_path / "moods.toml"
    axes = "".join(f"{key} = {json.dumps(study[key])}\n" for key in study if key != "set")
    sets = "".join(f'"{key}" = {json.dumps(value)}\n' for key, value in study["set"].items())
    assert text
    path.write_text(f"{axes}[set]\n{sets}")
    command = [sys.executable, "-m", "encircle", "study", str(path), "--out", str(tmp_path / "t")]
    return completed([*command, *failures])


def test_the_command_says_how_many_failed_and_ends_with_status_1(tmp_path):
    done = started(tmp_path, **tree("moody"))
    assert done.returncode == 1
    last = done.stderr.splitlines()[-1]
    assert re.match(r"encircle: \d of 16 runs failed\. The .* left out of every cell", last)
    assert "The first, at strategy moody, seed " in last
    assert "ValueError: not in the mood; traceback in " in last
    assert "Traceback" not in done.stderr
    assert "report " in done.stdout


def test_a_study_all_of_whose_runs_fail_in_one_arm_has_a_report_of_that(tmp_path):
    done = started(tmp_path, "--json", **tree("never", seeds=2))
    assert done.returncode == 1
    answer = json.loads(done.stdout)
    assert answer["failed"] == 2
    assert answer["findings"] == []
    page = Path(answer["report"]).read_text()
    assert "2 of 4 runs failed, at least one with every seed: there is nothing to compare." in page
    assert "ValueError: never" in page


def test_a_team_that_cannot_be_placed_with_a_seed_is_a_failed_run(tmp_path):
    crowded = {
        "scenario": {
            "ticks_max": 2,
            "team": {
                "robots": 60,
                "placement": {"distance_m_min": 3.0, "distance_m_max": 4.0},
            },
        },
        "seeds": 1,
        "measures": ["captured"],
    }
    study = encircle.study(crowded, tmp_path / "t")
    assert study.run(workers=1) == 1
    frame, failed, _ = table_of(study)
    assert failed.all()
    assert "ScenarioError" in frame.failed[0]


def test_a_policy_that_raises_what_ctrl_c_raises_has_failed_like_any_other(tmp_path):
    study_run = encircle.study(tree("interrupts", seeds=2), tmp_path / "t")
    assert study_run.run(workers=1) == 4
    with pytest.warns(RuntimeWarning, match="2 of 4 runs failed"):
        table = study_run.table()
    assert failing(table) == {("interrupts", 1), ("interrupts", 2)}
