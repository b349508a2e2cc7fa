"""A small reader of protobuf messages by the descriptors that an MCAP file has in it.

It knows of protobuf's encoding what Foxglove's schemas use, and nothing of foxglove-sdk.
"""

import json
import struct

from mcap.reader import make_reader

DOUBLE, FLOAT, BOOL, STRING, MESSAGE, BYTES = 1, 2, 8, 9, 11, 12
FIXED = {DOUBLE: "<d", FLOAT: "<f", 7: "<I", 15: "<i"}


def fields_of(data: bytes):
    """(number, value) of each field in a message: an integer, or the bytes of what has a length."""
    at = 0
    while at < len(data):
        tag, at = _varint(data, at)
        number, wire = tag >> 3, tag & 7
        if wire == 0:
            value, at = _varint(data, at)
        else:
            size = {1: 8, 5: 4}.get(wire)
            if size is None:
                assert wire == 2, f"wire type {wire}"
                size, at = _varint(data, at)
            value, at = data[at : at + size], at + size
        yield number, value


def _varint(data: bytes, at: int):
    value = shift = 0
    while True:
        byte = data[at]
        value, shift, at = value | (byte & 127) << shift, shift + 7, at + 1
        if byte < 128:
            return value, at


def _all(data: bytes, number: int):
    return [value for found, value in fields_of(data) if found == number]


class Descriptors:
    """The message types of a FileDescriptorSet, by their full names."""

    def __init__(self, data: bytes):
        self._types = {}
        for file in _all(data, 1):
            package = b"".join(_all(file, 2)).decode()
            for message in _all(file, 4):
                self._add(f".{package}", message)

    def _add(self, prefix: str, message: bytes):
        name = f"{prefix}.{_all(message, 1)[0].decode()}"
        self._types[name] = {}
        for field in map(dict, map(fields_of, _all(message, 2))):
            about = (field[1].decode(), field[5], field.get(4) == 3, field.get(6, b"").decode())
            self._types[name][field[3]] = about
        for nested in _all(message, 3):
            self._add(name, nested)

    def decoded(self, name: str, data: bytes) -> dict:
        """A message as a dictionary: repeated fields as lists, absent numbers and texts empty."""
        types, message = self._types[name], {}
        for field, kind, repeated, _ in types.values():
            if repeated:
                message[field] = []
            elif kind != MESSAGE:
                message[field] = {STRING: "", BYTES: b""}.get(kind, 0)
        for number, raw in fields_of(data):
            field, kind, repeated, inner = types[number]
            values = self._values(kind, inner, raw)
            if repeated:
                message[field] += values
            else:
                (message[field],) = values
        return message

    def _values(self, kind: int, inner: str, raw):
        if kind == MESSAGE:
            return [self.decoded(inner, raw)]
        if kind == STRING:
            return [raw.decode()]
        if kind in FIXED:
            return [value for (value,) in struct.iter_unpack(FIXED[kind], raw)]
        return [raw]


def decoded_messages(path):
    """(topic, log time in ns, schema name, message) of a file of protobuf messages and JSON."""
    known, found = {}, []
    with open(path, "rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            if channel.message_encoding == "json":
                value = json.loads(message.data)
            else:
                assert (channel.message_encoding, schema.encoding) == ("protobuf", "protobuf")
                if schema.id not in known:
                    known[schema.id] = Descriptors(schema.data)
                value = known[schema.id].decoded(f".{schema.name}", message.data)
            found.append((channel.topic, message.log_time, schema.name, value))
    return found
