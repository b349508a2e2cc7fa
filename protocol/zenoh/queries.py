"""Asking other nodes over Zenoh: queries on a key, and a look at what is being sent."""

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import zenoh

from encircle.protocol.mailbox import now_us

FIRST_MESSAGES_MAX = 1024
"""How many keys ``first_messages`` keeps a message of."""


def serve_queries(session: zenoh.Session, key: str, reply: Callable[[], bytes]) -> Any:
    """Answer queries on a key, on Zenoh's own thread, as long as what is returned is kept."""

    def answer(query: zenoh.Query) -> None:
        query.reply(key, reply())

    return session.declare_queryable(key, zenoh.handlers.Callback(answer, indirect=False))


class QueryReply(NamedTuple):
    """The answer to a query, and when the query was sent and the answer came, by this clock."""

    payload: bytes
    asked_us: int
    arrival_us: int


def query(session: zenoh.Session, key: str, s_max: float) -> QueryReply | None:
    """Query a key once; None if nobody answers within ``s_max`` seconds."""
    asked_us = now_us()
    for reply in session.get(key, timeout=s_max):
        arrival_us = now_us()
        if reply.ok is not None:
            return QueryReply(reply.ok.payload.to_bytes(), asked_us, arrival_us)
    return None


def first_messages(session: zenoh.Session, expression: str, s_max: float) -> dict[str, bytes]:
    """The first message on each key that matches, of those sent in the next ``s_max`` seconds."""
    messages: dict[str, bytes] = {}

    def take(sample: zenoh.Sample) -> None:
        if len(messages) < FIRST_MESSAGES_MAX:
            messages.setdefault(str(sample.key_expr), sample.payload.to_bytes())

    callback = zenoh.handlers.Callback(take, indirect=False)
    subscriber = session.declare_subscriber(
        expression, callback, allowed_origin=zenoh.Locality.REMOTE
    )
    time.sleep(s_max)
    subscriber.undeclare()  # type: ignore[no-untyped-call]
    return dict(messages)
