"""Bundles that mean one thing to who reads them and another to who verifies them; and bombs."""

import json
import os
import re
import struct
import warnings
import zipfile
import zlib

import pytest
from helpers_bundles import members_of, verified, with_hashes, written

from encircle.bundles.bundle_file import (
    JSON_BYTES_MAX,
    MANIFEST,
    NUMBERS,
    PLAN,
    REPORT,
    BundleError,
    NotABundle,
    read_members,
    write_members,
)
from encircle.bundles.reruns import NotRun, do
from encircle.bundles.table_text import equal
from encircle.figures.picture_comparison import picture_problem
from encircle.studies.tasks import Task


@pytest.fixture
def members(bundle):
    return members_of(bundle)


def found_in(members, folder, monkeypatch):
    """What differs in a bundle whose hashes all fit, as lines."""
    found = verified(written(with_hashes(members), folder / "b.zip"), monkeypatch, rows=0)
    return [one.line for one in found.differences]


@pytest.mark.parametrize(
    "name",
    [
        "policies/__pycache__/helper.cpython-311.pyc",
        "policies/helper.pyc",
        "policies/helper.so",
        "policies/helper",
    ],
)
def test_what_would_run_in_place_of_the_source_that_is_read_is_in_no_bundle(tmp_path, name):
    with pytest.raises(BundleError, match="can have no member of that name"):
        write_members(tmp_path / "b.zip", {name: b"compiled"})
    with zipfile.ZipFile(tmp_path / "other.zip", "w") as file:
        file.writestr(name, b"compiled")
    with pytest.raises(BundleError, match=r"no bundle has one of that name|belong to no member"):
        read_members(tmp_path / "other.zip")


@pytest.mark.parametrize(
    ("member", "written_first"),
    [
        (NUMBERS, '"cells": [],'),
        (PLAN, '"seeds": 1000, "title": "Another",'),
        (MANIFEST, '"code": "deadbeefdeadbeef",'),
    ],
)
def test_a_name_that_comes_twice_is_not_read_as_its_last(
    members, tmp_path, monkeypatch, member, written_first
):
    members = with_hashes(members)
    text = members[member].decode()
    members[member] = text.replace("{", "{" + written_first, 1).encode()
    if member != MANIFEST:
        lines = found_in(members, tmp_path, monkeypatch)
        assert any("comes twice in one map" in line for line in lines)
        return
    with pytest.raises(BundleError, match="'code' comes twice in one map"):
        verified(written(members, tmp_path / "b.zip"), monkeypatch, rows=0)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_a_manifest_in_another_encoding_is_none(members, tmp_path, monkeypatch, encoding):
    members = with_hashes(members)
    members[MANIFEST] = members[MANIFEST].decode().encode(encoding)
    with pytest.raises(BundleError, match="cannot be read"):
        verified(written(members, tmp_path / "b.zip"), monkeypatch, rows=0)


def test_what_only_the_bundle_has_is_a_difference_whatever_it_says(members, tmp_path, monkeypatch):
    tree = json.loads(members[NUMBERS])
    tree["extra"] = "nothing"
    next(part for part in tree.values() if isinstance(part, list)).append("nothing")
    members[NUMBERS] = json.dumps(tree).encode()
    assert len(found_in(members, tmp_path, monkeypatch)) == 2


def test_a_number_that_no_float_can_hold_is_a_difference(members, tmp_path, monkeypatch):
    text = re.sub(r"\b[0-9]+\.[0-9]+", f"{10**400}", members[NUMBERS].decode(), count=1)
    members[NUMBERS] = text.encode()
    assert len(found_in(members, tmp_path, monkeypatch)) == 1


@pytest.mark.parametrize(("key", "value"), [("cells", 2.0), ("runs", 8.0), ("format_version", 1.0)])
def test_a_count_is_a_whole_number(members, tmp_path, monkeypatch, key, value):
    tree = json.loads(members[MANIFEST])
    assert tree[key] == value
    members[MANIFEST] = json.dumps({**tree, key: value}).encode()
    if key == "format_version":
        with pytest.raises(NotABundle, match=r"format_version = 1\.0"):
            found_in(members, tmp_path, monkeypatch)
        return
    (line,) = found_in(members, tmp_path, monkeypatch)
    assert line.startswith(f"{MANIFEST}, {key}: {value}")


