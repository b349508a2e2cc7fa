"""What waits to be looked at: bounded, and what is too much goes as a whole.

Who looks on may be slower than the run. To drop single messages would spoil every round. So when
there is no room, all that waits is dropped: some rounds are missed, and the next are whole again.
"""

import threading
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")

ITEMS_MAX = 16_384
BYTES_MAX = 64 * 1024 * 1024


class Inbox(Generic[T]):
    """A queue between a thread that must not wait and one that may be slow.

    ``size_of``: how many bytes an item takes. ``overflows``: how often all that waited was dropped.
    """

    def __init__(
        self, size_of: Callable[[T], int], items_max: int = ITEMS_MAX, bytes_max: int = BYTES_MAX
    ) -> None:
        self.overflows = 0
        self._size_of = size_of
        self._items_max, self._bytes_max = items_max, bytes_max
        self._items: deque[T] = deque()
        self._bytes = 0
        self._closed = False
        self._changed = threading.Condition()

    def put(self, item: T) -> None:
        """Put an item in; never waits."""
        with self._changed:
            if self._closed:
                return
            if len(self._items) >= self._items_max or self._bytes >= self._bytes_max:
                self._items.clear()
                self._bytes = 0
                self.overflows += 1
            self._items.append(item)
            self._bytes += self._size_of(item)
            self._changed.notify()

    def take(self, wait_s: float) -> list[T]:
        """All that is there; waits up to ``wait_s`` s for the first item, or until ``close``."""
        with self._changed:
            self._changed.wait_for(lambda: self._items or self._closed, max(0.0, wait_s))
            items = list(self._items)
            self._items.clear()
            self._bytes = 0
            return items

    def close(self) -> None:
        """Take nothing more in, and wake who waits; what is there can still be taken."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
