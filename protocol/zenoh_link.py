"""A link over Eclipse Zenoh: the only module that knows Zenoh.

Messages for this party come in through one bounded first-in-first-out channel, waited on by the
thread that calls ``receive``; on this library a blocking wait costs two thirds of what waking an
asyncio loop does (``docs/architecture.md`` has the figures). Publishers are declared once per key,
express and blocking on congestion, so that nothing is dropped silently. Liveliness comes in through
a callback on one of Zenoh's threads, which only hands it over.
"""

import json
import threading
from collections.abc import Callable, Iterable
from typing import Any

import zenoh

from protocol.errors import LinkClosed

INBOX_MAX = 4096
CONNECT_RETRY_MS = 20
CONNECT_RETRY_MS_MAX = 200


class LinkError(Exception):
    """The link cannot be opened; the message says where and why."""


class ZenohLink:
    """A ``protocol.links.Link`` over one Zenoh session.

    ``listens``: whether this end waits at ``endpoint`` or connects to it. ``takes``: key expression
    of the messages to receive; what this session sends itself never comes back.
    """

    def __init__(
        self, endpoint: str, listens: bool, takes: str, connect_s_max: float = 30.0
    ) -> None:
        zenoh.init_log_from_env_or("off")
        try:
            self._session = zenoh.open(_config(endpoint, listens, connect_s_max))
        except zenoh.ZError as error:
            doing = "listen on" if listens else "connect to"
            raise LinkError(f"cannot {doing} {endpoint}: {_first_line(error)}") from None
        self.endpoint = endpoint
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._tokens: list[zenoh.LivelinessToken] = []
        self._watchers: list[Any] = []
        self._closing = threading.Lock()
        self._inbox = self._session.declare_subscriber(
            takes, zenoh.handlers.FifoChannel(INBOX_MAX), allowed_origin=zenoh.Locality.REMOTE
        )

    @property
    def session(self) -> zenoh.Session:
        """The session itself, for what a link does not offer."""
        return self._session

    def send(self, key: str, payload: bytes) -> None:
        """Publish; blocks while the transport is congested. ``LinkClosed`` after ``close``."""
        try:
            publisher = self._publishers.get(key)
            if publisher is None:
                publisher = self._publishers[key] = self._session.declare_publisher(
                    key, express=True, congestion_control=zenoh.CongestionControl.BLOCK
                )
            publisher.put(payload)
        except zenoh.ZError as error:
            raise LinkClosed(str(error)) from None

    def receive(self) -> tuple[str, bytes]:
        """The next message; ``LinkClosed`` once ``close`` was called."""
        try:
            sample = self._inbox.recv()
        except zenoh.ZError as error:
            raise LinkClosed(str(error)) from None
        return str(sample.key_expr), sample.payload.to_bytes()

    def announce(self, key: str) -> None:
        """Declare a liveliness token: it is gone when this process is, however it ends."""
        self._tokens.append(self._session.liveliness().declare_token(key))

    def watch(self, expression: str, tell: Callable[[str, bool], None]) -> None:
        """Call ``tell(key, alive)`` for tokens that are there, come or go, from another thread."""

        def handed_over(sample: zenoh.Sample) -> None:
            tell(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        # Called on Zenoh's own thread. The default is a Python thread per subscriber, which may
        # outlive the session and then keeps the process from ending.
        callback = zenoh.handlers.Callback(handed_over, indirect=False)
        self._watchers.append(
            self._session.liveliness().declare_subscriber(expression, callback, history=True)
        )

    def close(self) -> None:
        """Close the session and wake whoever waits in ``receive``; may be called twice.

        What was sent before is flushed.
        """
        with self._closing:
            if not self._session.is_closed():
                self._session.close()  # type: ignore[no-untyped-call]


def _config(endpoint: str, listens: bool, connect_s_max: float) -> zenoh.Config:
    """Explicit endpoints only: nothing is scouted for, nothing listens that was not asked to."""
    config = zenoh.Config()
    retry = {
        "period_init_ms": CONNECT_RETRY_MS,
        "period_max_ms": CONNECT_RETRY_MS_MAX,
        "period_increase_factor": 2,
    }
    settings: Iterable[tuple[str, object]] = (
        ("mode", "peer" if listens else "client"),
        ("scouting/multicast/enabled", False),
        ("scouting/gossip/enabled", False),
        ("transport/shared_memory/enabled", False),
        ("listen/endpoints", [endpoint] if listens else []),
        ("connect/endpoints", [] if listens else [endpoint]),
        ("connect/timeout_ms", int(connect_s_max * 1000)),
        ("connect/exit_on_failure", True),
        ("connect/retry", retry),
    )
    for name, value in settings:
        config.insert_json5(name, json.dumps(value))
    return config


def _first_line(error: BaseException) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]
