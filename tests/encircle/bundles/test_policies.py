"""Code in a bundle: packed with what it imports, run only where that was asked for."""

import io
import json
import sys
from contextlib import redirect_stdout

import pytest
from helpers_bundles import (
    TREE,
    members_of,
    packed,
    study_of,
    verified,
    with_hashes,
    with_rows,
    written,
)

from encircle.bundles.bundle_file import MANIFEST, PLAN
from encircle.cli.main import main
from encircle.protocol.plugin_files import FOLDERS
from encircle.studies.tasks import code_and_versions

MARK = "IMPORTED_AT"
POLICY = """
import os
import pathlib

from gains_of_chaser import gain

mark = os.environ.get("IMPORTED_AT")
if mark:
    pathlib.Path(mark).touch()


def chase(memory, view, *, boldness: float = 1.0):
    from encircle.agents.policies.paper import pursue

    return pursue(memory, view)


def stumble(memory, view):
    if view.tick == 4:
        raise ValueError("enough")
    return chase(memory, view)
"""
NAME = "own/chaser.py:chase"


@pytest.fixture(scope="session")
def policy_bundle(tmp_path_factory):
    """A bundle with a policy, whose file is then taken away."""
    folder = tmp_path_factory.mktemp("policies")
    (folder / "own").mkdir()
    (folder / "own" / "chaser.py").write_text(POLICY)
    (folder / "own" / "gains_of_chaser.py").write_text("gain = 1.0\n")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(FOLDERS, str(folder))
        # Workers of tests are forked from a process with another environment.
        patch.setattr(
            "encircle.runner.process_pool.in_processes", lambda work, tasks, _: map_of(work, tasks)
        )
        tree = {**TREE, "name": "own", "axes": [], "strategies": ["pursuit", NAME], "seeds": 3}
        del tree["compare"]
        tree["axes"] = []
        study = study_of(folder, tree)
        bundle = packed(study, folder / "own.zip", 6)
        said = io.StringIO()
        with redirect_stdout(said):
            out = str(folder / "again.zip")
            assert main(["bundle", str(study.directory), "--out", out, "--recordings", "0"]) == 0
        assert said.getvalue().endswith(f"encircle verify {out} --run-policies\n")
    for file in (folder / "own").iterdir():
        if file.suffix == ".py":
            file.unlink()
    return bundle


def map_of(work, tasks):
    yield from map(work, tasks)


@pytest.fixture
def mark(tmp_path, monkeypatch):
    path = tmp_path / "mark"
    monkeypatch.setenv(MARK, str(path))
    # What a process that runs them keeps of it.
    monkeypatch.setenv(FOLDERS, "")
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.delitem(sys.modules, "gains_of_chaser", raising=False)
    code_and_versions.cache_clear()
    return path


def test_the_policy_and_what_it_imports_are_in_the_bundle(policy_bundle):
    members = members_of(policy_bundle)
    assert members["policies/own/chaser.py"].decode() == POLICY
    assert members["policies/own/gains_of_chaser.py"] == b"gain = 1.0\n"
    assert json.loads(members[MANIFEST])["policies"] == [
        "policies/own/chaser.py",
        "policies/own/gains_of_chaser.py",
    ]


def test_code_in_a_bundle_is_not_run_unasked(policy_bundle, monkeypatch, mark):
    before = list(sys.path)
    found = verified(policy_bundle, monkeypatch, None)
    assert not mark.exists()
    assert sys.path == before
    assert found.count == 0
    # The shipped policy's runs are run again, and the report is whole.
    assert found.numbers["rows"]["rerun"] == 3
    assert any(line.startswith("the report, computed again") for line in found.agreed)
    said = " ".join(found.unchecked)
    assert f"3 of 6 rows: they need {NAME}" in said
    assert "--run-policies" in said
    assert "3 recordings: their runs cannot be run here" in said
    assert "the code: its digest here is not known" in said


def test_a_file_of_that_name_on_the_readers_machine_is_not_run_either(
    policy_bundle, monkeypatch, mark, tmp_path
):
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "chaser.py").write_text(POLICY)
    monkeypatch.chdir(tmp_path)
    assert verified(policy_bundle, monkeypatch, None).count == 0
    assert not mark.exists()


