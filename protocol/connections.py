"""What a connection is, and the kind that stays in memory.

A connection carries ``(key, payload)`` pairs between nodes that know nothing else of each other.
The shells of robot and world are written against ``Connection`` and run unchanged over either kind.
"""

import queue
from collections.abc import Callable, Iterable
from fnmatch import fnmatchcase
from typing import Protocol, TypeAlias

from encircle.protocol.errors import ConnectionClosed

Handler: TypeAlias = Callable[[str, bytes], None]

QUEUE_MAX = 65_536


class Connection(Protocol):
    """Ordered delivery of messages by key, as long as both ends live; see ``send`` for losses."""

    def send(self, key: str, payload: bytes) -> None:
        """Hand a message over; may block for a bounded time.

        A message that finds no room in a queue may be lost, except a ``setup``, an ``end``, and a
        message that is sent a second time, unchanged. So a node that waits for an answer in vain
        sends the same message again.
        """

    def receive(self) -> tuple[str, bytes]:
        """Wait for the next message; raises ``ConnectionClosed`` once this is closed."""

    def subscribe(self, expression: str, handler: Handler) -> Callable[[], None]:
        """Also call ``handler(key, payload)`` from another thread for messages of other nodes.

        ``expression``: a key in which ``*`` stands for any part. The function that is returned ends
        the subscription.
        """

    def drop_when_congested(self) -> None:
        """From now on drop messages rather than wait, repeated ones too, but no setup or end."""

    def close(self) -> None:
        """Close the connection and wake the thread in ``receive``. May be called twice."""


class MemoryHub:
    """Joins connections in memory: a message reaches every other one that takes its key."""

    def __init__(self) -> None:
        self._connections: list[MemoryConnection] = []

    def connection(self, prefixes: Iterable[str]) -> "MemoryConnection":
        """A new connection that takes every key starting with one of ``prefixes``."""
        connection = MemoryConnection(self, tuple(prefixes))
        self._connections.append(connection)
        return connection

    def deliver(self, sender: "MemoryConnection", key: str, payload: bytes) -> None:
        """Put a message into the queue of each connection that takes it, but its sender's."""
        for connection in self._connections:
            if connection is sender or connection.closed:
                continue
            if key.startswith(connection.prefixes):
                connection.inbox.put((key, payload), timeout=10.0)
            for expression, handler in list(connection.subscriptions.values()):
                if fnmatchcase(key, expression):
                    handler(key, payload)


class MemoryConnection:
    """A ``Connection`` inside one process: for tests of the shells, and hunts without processes."""

    def __init__(self, hub: MemoryHub, prefixes: tuple[str, ...]) -> None:
        self._hub = hub
        self.closed = False
        self.prefixes = prefixes
        self.inbox: queue.Queue[tuple[str, bytes] | None] = queue.Queue(QUEUE_MAX)
        self.subscriptions: dict[object, tuple[str, Handler]] = {}

    def send(self, key: str, payload: bytes) -> None:
        """Deliver at once to every other connection that takes the key."""
        if self.closed:
            raise ConnectionClosed("this connection is closed")
        self._hub.deliver(self, key, payload)

    def receive(self) -> tuple[str, bytes]:
        """The next message, waiting for it; ``ConnectionClosed`` when closed and empty."""
        item = self.inbox.get()
        if item is None:
            self.inbox.put(None)
            raise ConnectionClosed("this connection is closed")
        return item

    def subscribe(self, expression: str, handler: Handler) -> Callable[[], None]:
        """Have ``handler`` called by the sender's thread for messages on such keys."""
        subscription = object()
        self.subscriptions[subscription] = expression, handler

        def end() -> None:
            self.subscriptions.pop(subscription, None)

        return end

    def drop_when_congested(self) -> None:
        """Nothing to do: there is always room."""

    def close(self) -> None:
        """Close, and wake the receiver."""
        if not self.closed:
            self.closed = True
            self.inbox.put(None)
