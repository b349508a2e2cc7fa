"""What a link is, and the one that stays in memory.

A link carries ``(key, payload)`` pairs between parties that know nothing else of each other. The
shells of robot and world are written against ``Connection`` and run unchanged over either kind.
"""

import queue
from collections.abc import Callable, Iterable
from fnmatch import fnmatchcase
from typing import Protocol

from encircle.protocol.errors import ConnectionClosed

QUEUE_MAX = 65_536


class Connection(Protocol):
    """Ordered delivery of messages by key, as long as both ends live; see ``send`` for losses."""

    def send(self, key: str, payload: bytes) -> None:
        """Hand a message over; may block for a bounded time.

        What finds no room on its way may be lost, but not a ``setup`` or ``end``, nor what is sent
        once more, unchanged: so whoever waits for an answer in vain says the same again.
        """

    def receive(self) -> tuple[str, bytes]:
        """Wait for the next message; raises ``ConnectionClosed`` once the link is closed."""

    def subscribe(self, expression: str, tell: Callable[[str, bytes], None]) -> Callable[[], None]:
        """Also call ``tell(key, payload)`` from another thread for messages of others.

        ``expression``: a key in which ``*`` stands for any part. Calling what is returned ends it.
        """

    def drop_when_congested(self) -> None:
        """From now on drop rather than wait, what is sent again as well, but no setup or end."""

    def close(self) -> None:
        """Close the link and wake whoever waits in ``receive``. May be called twice."""


class MemoryHub:
    """Joins memory links: what one sends reaches every other that takes its key."""

    def __init__(self) -> None:
        self._connections: list[MemoryConnection] = []

    def connection(self, prefixes: Iterable[str]) -> "MemoryConnection":
        """A new link that takes every key starting with one of ``prefixes``."""
        connection = MemoryConnection(self, tuple(prefixes))
        self._connections.append(connection)
        return connection

    def deliver(self, sender: "MemoryConnection", key: str, payload: bytes) -> None:
        """Put a message into the queue of each link that takes it, but its sender's."""
        for connection in self._connections:
            if connection is sender or connection.closed:
                continue
            if key.startswith(connection.prefixes):
                connection.inbox.put((key, payload), timeout=10.0)
            for expression, tell in list(connection.subscriptions.values()):
                if fnmatchcase(key, expression):
                    tell(key, payload)


class MemoryConnection:
    """A ``Connection`` inside one process: for tests of the shells, and hunts without processes."""

    def __init__(self, hub: MemoryHub, prefixes: tuple[str, ...]) -> None:
        self._hub = hub
        self.closed = False
        self.prefixes = prefixes
        self.inbox: queue.Queue[tuple[str, bytes] | None] = queue.Queue(QUEUE_MAX)
        self.subscriptions: dict[object, tuple[str, Callable[[str, bytes], None]]] = {}

    def send(self, key: str, payload: bytes) -> None:
        """Deliver at once to every other link that takes the key."""
        if self.closed:
            raise ConnectionClosed("this link is closed")
        self._hub.deliver(self, key, payload)

    def receive(self) -> tuple[str, bytes]:
        """The next message, waiting for it; ``ConnectionClosed`` when closed and empty."""
        item = self.inbox.get()
        if item is None:
            self.inbox.put(None)
            raise ConnectionClosed("this link is closed")
        return item

    def subscribe(self, expression: str, tell: Callable[[str, bytes], None]) -> Callable[[], None]:
        """Have ``tell`` called for what others send on such keys; the sender's thread calls it."""
        listener = object()
        self.subscriptions[listener] = expression, tell

        def end() -> None:
            self.subscriptions.pop(listener, None)

        return end

    def drop_when_congested(self) -> None:
        """Nothing to do: there is always room."""

    def close(self) -> None:
        """Close, and wake the receiver."""
        if not self.closed:
            self.closed = True
            self.inbox.put(None)
