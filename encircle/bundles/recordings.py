"""Recordings of some runs of a study: made for a bundle, and looked at when it is verified.

A recording is made by running the run once more. When it is verified it is made again; equal bytes
need no second look. Where the bytes differ, the messages are compared one by one. A recording of a
stranger is read with limits: nothing in it is decompressed, for this program's recordings are not
compressed, and what its head says is compared and not obeyed.
"""

import io
import json
import tempfile
import warnings
from contextlib import suppress
from itertools import zip_longest
from pathlib import Path
from typing import NamedTuple

from mcap.records import Channel, Chunk, Message, Metadata
from mcap.stream_reader import StreamReader, breakup_chunk

from encircle.bundles.bundle_file import MEMBER_BYTES_MAX, RECORDINGS_FOLDER, BundleError
from encircle.protocol.plugins import PluginFailed, error_line
from encircle.protocol.process.log import bounded_log
from encircle.replay.replaying import replay
from encircle.runner.memory import RunEndedByPlugin, run_in_memory
from encircle.studies.running import RUN
from encircle.world.arena.engine import build
from encircle.world.loading.load import load
from encircle.world.recording.recorder import Recorder
from encircle.world.recording.recording import UNREADABLE, Recording
from encircle.world.recording.run_directory import versions
from encircle.world.scenario.model import Scenario, digest_header

VERSIONS, HEAD = "versions", "encircle"
Messages = list[tuple[int, str, bytes]]


class RecordedRun(NamedTuple):
    """A run and its recording as bytes; ``failure``: how the run failed, empty if it did not."""

    content: bytes
    digest: str
    failure: str


class RecordingJob(NamedTuple):
    """A recording to be looked at: of which run it is, as the plan has it, and its bytes."""

    cell: int
    seed: int
    scenario: str
    content: bytes


class RecordingFindings(NamedTuple):
    """What came of it: the digest of the run made again, and what differs.

    ``differences``: (what, given, recomputed). ``same_bytes``: whether it was made again byte for
    byte; if not, and nothing differs, other versions have recorded the same messages.
    """

    cell: int
    seed: int
    digest: str
    differences: tuple[tuple[str, str, str], ...]
    same_bytes: bool
    decisions: int


def recording_member(cell: int, seed: int) -> str:
    """The member that a recording has in a bundle."""
    return f"{RECORDINGS_FOLDER}cell-{cell}-seed-{seed}.mcap"


def recorded(scenario: Scenario, seed: int) -> RecordedRun:
    """Run it in memory and record it; the same run gives the same bytes."""
    scenario = scenario.model_copy(update={"seed": seed})
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "recording.mcap"
        recorder = Recorder(path, scenario.tick_s, _head(scenario, seed))
        try:
            failure, digest = _run(scenario, seed, recorder)
        finally:
            recorder.close()
        return RecordedRun(path.read_bytes(), digest, failure)


def look_at(job: RecordingJob) -> RecordingFindings:
    """Make a recording again, compare it, and replay it with fresh brains."""
    scenario = load(json.loads(job.scenario))
    again = recorded(scenario, job.seed)
    same_bytes = again.content == job.content
    differences: list[tuple[str, str, str]] = []
    decisions = 0
    try:
        head, messages = read_bounded(job.content)
        if not same_bytes:
            differences += _compared(head, messages, *read_bounded(again.content))
        # Equal messages are replayed as well: other brains than the run's may decide otherwise.
        said, decisions = _replayed(scenario, job.seed, messages, complete=not again.failure)
        differences += said
    except BundleError as error:
        differences.append(("recording", str(error), "a whole recording"))
    return RecordingFindings(
        job.cell, job.seed, again.digest, tuple(differences), same_bytes, decisions
    )


def read_bounded(content: bytes) -> tuple[dict[str, str], Messages]:
    """The head and the messages of a recording; ``BundleError`` if it is not a whole one."""
    head: dict[str, str] = {}
    channels: dict[int, str] = {}
    messages: Messages = []
    try:
        reader = StreamReader(
            io.BytesIO(content),
            emit_chunks=True,
            validate_crcs=True,
            record_size_limit=MEMBER_BYTES_MAX,
        )
        for record in reader.records:
            if isinstance(record, Chunk) and record.compression:
                raise BundleError(f"a chunk is compressed ({record.compression[:20]!r})")
            inner = breakup_chunk(record, True) if isinstance(record, Chunk) else [record]
            for one in inner:
                if isinstance(one, Channel):
                    channels[one.id] = one.topic
                elif isinstance(one, Message):
                    messages.append((one.sequence, channels[one.channel_id], one.data))
                elif isinstance(one, Metadata) and one.name == HEAD:
                    head = dict(one.metadata)
    except BundleError:
        raise
    except UNREADABLE as error:
        raise BundleError(f"it is damaged: {error_line(error)}") from None
    return head, messages


def _run(scenario: Scenario, seed: int, recorder: Recorder) -> tuple[str, str]:
    try:
        result = run_in_memory(build(scenario, seed), RUN, bounded_log(), recorder.record)
    except RunEndedByPlugin as error:
        return str(error), error.result.digest
    return "", result.digest


def _head(scenario: Scenario, seed: int) -> dict[str, str]:
    return {
        "run": RUN,
        "seed": str(seed),
        "scenario": scenario.model_dump_json(),
        "digest_header": digest_header(scenario, seed),
        VERSIONS: json.dumps(versions()),
    }


def _compared(
    head: dict[str, str], messages: Messages, own_head: dict[str, str], own: Messages
) -> list[tuple[str, str, str]]:
    """The first differences of a recording from the one that was made again."""
    for key in sorted({*head, *own_head} - {VERSIONS}):
        if head.get(key) != own_head.get(key):
            return [(f"{key} in its head", str(head.get(key)), str(own_head.get(key)))]
    for number, (theirs, mine) in enumerate(zip_longest(messages, own)):
        if theirs != mine:
            return [(f"message {number}", _message_text(theirs), _message_text(mine))]
    if head.get(VERSIONS) == own_head.get(VERSIONS):
        return [("bytes besides its messages", "others", "those of the run made again")]
    return []


def _message_text(message: tuple[int, str, bytes] | None) -> str:
    if message is None:
        return "none"
    tick, topic, payload = message
    return f"{topic} at tick {tick}: {payload[:24].hex()}{'...' if len(payload) > 24 else ''}"


def _replayed(
    scenario: Scenario, seed: int, messages: Messages, complete: bool
) -> tuple[list[tuple[str, str, str]], int]:
    """What fresh brains decide otherwise, and how many decisions were compared."""
    recording = Recording(Path("recording"), scenario, seed, RUN, tuple(messages), complete)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            check = replay(recording)
    except PluginFailed as error:
        # As in the run: a policy that fails has decided nothing more.
        return ([], 0) if not complete else ([("replay", "a whole run", str(error))], 0)
    except Exception as error:
        # The messages are a stranger's.
        return [("replay", "a recording", error_line(error))], 0
    if check.same:
        return [], check.compared
    with suppress(IndexError):
        tick, robot, channel = check.differences[0]
        count = len(check.differences)
        where = f"{channel} of {robot} at tick {tick}"
        return [("replay", where, f"decided otherwise, the first of {count}")], check.compared
    return [("replay", "no decisions", "at least one")], 0
