"""A bundle as a file: a zip whose members, their order and their dates are fixed.

A bundle comes from strangers. Nothing of it is unpacked under a name that it chooses: members are
read into memory, one at a time, and only under names that a bundle can have. What is read has
limits, so that a small file cannot become a large one. A zip says twice what is in it, before each
member and in its directory, and tools differ in which they believe: here both must say the same,
and the packed bytes must be those of the member and no others.
"""

import hashlib
import os
import re
import struct
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import BinaryIO

MANIFEST, PLAN, TABLE = "bundle.json", "plan.json", "table.csv"
REPORT, NUMBERS = "report/report.html", "report/numbers.json"
REPORT_FOLDER, FIGURES_FOLDER = "report/", "report/figures/"
RECORDINGS_FOLDER, POLICIES_FOLDER, TRACES_FOLDER = "recordings/", "policies/", "traces/"

_PART = r"[A-Za-z0-9_][A-Za-z0-9_.\-]{0,99}"
NAME = re.compile(
    rf"{MANIFEST}|{PLAN}|{TABLE}|{REPORT}|{NUMBERS}"
    rf"|report/(?:summary|comparisons)\.csv|report/figures/{_PART}\.png"
    rf"|recordings/cell-[0-9]{{1,6}}-seed-[0-9]{{1,19}}\.mcap"
    rf"|policies/(?:{_PART}/){{0,8}}{_PART}\.py|traces/[0-9a-f]{{16}}\.(?:csv|parquet)"
)
"""The names that a bundle's members can have: none of them leads out of its directory.

Of policies, sources alone: what is compiled would run in place of the source that is there to read.
"""
MEMBERS_MAX = 2000
TABLE_BYTES_MAX, MEMBER_BYTES_MAX, BUNDLE_BYTES_MAX = 2**29, 2**26, 2**30
"""How large a table, any other member, and all of a bundle may be, packed and unpacked."""
JSON_BYTES_MAX = 2**24
"""How large manifest and plan may be: JSON takes many times its length in memory."""
HEADER = struct.Struct("<4s5H3I2H")
HEADER_BEGINS = b"PK\x03\x04"
HEADER_BYTES, ENTRY_BYTES, END_BYTES = HEADER.size, 46, 22
"""What a zip has before each member, and for each in its directory, besides texts; and its end."""
DATE = (1980, 1, 1, 0, 0, 0)
LEVEL = 6
REGULAR_FILE = 0o100644 << 16
ZIP_BEGINS = b"PK"

DAMAGED = (
    OSError,
    ValueError,
    zipfile.BadZipFile,
    zlib.error,
    EOFError,
    NotImplementedError,
    RuntimeError,
)
"""What is raised while a zip is read that is not whole."""

Members = Mapping[str, bytes]


class BundleError(ValueError):
    """A bundle that cannot be made or read; the message says which and why."""


class NotABundle(BundleError):
    """Something that is no bundle, or one of another format, and not an altered one."""


def write_members(path: Path, members: Members) -> None:
    """Write a bundle's members, sorted by name; the same members give the same bytes.

    The compressed bytes are zlib's: another release of it may pack the same members otherwise.
    """
    _refuse_large({name: len(content) for name, content in members.items()})
    with zipfile.ZipFile(path, "x", zipfile.ZIP_DEFLATED, compresslevel=LEVEL) as file:
        for name in sorted(members, key=lambda name: (name != MANIFEST, name)):
            if NAME.fullmatch(name) is None or ".." in name:
                raise BundleError(f"{name!r}: a bundle can have no member of that name")
            info = zipfile.ZipInfo(name, DATE)
            info.compress_type = zipfile.ZIP_DEFLATED
            info.external_attr, info.create_system = REGULAR_FILE, 3
            file.writestr(info, members[name])


def read_members(path: Path) -> dict[str, bytes]:
    """A bundle's members by name; ``BundleError`` if it is none, or has what none can have."""
    try:
        if path.exists() and not path.is_file() and not path.is_dir():
            raise NotABundle(f"{path} is no bundle: it is no regular file")
        content = path.open("rb")
    except OSError as error:
        raise NotABundle(f"{path} cannot be read: {error.strerror or error}") from None
    with content:
        size = os.fstat(content.fileno()).st_size
        if size > BUNDLE_BYTES_MAX:
            raise BundleError(f"{path}: is larger than {BUNDLE_BYTES_MAX} bytes")
        if content.read(len(ZIP_BEGINS)) != ZIP_BEGINS:
            raise NotABundle(f"{path} is no bundle: it is no zip file")
        try:
            with zipfile.ZipFile(content) as file:
                _refuse_bytes_of_no_member(path, file, size)
                return dict(_members(path, file, content))
        except BundleError:
            raise
        except DAMAGED as error:
            raise BundleError(f"{path} is no whole bundle: {error}") from None


