"""``encircle benchmark``: a policy in a file, from the command to page, bundle and score again."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers_benchmark import filled_study
from helpers_pages import Page

from encircle.benchmark.command import SEEDS_MAX
from encircle.benchmark.published import published
from encircle.benchmark.seeds import SEEDS, held_out_seeds
from encircle.benchmark.submission import Request, split_seeds, write_submission_page
from encircle.benchmark.tables import read_runs
from encircle.benchmark.tasks import submission_plan, tasks
from encircle.cli.main import main
from encircle.studies.plan import StudyError
from encircle.studies.plan_files import load_plan

POLICY = """
from encircle.agents.policies.closed_ring import closed_ring


def mine(memory, view):
    return closed_ring(memory, view)
"""


@pytest.fixture(scope="module")
def submitted(tmp_path_factory):
    """A directory with a policy's file, and what the command made of it with one seed of each."""
    folder = tmp_path_factory.mktemp("reader")
    (folder / "my_robots.py").write_text(POLICY)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        arguments = ["benchmark", "my_robots.py:mine", "--name", "Joan's  ring", "--seeds", "1"]
        assert main([*arguments, "--workers", "1"]) == 0
    return folder, folder / "runs" / "benchmark-joan-s-ring"


def test_the_command_leaves_a_page_a_table_and_a_bundle(submitted):
    folder, directory = submitted
    text = (directory / "benchmark.html").read_text(encoding="utf-8")
    assert "Encircle benchmark 1: Joan" in text
    assert (directory / "benchmark-1.zip").is_file()
    assert {path.name for path in folder.iterdir()} <= {"my_robots.py", "runs", "__pycache__"}


def test_a_policy_that_decides_as_a_shipped_one_has_the_runs_that_are_published(submitted):
    runs = read_runs(submitted[1])
    public, held_out = split_seeds(runs)
    table = published().outcomes
    shipped = table.with_seeds(public.seeds).capture_ticks[table.policies.index("closed-ring")]
    assert (public.capture_ticks[0] == shipped).all()
    assert held_out.seeds == held_out_seeds(1, "Joan's ring", 1)
    assert not (held_out.capture_ticks == public.capture_ticks).all()