@pytest.mark.parametrize(
    "drawn_with", [{"matplotlib": "9.9 <b>", "numpy": "2"}, {"matplotlib": "3"}, {"numpy": 3}]
)
def test_what_drew_the_figures_is_versions(members, tmp_path, monkeypatch, drawn_with):
    tree = json.loads(members[MANIFEST])
    members[MANIFEST] = json.dumps({**tree, "drawn_with": drawn_with}).encode()
    with pytest.raises(BundleError, match="drawn_with"):
        found_in(members, tmp_path, monkeypatch)


def chunk(kind, content):
    checked = zlib.crc32(kind + content)
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", checked)


@pytest.mark.parametrize(
    ("kind", "content"),
    [
        (b"acTL", struct.pack(">II", 1, 0)),
        (b"gAMA", struct.pack(">I", 1000)),
        (b"iCCP", b"x"),
        (b"fdAT", b"frame"),
    ],
)
def test_a_picture_with_a_further_part_is_another_one(members, kind, content):
    name = next(name for name in members if name.endswith(".png"))
    picture = members[name]
    at = picture.index(b"IDAT") - 4
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        problem = picture_problem(picture[:at] + chunk(kind, content) + picture[at:], picture)
    assert repr(kind) in problem


def test_a_picture_of_other_numbers_for_its_colours_is_another_one(members):
    """With 16 bits to a colour, viewers differ in what is transparent."""
    name = next(name for name in members if name.endswith(".png"))
    picture = members[name]
    size = picture[16:24]
    head = chunk(b"IHDR", size + bytes((16, 2, 0, 0, 0)))
    forged = picture[:8] + head + chunk(b"tRNS", bytes(6)) + picture[33:]
    assert "b'IHDR'" in picture_problem(forged, picture)
    twice = picture[:33] + picture[8:33] + picture[33:]
    assert picture_problem(twice, picture) == "has not the parts that ours has"


def test_a_picture_ends_at_its_end_and_is_whole(members):
    name = next(name for name in members if name.endswith(".png"))
    picture = members[name]
    assert "after its end" in picture_problem(picture + chunk(b"tEXt", b"more"), picture)
    assert "damaged" in picture_problem(picture[:-6], picture)
    assert "no PNG" in picture_problem(b"GIF89a", picture)


def test_a_page_of_nothing_but_brackets_is_compared_at_once(members, tmp_path, monkeypatch):
    # A quadratic search would take hours; the limit on each test ends it.
    members[REPORT] += b"<" * 2**21
    assert len(found_in(members, tmp_path, monkeypatch)) == 1


def test_json_has_a_limit_of_its_own(tmp_path, members):
    members[PLAN] = b"0" * (JSON_BYTES_MAX + 1)
    with pytest.raises(BundleError, match=f"may have {JSON_BYTES_MAX}"):
        written(members, tmp_path / "b.zip")


def test_numbers_far_longer_than_ours_are_not_looked_through(members, tmp_path, monkeypatch):
    members[NUMBERS] += b" " * (2 * len(members[NUMBERS]) + 2**20)
    (line,) = found_in(members, tmp_path, monkeypatch)
    assert line.startswith(f"{NUMBERS}: {len(members[NUMBERS])} bytes")


def test_many_names_are_looked_through_at_once(members, tmp_path, monkeypatch):
    # A search for each would take hours; the limit on each test ends it.
    names = ", ".join(f'"{k}": 0' for k in range(400_000))
    members = with_hashes(members)
    members[MANIFEST] = f'{{{names}, "7": 1}}'.encode()
    with pytest.raises(BundleError, match="'7' comes twice in one map"):
        verified(written(members, tmp_path / "b.zip"), monkeypatch, rows=0)


