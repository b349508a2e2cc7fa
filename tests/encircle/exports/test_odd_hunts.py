"""Hunts that are odd, in the formats of the field's viewers: cut off, empty, alone, damaged."""

from dataclasses import replace

import pytest
from helpers_export_readers import foxglove_ticks, rerun_ticks, rosbag2_ticks
from helpers_exports import lossy_hunt
from helpers_scene import hunted

from encircle.exports import foxglove_file, foxglove_layout, rerun_file, rosbag2_directory
from encircle.world.recording.recording import RecordingError

FORMATS = pytest.mark.parametrize(
    ("export", "ticks_of"),
    [
        (foxglove_file.export, foxglove_ticks),
        (rerun_file.export, rerun_ticks),
        (rosbag2_directory.export, rosbag2_ticks),
    ],
    ids=["foxglove", "rerun", "rosbag2"],
)


def cut_off(recording, tick):
    """What is there of a recording whose file ends in the middle of a round."""
    before = [message for message in recording.messages if message[0] < tick]
    begun = [message for message in recording.messages if message[0] == tick][:3]
    return replace(recording, messages=(*before, *begun), complete=False)


@FORMATS
def test_a_recording_that_is_cut_off_is_exported_as_far_as_it_goes(export, ticks_of, tmp_path):
    export(cut_off(lossy_hunt(), 9), tmp_path / "out")
    ticks = ticks_of(tmp_path / "out")
    assert ticks == list(range(len(ticks)))
    assert len(ticks) in (9, 10)


@FORMATS
def test_of_one_cut_off_before_the_first_tick_the_start_is_shown(export, ticks_of, tmp_path):
    export(replace(lossy_hunt(), messages=(), complete=False), tmp_path / "out")
    assert ticks_of(tmp_path / "out") == [0]


@FORMATS
def test_a_robot_alone_has_peers_in_nothing(export, ticks_of, tmp_path):
    recording, log = hunted("sim1", ["team.positions=[[5.0, 0.0]]", "ticks_max=4"])
    export(recording, tmp_path / "out")
    assert ticks_of(tmp_path / "out") == list(range(log.ticks + 1))
    foxglove_layout.export(recording, tmp_path / "layout.json")


@FORMATS
def test_a_message_that_cannot_be_read_is_told(export, ticks_of, tmp_path):
    messages = [
        (tick, topic, payload[:-1] if (tick, topic) == (3, "world/state") else payload)
        for tick, topic, payload in lossy_hunt().messages
    ]
    with pytest.raises(RecordingError, match="tick 3"):
        export(replace(lossy_hunt(), messages=tuple(messages)), tmp_path / "out")


@FORMATS
def test_what_is_there_is_not_written_over(export, ticks_of, tmp_path):
    """The command looks first; a function that is called by a script does not overwrite either."""
    (tmp_path / "out").write_text("kept")
    with pytest.raises(FileExistsError):
        export(lossy_hunt(), tmp_path / "out")
    assert (tmp_path / "out").read_text() == "kept"
