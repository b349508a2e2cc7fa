"""A submission's bundle: scored from its rows, and refused if these cannot be true."""

import json
import math
from pathlib import Path

import pytest
from helpers_bundles import members_of, read_any, with_rows, written
from helpers_pages import Page

from encircle.benchmark.seeds import NAME_LETTERS_MAX, held_out_seeds, public_seeds
from encircle.benchmark.submission import score_bundle
from encircle.benchmark.tables import runs_of
from encircle.benchmark.tasks import submission_plan
from encircle.bundles.bundle_file import MANIFEST, PLAN, TABLE
from encircle.bundles.manifest import GIVEN, manifest, manifest_bytes
from encircle.bundles.packing import pack
from encircle.bundles.table_text import read_table
from encircle.cli.main import main
from encircle.studies.plan import StudyError
from encircle.studies.study import Study
from encircle.whole_files import OutputError

NAME = "Joan"


@pytest.fixture(scope="module")
def bundle(tmp_path_factory):
    """A sound bundle of a shipped policy, with one seed of each kind and no recordings."""
    folder = tmp_path_factory.mktemp("submitted")
    study = Study(submission_plan("pursuit", NAME, 1), folder / "study")
    study.run(workers=1)
    pack(study.directory, folder / "joan.zip", 0)
    return folder / "joan.zip"


@pytest.fixture
def members(bundle):
    """Its members, to be altered."""
    return members_of(bundle)


def covered(members):
    """The members with a manifest that fits them, as whoever alters a bundle can make it."""
    plan = read_any(members)
    row = read_table(plan, members[TABLE])[0]
    given = {key: json.loads(members[MANIFEST])[key] for key in GIVEN}
    versions = json.loads(row["versions"])
    members[MANIFEST] = manifest_bytes(manifest(plan, row["code"], versions, members, given))
    return members


def titled(members, title):
    """The members of a submission of that title, with the seeds that are held out for it."""
    tree = json.loads(members[PLAN])
    seeds = [*public_seeds(1), *held_out_seeds(1, title, 1)]
    others = dict(zip(tree["seeds"], seeds, strict=True))

    def change(rows):
        for row in rows:
            row["seed"] = others[row["seed"]]

    with_rows(members, change)
    members[PLAN] = json.dumps({**tree, "title": title, "seeds": seeds}).encode()
    return covered(members)


def refused(path, out, capsys):
    """What the command says of a bundle that it refuses, in one line, having written nothing."""
    assert main(["benchmark", str(path), "--out", str(out)]) == 2
    captured = capsys.readouterr()
    (line,) = captured.err.splitlines()
    assert captured.out == ""
    assert not out.exists()
    return line


def test_a_bundle_that_was_covered_up_and_not_altered_is_scored(members, tmp_path):
    path = written(covered(members), tmp_path / "b.zip")
    assert score_bundle(path, tmp_path / "o")["name"] == NAME


def test_rows_that_were_altered_and_nothing_else_are_refused(members, tmp_path, capsys):
    def change(rows):
        for row in rows:
            row["captured"], row["ticks"] = 1.0, 1

    path = written(with_rows(members, change), tmp_path / "b.zip")
    line = refused(path, tmp_path / "o", capsys)
    assert f"{TABLE}, hash" in line
    assert "one thing differs" in line
    assert f"encircle verify {path}" in line


def test_a_bundle_without_all_rows_is_refused_with_the_number_of_differences(
    members, tmp_path, capsys
):
    def change(rows):
        del rows[:2]

    path = written(covered(with_rows(members, change)), tmp_path / "b.zip")
    line = refused(path, tmp_path / "o", capsys)
    assert "row of cell 0" in line
    assert "2 things differ" in line
    assert "encircle verify" in line


def test_a_table_that_cannot_be_read_is_refused(members, tmp_path, capsys):
    members[TABLE] = b"no\ntable\n"
    line = refused(written(members, tmp_path / "b.zip"), tmp_path / "o", capsys)
    assert "encircle verify" in line


