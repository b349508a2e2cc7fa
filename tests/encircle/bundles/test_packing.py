"""What is packed of a study, and which studies are not."""

import json
import shutil
from contextlib import closing

import pyarrow.parquet as pq
import pytest
from helpers_bundles import TREE, members_of, packed, study_of, verified

import encircle
from encircle.bundles.bundle_file import MANIFEST, TABLE, BundleError
from encircle.bundles.packing import directory_of, pack, plan_in
from encircle.bundles.table_text import equal, read_table
from encircle.studies import sources
from encircle.studies.plan import StudyError
from encircle.studies.study_directory import OWNER_FILE, TABLE_FILE
from encircle.whole_files import OutputError


@pytest.fixture
def copy(study, tmp_path):
    """A study's directory, to be changed."""
    return shutil.copytree(study.directory, tmp_path / "study")


def test_the_table_in_a_bundle_is_the_studys(study, bundle):
    rows = read_table(study.plan, members_of(bundle)[TABLE])
    table = pq.read_table(study.directory / TABLE_FILE).to_pylist()
    assert len(rows) == len(table) == 8
    for row, given in zip(rows, table, strict=True):
        assert list(row) == list(given)
        assert all(equal(row[name], given[name]) for name in given)


def test_seeds_that_were_added_later_are_packed(copy, tmp_path, monkeypatch):
    encircle.study({**TREE, "seeds": 5}, copy).run(workers=1)
    assert plan_in(copy).seed_list == (1, 2, 3, 4, 5)
    out = tmp_path / "more.zip"
    assert pack(copy, out, 0).plan.runs == 10
    assert verified(out, monkeypatch).count == 0


def test_seeds_with_gaps_are_packed(tmp_path, monkeypatch):
    study = study_of(tmp_path, {**TREE, "seeds": [7, 1001]})
    found = verified(packed(study, tmp_path / "b.zip"), monkeypatch, None)
    assert found.count == 0
    assert found.numbers["rows"]["rerun"] == 4


def test_a_study_whose_runs_fail_is_packed_and_fails_again(tmp_path, monkeypatch):
    """A team that cannot be placed."""
    tree = {**TREE, "axes": [{"name": "n", "key": "team.robots", "values": [2, 40]}], "seeds": 2}
    del tree["compare"]
    crowded = {"team.placement.distance_m_min": 1.5, "team.placement.distance_m_max": 3.0}
    tree |= {"scenario": {"team": {"robots": 2}}, "set": {"ticks_max": 20, **crowded}}
    study = study_of(tmp_path, tree)
    out = packed(study, tmp_path / "b.zip", 4)
    assert sum(name.endswith(".mcap") for name in members_of(out)) == 2
    found = verified(out, monkeypatch, None)
    assert found.differences == []
    assert found.numbers["rows"]["rerun"] == 4


def test_runs_that_are_missing_are_told(tmp_path):
    study = encircle.study({**TREE, "seeds": 1}, tmp_path / "s")
    study.run(workers=1)
    other = encircle.study({**TREE, "seeds": 2}, tmp_path / "s")
    with closing(other.open()) as table:
        row = {**table.read().to_pylist()[0], "seed": 2}
        table.append([row])
    with pytest.raises(StudyError, match="1 of 4 runs are missing: run encircle study first"):
        pack(tmp_path / "s", tmp_path / "b.zip")
    assert not (tmp_path / "b.zip").exists()


def test_a_study_of_other_code_is_not_packed(copy, tmp_path, monkeypatch):
    monkeypatch.setattr("encircle.studies.study.code", lambda _plugins: "0" * 16)
    with pytest.raises(StudyError, match="code"):
        pack(copy, tmp_path / "b.zip")


def test_a_run_that_comes_out_otherwise_is_not_packed(copy, tmp_path):
    path = copy / TABLE_FILE
    table = pq.read_table(path)
    digests = table["digest"].to_pylist()[::-1]
    index = table.schema.get_field_index("digest")
    pq.write_table(table.set_column(index, "digest", [digests]), path)
    with pytest.raises(BundleError, match="run again it came to digest"):
        pack(copy, tmp_path / "b.zip", 1)
    assert not (tmp_path / "b.zip").exists()


def test_nothing_is_overwritten(study, tmp_path):
    (tmp_path / "b.zip").write_text("mine")
    with pytest.raises(OutputError, match="is there already"):
        pack(study.directory, tmp_path / "b.zip", 0)
    assert (tmp_path / "b.zip").read_text() == "mine"


def test_a_study_is_named_by_its_directory_its_name_or_its_file(study, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert directory_of(str(study.directory)) == study.directory
    assert str(directory_of("loss")) == "runs/study-loss"
    (tmp_path / "mine.toml").write_text('scenario = "sim1"\nseeds = 1\n')
    assert str(directory_of("mine.toml")) == "runs/study-mine"
    with pytest.raises(StudyError, match="neither a file nor one of"):
        directory_of("nothing")


@pytest.mark.parametrize(
    ("content", "match"),
    [
        (None, "has no study.json"),
        ("{", "is damaged"),
        ('{"plan": {}}', "is damaged"),
        ("[]", "is damaged"),
    ],
)
def test_what_is_no_study_is_told(tmp_path, content, match):
    if content is not None:
        (tmp_path / OWNER_FILE).write_text(content)
    with pytest.raises(StudyError, match=match):
        plan_in(tmp_path)


def test_the_manifest_says_what_made_it(bundle, study):
    tree = json.loads(members_of(bundle)[MANIFEST])
    assert tree["fingerprint"] == study.plan.fingerprint
    assert tree["code"] == sources.code()
    assert tree["versions"] == sources.versions()
    assert (tree["cells"], tree["seeds"], tree["runs"]) == (2, 4, 8)
