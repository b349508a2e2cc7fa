"""Recordings as others read them: with mcap's own reader, whole or cut off at any byte."""

import json
import sys
from itertools import pairwise

import msgpack
import pytest
from helpers_waiting import completed
from helpers_world import RUN, arena, played, small
from mcap.exceptions import EndOfFile
from mcap.reader import make_reader
from mcap.records import Message
from mcap.stream_reader import StreamReader
from mcap.writer import Writer

from encircle.protocol.codec import decode
from encircle.world.recording.recorder import CHUNK_BYTES, Recorder
from encircle.world.recording.recording import RecordingError, read_recording
from encircle.world.recording.run_directory import start_recording, versions
from encircle.world.recording.schemas import KINDS

TICKS = 120
LIVELY = (f"ticks_max={TICKS}", "target.behaviour=flee", "channel.delay.mean_s=0.3", "tick_s=0.02")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A recorded run: its directory, and every (tick, key, payload) that was to be recorded."""
    path = tmp_path_factory.mktemp("recorded")
    messages = []
    recorder = start_recording(path, small(*LIVELY), RUN)

    def record(*message):
        messages.append(message)
        recorder.record(*message)

    played(arena(*LIVELY), RUN, record)
    recorder.close()
    return path, messages


def read_by_mcap(path):
    with open(path / "recording.mcap", "rb") as file:
        reader = make_reader(file, validate_crcs=True)
        return (
            reader.get_header(),
            reader.get_summary(),
            list(reader.iter_metadata()),
            list(reader.iter_messages(log_time_order=False)),
        )


def test_mcaps_reader_finds_every_message_as_it_was_in_order_and_in_simulated_time(recorded):
    path, messages = recorded
    header, summary, _, found = read_by_mcap(path)
    assert header.library == "encircle"
    assert summary.statistics.message_count == len(found) == len(messages)
    for (tick, key, payload), (schema, channel, message) in zip(messages, found, strict=True):
        assert f"encircle/{RUN}/{channel.topic}" == key
        assert message.data == payload
        assert message.sequence == tick
        assert message.log_time == message.publish_time == tick * 20_000_000
        assert channel.message_encoding == "msgpack"
        assert (schema.name, schema.encoding) == (key.rsplit("/", 1)[1], "jsonschema")


def test_every_channel_of_the_run_is_there_and_every_message_decodes(recorded):
    path, _ = recorded
    found = read_by_mcap(path)[3]
    counts = {}
    for _, channel, message in found:
        name = channel.topic.rsplit("/", 1)[1]
        decoded = decode(KINDS[name], message.data, RUN)
        assert getattr(decoded, "tick", 0) == message.sequence
        counts[channel.topic] = counts.get(channel.topic, 0) + 1
    robots = [f"robots/r{k}" for k in (1, 2, 3, 4)]
    assert counts == {
        **{f"{robot}/{name}": 1 for robot in robots for name in ("setup", "end")},
        **{f"{r}/{name}": TICKS for r in robots for name in ("observation", "pose", "command")},
        "world/radio": TICKS,
        "world/state": TICKS + 1,
    }


def test_metadata_says_scenario_seed_run_and_versions(recorded):
    path, _ = recorded
    [metadata] = read_by_mcap(path)[2]
    assert metadata.name == "encircle"
    scenario = json.loads(metadata.metadata["scenario"])
    assert scenario == small(*LIVELY).model_dump(mode="json")
    assert metadata.metadata["seed"] == "1"
    assert metadata.metadata["run"] == RUN
    assert json.loads(metadata.metadata["versions"]) == versions()


def test_the_reader_of_this_project_finds_the_same(recorded):
    path, messages = recorded
    recording = read_recording(path)
    assert recording.complete
    assert recording == read_recording(path / "recording.mcap")
    assert [(t, f"encircle/{RUN}/{topic}", p) for t, topic, p in recording.messages] == messages
    assert (recording.run, recording.seed) == (RUN, 1)
    assert recording.scenario == small(*LIVELY)
    poses = list(recording.of_channel("pose"))
    assert [(t, r) for t, r, _ in poses[:5]] == [
        (0, "r1"),
        (0, "r2"),
        (0, "r3"),
        (0, "r4"),
        (1, "r1"),
    ]


def test_messages_are_in_chunks_of_at_most_64_kib_and_a_message(recorded):
    path, messages = recorded
    chunks = read_by_mcap(path)[1].chunk_indexes
    largest = max(len(payload) for _, _, payload in messages)
    assert len(chunks) > 4
    assert all(c.uncompressed_size <= CHUNK_BYTES + largest + 10_000 for c in chunks)
    assert all(c.uncompressed_size >= CHUNK_BYTES for c in chunks[:-1])


def cut(path, length, tmp_path):
    whole = (path / "recording.mcap").read_bytes()
    shorter = tmp_path / "cut.mcap"
    shorter.write_bytes(whole[:length])
    return shorter


def places_to_cut(path):
    """Around the borders of every chunk, within them, and near both ends of the file."""
    chunks = read_by_mcap(path)[1].chunk_indexes
    size = (path / "recording.mcap").stat().st_size
    borders = [c.chunk_start_offset for c in chunks]
    borders += [c.chunk_start_offset + c.chunk_length for c in chunks]
    near = {b + k for b in borders for k in (-1, 0, 1, 5, 9, 17, 40)}
    return sorted(
        near | {(a + b) // 2 for a, b in pairwise(sorted(borders))} | {size - 1, size - 9}
    )


def test_a_recording_cut_off_anywhere_reads_up_to_its_last_whole_chunk(recorded, tmp_path):
    path, _ = recorded
    whole = read_recording(path)
    chunks = read_by_mcap(path)[1].chunk_indexes
    for length in places_to_cut(path):
        if length < chunks[0].chunk_start_offset:
            continue
        found = read_recording(cut(path, length, tmp_path))
        readable = sum(
            sum(count for _, count in _counts(path, chunk))
            for chunk in chunks
            if chunk.chunk_start_offset + chunk.chunk_length <= length
        )
        assert len(found.messages) == readable, length
        assert found.messages == whole.messages[:readable]
        assert not found.complete
        assert (found.seed, found.scenario) == (whole.seed, whole.scenario)


def _counts(path, chunk):
    """Messages of a chunk by channel, from the file's own index of them."""
    with open(path / "recording.mcap", "rb") as file:
        for channel, offset in chunk.message_index_offsets.items():
            file.seek(offset + 1 + 8 + 2)
            yield channel, int.from_bytes(file.read(4), "little") // 16


