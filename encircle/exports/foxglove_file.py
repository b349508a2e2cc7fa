"""A recording as an MCAP file for Foxglove and what reads its schemas."""

from pathlib import Path

from foxglove import Context, open_mcap
from foxglove.mcap import MCAPWriteOptions

from encircle.exports.foxglove_topics import HuntTopics
from encircle.exports.native_errors import write_failures
from encircle.protocol.process.interrupts import check
from encircle.scene.builder import frames_of_recording
from encircle.scene.stage import stage_of
from encircle.world.recording.recording import Recording


def export(recording: Recording, out: Path, *, beliefs: bool = True) -> None:
    """Write a recording for Foxglove to a new file.

    ``beliefs``: whether to work out what robots believed, which takes the longest. Raises
    ``RecordingError`` for a message that cannot be read.
    """
    stage = stage_of(recording.scenario, recording.seed, recording.run)
    context = Context()
    # By one thread, the bytes are the same on every machine.
    options = MCAPWriteOptions(compression_threads=0)
    with (
        write_failures(),
        open_mcap(out, context=context, writer_options=options) as file,
    ):
        about = {"run": stage.run, "seed": str(stage.seed), "title": stage.title}
        file.write_metadata("encircle", about)
        topics = HuntTopics(stage, context)
        topics.begin()
        for frame in frames_of_recording(recording, beliefs):
            check()
            topics.take(frame)
    topics.close()
