"""A study in a notebook: how far it is, by its files alone, which stay as they are."""

from pathlib import Path
from xml.etree import ElementTree

import pytest

import encircle
from encircle.statistics.intervals import capture_rate
from encircle.studies.notebook.looking_on import runs_so_far
from encircle.studies.notebook.study_view import ROWS_MAX

PLAN = {
    "name": "seen",
    "title": "Seen in a notebook",
    "scenario": "sim1",
    "seeds": 4,
    "measures": ["captured"],
    "strategies": ["xi-star", "xi-0"],
    "set": {"ticks_max": 40, "team.jitter_m": 0.25},
}


def study_at(path, **changes):
    return encircle.study({**PLAN, **changes}, out=path)


def words_of(study):
    return " ".join(" ".join(ElementTree.fromstring(study._repr_html_()).itertext()).split())


def files_in(path):
    return {file: file.read_bytes() for file in path.rglob("*") if file.is_file()}


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    path = tmp_path_factory.mktemp("studies") / "seen"
    study_at(path).run(workers=1)
    return path


def test_before_it_is_run_nothing_is_there_and_nothing_is_made(tmp_path):
    study = study_at(tmp_path / "new")
    assert "0 of 8 runs" in words_of(study)
    assert not (tmp_path / "new").exists()


def test_finished_it_has_rates_with_intervals(finished):
    study = study_at(finished)
    words = words_of(study)
    assert "8 of 8 runs" in words
    table = study.table()
    for cell, rows in table.groupby("cell"):
        flags = rows["captured"].to_numpy() > 0.5
        so_far = runs_so_far(finished, study.plan).cells[cell]
        assert so_far.captured == tuple(flags.tolist())
        assert so_far.ticks == tuple(rows["ticks"])
        low, high = (100.0 * bound for bound in capture_rate(flags)[1:])
        assert f"[{low:.1f}, {high:.1f}]" in words


def test_with_more_seeds_it_is_not_finished(finished):
    assert "8 of 20 runs" in words_of(study_at(finished, seeds=10))


def test_who_looks_needs_no_lock_and_changes_nothing(finished):
    before = files_in(finished)
    study = study_at(finished)
    table = study.open()
    try:
        assert "8 of 8 runs" in words_of(study_at(finished))
    finally:
        table.close()
    assert files_in(finished) == before


def test_another_study_and_another_directory_are_named(finished, tmp_path):
    assert "runs of another configuration" in words_of(study_at(finished, set={"ticks_max": 41}))
    (tmp_path / "notes.txt").write_text("mine")
    assert f"{tmp_path} is not a study's" in words_of(study_at(tmp_path))


def test_failed_runs_are_counted(tmp_path, monkeypatch):
    (tmp_path / "policies").mkdir()
    policy = tmp_path / "policies" / "broken.py"
    policy.write_text("def broken(memory, view):\n    raise ValueError('no idea')\n")
    monkeypatch.chdir(tmp_path)
    study = study_at(tmp_path / "s", strategies=["xi-star", "policies/broken.py:broken"])
    study.run(workers=1)
    assert "4 of 8 runs, 4 failed" in words_of(study)


def test_a_file_that_goes_while_it_is_read_is_read_elsewhere(finished, monkeypatch):
    """As when parts are merged: the list is made anew."""
    from encircle.studies.notebook import looking_on

    read, asked = looking_on.pq.read_table, []

    def vanishing(path, columns):
        asked.append(Path(path).name)
        if len(asked) == 1:
            raise FileNotFoundError(path)
        return read(path, columns=columns)

    monkeypatch.setattr(looking_on.pq, "read_table", vanishing)
    assert "8 of 8 runs" in words_of(study_at(finished))
    assert asked == ["table.parquet"] * 2


def test_a_damaged_file_is_passed_over(finished, tmp_path):
    copy = tmp_path / "copy"
    (copy / "parts").mkdir(parents=True)
    for name in ("study.json", "table.parquet"):
        (copy / name).write_bytes((finished / name).read_bytes())
    (copy / "parts" / "00000001.parquet").write_bytes(b"PAR1 no")
    assert "8 of 8 runs" in words_of(study_at(copy))


def test_a_study_without_axes_and_one_of_many_cells(tmp_path):
    single = {key: value for key, value in PLAN.items() if key != "strategies"}
    study = encircle.study(single, out=tmp_path / "one")
    assert "all" in words_of(study)
    rates = [k / 100 for k in range(50)]
    axis = {"name": "loss", "key": "channel.loss.rate", "values": rates}
    many = study_at(
        tmp_path / "many", axes=[axis], set={**PLAN["set"], "channel.loss.model": "bernoulli"}
    )
    assert f"{100 - ROWS_MAX} more cells are not shown" in words_of(many)
