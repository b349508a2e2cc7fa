"""``encircle bundle`` and ``encircle verify`` as a person or a program calls them."""

import json

import pytest
from helpers_bundles import members_of, run_here, with_hashes, with_rows, written
from helpers_commands import command

from encircle.bundles import reruns
from encircle.cli.main import main


@pytest.fixture
def in_this_process(monkeypatch):
    monkeypatch.setattr(reruns.pool, "in_processes", run_here)


def test_a_study_is_packed_and_verified_by_processes_of_their_own(study, tmp_path):
    out = tmp_path / "b.zip"
    made = command("bundle", str(study.directory), "--out", str(out), "--json")
    assert made.returncode == 0, made.stderr
    facts = json.loads(made.stdout)
    assert (facts["runs"], facts["recordings"]) == (8, 2)
    done = command("verify", str(out), "--rows", "4", "--seed", "3", "--workers", "2", "--json")
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["agrees"] is True
    assert told["sha256"] == facts["sha256"]
    assert told["rows"]["rerun"] == 4


@pytest.mark.usefixtures("in_this_process")
def test_what_agrees_and_what_was_not_checked_is_said(bundle, capsys):
    assert main(["verify", str(bundle), "--rows", "2", "--seed", "5"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert any(line.startswith("agrees: 2 of 8 rows were rerun") for line in lines)
    (open_rows,) = (line for line in lines if "rows were not rerun" in line)
    assert open_rows.startswith("not checked: 6 of 8 rows were not rerun (--seed 5 draws the same")
    assert lines[-1] == "all that was checked agrees; 2 things were not checked, as said above"


@pytest.mark.usefixtures("in_this_process")
def test_what_differs_is_named_and_gives_status_1(bundle, tmp_path, capsys):
    def alter(rows):
        rows[7]["path_m_mean"] += 0.5

    path = written(with_hashes(with_rows(members_of(bundle), alter)), tmp_path / "b.zip")
    assert main(["verify", str(path), "--all"]) == 1
    out = capsys.readouterr().out
    assert "differs: row of cell 1, loss = 0.9, seed 4, path_m_mean: " in out
    assert main(["verify", str(path), "--all", "--json"]) == 1
    told = json.loads(capsys.readouterr().out)
    assert told["agrees"] is False
    assert told["different"] == len(told["differences"]) > 1


def test_a_damaged_bundle_is_no_usage_error(bundle, tmp_path, capsys):
    path = tmp_path / "b.zip"
    path.write_bytes(bundle.read_bytes()[:-50])
    assert main(["verify", str(path)]) == 1
    assert "no whole bundle" in capsys.readouterr().err
    assert main(["verify", str(path), "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["agrees"] is False


@pytest.mark.parametrize(
    "arguments",
    [
        ["verify"],
        ["verify", "absent.zip"],
        ["verify", "absent.zip", "--all", "--rows", "3"],
        ["verify", "absent.zip", "--rows", "-1"],
        ["bundle"],
        ["bundle", "no-such-study"],
        ["bundle", "loss", "--recordings", "many"],
    ],
)
def test_bad_usage_has_status_2_and_one_line(arguments, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    assert "encircle" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
