"""What waits for a node: the messages of one key expression, or of several in one queue.

Zenoh has a bounded channel for one subscription, which is waited on inside Zenoh. A process of
several robots has a subscription for each, and one thread that answers: their messages go into one
bounded queue of Python's. In both, who sends waits while it is full.
"""

import contextlib
import queue
from collections.abc import Collection
from typing import Any, Protocol

import zenoh

from encircle.protocol.errors import ConnectionClosed

CLOSED = "this connection is closed"
CLOSE_S_MAX = 1.0


class Inbox(Protocol):
    """Messages ``(key, payload)`` in the order in which they came."""

    def take(self) -> tuple[str, bytes]:
        """The next message, waiting for it; ``ConnectionClosed`` once the session is closed."""

    def take_waiting(self) -> tuple[str, bytes] | None:
        """The next message if one is there; ``ConnectionClosed`` as in ``take``."""

    def leave(self, expression: str) -> None:
        """Take nothing more of one of the expressions."""

    def close(self) -> None:
        """Wake whoever waits in ``take``; the session is closed."""


def inbox(session: zenoh.Session, expressions: Collection[str], count_max: int) -> Inbox:
    """The inbox of a session for messages of other nodes, with room for ``count_max``."""
    if len(expressions) == 1:
        return _Channel(session, next(iter(expressions)), count_max)
    return _Queue(session, expressions, count_max)


class _Channel:
    def __init__(self, session: zenoh.Session, expression: str, count_max: int) -> None:
        self._subscriber = session.declare_subscriber(
            expression,
            zenoh.handlers.FifoChannel(count_max),
            allowed_origin=zenoh.Locality.REMOTE,
        )

    def take(self) -> tuple[str, bytes]:
        try:
            sample = self._subscriber.recv()
        except zenoh.ZError as error:
            raise ConnectionClosed(str(error)) from None
        return str(sample.key_expr), sample.payload.to_bytes()

    def take_waiting(self) -> tuple[str, bytes] | None:
        try:
            sample = self._subscriber.try_recv()
        except zenoh.ZError as error:
            raise ConnectionClosed(str(error)) from None
        return None if sample is None else (str(sample.key_expr), sample.payload.to_bytes())

    def leave(self, _expression: str) -> None:
        """It is the only one, and ends with the session."""

    def close(self) -> None:
        """Zenoh itself wakes who waits."""


class _Queue:
    def __init__(
        self, session: zenoh.Session, expressions: Collection[str], count_max: int
    ) -> None:
        self._messages: queue.Queue[tuple[str, bytes] | None] = queue.Queue(count_max)
        # The default is a Python thread per subscriber.
        callback = zenoh.handlers.Callback(self._put, indirect=False)
        self._subscribers: dict[str, Any] = {
            expression: session.declare_subscriber(
                expression, callback, allowed_origin=zenoh.Locality.REMOTE
            )
            for expression in expressions
        }

    def _put(self, sample: zenoh.Sample) -> None:
        self._messages.put((str(sample.key_expr), sample.payload.to_bytes()))

    def take(self) -> tuple[str, bytes]:
        return self._checked(self._messages.get())

    def take_waiting(self) -> tuple[str, bytes] | None:
        try:
            return self._checked(self._messages.get_nowait())
        except queue.Empty:
            return None

    def _checked(self, message: tuple[str, bytes] | None) -> tuple[str, bytes]:
        if message is None:
            with contextlib.suppress(queue.Full):  # for whoever looks next
                self._messages.put_nowait(None)
            raise ConnectionClosed(CLOSED)
        return message

    def leave(self, expression: str) -> None:
        subscriber = self._subscribers.pop(expression, None)
        if subscriber is not None:
            with contextlib.suppress(zenoh.ZError):
                subscriber.undeclare()

    def close(self) -> None:
        # Whoever empties it makes room.
        with contextlib.suppress(queue.Full):
            self._messages.put(None, timeout=CLOSE_S_MAX)
