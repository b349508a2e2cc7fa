import json
import shutil

import numpy as np
import pyarrow.parquet as pq
import pytest

from encircle.studies import study_table
from encircle.studies.plan import StudyError
from encircle.studies.plan_files import load_plan

TREE = {
    "name": "tested",
    "scenario": "sim1",
    "seeds": 3,
    "axes": [{"name": "limit", "key": "ticks_max", "values": [5, 6]}],
}
CODE = {"code": "c0de"}
_opened = []


@pytest.fixture(autouse=True)
def _close_tables():
    yield
    while _opened:
        _opened.pop().close()


def StudyTable(*arguments):
    _opened.append(study_table.StudyTable(*arguments))
    return _opened[-1]


def plan(**changes):
    return load_plan({**TREE, **changes})


def row(cell, seed, **changes):
    levels = {"limit": float(5 + cell)}
    found = {"cell": cell, **levels, "seed": seed, "digest": f"{cell}-{seed}", "failed": ""}
    return {**found, "x_m": 0.5, **changes}


def filled(path, pairs, found=None):
    table = StudyTable(path, found or plan(), CODE)
    for pair in pairs:
        table.append([row(*pair)])
    return table


def pairs_in(table):
    rows = table.read(["digest"])
    return list(zip(rows["cell"].to_pylist(), rows["seed"].to_pylist(), strict=True))


def contents(path):
    return {p.name: p.read_bytes() for p in path.rglob("*") if p.is_file() and p.name != "lock"}


def missing(table):
    return np.argwhere(~table.done).tolist()


ALL = [(cell, seed) for cell in (0, 1) for seed in (1, 2, 3)]


def test_rows_come_back_sorted_whatever_the_order_they_came_in(tmp_path):
    table = filled(tmp_path / "t", reversed(ALL))
    assert pairs_in(table) == ALL
    table.merge()
    assert pairs_in(table) == ALL
    assert [p.name for p in (tmp_path / "t").rglob("*.parquet")] == ["table.parquet"]
    assert pq.read_table(tmp_path / "t" / "table.parquet")["digest"].to_pylist() == [
        f"{c}-{s}" for c, s in ALL
    ]


def test_what_is_missing_is_known_after_reopening(tmp_path):
    table = filled(tmp_path / "t", [(0, 2), (1, 3)])
    table.close()
    again = StudyTable(tmp_path / "t", plan(), CODE)
    assert missing(again) == [[0, 0], [0, 2], [1, 0], [1, 1]]
    again.merge()
    again.append([row(0, 1)])
    again.close()
    assert missing(StudyTable(tmp_path / "t", plan(), CODE)) == [[0, 2], [1, 0], [1, 1]]


def test_a_run_is_never_taken_twice(tmp_path):
    table = filled(tmp_path / "t", [(0, 1)])
    with pytest.raises(AssertionError, match="came twice"):
        table.append([row(0, 1)])


def test_a_merge_that_was_cut_off_repeats_nothing(tmp_path):
    table = filled(tmp_path / "t", ALL)
    parts = tmp_path / "kept"
    shutil.copytree(tmp_path / "t" / "parts", parts)
    table.merge()
    # The state after a program that ended between renaming and deleting.
    shutil.rmtree(tmp_path / "t" / "parts")
    parts.rename(tmp_path / "t" / "parts")
    table.close()
    again = StudyTable(tmp_path / "t", plan(), CODE)
    assert len(missing(again)) == 0
    assert pairs_in(again) == ALL
    again.merge()
    assert pairs_in(again) == ALL


def test_a_part_that_was_being_written_does_not_count(tmp_path):
    table = filled(tmp_path / "t", ALL[:2])
    (tmp_path / "t" / "parts" / "00000003.tmp").write_bytes(b"PAR1 half of it")
    table.close()
    again = StudyTable(tmp_path / "t", plan(), CODE)
    assert len(missing(again)) == 4
    assert not list((tmp_path / "t").rglob("*.tmp"))


def test_more_seeds_can_be_added_and_fewer_asked_for(tmp_path):
    filled(tmp_path / "t", ALL).close()
    more = StudyTable(tmp_path / "t", plan(seeds=5), CODE)
    assert missing(more) == [[0, 3], [0, 4], [1, 3], [1, 4]]
    more.append([row(0, 4), row(0, 5), row(1, 4), row(1, 5)])
    more.close()
    fewer = StudyTable(tmp_path / "t", plan(seeds=[2, 5]), CODE)
    assert len(missing(fewer)) == 0
    assert pairs_in(fewer) == [(0, 2), (0, 5), (1, 2), (1, 5)]
    fewer.merge()
    fewer.close()
    assert pairs_in(StudyTable(tmp_path / "t", plan(seeds=5), CODE)) == [
        (c, s) for c in (0, 1) for s in (1, 2, 3, 4, 5)
    ]