def test_it_is_told_that_the_rows_were_not_run_again(bundle, tmp_path, capsys):
    said = f"were not run again here: encircle verify {bundle} does that for some of them"
    assert main(["benchmark", str(bundle), "--out", str(tmp_path / "a")]) == 0
    assert said in capsys.readouterr().out
    assert main(["benchmark", str(bundle), "--out", str(tmp_path / "b"), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert said in answer["unchecked"][0]
    text = Path(answer["page"]).read_text(encoding="utf-8")
    assert "were not run again here: encircle verify joan.zip does that for some of them" in text
    assert str(bundle.parent) not in text
    assert "Policy, as the bundle names it: pursuit." in text


def test_the_commands_on_the_page_of_a_bundle_are_commands(bundle, tmp_path):
    answer = score_bundle(bundle, tmp_path / "o")
    page = Page(Path(answer["page"]).read_text(encoding="utf-8"))
    assert "encircle benchmark joan.zip --out checked" in page.text
    assert "encircle verify joan.zip" in page.text


@pytest.mark.parametrize(
    ("title", "said"),
    [
        ("closed-ring", "'closed-ring' is the name of a shipped policy"),
        ("x" * (NAME_LETTERS_MAX + 1), "must be 1 to 60 characters"),
        (" ", "must be 1 to 60 characters"),
        ("Jo  an", "single spaces"),
    ],
)
def test_a_title_that_no_name_can_be_is_refused(title, said, members, tmp_path, capsys):
    path = written(titled(members, title), tmp_path / "b.zip")
    line = refused(path, tmp_path / "o", capsys)
    assert said in line
    assert "title" in line


def test_a_title_that_a_name_can_be_is_scored(members, tmp_path):
    path = written(titled(members, "Jane's ring"), tmp_path / "b.zip")
    assert score_bundle(path, tmp_path / "o")["name"] == "Jane's ring"


@pytest.mark.parametrize(
    ("column", "value", "said"),
    [
        ("captured", math.inf, "captured = inf: must be 0 or 1"),
        ("captured", math.nan, "captured = nan: must be 0 or 1"),
        ("captured", 0.6, "captured = 0.6: must be 0 or 1"),
        ("captured", -1.0, "captured = -1.0: must be 0 or 1"),
        ("ticks", 0, "ticks = 0: must be 1 to "),
        ("ticks", 100_000, "ticks = 100000: must be 1 to "),
        ("ticks", 9_999_999_999_999_999_999, "ticks = 9999999999999999999: must be 1 to "),
    ],
)
def test_a_row_of_no_hunt_is_refused(column, value, said, members, tmp_path, capsys):
    seed = public_seeds(1)[0]

    def change(rows):
        (row,) = [row for row in rows if (row["cell"], row["seed"]) == (3, seed)]
        row["captured"] = 1.0
        row[column] = value

    path = written(covered(with_rows(members, change)), tmp_path / "b.zip")
    line = refused(path, tmp_path / "o", capsys)
    assert f"cell 3, seed {seed}, {said}" in line


@pytest.mark.parametrize("ticks", [-1, 10**30])
def test_a_number_of_ticks_that_no_table_text_has_is_refused_too(ticks):
    plan = submission_plan("pursuit", NAME, 1)
    row = {"failed": "", "captured": 1.0, "ticks": ticks, "digest": ""}
    rows = [{**row, "cell": c, "seed": s} for c in range(len(plan.cells)) for s in plan.seed_list]
    with pytest.raises(StudyError, match=f"cell 0, seed 140001, ticks = {ticks}: must be 1 to"):
        runs_of(plan, rows, "c0de", "t")


def test_the_last_tick_of_a_task_is_one_of_its_ticks(members, tmp_path):
    limits = [arm["set"]["ticks_max"] for arm in json.loads(members[PLAN])["axes"][0]["arms"]]

    def change(rows):
        for row in rows:
            row["captured"], row["ticks"] = 1.0, limits[row["cell"]]

    path = written(covered(with_rows(members, change)), tmp_path / "b.zip")
    answer = score_bundle(path, tmp_path / "o")
    assert (answer["score"]["score"], answer["score"]["time"]) == (1.0, 1.0)


def test_nothing_in_a_directory_is_overwritten(bundle, tmp_path, capsys):
    out = tmp_path / "mine"
    out.mkdir()
    (out / "benchmark.html").write_text("precious")
    assert main(["benchmark", str(bundle), "--out", str(out)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"{out} is not empty" in line
    assert "nothing was changed" in line
    assert [path.name for path in out.iterdir()] == ["benchmark.html"]
    assert (out / "benchmark.html").read_text() == "precious"


def test_a_page_is_not_written_over_the_page_of_before(bundle, tmp_path, capsys):
    arguments = ["benchmark", str(bundle), "--out", str(tmp_path / "o")]
    assert main(arguments) == 0
    assert main(arguments) == 2
    assert "nothing was changed" in capsys.readouterr().err


def test_an_empty_directory_is_taken(bundle, tmp_path):
    (tmp_path / "o").mkdir()
    assert Path(score_bundle(bundle, tmp_path / "o")["page"]).is_file()


@pytest.mark.parametrize("out", ["a file", "a file/o", "/proc/foo"])
def test_a_place_that_is_no_directory_gets_one_line(out, bundle, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a file").write_text("precious")
    assert main(["benchmark", str(bundle), "--out", out]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"encircle: {out} cannot be used: ")
    assert (tmp_path / "a file").read_text() == "precious"


def test_a_page_that_cannot_be_written_whole_leaves_nothing(bundle, tmp_path, monkeypatch):
    def full(_outcomes, path):
        path.write_text("half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("encircle.benchmark.page.write_tasks", full)
    with pytest.raises(OutputError, match="o cannot be written: No space left on device"):
        score_bundle(bundle, tmp_path / "o")
    assert list((tmp_path / "o").iterdir()) == []