def test_a_bundle_scores_as_its_submission(submitted, tmp_path, capsys):
    _folder, directory = submitted
    bundle = str(directory / "benchmark-1.zip")
    assert main(["benchmark", bundle, "--out", str(tmp_path / "o"), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["name"] == "Joan's ring"
    outcomes = split_seeds(read_runs(directory))[0]
    assert answer["score"]["score"] == pytest.approx(outcomes.captured.mean())
    assert Path(answer["page"]).is_file()


def test_the_same_command_runs_nothing_twice(submitted, monkeypatch, capsys):
    monkeypatch.chdir(submitted[0])
    arguments = ["benchmark", "my_robots.py:mine", "--name", "Joan's ring", "--seeds", "1"]
    assert main([*arguments, "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert (answer["ran"], answer["runs"], answer["failed"]) == (0, 2 * len(tasks()), 0)


def test_another_name_does_not_go_on_in_the_same_directory(submitted, monkeypatch, capsys):
    folder, directory = submitted
    monkeypatch.chdir(folder)
    arguments = ["benchmark", "my_robots.py:mine", "--name", "Jane", "--out", str(directory)]
    assert main([*arguments, "--seeds", "1"]) == 2
    assert "holds the runs of \"Joan's ring\", this is 'Jane'" in capsys.readouterr().err


@pytest.mark.parametrize(
    "seeds", [(140_001, 140_002), (140_002, "held out"), (140_001, 2**40), (140_001,)]
)
def test_seeds_that_were_chosen_are_refused(tmp_path, seeds):
    given = [held_out_seeds(1, "Joan")[0] if seed == "held out" else seed for seed in seeds]
    plan = submission_plan("pursuit", "Joan", 1).model_copy(update={"seeds": tuple(given)})
    filled_study(tmp_path / "s", plan, lambda _cell, _seed: 1)
    with pytest.raises(StudyError, match="held out for 'Joan'"):
        split_seeds(read_runs(tmp_path / "s"))


def test_held_out_seeds_of_another_name_are_refused(tmp_path):
    plan = submission_plan("pursuit", "Joan", 2).model_copy(update={"title": "Jane"})
    filled_study(tmp_path / "s", plan, lambda _cell, _seed: 1)
    with pytest.raises(StudyError, match="held out for 'Jane'"):
        split_seeds(read_runs(tmp_path / "s"))


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["pursuit"], "needs --name"),
        (["pursuit", "--name", "xi-star"], "is the name of a shipped policy"),
        (["pursuit", "--name", " "], "must be 1 to 60 characters"),
        (["no-such-policy", "--name", "Joan"], "no-such-policy"),
        (["pursuit", "--name", "Joan", "--seeds", "101"], "from 1 to 100"),
        (["pursuit", "--name", "Joan", "--set", "speed=3"], "speed"),
        (["absent.zip"], "needs --out"),
        (["absent.zip", "--out", "o"], "absent.zip"),
        (["absent.zip", "--out", "o", "--name", "Joan"], "--name means nothing here: a bundle has"),
        (["absent.zip", "--out", "o", "--seeds", "100"], "--seeds means nothing here: a bundle"),
        (["absent.zip", "--out", "o", "--set", "k=1"], "--set means nothing here: a bundle"),
        (["absent.zip", "--out", "o", "--workers", "1"], "--workers means nothing here: a bundle"),
        (["--name", "Joan"], "--name means nothing here: without a POLICY"),
        (["--seeds", "100"], "--seeds means nothing here: without a POLICY"),
        (["--set", "k=1"], "--set means nothing here: without a POLICY"),
        (["--workers", "1"], "--workers means nothing here: without a POLICY"),
        (["--out", "o"], "--out means nothing here: without a POLICY"),
        (["--json"], "--json means nothing here: without a POLICY"),
    ],
)
def test_what_is_asked_wrongly_gets_one_clear_line_and_writes_nothing(
    arguments, said, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    assert main(["benchmark", *arguments]) == 2
    assert said in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_place_that_is_a_file_gets_one_line_for_a_policy_too(tmp_path, capsys):
    (tmp_path / "a file").write_text("precious")
    arguments = ["benchmark", "pursuit", "--name", "Joan", "--seeds", "1"]
    assert main([*arguments, "--out", str(tmp_path / "a file")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"{tmp_path / 'a file'} cannot be used" in line
    assert (tmp_path / "a file").read_text() == "precious"


def test_all_seeds_are_run_if_their_number_is_left_out(monkeypatch, tmp_path):
    asked = []

    def run(request):
        asked.append(request)
        raise StudyError("seen")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("encircle.benchmark.submission.run_submission", run)
    assert main(["benchmark", "pursuit", "--name", "Joan"]) == 2
    assert main(["benchmark", "pursuit", "--name", "Joan", "--seeds", "3"]) == 2
    assert [request.seeds for request in asked] == [SEEDS, 3]


def strict(text):
    """What a reader of JSON that knows no NaN makes of a text."""

    def refuse(name):
        raise AssertionError(name)

    return json.loads(text, parse_constant=refuse)


def test_a_single_seed_has_no_bounds_wherever_they_are_told(submitted, monkeypatch, capsys):
    folder, directory = submitted
    monkeypatch.chdir(folder)
    arguments = ["benchmark", "my_robots.py:mine", "--name", "Joan's ring", "--seeds", "1"]
    assert main([*arguments, "--json"]) == 0
    answer = strict(capsys.readouterr().out)
    bounds = [answer["score"][key] for key in ("low", "high", "seeds_low", "seeds_high")]
    assert bounds + [answer["held_out"][key] for key in ("low", "high")] == [None] * 6
    assert not any("[" in sentence or "resamples" in sentence for sentence in answer["findings"])
    assert "This is a try with few seeds, 1 of each" in answer["findings"][-1]
    page = Page((directory / "benchmark.html").read_text(encoding="utf-8"))
    assert all("[" not in cell for row in page.tables[0][1:] for cell in row)
    assert all(row[5] == "" for row in page.tables[0][1:])
    assert "A single seed gives no intervals and no ranks in resamples." in page.text
    assert len(page.images) == 2
    with open(directory / "scores.csv", newline="") as file:
        for row in csv.DictReader(file):
            told = [key for key, text in row.items() if text == "nan"]
            assert {"low", "high", "seeds_low", "seeds_high", "rank_1_share"} <= set(told)
            assert row["score"] != "nan"


def test_without_a_policy_the_published_table_is_printed(capsys):
    assert main(["benchmark"]) == 0
    head, *lines = capsys.readouterr().out.splitlines()
    assert head.startswith("benchmark 1: 24 tasks")
    assert {line.split()[1] for line in lines} == set(published().outcomes.policies)


def test_the_command_and_the_benchmark_have_as_many_seeds():
    assert SEEDS_MAX == SEEDS


def test_the_command_on_the_page_repeats_the_numbers():
    request = Request("a b.py:f", "Jo's", seeds=3, policy_parameters=["k=1"])
    assert request.command == (
        "encircle benchmark 'a b.py:f' --name 'Jo'\"'\"'s' --set k=1 --seeds 3"
    )
    assert "--seeds" not in replace(request, seeds=SEEDS).command


def test_the_page_names_the_own_parameters_that_were_set(submitted, tmp_path):
    runs = read_runs(submitted[1])
    changed = runs.plan.model_copy(update={"changes": ("team.policy_parameters.k=1.5",)})
    answer = write_submission_page(runs._replace(plan=changed), ("a command",), tmp_path / "p")
    text = Path(answer["page"]).read_text(encoding="utf-8")
    assert "Policy: my_robots.py:mine, k=1.5." in text


def test_runs_of_several_policies_are_no_submission(submitted):
    runs = read_runs(submitted[1])
    outcomes = replace(
        runs.outcomes,
        policies=("a", "b"),
        capture_ticks=np.concatenate([runs.outcomes.capture_ticks] * 2),
    )
    with pytest.raises(StudyError, match="not those of one policy"):
        split_seeds(runs._replace(outcomes=outcomes))


def test_the_study_of_the_benchmark_has_its_page_beside_its_report(tmp_path, monkeypatch, capsys):
    plan = load_plan("benchmark", seeds="140001-140001")
    filled_study(tmp_path / "s", plan, lambda cell, _seed: cell % 7)
    answer = {"out": str(tmp_path / "s"), "failed": 0, "report": "r.html", "findings": []}
    answer |= {"runs": plan.runs, "cells": len(plan.cells), "ran": 0}
    monkeypatch.setattr("encircle.studies.command.study_command.run_study", lambda _request: answer)
    assert main(["study", "benchmark"]) == 0
    assert f"page    {tmp_path / 's' / 'benchmark.html'}" in capsys.readouterr().out
    (tmp_path / "s" / "benchmark.html").unlink()
    assert main(["study", "benchmark", "--set", "ticks_max=5"]) == 0
    assert not (tmp_path / "s" / "benchmark.html").exists()
