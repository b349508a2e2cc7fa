"""Recordings that version 0.1.0 made are replayed, taken up again and measured as it did.

``tests/data/recorded_by_0_1_0`` has two hunts over Zenoh, 12 ticks long: one in lock-step with a
lossy, slow and noisy radio, one by the clock with direct radio. Digests and measures are those of
that version.
"""

import gzip
import json
from math import isnan

import pytest
from helpers_paths import TESTS

from encircle.measures.registry import measure
from encircle.replay.replaying import replay
from encircle.runlog.recorded_log import log_of_recording
from encircle.runner.hunts import resume
from encircle.world.recording.recording import read_recording

DATA = TESTS / "data" / "recorded_by_0_1_0"


def unpacked(name, into, share=1.0):
    """A run's directory with so much of its recording, and nothing else."""
    into.mkdir()
    whole = gzip.decompress((DATA / name / "recording.mcap.gz").read_bytes())
    (into / "recording.mcap").write_bytes(whole[: int(share * len(whole))])
    return into


def summary(name):
    return json.loads((DATA / name / "summary.json").read_text())


@pytest.mark.parametrize("name", ["lossy", "by-the-clock"])
def test_they_are_replayed_to_the_same_decisions(name, tmp_path):
    check = replay(unpacked(name, tmp_path / "run"))
    assert check.same
    assert check.complete
    assert check.ticks == summary(name)["ticks"] == 12


@pytest.mark.parametrize("share", [0.5, 0.8, 0.97])
def test_one_that_was_cut_off_is_taken_up_again_to_the_same_digest(share, tmp_path):
    directory = unpacked("lossy", tmp_path / "run", share)
    assert resume(directory, link="memory").digest == summary("lossy")["digest"]


def test_they_are_measured_to_the_same_numbers(tmp_path):
    recording = read_recording(unpacked("lossy", tmp_path / "run"))
    measured = measure(log_of_recording(recording))
    before = json.loads((DATA / "lossy" / "measures.json").read_text())
    assert before.keys() <= measured.keys()
    for name, value in before.items():
        if value is None:
            assert isnan(measured[name]), name
        else:
            assert measured[name] == pytest.approx(value, rel=1e-9, abs=1e-12), name
