"""Recordings cut off at a byte drawn at random, exported to every format.

What of such a file is whole is worked out here from its bytes, by the rules of MCAP.
"""

import random
import struct

import pytest
from helpers_export_readers import TICKS_OF

import encircle
from encircle.cli.exporting import FORMATS
from encircle.cli.main import main
from encircle.world.recording import recorder

CHANGES = ['channel.loss={model="bernoulli", rate=0.4}', "ticks_max=12"]
SMALL = {
    "mp4": ["--size", "480x270", "--fps", "10"],
    "gif": ["--size", "480x270", "--fps", "10"],
    "png": ["--size", "480x270"],
}
CUTS, CUTS_NIGHTLY = 4, 20
METADATA, CHANNEL, MESSAGE, CHUNK = 0x0C, 0x04, 0x05, 0x06
MAGIC_BYTES, FIXED_BYTES = 8, 8 + 8 + 8 + 4
"""Of a file's beginning; of a chunk before the name of its compression."""


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A recording in many small chunks, so that cuts differ in what they leave."""
    out = tmp_path_factory.mktemp("runs") / "hunt"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(recorder, "CHUNK_BYTES", 4096)
        encircle.run("sim1", link="memory", overrides=CHANGES, out=out)
    return (out / "recording.mcap").read_bytes()


def records(data):
    """Operation and content of the records that are there with all their bytes."""
    at = 0
    while at + 9 <= len(data):
        operation, size = struct.unpack_from("<BQ", data, at)
        if at + 9 + size > len(data):
            return
        yield operation, data[at + 9 : at + 9 + size]
        at += 9 + size


def what_is_whole(data):
    """Whether the head is there, and tick and topic of every message in a whole chunk."""
    has_head, topics, messages = False, {}, []
    for operation, content in records(data[MAGIC_BYTES:]):
        has_head |= operation == METADATA
        if operation != CHUNK:
            continue
        (length,) = struct.unpack_from("<I", content, FIXED_BYTES)
        assert length == 0, "chunks are not compressed"
        for kind, inner in records(content[FIXED_BYTES + 4 + 8 :]):
            if kind == CHANNEL:
                number, _, length = struct.unpack_from("<HHI", inner)
                topics[number] = inner[8 : 8 + length].decode()
            elif kind == MESSAGE:
                number, tick = struct.unpack_from("<HI", inner)
                messages.append((tick, topics[number]))
    return has_head, messages


def cuts_of(name, whole, count):
    """Bytes to cut off at, every fourth one in the file's first chunk or before it."""
    draws = random.Random(f"cuts {name}")
    return [draws.randrange(len(whole) if k % 4 else 6000) for k in range(count)]


@pytest.mark.parametrize(
    "count", [CUTS, pytest.param(CUTS_NIGHTLY, marks=pytest.mark.nightly)], ids=["few", "many"]
)
@pytest.mark.parametrize("name", FORMATS)
def test_what_is_whole_is_exported_or_one_line_says_why_not(name, count, whole, tmp_path, capsys):
    for cut in cuts_of(name, whole, count):
        directory = tmp_path / f"cut-{cut}"
        directory.mkdir()
        recording, out = directory / "recording.mcap", tmp_path / f"out-{cut}"
        recording.write_bytes(whole[:cut])
        before = recording.stat()
        status = main(
            ["export", str(recording), "--to", name, "--out", str(out), *SMALL.get(name, ())]
        )
        printed, told = capsys.readouterr()
        told = [line for line in told.splitlines(keepends=True) if not line.startswith("drawn: ")]
        has_head, messages = what_is_whole(whole[:cut])
        assert len(told) == 1, (cut, told)
        if has_head:
            last = max((tick for tick, _ in messages), default=0)
            assert (
                f"{recording} is cut off or damaged: it can be read up to tick {last}," in told[0]
            )
            assert (status, printed.count("\n")) == (0, 1), cut
            states = [tick for tick, topic in messages if topic == "world/state"]
            if name in TICKS_OF:
                assert TICKS_OF[name](out) == (states or [0]), cut
        else:
            assert told[0].startswith(f"encircle: {recording} is not a recording"), cut
            assert (status, printed) == (2, ""), cut
        assert out.exists() == has_head, cut
        assert recording.read_bytes() == whole[:cut], cut
        assert recording.stat().st_mtime_ns == before.st_mtime_ns, cut
        assert list(directory.iterdir()) == [recording], cut
    assert all(path.name.startswith(("cut-", "out-")) for path in tmp_path.iterdir())
