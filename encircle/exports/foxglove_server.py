"""A running hunt for Foxglove: a WebSocket server with the topics that a file for it has.

The server has threads of its own and waits for no client. One that is too slow misses messages, the
oldest first. A client that comes later sees the hunt from then on; what stays the same is said
again whenever somebody subscribes. Clients can only look on.
"""

import threading
from collections.abc import Iterable
from typing import Any

from foxglove import Context, start_server
from foxglove.websocket import Capability, ServerListener

from encircle.exports.foxglove_topics import HuntTopics
from encircle.scene.frame import Frame
from encircle.scene.stage import Stage

LOOPBACK = "127.0.0.1"
PORT = 8765
"""Where Foxglove looks for a server by default."""


class ServerFailed(Exception):
    """The server cannot be; the message says why."""


class FoxgloveServer:
    """Serves one hunt from when it is made until ``stop``.

    ``host`` and ``port``: where it listens, port 0 for any that is free. Raises ``ServerFailed`` if
    it cannot.
    """

    def __init__(self, stage: Stage, host: str = LOOPBACK, port: int = PORT) -> None:
        self._subscriptions = _Subscriptions()
        context = Context()
        self._topics = HuntTopics(stage, context)
        try:
            self._server = start_server(
                name=f"{stage.title}, run {stage.run}",
                host=host,
                port=port,
                capabilities=[Capability.Time],
                server_listener=self._subscriptions,
                context=context,
                session_id=stage.run,
            )
        except (RuntimeError, OSError, ValueError) as error:
            self._topics.close()
            where = f"{host}:{port}"
            raise ServerFailed(f"Foxglove's server cannot listen at {where}: {error}") from None
        self.address = f"ws://{f'[{host}]' if ':' in host else host}:{self._server.port}"

    @property
    def subscriptions(self) -> int:
        """How many subscriptions to topics there are now, of all clients."""
        return self._subscriptions.count

    def take(self, frames: Iterable[Frame]) -> None:
        """Send what there is to see at some ticks to whoever has subscribed to it."""
        for frame in frames:
            self._server.broadcast_time(self._topics.time_ns(frame.tick))
            if self._subscriptions.are_new():
                self._topics.begin(frame.tick)
            self._topics.take(frame)

    def stop(self) -> None:
        """Serve no longer, and drop what is on its way to clients; may be called twice."""
        self._server.stop()
        self._topics.close()


class _Subscriptions(ServerListener):
    """Counts subscriptions, and notes that there are new ones."""

    def __init__(self) -> None:
        self._new = threading.Event()
        self._lock = threading.Lock()
        self._count = 0

    def on_subscribe(self, client: Any, channel: Any) -> None:  # noqa: ARG002  # given by name
        with self._lock:
            self._count += 1
        self._new.set()

    def on_unsubscribe(self, client: Any, channel: Any) -> None:  # noqa: ARG002  # given by name
        with self._lock:
            self._count -= 1

    @property
    def count(self) -> int:
        """How many there are now."""
        return self._count

    def are_new(self) -> bool:
        """Whether there are any since this was asked last."""
        found = self._new.is_set()
        self._new.clear()
        return found
