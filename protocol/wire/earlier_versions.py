"""Messages of version 3 of the wire as messages of version 4: for recordings, which are kept.

Version 4 added fields that may be left out (``say`` and ``estimate`` of Pose, ``policy_parameters``
and ``policy_source`` of Setup). So a message of version 3 is one of version 4 as soon as its ``v``
is 4, and so are the packets in an observation's inbox. Only the last byte of each ``v`` is changed:
lengths, order and number formats stay as their sender chose them, and with them the digest.

On a connection nothing of this is done: who speaks another version is refused there.
"""

import msgpack

from encircle.protocol.wire.packing import map_header_bytes

VERSION_BEFORE, VERSION_SINCE = 3, 4
_NOT_OLD = b"\xa1v" + bytes([VERSION_SINCE])


def upgraded(payload: bytes) -> bytes:
    """A message of version 3 as one of version 4; whatever else it is, as it is.

    Bytes that are no message are returned unchanged too: decoding them says what is wrong.
    """
    if not payload or payload.startswith(_NOT_OLD, map_header_bytes(payload)):
        return payload
    places = _version_places(payload, has_inbox=True)
    if not places:
        return payload
    changed = bytearray(payload)
    for place in places:
        changed[place] = VERSION_SINCE
    return bytes(changed)


def _version_places(payload: bytes, has_inbox: bool) -> list[int]:
    """Where the last byte of each ``v`` that is 3 stands, those of packets in an inbox included.

    None at all if the message is not of version 3, or cannot be read.
    """
    places: list[int] = []
    version = None
    try:
        unpacker = msgpack.Unpacker(max_buffer_size=len(payload))
        unpacker.feed(payload)
        for _ in range(unpacker.read_map_header()):
            name = unpacker.unpack()
            if name == "v":
                version = unpacker.unpack()
                places.append(unpacker.tell() - 1)
            elif name == "inbox" and has_inbox:
                for _ in range(unpacker.read_array_header()):
                    places += _places_in_packet(unpacker)
            else:
                unpacker.skip()
    except Exception:  # msgpack raises ValueError, TypeError, StackError and others
        return []
    return places if type(version) is int and version == VERSION_BEFORE else []


def _places_in_packet(unpacker: msgpack.Unpacker) -> list[int]:
    packet = unpacker.unpack()
    if type(packet) is not bytes:
        return []
    begin = unpacker.tell() - len(packet)
    return [begin + place for place in _version_places(packet, has_inbox=False)]