def test_a_recording_cut_off_within_its_head_is_refused(recorded, tmp_path):
    path, _ = recorded
    head = read_by_mcap(path)[1].metadata_indexes[0]
    for length in [*range(60), *range(60, head.offset + head.length, 97), head.offset + 20]:
        with pytest.raises(RecordingError, match="not a recording"):
            read_recording(cut(path, length, tmp_path))


@pytest.mark.parametrize(
    "content", [b"", b"no recording at all" * 99, b"\x89MCAP0\r\n", b"\xff" * 500]
)
def test_a_file_that_is_no_recording_is_refused_with_its_name(tmp_path, content):
    (tmp_path / "other.mcap").write_bytes(content)
    with pytest.raises(RecordingError, match=r"other\.mcap"):
        read_recording(tmp_path / "other.mcap")


def test_a_recording_of_another_program_is_refused(tmp_path):
    with open(tmp_path / "recording.mcap", "wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("x", "jsonschema", b"{}")
        channel = writer.register_channel("x", "json", schema)
        writer.add_message(channel, 0, msgpack.packb({}), 0)
        writer.finish()
    with pytest.raises(RecordingError, match="not a recording of this program"):
        read_recording(tmp_path)


@pytest.mark.parametrize("missing", ["seed", "run", "scenario"])
def test_a_recording_with_half_its_metadata_is_refused(tmp_path, missing):
    metadata = {"run": RUN, "seed": "1", "scenario": small().model_dump_json()}
    del metadata[missing]
    Recorder(tmp_path / "recording.mcap", 0.1, metadata).close()
    with pytest.raises(RecordingError):
        read_recording(tmp_path)


def test_a_missing_recording_is_refused(tmp_path):
    for path in (tmp_path, tmp_path / "nothing", tmp_path / "recording.mcap"):
        with pytest.raises(RecordingError, match="cannot be read"):
            read_recording(path)


def test_a_recording_is_never_overwritten(tmp_path):
    path = tmp_path / "recording.mcap"
    path.write_bytes(b"precious")
    with pytest.raises(FileExistsError):
        Recorder(path, 0.1, {})
    assert path.read_bytes() == b"precious"


def test_while_it_is_written_all_but_the_last_chunks_are_in_the_file_already(tmp_path):
    recorder = Recorder(
        tmp_path / "recording.mcap",
        0.1,
        {"run": RUN, "seed": "1", "scenario": small().model_dump_json()},
    )
    assert read_recording(tmp_path).messages == ()
    payload = b"x" * 1000
    for tick in range(1000):
        recorder.record(tick, f"encircle/{RUN}/robots/r1/pose", payload)
        if tick % 100 == 99:
            # A message takes 31 bytes besides its payload; one chunk may still be filling.
            on_its_way = CHUNK_BYTES // 1031 + 2
            found = read_recording(tmp_path)
            assert len(found.messages) >= tick - on_its_way
            assert not found.complete
    recorder.close()
    assert read_recording(tmp_path).complete


FILL = """
import resource, sys
from pathlib import Path
from encircle.world.recording.recorder import Recorder, RecordingStopped
resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))
recorder = Recorder(Path(sys.argv[1]), 0.1, {})
said = []
for tick in range(1000):
    try:
        recorder.record(tick, "encircle/x/world/state", bytes(1000))
    except RecordingStopped as error:
        said.append(str(error))
try:
    recorder.close()
except RecordingStopped as error:
    said.append(str(error))
print("\\n".join(said))
"""


def test_a_disk_that_is_full_stops_the_recording_at_its_last_whole_chunk(tmp_path):
    path = tmp_path / "recording.mcap"
    done = completed([sys.executable, "-c", FILL, str(path)])
    # Once when it happens, and once more at the end.
    assert done.stdout.splitlines() == [f"cannot record to {path}: File too large"] * 2
    ticks = []
    with open(path, "rb") as file:
        # Nothing half written is there to stumble over: the end of the file is one of a record.
        records = StreamReader(file).records
        with pytest.raises(EndOfFile):
            ticks.extend(record.sequence for record in records if isinstance(record, Message))
        assert file.tell() == path.stat().st_size
    assert ticks == list(range(len(ticks)))
    assert 100_000 < 1000 * len(ticks) < 200_000