def test_code_in_a_bundle_is_run_where_that_was_asked_for(policy_bundle, monkeypatch, mark):
    found = verified(policy_bundle, monkeypatch, None, runs_files=True)
    assert mark.exists()
    assert found.differences == []
    assert found.numbers["rows"]["rerun"] == 6
    assert found.numbers["recordings"] == {"of": 6, "replayed": 6}
    assert any(line.startswith("the code here is that of the bundle") for line in found.agreed)


def test_the_bundles_policy_is_run_and_not_one_of_that_name_here(
    policy_bundle, monkeypatch, mark, tmp_path
):
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "chaser.py").write_text("raise RuntimeError('the wrong one')\n")
    monkeypatch.chdir(tmp_path)
    assert verified(policy_bundle, monkeypatch, None, runs_files=True).count == 0


def test_a_row_of_a_policy_that_was_altered_is_found_when_it_is_run(
    policy_bundle, monkeypatch, mark, tmp_path
):
    def alter(rows):
        rows[4]["path_m_mean"] += 1.0

    path = written(
        with_hashes(with_rows(members_of(policy_bundle), alter)), tmp_path / "altered.zip"
    )
    found = verified(path, monkeypatch, None, runs_files=True)
    assert f"row of cell 1, strategy = {NAME}, seed 2" in {one.where for one in found.differences}


def test_another_source_of_the_policy_is_another_code(policy_bundle, monkeypatch, mark, tmp_path):
    members = members_of(policy_bundle)
    members["policies/own/gains_of_chaser.py"] = b"gain = 2.0\n"
    path = written(with_hashes(members), tmp_path / "altered.zip")
    found = verified(path, monkeypatch, 2, runs_files=True)
    assert any(line.startswith("the code: here it is") for line in found.unchecked)


def test_a_policy_that_nobody_has_is_named(bundle, monkeypatch, tmp_path):
    members = members_of(bundle)
    tree = json.loads(members[PLAN])
    tree["set"]["team.strategy"] = "of-a-package-that-is-not-here"
    members[PLAN] = json.dumps(tree).encode()
    found = verified(written(with_hashes(members), tmp_path / "b.zip"), monkeypatch, None)
    assert any(
        "8 of 8 rows: they need of-a-package-that-is-not-here" in line for line in found.unchecked
    )
    # Another plan has another fingerprint all the same.
    assert found.count > 0


def test_a_policy_that_cannot_be_imported_leaves_its_rows_unchecked(
    policy_bundle, monkeypatch, mark, tmp_path
):
    members = members_of(policy_bundle)
    members["policies/own/gains_of_chaser.py"] = b"import a_package_that_is_not_here\n"
    path = written(with_hashes(members), tmp_path / "altered.zip")
    found = verified(path, monkeypatch, None, runs_files=True)
    assert found.count == 0
    assert found.numbers["rows"]["rerun"] == 3
    (line,) = (line for line in found.unchecked if "a_package_that_is_not_here" in line)
    assert line.startswith("3 rows and 3 recordings could not be run")


@pytest.mark.parametrize(
    "change",
    [
        {"strategies": ["os.py:system"]},
        {"set": {"target.behaviour": "os.py:system"}},
        {"measures": ["captured", "os.py:system"]},
        {"set": {"team.robots": 4, "team.robots.r2.strategy": "os.py:system"}},
        {"changes": ["team.strategy=os.py:system"]},
        {"axes": [{"name": "x", "arms": [{"name": "a", "set": {"team.strategy": "os.py:f"}}]}]},
    ],
    ids=["strategies", "behaviour", "measure", "robot", "override", "arm"],
)
def test_no_place_of_a_plan_runs_a_file(bundle, monkeypatch, tmp_path, mark, change):
    """The file is there, as the reader's own."""
    source = (
        "import pathlib, os\npathlib.Path(os.environ['IMPORTED_AT']).touch()\nsystem = f = print"
    )
    (tmp_path / "os.py").write_text(source)
    monkeypatch.chdir(tmp_path)
    members = members_of(bundle)
    tree = json.loads(members[PLAN])
    tree["set"] = {**tree["set"], **change.pop("set", {})}
    members[PLAN] = json.dumps({**tree, **change}).encode()
    for runs_files in (False, True):
        # Not in the bundle, it is not run where files may be.
        found = verified(
            written(with_hashes(members), tmp_path / "b.zip"),
            monkeypatch,
            None,
            runs_files=runs_files,
        )
        assert found.count > 0
        assert not mark.exists()
