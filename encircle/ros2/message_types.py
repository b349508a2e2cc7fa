"""The messages of a release of ROS 2: their classes, their hashes, and their bytes (CDR).

They are those that rosbags has, which needs no ROS 2. It is imported here alone.
"""

from typing import Any

from encircle.extras import needing
from encircle.ros2.releases import NO_HASH, Release
from encircle.ros2.wire import Quality, Topic


class MessageTypes:
    """The types of one release; raises ``MissingExtra`` if rosbags is not installed."""

    def __init__(self, release: Release) -> None:
        with needing("ros2", "ros2"):
            from rosbags import typesys
        self._release = release
        self._store = typesys.get_typestore(typesys.Stores(release.store))

    def topic(self, name: str, type_name: str, quality: Quality | None = None) -> Topic:
        """A topic of messages of a type."""
        has_hashes = self._release.has_hashes
        type_hash = self._store.hash_rihs01(type_name) if has_hashes else NO_HASH
        return Topic(name, type_name, type_hash, quality or Quality())

    def make(self, type_name: str, *fields: Any, **named: Any) -> Any:
        """A message."""
        return self._store.types[type_name](*fields, **named)

    def encoded(self, message: Any) -> bytes:
        """A message as CDR, little-endian, with the four bytes that say so."""
        return bytes(self._store.serialize_cdr(message, message.__msgtype__))

    def decoded(self, payload: bytes, type_name: str) -> Any:
        """A message from CDR; ``ValueError`` if it is none of that type."""
        try:
            return self._store.deserialize_cdr(payload, type_name)
        except Exception as error:  # rosbags raises whatever its readers of bytes do
            raise ValueError(f"{len(payload)} bytes are no {type_name}: {error}") from None
