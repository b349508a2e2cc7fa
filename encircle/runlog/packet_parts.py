"""Parts of a pose packet that may be empty, and how many bytes each takes of it.

What is left is the pose itself: who, when, where, the detection and the intent.
"""

from collections.abc import Sequence
from typing import TypeAlias

import msgpack

PARTS = ("say", "relayed", "estimate")
"""Fields of ``encircle.protocol.messages.Pose``, in the order of ``parts_bytes``."""
PAYLOAD, RELAYED, ESTIMATE = range(len(PARTS))
PartsBytes: TypeAlias = tuple[int, ...]
NO_PARTS: PartsBytes = (0,) * len(PARTS)
EMPTY_LIST = b"\x90"
_SAY, _RELAYED, _ESTIMATE = (part.encode() for part in PARTS)


def parts_bytes(packet: bytes) -> PartsBytes:
    """The bytes in a decodable packet of each of ``PARTS``, with the field's name.

    An empty part counts as 0, also if the packet has its name, which then belongs to the pose.
    """
    if _has_clearly_none(packet):
        return NO_PARTS
    body = msgpack.unpackb(packet, use_list=False)
    if not any(body.get(part) for part in PARTS):
        return NO_PARTS
    sizes = dict.fromkeys(PARTS, 0)
    for name, size_bytes in _entries(packet):
        if body.get(name) and name in sizes:
            sizes[name] = size_bytes
    return tuple(sizes.values())


def _has_clearly_none(packet: bytes) -> bool:
    """Whether all parts are empty, as of most packets: much faster than to unpack them.

    False says nothing: the names may also be in other fields.
    """
    if _SAY in packet or _ESTIMATE in packet:
        return False
    # An empty list behind the name; no text has that byte behind a letter.
    return packet.count(_RELAYED) == packet.count(_RELAYED + EMPTY_LIST)


def _entries(packet: bytes) -> Sequence[tuple[str, int]]:
    """Each field's name, and the bytes that it and its value take, however they are packed."""
    unpacker = msgpack.Unpacker()
    unpacker.feed(packet)
    entries = []
    for _ in range(unpacker.read_map_header()):
        start = unpacker.tell()
        name = unpacker.unpack()
        unpacker.skip()
        entries.append((name, unpacker.tell() - start))
    return entries