def repacked(bundle, path, change):
    """A bundle of which a member is packed otherwise; ``change`` gets its content and headers."""
    with zipfile.ZipFile(bundle) as file:
        infos = file.infolist()
        contents = {info.filename: file.read(info) for info in infos}
    out, directory = b"", b""
    for info in infos:
        name, content = info.filename.encode(), contents[info.filename]
        says = {"crc": zlib.crc32(content), "size": len(content)}
        central = dict(says)
        packer = zlib.compressobj(6, zlib.DEFLATED, -zlib.MAX_WBITS)
        packed = packer.compress(content) + packer.flush()
        if info.filename == REPORT:
            packed = change(content, packed, says, central)
        fields = (20, 0, 8, 0, 33)
        at = len(out)
        sizes = (says["crc"], len(packed), says["size"], len(name), 0)
        out += struct.pack("<4s5H3I2H", b"PK\x03\x04", *fields, *sizes) + name + packed
        sizes = (central["crc"], len(packed), central["size"], len(name), 0, 0, 0, 0)
        head = (b"PK\x01\x02", 3 << 8 | 20, *fields, *sizes, 0o100644 << 16, at)
        directory += struct.pack("<4s6H3I5H2I", *head) + name
    count = len(infos)
    end = (b"PK\x05\x06", 0, 0, count, count, len(directory), len(out), 0)
    path.write_bytes(out + directory + struct.pack("<4s4H2IH", *end))
    return path


def unaltered(_content, packed, _says, _central):
    return packed


def with_a_longer_page(content, _packed, says, _central):
    packer = zlib.compressobj(6, zlib.DEFLATED, -zlib.MAX_WBITS)
    longer = content + b"<script>document.body.innerHTML = 'forged'</script>"
    says.update(crc=zlib.crc32(longer), size=len(longer))
    return packer.compress(longer) + packer.flush()


def with_bytes_behind_it(_content, packed, _says, _central):
    return packed + b"hidden" * 100


def with_another_size_before_it(_content, packed, says, _central):
    says["size"] -= 1
    return packed


def test_a_bundle_that_is_packed_anew_is_read(bundle, tmp_path):
    assert read_members(repacked(bundle, tmp_path / "b.zip", unaltered)) == read_members(bundle)


@pytest.mark.parametrize(
    "change", [with_a_longer_page, with_bytes_behind_it, with_another_size_before_it]
)
def test_a_zip_says_one_thing_of_a_member_and_that_is_so(bundle, tmp_path, change):
    path = repacked(bundle, tmp_path / "b.zip", change)
    # What reads the directory alone finds nothing wrong.
    with zipfile.ZipFile(path) as file:
        assert file.testzip() is None
    with pytest.raises(BundleError, match="is not what the zip says of it"):
        read_members(path)


@pytest.mark.parametrize("where", ["before", "after", "comment"])
def test_a_zip_holds_members_and_nothing_else(bundle, tmp_path, where):
    path = tmp_path / "b.zip"
    path.write_bytes(bundle.read_bytes())
    read_members(path)
    if where == "comment":
        with zipfile.ZipFile(path, "a") as file:
            file.comment = b"all is well"
    else:
        content = bundle.read_bytes()
        path.write_bytes(b"PK" + content if where == "before" else content + b"more")
    with pytest.raises(BundleError, match=r"belong to no member|no whole bundle"):
        read_members(path)


def test_what_is_no_regular_file_is_not_waited_for(tmp_path):
    pipe = tmp_path / "pipe.zip"
    os.mkfifo(pipe)
    for path in (pipe, os.devnull, "/dev/zero"):
        with pytest.raises(NotABundle, match="no regular file"):
            read_members(type(pipe)(path))


def test_code_that_raises_what_ctrl_c_raises_is_not_taken_for_it(monkeypatch):
    def interrupt(_task):
        raise KeyboardInterrupt

    monkeypatch.setattr("encircle.bundles.reruns.run_task", interrupt)
    answer = do("", Task(3, {}, "{}", (1, 2), (), ()))
    assert answer == NotRun(3, 2, 0, "KeyboardInterrupt")


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [(0.0, -0.0, False), (-0.0, -0.0, True), (float("nan"), float("nan"), True), (1, 1.0, True)],
)
def test_equal_is_to_the_last_bit(one, other, same):
    assert equal(one, other) is same
