"""How the answers of nodes that are asked are read: each is one msgpack map of bounded length."""

from typing import Any

import msgpack

from encircle.protocol.errors import MalformedMessage, OversizedMessage


def unpacked_answer(payload: bytes, bytes_max: int) -> dict[Any, Any]:
    """The map of an answer, its entries unchecked; ``OversizedMessage`` or ``MalformedMessage``."""
    if len(payload) > bytes_max:
        raise OversizedMessage(f"an answer of {len(payload)} bytes, at most {bytes_max} may be")
    try:
        body = msgpack.unpackb(payload)
    except Exception as error:  # msgpack raises ValueError, TypeError, StackError and others
        raise MalformedMessage(f"the answer is not msgpack: {error or type(error)}") from error
    if type(body) is not dict:
        raise MalformedMessage("the answer is not a map")
    return body
