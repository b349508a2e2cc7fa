"""Messages with their arrival times, from the threads that receive to the one that acts.

The arrival time of a message has to be known also while the node is busy with something else. So
the thread that receives it notes the time and puts both into a queue. The queue is bounded; a
message that finds no room is dropped and counted.
"""

import queue
import time

from encircle.protocol.errors import ConnectionClosed

MAIL_MAX = 16_384
TAKEN_MAX = 1024


def now_us() -> int:
    """The time by the clock of this machine: Unix time in us."""
    return time.time_ns() // 1000


class Mailbox:
    """A bounded queue of messages with their arrival times; ``dropped`` counts the others."""

    def __init__(self) -> None:
        self._mail: queue.SimpleQueue[tuple[int, str, bytes] | None] = queue.SimpleQueue()
        self.dropped = 0

    def put(self, key: str, payload: bytes, keep: bool = False) -> None:
        """Put a message in that arrives now; it is dropped and counted if there is no room.

        With ``keep`` it is put in all the same; the caller bounds the number of such messages.
        """
        if self._mail.qsize() >= MAIL_MAX and not keep:
            self.dropped += 1
        else:
            self._mail.put((now_us(), key, payload))

    def close(self) -> None:
        """Let ``take`` raise ``ConnectionClosed`` after the messages that are there."""
        self._mail.put(None)

    def take(self, wait_s: float) -> list[tuple[int, str, bytes]]:
        """The messages that are there, as ``(arrival_us, key, payload)``.

        Waits up to ``wait_s`` for the first one. Returns at most ``TAKEN_MAX`` messages, and none
        after an ``end``. Raises ``ConnectionClosed`` if it is closed and empty.
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
            raise ConnectionClosed("this connection is closed")
        self._mail.put(None)
        return messages
