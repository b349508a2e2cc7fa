"""How the answers of nodes that are asked are read: each is one msgpack map of bounded length."""

from typing import Any, TypeVar

import msgpack

from encircle.protocol.errors import MalformedMessage, OversizedMessage

ENTRIES_MAX = 256
"""Of each map and each list; and how many of these an answer may have."""

Collection = TypeVar("Collection", list[Any], dict[Any, Any])


def unpacked_answer(payload: bytes, bytes_max: int) -> dict[Any, Any]:
    """The map of an answer, its entries unchecked; ``OversizedMessage`` or ``MalformedMessage``."""
    if len(payload) > bytes_max:
        raise OversizedMessage(f"an answer of {len(payload)} bytes, at most {bytes_max} may be")
    collections = 0

    def counted(collection: Collection) -> Collection:
        # An empty map is a byte, and takes eighty once unpacked.
        nonlocal collections
        collections += 1
        if collections > ENTRIES_MAX:
            raise ValueError(f"more than {ENTRIES_MAX} maps and lists")
        return collection

    try:
        body = msgpack.unpackb(
            payload,
            object_hook=counted,
            list_hook=counted,
            max_array_len=ENTRIES_MAX,
            max_map_len=ENTRIES_MAX,
        )
    except Exception as error:  # msgpack raises ValueError, TypeError, StackError and others
        raise MalformedMessage(f"the answer is not msgpack: {error or type(error)}") from error
    if type(body) is not dict:
        raise MalformedMessage("the answer is not a map")
    return body
