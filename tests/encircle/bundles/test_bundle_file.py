"""Bundles as files: the same bytes each time, and nothing happens by reading a stranger's."""

import json
import struct
import tracemalloc
import zipfile

import pytest
from helpers_bundles import members_of, packed, verified, written

from encircle.bundles import bundle_file
from encircle.bundles.bundle_file import (
    MANIFEST,
    PLAN,
    REGULAR_FILE,
    TABLE,
    BundleError,
    NotABundle,
    read_members,
    write_members,
)

FEW = {MANIFEST: b"{}", PLAN: b"{}", TABLE: b"cell\n"}


def zipped(path, members, **changes):
    """A zip of any members, in their order, as nothing here would write it."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, content in members:
            info = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
            info.compress_type = zipfile.ZIP_DEFLATED
            for key, value in ({"external_attr": REGULAR_FILE} | changes).items():
                setattr(info, key, value)
            file.writestr(info, content)
    return path


def test_the_same_study_gives_the_same_bytes(study, bundle, tmp_path):
    assert packed(study, tmp_path / "again.zip").read_bytes() == bundle.read_bytes()


def test_another_tool_reads_what_is_written_and_it_is_read_back(bundle):
    with zipfile.ZipFile(bundle) as file:
        assert file.testzip() is None
        by_zipfile = {name: file.read(name) for name in file.namelist()}
        assert {info.date_time for info in file.infolist()} == {(1980, 1, 1, 0, 0, 0)}
    assert members_of(bundle) == by_zipfile
    assert json.loads(by_zipfile[MANIFEST])["format"] == "encircle-bundle"


@pytest.mark.parametrize(
    "name",
    [
        "../evil.py",
        "/etc/evil",
        "policies/../../evil.py",
        "policies/..",
        "policies/a/../b.py",
        "policies//b.py",
        "policies/.ssh",
        "policies/a\\..\\b.py",
        "C:evil.py",
        "report/other.html",
        "report/figures/a.svg",
        "recordings/cell-0-seed-1.mcap/x",
        "bundle.json/",
        "other.json",
    ],
)
def test_a_member_whose_name_no_bundle_has_is_refused(tmp_path, name):
    path = zipped(tmp_path / "b.zip", [*FEW.items(), (name, b"x")])
    with pytest.raises(BundleError, match="no bundle has one of that name"):
        read_members(path)
    with pytest.raises(BundleError, match="no member of that name"):
        write_members(tmp_path / "c.zip", {**FEW, name: b"x"})


def test_a_link_is_in_no_bundle(tmp_path):
    """A zip can say that a member is a link, and other tools make one of it."""
    path = zipped(
        tmp_path / "b.zip",
        [*FEW.items(), ("policies/link.py", b"/etc/passwd")],
        external_attr=0o120777 << 16,
    )
    with pytest.raises(BundleError, match="is not what the zip says of it"):
        read_members(path)


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_a_member_that_stands_twice_is_refused(tmp_path):
    path = zipped(tmp_path / "b.zip", [*FEW.items(), (PLAN, b"other")])
    with pytest.raises(BundleError, match="stands twice"):
        read_members(path)


@pytest.mark.parametrize("name", [MANIFEST, PLAN, TABLE])
def test_what_lacks_a_part_is_no_bundle(tmp_path, name):
    rest = [(n, c) for n, c in FEW.items() if n != name]
    with pytest.raises(BundleError, match=f"has no {name}"):
        read_members(zipped(tmp_path / "b.zip", rest))


def test_a_bomb_is_not_unpacked(tmp_path):
    path = zipped(tmp_path / "b.zip", [*FEW.items(), ("policies/a.py", bytes(2**27))])
    assert path.stat().st_size < 2**20
    tracemalloc.start()
    try:
        with pytest.raises(BundleError, match="is larger than"):
            read_members(path)
        assert tracemalloc.get_traced_memory()[1] < 3 * bundle_file.MEMBER_BYTES_MAX
    finally:
        tracemalloc.stop()


def test_what_a_member_says_of_its_size_is_not_believed(tmp_path, monkeypatch):
    monkeypatch.setattr(bundle_file, "MEMBER_BYTES_MAX", 1000)
    path = zipped(tmp_path / "b.zip", [*FEW.items(), ("policies/a.py", bytes(4000))])
    content = path.read_bytes()
    path.write_bytes(content.replace(struct.pack("<L", 4000), struct.pack("<L", 10)))
    with pytest.raises(BundleError):
        read_members(path)


def test_all_members_together_have_a_limit(tmp_path, monkeypatch):
    monkeypatch.setattr(bundle_file, "BUNDLE_BYTES_MAX", 5000)
    members = [*FEW.items(), *((f"policies/a{k}.py", bytes(2000)) for k in range(3))]
    with pytest.raises(BundleError, match="is larger than"):
        read_members(zipped(tmp_path / "b.zip", members))
    with pytest.raises(BundleError, match="give fewer --recordings"):
        write_members(tmp_path / "c.zip", dict(members))


def test_too_many_members_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(bundle_file, "MEMBERS_MAX", 3)
    path = zipped(tmp_path / "b.zip", [*FEW.items(), ("policies/a.py", b"")])
    with pytest.raises(BundleError, match="has 4 members"):
        read_members(path)


def test_a_member_that_is_encrypted_is_refused(tmp_path):
    path = zipped(tmp_path / "b.zip", FEW.items())
    content = bytearray(path.read_bytes())
    for magic, offset in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        at = content.find(magic)
        content[at + offset] |= 1
    path.write_bytes(content)
    with pytest.raises(BundleError, match="must be plain or deflated"):
        read_members(path)


@pytest.mark.parametrize("content", [b"", b"no zip at all", bytes(100)])
def test_what_is_no_zip_is_no_bundle(tmp_path, content):
    path = tmp_path / "b.zip"
    path.write_bytes(content)
    with pytest.raises(NotABundle, match="no bundle: it is no zip file"):
        read_members(path)


def test_what_begins_as_a_zip_is_a_damaged_bundle(tmp_path):
    path = tmp_path / "b.zip"
    path.write_bytes(b"PK\x05\x06")
    with pytest.raises(BundleError, match="no whole bundle") as caught:
        read_members(path)
    assert not isinstance(caught.value, NotABundle)


def test_what_is_not_there_or_a_directory_is_told_apart_from_what_is_altered(tmp_path):
    for path in (tmp_path, tmp_path / "absent.zip"):
        with pytest.raises(NotABundle, match="cannot be read"):
            read_members(path)


@pytest.mark.parametrize(
    ("manifest", "match"),
    [
        (b"{}", "format must be"),
        (b"[]", "format must be"),
        (b'{"format": "encircle-bundle", "format_version": 2}', "format_version = 2"),
        (b"[" * 100_000, "cannot be read"),
        (b"\xff", "cannot be read"),
        (b'{"format": "encircle-bundle", "format_version": 1, "sample": 3}', "sample = 3"),
    ],
)
def test_a_manifest_of_another_kind_is_refused(tmp_path, monkeypatch, manifest, match):
    path = written({**FEW, MANIFEST: manifest}, tmp_path / "b.zip")
    with pytest.raises(BundleError, match=match):
        verified(path, monkeypatch)
