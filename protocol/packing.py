"""What can be learned of msgpack bytes without unpacking them, and what unpacking would hide.

An empty map is one byte long and takes 80 unpacked: who believes a stranger's four million bytes
takes 340 million. And of an entry that a map has twice, unpacking leaves one.
"""

from typing import Any

import msgpack

_BINARY = b"\xc4\xc5\xc6"


class DuplicateName(Exception):
    """A name that comes twice in a map; the message is the name."""


def map_size(payload: bytes) -> int:
    """How many entries the header of a map announces. The payload must begin with one."""
    size = payload[0]
    if 0x80 <= size <= 0x8F:
        return size - 0x80
    return int.from_bytes(payload[1:3] if size == 0xDE else payload[1:5], "big")


def check_names(payload: bytes) -> None:
    """``DuplicateName`` for a name that a map has twice, at any depth, in a valid payload."""
    msgpack.unpackb(payload, use_list=False, object_pairs_hook=_unique)


def bytes_in_list(payload: bytes, name: str, item_bytes_min: int, fields_max: int) -> int:
    """How many of a map's bytes belong to the byte strings in the list that it has under a name.

    0 if that list has more items than can be that are ``item_bytes_min`` long. Raises whatever
    msgpack raises for what is no map.
    """
    walk = msgpack.Unpacker(max_buffer_size=len(payload))
    walk.feed(payload)
    packed_name: bytes = msgpack.packb(name)
    found = 0
    for _ in range(min(walk.read_map_header(), fields_max)):
        begin = walk.tell()
        walk.skip()
        if payload[begin : walk.tell()] != packed_name:
            walk.skip()
            continue
        count = walk.read_array_header()
        if count * item_bytes_min > len(payload):
            return 0
        for _ in range(count):
            begin = walk.tell()
            walk.skip()
            if payload[begin] in _BINARY:
                found += walk.tell() - begin
    return found


def _unique(pairs: list[tuple[Any, Any]]) -> dict[Any, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        names = [name for name, _ in pairs]
        raise DuplicateName(next(str(name) for name in names if names.count(name) > 1))
    return found
