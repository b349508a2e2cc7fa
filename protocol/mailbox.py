"""Messages with the times at which they came: between threads that receive and one that acts.

What came when has to be known also while the party is busy with something else, so whoever receives
puts a stamp on it and hands it over. The queue is bounded; what finds no room is dropped, counted.
"""

import queue
import time

from encircle.protocol.errors import ConnectionClosed

MAIL_MAX = 16_384
TAKEN_MAX = 1024


def now_us() -> int:
    """What the clock of this machine shows: Unix time in us."""
    return time.time_ns() // 1000


class Mailbox:
    """Messages with their times of arrival, from the threads that receive to the one that acts."""

    def __init__(self) -> None:
        self._mail: queue.SimpleQueue[tuple[int, str, bytes] | None] = queue.SimpleQueue()
        self.dropped = 0

    def put(self, key: str, payload: bytes, keep: bool = False) -> None:
        """Take a message in that comes now; it is dropped, and counted, if there is no room.

        ``keep``: not even then. It is for the caller to bound the number of these.
        """
        if self._mail.qsize() >= MAIL_MAX and not keep:
            self.dropped += 1
        else:
            self._mail.put((now_us(), key, payload))

    def close(self) -> None:
        """Nothing comes any more."""
        self._mail.put(None)

    def take(self, wait_s: float) -> list[tuple[int, str, bytes]]:
        """What is there, waiting for the first; empty after ``wait_s``.

        May raise ``ConnectionClosed``.

        At most ``TAKEN_MAX`` at once, and an ``end`` is the last of them.
        """
        messages: list[tuple[int, str, bytes]] = []
        try:
            item = self._mail.get(timeout=max(0.0, wait_s))
            while item is not None:
                messages.append(item)
                if len(messages) == TAKEN_MAX or item[1].endswith("/end"):
                    return messages
                item = self._mail.get_nowait()
        except queue.Empty:
            return messages
        if not messages:
            raise ConnectionClosed("this link is closed")
        self._mail.put(None)
        return messages
