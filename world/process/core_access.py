"""The one way to a run's core for the threads of a world.

asyncio's thread watches and a thread of its own runs the rounds; both change the core. Whoever
changes it holds its lock until the messages that result were sent, so that they leave in order.
"""

import contextlib
import threading
from collections.abc import Callable

from encircle.protocol.errors import ConnectionClosed, ProtocolError
from encircle.protocol.zenoh.connection import ZenohConnection
from encircle.world.coordinator.failure_detector import RunCannotContinue
from encircle.world.coordinator.outgoing import Outgoing
from encircle.world.coordinator.real_time_core import RealTimeWorldCore
from encircle.world.coordinator.world_core import WorldCore
from encircle.world.process.sending import send, send_in_batches

Change = Callable[[], Outgoing]
"""Changes the core; gives the messages to send."""


class CoreAccess:
    """Changes one core and sends the messages that result.

    ``on_ended`` and ``on_failure`` (with the reason) are called, in whatever thread, when the run
    has ended by a change, and when it cannot go on.
    """

    def __init__(
        self,
        core: WorldCore | RealTimeWorldCore,
        connection: ZenohConnection,
        on_ended: Callable[[], object],
        on_failure: Callable[[str], object],
    ) -> None:
        self._rounds = core.rounds
        self._connection = connection
        self._on_ended = on_ended
        self._on_failure = on_failure
        self._lock = threading.Lock()

    def change(self, change: Change, key: str = "") -> None:
        """Make a change. ``key``: on which the message came that is the reason for it, if any."""
        try:
            self.change_in_thread(change)
        except ProtocolError as error:
            self._rounds.refusals.add(key, error)
        except RunCannotContinue as error:
            self._on_failure(str(error))
        except ConnectionClosed:
            pass
        if self._rounds.ended is not None:
            self._on_ended()

    def change_in_thread(self, *changes: Change) -> None:
        """Make changes, one after the other; errors are the caller's to handle."""
        with self._lock:
            for change in changes:
                outgoing = change()
                if outgoing:
                    send_in_batches(self._connection, outgoing)
                    send(self._connection, self._rounds.commit())
                    self._rounds.foresee()

    def fail(self, reason: str) -> None:
        """End the run as failed, and tell the robots."""
        with contextlib.suppress(ConnectionClosed), self._lock:
            send(self._connection, self._rounds.fail(reason))
