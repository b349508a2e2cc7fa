"""Recordings in a bundle: made again byte for byte, and altered ones are found."""

import json
from io import BytesIO

import pytest
from helpers_bundles import members_of, verified, with_hashes, written
from mcap.writer import CompressionType, Writer

from encircle.bundles import recordings
from encircle.bundles.bundle_file import BundleError
from encircle.bundles.recordings import read_bounded, recorded
from encircle.replay.replaying import replay
from encircle.studies.plan import Plan
from encircle.world.recording.recorder import Recorder
from encircle.world.recording.recording import read_recording


@pytest.fixture
def members(recorded_bundle):
    return members_of(recorded_bundle)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "altered.zip"


def name_of(members):
    (name,) = (name for name in members if name.endswith(".mcap"))
    return name


def test_a_recording_is_one_that_the_program_reads_and_checks(members, tmp_path, study):
    file = tmp_path / "recording.mcap"
    file.write_bytes(members[name_of(members)])
    recording = read_recording(file)
    assert recording.complete
    assert replay(recording).same
    cell, seed = (int(name_of(members)[:-5].split("-")[k]) for k in (1, 3))
    assert recording.seed == seed
    rate = recording.scenario.channel.loss.rate
    assert rate == Plan.model_validate(study.plan.model_dump()).axes[0].levels[cell]


def test_an_unaltered_recording_agrees(recorded_bundle, monkeypatch):
    found = verified(recorded_bundle, monkeypatch)
    assert found.count == 0
    assert found.numbers["recordings"] == {"of": 1, "replayed": 1}
    assert any("fresh brains decide the same" in line for line in found.agreed)


@pytest.mark.parametrize("share", [0.02, 0.3, 0.7, 0.999])
def test_a_byte_of_a_recording_is_found_wherever_it_is(members, path, monkeypatch, share):
    name = name_of(members)
    content = bytearray(members[name])
    content[int(share * len(content))] ^= 0x01
    members[name] = bytes(content)
    found = verified(written(with_hashes(members), path), monkeypatch)
    assert {one.where for one in found.differences} == {name}


def with_message_altered(content, channel, path):
    """The recording with one bit of a message altered, written whole by what writes recordings."""
    head, messages = read_bounded(content)
    recorder = Recorder(path, 0.1, head)
    is_altered = False
    for tick, topic, payload in messages:
        if not is_altered and tick > 3 and topic.endswith(channel):
            payload, is_altered = payload[:-1] + bytes([payload[-1] ^ 1]), True
        recorder.record(tick, f"encircle/study/{topic}", payload)
    recorder.close()
    assert is_altered
    return path.read_bytes()


@pytest.mark.parametrize("channel", ["/pose", "/command", "/observation", "/state", "/radio"])
def test_a_message_that_is_altered_and_covered_up_is_named(members, path, monkeypatch, channel):
    name = name_of(members)
    other = with_message_altered(members[name], channel, path.with_suffix(".mcap"))
    assert len(other) == len(members[name])
    members[name] = other
    found = verified(written(with_hashes(members), path), monkeypatch)
    first = found.differences[0]
    assert (first.where, first.what.split()[0]) == (name, "message")
    assert channel in first.given


def test_a_recording_of_another_run_is_found(members, path, monkeypatch, study):
    name = name_of(members)
    other = recorded(study.plan.scenario_of(0), 77)
    members[name] = other.content
    found = verified(written(with_hashes(members), path), monkeypatch)
    assert (found.differences[0].where, found.differences[0].what) == (
        name,
        "digest_header in its head",
    )


def test_a_recording_that_was_not_drawn_or_is_missing_is_named(members, path, monkeypatch):
    name = name_of(members)
    other = "recordings/cell-0-seed-99.mcap"
    members[other] = members.pop(name)
    found = verified(written(with_hashes(members), path), monkeypatch)
    assert {(one.where, one.given) for one in found.differences} == {
        (name, "missing"),
        (other, "a recording"),
    }


def test_a_recording_by_other_versions_is_compared_by_its_messages(members, path, monkeypatch):
    monkeypatch.setattr(recordings, "versions", lambda: {"python": "3.99"})
    found = verified(written(members, path), monkeypatch)
    assert found.count == 0
    assert any("made by other versions" in line for line in found.unchecked)


def test_a_chunk_that_would_have_to_be_unpacked_is_refused():
    out = BytesIO()
    writer = Writer(out, compression=CompressionType.ZSTD)
    writer.start()
    schema = writer.register_schema("s", "jsonschema", b"{}")
    channel = writer.register_channel("world/state", "msgpack", schema)
    writer.add_message(channel, 0, bytes(2**20), 0)
    writer.finish()
    with pytest.raises(BundleError, match="compressed"):
        read_bounded(out.getvalue())


@pytest.mark.parametrize("content", [b"", b"no recording", bytes(1000)])
def test_what_is_no_recording_is_told(content):
    with pytest.raises(BundleError, match="damaged"):
        read_bounded(content)


def test_head_and_messages_are_read_without_obeying_them(members):
    head, messages = read_bounded(members[name_of(members)])
    assert json.loads(head["scenario"])["ticks_max"] == 50
    assert len(messages) > 100
