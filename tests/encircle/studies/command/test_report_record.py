"""A finished study is left as it is; whatever of it is altered, missing or older is made again."""

import json
import shutil
import subprocess
import sys
from dataclasses import replace

import pytest
from helpers_studies import LOSS

from encircle.studies.command import report_record
from encircle.studies.command.report_record import RECORD_FILE
from encircle.studies.command.request import Request
from encircle.studies.command.study_command import run_study
from encircle.studies.plan import StudyError
from encircle.studies.study_directory import LOCK_FILE, PARTS_DIRECTORY, lock_file

STUDY = f"""
title = "A small study"
scenario = "sim1"
seeds = 2
strategies = ["xi-star", "xi-0"]
measures = ["captured"]
[set]
ticks_max = 40
"channel.loss.model" = "bernoulli"
[[axes]]
name = "loss"
key = "{LOSS["key"]}"
values = [0.0, 0.9]
"""
DRAWN = "writing the report"
EDITED_TITLE = ("A small study", "Another title")


def asked(folder, **changes):
    request = Request(
        str(folder / "small.toml"), folder / "out", None, "memory", 1, None, (), "few"
    )
    return replace(request, **changes)


def contents(folder):
    files = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A folder with a study and its directory, whose runs and report are done."""
    folder = tmp_path_factory.mktemp("finished")
    (folder / "small.toml").write_text(STUDY)
    answer = run_study(asked(folder))
    assert answer["ran"] == 8
    assert answer["replays"], "pages of replays are part of what is tried below"
    return folder, answer


@pytest.fixture
def again(finished, tmp_path, monkeypatch):
    """A copy of the finished study, and a command that runs it again under its first name."""
    folder, _ = finished
    shutil.copytree(folder / "out", tmp_path / "kept")
    yield folder
    # The name of the directory stands in the report's command, so it is used by one after another.
    shutil.rmtree(folder / "out")
    shutil.move(tmp_path / "kept", folder / "out")
    (folder / "small.toml").write_text(STUDY)


def test_a_finished_study_is_left_as_it_is_and_says_the_same(again, finished, capsys):
    before = contents(again / "out")
    answer = run_study(asked(again))
    assert answer == {**finished[1], "ran": 0}
    assert contents(again / "out") == before
    assert DRAWN not in capsys.readouterr().err


def test_what_is_finished_needs_neither_hunts_nor_figures_nor_tables(again):
    """In a fresh interpreter."""
    script = (
        "import sys; from pathlib import Path\n"
        "from encircle.studies.command.study_command import run_study\n"
        "from encircle.studies.command.request import Request\n"
        f"folder = Path({str(again)!r})\n"
        "run_study(Request(str(folder / 'small.toml'), folder / 'out', None, 'memory', 1, None,"
        " (), 'few'))\n"
        "print(*sorted({name.partition('.')[0] for name in sys.modules}))"
        "; print(*sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    packages, modules = (set(line.split()) for line in done.stdout.splitlines())
    assert not packages & {"matplotlib", "pandas", "pyarrow", "rich", "bokeh", "zenoh"}
    assert "encircle.runner.memory" not in modules


FILES = ("report.html", "summary.csv", "comparisons.csv", "figures", "replays")


@pytest.mark.parametrize("end", ["altered", "missing"])
@pytest.mark.parametrize("name", FILES)
def test_what_is_altered_or_missing_is_made_again(again, finished, name, end):
    before = contents(again / "out")
    path = again / "out" / name
    for file in sorted(path.iterdir())[:1] if path.is_dir() else [path]:
        if end == "missing":
            file.unlink()
        else:
            file.write_bytes(file.read_bytes() + b" ")
    assert run_study(asked(again)) == {**finished[1], "ran": 0}
    assert contents(again / "out") == before


def edit_title(folder):
    path = folder / "small.toml"
    path.write_text(path.read_text().replace(*EDITED_TITLE))


CHANGES = {
    "title": ({}, edit_title),
    "replays": ({"replays": "none"}, None),
    "command": ({"changes": ("title='sim1'",)}, None),
    "more seeds": ({"seeds": 3}, None),
    "fewer seeds": ({"seeds": 1}, None),
    "record": ({}, lambda folder: forge(folder, findings=["All is captured."])),
    "no record": ({}, lambda folder: (folder / "out" / RECORD_FILE).unlink()),
}


def forge(folder, **changes):
    path = folder / "out" / RECORD_FILE
    path.write_text(json.dumps({**json.loads(path.read_text()), **changes}))


@pytest.mark.parametrize("kind", CHANGES)
def test_a_report_of_something_else_is_made_anew(again, finished, capsys, kind):
    changes, edit = CHANGES[kind]
    if edit is not None:
        edit(again)
    answer = run_study(asked(again, **changes))
    assert DRAWN in capsys.readouterr().err
    assert answer["ran"] == (4 if kind == "more seeds" else 0)
    if "record" in kind:
        assert answer == {**finished[1], "ran": 0}
    before = contents(again / "out")
    run_study(asked(again, **changes))
    assert DRAWN not in capsys.readouterr().err
    assert contents(again / "out") == before


@pytest.mark.parametrize("what", ["program", "_version"])
def test_a_report_that_other_code_has_drawn_is_made_anew(again, capsys, monkeypatch, what):
    monkeypatch.setattr(report_record, what, lambda *_of: "another")
    run_study(asked(again, replays="none"))
    assert DRAWN in capsys.readouterr().err


def test_a_table_that_is_another_one_has_a_report_of_its_own(again, capsys):
    table = again / "out" / "table.parquet"
    part = again / "out" / PARTS_DIRECTORY / "00000001.parquet"
    table.rename(part)  # as if the study had been interrupted before the end
    answer = run_study(asked(again))
    assert DRAWN in capsys.readouterr().err
    assert answer["ran"] == 0
    assert table.exists()
    assert not part.exists()


def test_a_directory_in_which_another_process_works_is_refused(again):
    lock = lock_file(again / "out" / LOCK_FILE)
    with lock, pytest.raises(StudyError, match="is in use by another process"):
        run_study(asked(again))


def test_failed_runs_are_tried_again_each_time(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small.toml").write_text(STUDY.replace('"xi-star", "xi-0"', '"grumpy.py:grumpy"'))
    (tmp_path / "grumpy.py").write_text("def grumpy(memory, view):\n    raise ValueError\n")
    for _ in range(2):
        answer = run_study(asked(tmp_path))
        assert (answer["ran"], answer["failed"]) == (4, 4)
        assert DRAWN in capsys.readouterr().err
    assert not (tmp_path / "out" / RECORD_FILE).exists()
