"""The directory of a run: made or taken when empty, refused otherwise, never overwritten."""

import json
import platform
from dataclasses import asdict
from importlib.metadata import version

import pytest
from helpers_world import RUN, played, small

from protocol import VERSION
from world.engine import build
from world.run_directory import (
    RunDirectoryError,
    create,
    start_recording,
    versions,
    write_summary,
)
from world.scenario import load


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
    for wanted in (path, path / "below"):
        with pytest.raises(RunDirectoryError, match="taken"):
            create(wanted)
    assert path.read_text() == "precious"


def test_a_recording_that_exists_is_refused_and_left_as_it_is(tmp_path):
    (tmp_path / "recording.mcap").write_bytes(b"precious")
    with pytest.raises(RunDirectoryError, match=r"recording\.mcap"):
        start_recording(tmp_path, small(), RUN)
    assert (tmp_path / "recording.mcap").read_bytes() == b"precious"


def test_the_summary_holds_the_result_and_what_it_takes_to_repeat_the_run(tmp_path):
    scenario = small("seed=5", "channel.loss={model='bernoulli', rate=0.2}")
    result = played(build(scenario, 5)).result()
    write_summary(tmp_path, scenario, result, RUN, {"rounds_s": 1.5})
    summary = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    assert (summary["run"], summary["seed"], summary["rounds_s"]) == (RUN, 5, 1.5)
    expected = asdict(result) | {"distances_m": list(result.distances_m)}
    assert {name: summary[name] for name in expected} == expected
    assert summary["versions"] == versions()
    assert load(summary["scenario"]) == scenario
    again = played(build(load(summary["scenario"]), summary["seed"])).result()
    assert again.digest == summary["digest"]


def test_versions_are_those_of_everything_with_a_part_in_the_numbers():
    found = versions()
    assert found["python"] == platform.python_version()
    assert found["protocol"] == str(VERSION)
    for package in ("encircle", "eclipse-zenoh", "msgpack", "numpy", "scipy", "filterpy", "mcap"):
        assert found[package] == version(package)
