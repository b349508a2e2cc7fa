"""The directory of a run: made or taken when empty, refused otherwise, never overwritten."""

import json
import platform
from dataclasses import asdict
from importlib.metadata import version

import pytest
from helpers_world import RUN, played, small

from encircle.protocol import VERSION
from encircle.world.arena.engine import build
from encircle.world.loading.load import load
from encircle.world.recording.recorder import RecordingStopped
from encircle.world.recording.run_directory import (
    RunDirectoryError,
    attempts,
    create,
    set_aside,
    start_recording,
    versions,
    write_summary,
)


def test_a_directory_is_made_with_its_parents_or_taken_if_it_is_empty(tmp_path):
    path = tmp_path / "a" / "b" / "run"
    assert create(path) == path
    assert path.is_dir()
    assert create(path) == path
    assert list(path.iterdir()) == []


@pytest.mark.parametrize("content", ["notes.txt", ".hidden"])
def test_a_directory_that_is_not_empty_is_refused_and_left_as_it_is(tmp_path, content):
    (tmp_path / content).write_text("precious")
    with pytest.raises(RunDirectoryError, match="not empty") as caught:
        create(tmp_path)
    assert str(tmp_path) in str(caught.value)
    assert [p.name for p in tmp_path.iterdir()] == [content]
    assert (tmp_path / content).read_text() == "precious"


def test_a_file_in_the_way_is_refused_and_left_as_it_is(tmp_path):
    path = tmp_path / "taken"
    path.write_text("precious")
    for wanted, it in ((path, "it"), (path / "below", str(path))):
        with pytest.raises(RunDirectoryError) as caught:
            create(wanted)
        said = f"{wanted} cannot be used: {it} is a file, and a directory is needed"
        assert str(caught.value) == said
    assert path.read_text() == "precious"


def test_a_directory_that_may_not_be_written_to_is_refused(tmp_path, monkeypatch):
    # Root may write everywhere, so that nothing real can be tried.
    monkeypatch.setattr("os.access", lambda _path, _mode: False)
    with pytest.raises(RunDirectoryError, match=f"{tmp_path} cannot be used: Permission denied"):
        create(tmp_path)


def test_attempts_are_set_aside_under_names_of_their_own_and_nothing_is_lost(tmp_path):
    for number in (1, 2):
        (tmp_path / "recording.mcap").write_text(f"recording {number}")
        (tmp_path / "summary.json").write_text(f"summary {number}")
        set_aside(tmp_path)
    assert attempts(tmp_path) == [tmp_path / f"recording-broken-{k}.mcap" for k in (1, 2)]
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {
        f"{name}-broken-{k}.{ending}": f"{name} {k}"
        for name, ending in (("recording", "mcap"), ("summary", "json"))
        for k in (1, 2)
    }


def test_a_summary_is_written_whole_or_not_at_all(tmp_path):
    scenario = small()
    (tmp_path / "summary.json").mkdir()
    with pytest.raises(RecordingStopped, match=r"cannot write .*summary\.json"):
        write_summary(tmp_path, scenario, played(build(scenario, 1)).rounds.result(), RUN, {})
    assert [path.name for path in tmp_path.iterdir()] == ["summary.json"]


def test_a_recording_that_exists_is_refused_and_left_as_it_is(tmp_path):
    (tmp_path / "recording.mcap").write_bytes(b"precious")
    with pytest.raises(RunDirectoryError, match=r"recording\.mcap"):
        start_recording(tmp_path, small(), RUN)
    assert (tmp_path / "recording.mcap").read_bytes() == b"precious"


def test_nobody_else_records_where_a_run_is_being_recorded(tmp_path):
    first = start_recording(tmp_path, small(), RUN)
    with pytest.raises(RunDirectoryError, match=f"{tmp_path}: a run is being recorded there now"):
        start_recording(tmp_path, small(), RUN, so_far=[])
    assert [path.name for path in tmp_path.iterdir()] == ["recording.mcap"]
    first.close()
    start_recording(tmp_path, small(), RUN, so_far=[]).close()
    assert len(attempts(tmp_path)) == 2


def test_the_summary_holds_the_result_and_what_it_takes_to_repeat_the_run(tmp_path):
    scenario = small("seed=5", "channel.loss={model='bernoulli', rate=0.2}")
    result = played(build(scenario, 5)).rounds.result()
    write_summary(tmp_path, scenario, result, RUN, {"rounds_s": 1.5})
    summary = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    assert (summary["run"], summary["seed"], summary["rounds_s"]) == (RUN, 5, 1.5)
    expected = json.loads(json.dumps(asdict(result)))
    assert {name: summary[name] for name in expected} == expected
    assert summary["versions"] == versions()
    assert load(summary["scenario"]) == scenario
    again = played(build(load(summary["scenario"]), summary["seed"])).rounds.result()
    assert again.digest == summary["digest"]


def test_versions_are_those_of_everything_with_a_part_in_the_numbers():
    found = versions()
    assert found["python"] == platform.python_version()
    assert found["protocol"] == str(VERSION)
    for package in ("encircle", "eclipse-zenoh", "msgpack", "numpy", "scipy", "filterpy", "mcap"):
        assert found[package] == version(package)
