"""What can be learned of msgpack bytes without unpacking them, and what unpacking would hide.

An empty map is one byte long and takes 80 bytes of memory once unpacked: a program that unpacks
four million bytes from a stranger uses 340 million. And if a map has an entry twice, unpacking
leaves one.
"""

from typing import Any

import msgpack

_BINARY = b"\xc4\xc5\xc6"
_MAP_HEADER_BYTES = {0xDE: 3, 0xDF: 5}


class DuplicateName(Exception):
    """A name that comes twice in a map; the message is the name."""


def map_size(payload: bytes) -> int:
    """How many entries the header of a map announces. The payload must begin with one."""
    size = payload[0]
    if 0x80 <= size <= 0x8F:
        return size - 0x80
    return int.from_bytes(payload[1:3] if size == 0xDE else payload[1:5], "big")


def map_header(entries: int) -> bytes:
    """The header of a map, in the shortest form."""
    header: bytes = msgpack.Packer().pack_map_header(entries)
    return header


def map_header_bytes(payload: bytes) -> int:
    """How many bytes the header of a map takes. The payload must begin with one."""
    return _MAP_HEADER_BYTES.get(payload[0], 1)


def check_names(payload: bytes) -> None:
    """``DuplicateName`` for a name that a map has twice, at any depth, in a valid payload."""
    msgpack.unpackb(payload, use_list=False, object_pairs_hook=_unique)


def bytes_in_list(payload: bytes, name: str, item_bytes_min: int, fields_max: int) -> int:
    """How many of a map's bytes belong to the byte strings in the list that it has under a name.

    0 if that list has more items than can be that are ``item_bytes_min`` long. Raises whatever
    msgpack raises for what is no map.
    """
    unpacker = msgpack.Unpacker(max_buffer_size=len(payload))
    unpacker.feed(payload)
    packed_name: bytes = msgpack.packb(name)
    binary_bytes = 0
    for _ in range(min(unpacker.read_map_header(), fields_max)):
        begin = unpacker.tell()
        unpacker.skip()
        if payload[begin : unpacker.tell()] != packed_name:
            unpacker.skip()
            continue
        items = unpacker.read_array_header()
        if items * item_bytes_min > len(payload):
            return 0
        for _ in range(items):
            begin = unpacker.tell()
            unpacker.skip()
            if payload[begin] in _BINARY:
                binary_bytes += unpacker.tell() - begin
    return binary_bytes


def _unique(pairs: list[tuple[Any, Any]]) -> dict[Any, Any]:
    mapping = dict(pairs)
    if len(mapping) != len(pairs):
        names = [name for name, _ in pairs]
        raise DuplicateName(next(str(name) for name in names if names.count(name) > 1))
    return mapping