def sha256(content: bytes) -> str:
    """SHA-256 in hex."""
    return hashlib.sha256(content).hexdigest()


def _refuse_bytes_of_no_member(path: Path, file: zipfile.ZipFile, size: int) -> None:
    """``BundleError`` if something stands before, between or after the members."""
    infos = sorted(file.infolist(), key=lambda info: info.header_offset)
    named = [(info, len(_bytes_of(info))) for info in infos]
    starts = [*(info.header_offset for info in infos), file.start_dir, size]
    ends = [i.header_offset + HEADER_BYTES + length + i.compress_size for i, length in named]
    directory_end = file.start_dir + sum(ENTRY_BYTES + length for _, length in named) + END_BYTES
    commented = file.comment or any(info.extra or info.comment for info in infos)
    if commented or starts != [0, *ends, directory_end]:
        raise BundleError(f"{path}: has bytes that belong to no member, which no bundle has")


def _bytes_of(info: zipfile.ZipInfo) -> bytes:
    return info.orig_filename.encode()


def _members(path: Path, file: zipfile.ZipFile, content: BinaryIO) -> Iterator[tuple[str, bytes]]:
    infos = file.infolist()
    names = [info.filename for info in infos]
    if len(infos) > MEMBERS_MAX:
        raise BundleError(f"{path}: has {len(infos)} members, at most {MEMBERS_MAX} are allowed")
    for info in infos:
        # The reader cuts a name where others may not.
        if NAME.fullmatch(info.orig_filename) is None or ".." in info.filename:
            name = info.orig_filename
            raise BundleError(f"{path}: member {name!r}: no bundle has one of that name")
        if names.count(info.filename) > 1:
            raise BundleError(f"{path}: member {info.filename!r}: stands twice")
        if info.flag_bits & 0x1 or info.compress_type not in (
            zipfile.ZIP_STORED,
            zipfile.ZIP_DEFLATED,
        ):
            raise BundleError(f"{path}: member {info.filename!r}: must be plain or deflated")
    for name in (MANIFEST, PLAN, TABLE):
        if name not in names:
            raise BundleError(f"{path}: has no {name}, so it is no bundle")
    left = BUNDLE_BYTES_MAX
    for info in infos:
        most = min(left, bytes_max(info.filename))
        if info.file_size > most:
            raise BundleError(f"{path}: member {info.filename!r}: is larger than {most} bytes")
        left -= info.file_size
        yield info.filename, _unpacked(path, info, content)


def _unpacked(path: Path, info: zipfile.ZipInfo, content: BinaryIO) -> bytes:
    """A member's bytes; ``BundleError`` unless all that the zip says of it is the same and true."""
    content.seek(info.header_offset)
    head, name = content.read(HEADER_BYTES), content.read(len(_bytes_of(info)))
    packed = content.read(info.compress_size)
    says = HEADER.unpack(head) if len(head) == HEADER_BYTES else ()
    sizes = (info.CRC, info.compress_size, info.file_size, len(_bytes_of(info)), 0)
    stored = info.compress_type == zipfile.ZIP_STORED
    unpacker = zlib.decompressobj(-zlib.MAX_WBITS)
    unpacked = packed if stored else unpacker.decompress(packed, info.file_size + 1)
    if (
        says[:1] != (HEADER_BEGINS,)
        or (says[2], says[3]) != (info.flag_bits, info.compress_type)
        or says[6:] != sizes
        or name != _bytes_of(info)
        or (info.flag_bits, info.external_attr) != (0, REGULAR_FILE)
        or len(unpacked) != info.file_size
        or zlib.crc32(unpacked) != info.CRC
        or not (stored or (unpacker.eof and not unpacker.unused_data))
    ):
        raise BundleError(
            f"{path} is no whole bundle: member {info.filename!r} is not what the zip says of it,"
            " or that says two things"
        )
    return unpacked


def bytes_max(name: str) -> int:
    """How many bytes a member may have."""
    if name == TABLE:
        return TABLE_BYTES_MAX
    return JSON_BYTES_MAX if name in (MANIFEST, PLAN) else MEMBER_BYTES_MAX


def _refuse_large(sizes: Mapping[str, int]) -> None:
    for name, size in sizes.items():
        if size > bytes_max(name):
            raise BundleError(f"{name}: has {size} bytes, a bundle's may have {bytes_max(name)}")
    if sum(sizes.values()) > BUNDLE_BYTES_MAX or len(sizes) > MEMBERS_MAX:
        raise BundleError(
            f"{len(sizes)} members of {sum(sizes.values())} bytes: a bundle may have"
            f" {MEMBERS_MAX} of {BUNDLE_BYTES_MAX}; give fewer --recordings"
        )