def test_many_parts_are_merged_on_the_way(tmp_path, monkeypatch):
    monkeypatch.setattr(study_table, "PARTS_MAX", 3)
    table = filled(tmp_path / "t", ALL)
    assert len(list((tmp_path / "t" / "parts").glob("*.parquet"))) < 3
    assert pairs_in(table) == ALL


def test_merging_in_pieces_gives_the_same_table(tmp_path, monkeypatch):
    whole = filled(tmp_path / "whole", ALL)
    whole.merge()
    monkeypatch.setattr(study_table, "MERGED_ROWS", 1)
    pieces = filled(tmp_path / "pieces", reversed(ALL))
    pieces.merge()
    assert pieces.read().equals(whole.read())


@pytest.mark.parametrize(
    ("changes", "code", "message"),
    [
        ({"name": "other"}, CODE, "holds runs of study 'tested', this is 'other'"),
        ({"scenario": "sim3"}, CODE, "holds runs of configuration"),
        ({}, {"code": "new"}, "holds runs of code 'c0de', this is 'new'"),
    ],
)
def test_a_table_of_another_study_configuration_or_code_is_refused(
    tmp_path, changes, code, message
):
    filled(tmp_path / "t", ALL[:2]).close()
    before = contents(tmp_path / "t")
    with pytest.raises(StudyError, match=message) as caught:
        StudyTable(tmp_path / "t", plan(**changes), code)
    assert "choose another --out; nothing was changed" in str(caught.value)
    assert contents(tmp_path / "t") == before


def test_a_foreign_part_among_ours_is_refused(tmp_path):
    filled(tmp_path / "t", ALL[:2]).close()
    filled(tmp_path / "o", ALL[:1], plan(scenario="sim3")).close()
    shutil.copy(tmp_path / "o/parts/00000001.parquet", tmp_path / "t/parts/00000009.parquet")
    with pytest.raises(StudyError, match=r"00000009.parquet holds runs of configuration"):
        StudyTable(tmp_path / "t", plan(), CODE)


@pytest.mark.parametrize("damage", [b"", b"not parquet at all", b"PAR1garbagePAR1"])
@pytest.mark.parametrize("name", ["parts/00000001.parquet", "table.parquet"])
def test_damaged_files_are_named_and_left_alone(tmp_path, damage, name):
    table = filled(tmp_path / "t", ALL)
    table.merge()
    table.close()
    (tmp_path / "t" / name).write_bytes(damage)
    before = contents(tmp_path / "t")
    with pytest.raises(StudyError, match=f"{name} is damaged") as caught:
        StudyTable(tmp_path / "t", plan(), CODE)
    assert "\n" not in str(caught.value)
    assert contents(tmp_path / "t") == before


def test_a_directory_with_other_things_in_it_is_refused(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(StudyError, match="is not empty and not a study's"):
        StudyTable(tmp_path, plan(), CODE)
    assert [p.name for p in tmp_path.iterdir()] == ["notes.txt"]


def test_a_damaged_owner_is_named(tmp_path):
    filled(tmp_path / "t", ALL).close()
    (tmp_path / "t" / "study.json").write_text("{")
    with pytest.raises(StudyError, match=r"study.json is damaged"):
        StudyTable(tmp_path / "t", plan(), CODE)


def test_only_one_process_at_a_time(tmp_path):
    table = filled(tmp_path / "t", ALL[:1])
    with pytest.raises(StudyError, match="in use by another process"):
        StudyTable(tmp_path / "t", plan(), CODE)
    table.close()
    StudyTable(tmp_path / "t", plan(), CODE).close()


def test_the_directory_tells_what_it_holds(tmp_path):
    filled(tmp_path / "t", ALL).close()
    message = json.loads((tmp_path / "t" / "study.json").read_text())
    assert (message["study"], message["code"]) == ("tested", "c0de")
    assert message["fingerprint"] == plan().fingerprint
    assert message["plan"]["axes"][0]["values"] == [5, 6]


def test_a_place_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    for place in (tmp_path / "file", tmp_path / "file" / "t"):
        said = f"{place} cannot be used: .* is a file, and a directory is needed"
        with pytest.raises(StudyError, match=said):
            StudyTable(place, plan(), CODE)
