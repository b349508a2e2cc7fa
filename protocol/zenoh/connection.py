"""A node's connection over Eclipse Zenoh: messages in and out, tokens, queries.

Messages for this node come in through one bounded first-in-first-out channel, waited on by the
thread that calls ``receive``; on this library a blocking wait costs two thirds of what waking an
asyncio loop does (``docs/architecture.md`` has the figures). Publishers are declared once per key
and priority (``encircle.protocol.zenoh.lanes``), express and blocking on congestion; a run by the
clock asks for the opposite, since there one node that is cut off would hold up all others.
Liveliness comes in through a callback on one of Zenoh's threads, which only hands it over.
"""

import contextlib
import threading
from collections.abc import Callable, Collection, Iterator
from typing import Any

import zenoh

from encircle.protocol.errors import ConnectionClosed, ProtocolError
from encircle.protocol.mailbox import now_us
from encircle.protocol.zenoh.endpoints import ConnectionFailed, Endpoints
from encircle.protocol.zenoh.inbox import inbox
from encircle.protocol.zenoh.lanes import ROUND, SURE, message_priority
from encircle.protocol.zenoh.liveliness import TokenFilter, subscribe_alive
from encircle.protocol.zenoh.node_info import NodeInfo, decode_info, info_replier
from encircle.protocol.zenoh.queries import query, serve_queries
from encircle.protocol.zenoh.session import CLOSE_S_MAX, close_session, open_session

__all__ = ["ConnectionFailed", "ZenohConnection"]

INBOX_MAX = 4096
INBOX_BYTES_MAX = 256 * 1024 * 1024
"""What may wait for this node, in messages and in bytes; when it is full, senders wait."""


class ZenohConnection:
    """A ``encircle.protocol.connections.Connection`` over one Zenoh session.

    ``subscription``: key expression of the messages to receive, or several; what this session sends
    itself never comes back. ``check``: called before anything is received, and may raise to go no
    further. ``is_open``: whether no certificates and no rules of others limit which keys may be
    used. Raises ``ConnectionFailed``.
    """

    def __init__(
        self,
        endpoints: Endpoints,
        subscription: str | Collection[str],
        check: Callable[[zenoh.Session], None] = lambda _session: None,
    ) -> None:
        self._session = open_session(endpoints)
        # Rules that others have written may know no key but those of every version.
        self.is_open = endpoints.identity is None and endpoints.config is None
        try:
            # Before: what nobody receives would soon fill the inbox, and then hold up the others.
            check(self._session)
        except BaseException:
            close_session(self._session)
            raise
        self._publishers: dict[tuple[str, str], zenoh.Publisher] = {}
        self._last_payloads: dict[str, bytes] = {}
        self._waits = True
        self._declared: dict[str, Any] = {}
        self._watchers: list[Any] = []
        self._closing = threading.Lock()
        self._closed = threading.Event()
        # Zenoh bounds a channel by count alone, and a message by its bytes.
        count_max = min(INBOX_MAX, INBOX_BYTES_MAX // endpoints.message_bytes_max)
        expressions = (subscription,) if isinstance(subscription, str) else subscription
        self._inbox = inbox(self._session, expressions, count_max)

    @property
    def session(self) -> zenoh.Session:
        """The session itself, for what a connection does not offer."""
        return self._session

    def send(self, key: str, payload: bytes) -> None:
        """Publish; blocks while the transport is congested, or drops after ``drop_when_congested``.

        What becomes of it on its way: ``encircle.protocol.zenoh.lanes``.
        ``ConnectionClosed`` after ``close``.
        """
        chosen = message_priority(key, self._waits and self._last_payloads.get(key) == payload)
        self._last_payloads[key] = payload
        try:
            publisher = self._publishers.get((key, chosen))
            if publisher is None:
                publisher = self._publishers[key, chosen] = self._publisher(key, chosen)
            publisher.put(payload)
        except zenoh.ZError as error:
            raise ConnectionClosed(str(error)) from None

    def _publisher(self, key: str, chosen: str) -> zenoh.Publisher:
        control = zenoh.CongestionControl
        return self._session.declare_publisher(
            key,
            express=True,
            priority=_priority(chosen),
            congestion_control=control.BLOCK if self._waits or chosen == SURE else control.DROP,
        )

    def receive(self) -> tuple[str, bytes]:
        """The next message; ``ConnectionClosed`` once ``close`` was called."""
        return self._inbox.take()

    def waiting(self) -> Iterator[tuple[str, bytes]]:
        """The messages that are there now, one by one; ``ConnectionClosed`` as in ``receive``."""
        while (message := self._inbox.take_waiting()) is not None:
            yield message

    def subscribe(self, expression: str, tell: Callable[[str, bytes], None]) -> Callable[[], None]:
        """As in ``Connection``; ``tell`` is called on one of Zenoh's threads."""

        def take_sample(sample: zenoh.Sample) -> None:
            tell(str(sample.key_expr), sample.payload.to_bytes())

        callback = zenoh.handlers.Callback(take_sample, indirect=False)
        subscriber = self._session.declare_subscriber(
            expression, callback, allowed_origin=zenoh.Locality.REMOTE
        )

        def end() -> None:
            with contextlib.suppress(zenoh.ZError):  # the session may be closed by now
                subscriber.undeclare()  # type: ignore[no-untyped-call]

        return end

    def drop_when_congested(self) -> None:
        """As in ``encircle.protocol.connections.Connection``."""
        self._waits = False
        self._publishers.clear()

    def declare_alive(self, key: str) -> None:
        """Declare a liveliness token: it is gone when this process is, however it ends."""
        self._declared[key] = self._session.liveliness().declare_token(key)

    def watch(self, expression: str, tell: Callable[[str, bool], None]) -> None:
        """Call ``tell(key, alive)`` for tokens that are there, come or go, from another thread.

        A router that goes takes all tokens with it: then ``tell`` gets only those that are not back
        ``ROUTER_S_MAX`` later.
        """
        if self._session.info.routers_zid():
            tell = TokenFilter(self._session, tell, self._closed).take
        self._watchers.append(subscribe_alive(self._session, expression, tell))

    def answer_info_queries(self, key: str, node: str, takes: Collection[str] = ()) -> None:
        """Answer whoever asks what this node is, which versions it has, what its clock shows.

        ``takes``: as of ``NodeInfo``.
        """
        self.answer_queries(key, info_replier(node, now_us, tuple(takes)))

    def answer_queries(self, key: str, reply: Callable[[], bytes]) -> None:
        """Answer whoever asks on a key with what ``reply`` makes, on one of Zenoh's threads."""
        self._declared[key] = serve_queries(self._session, key, reply)

    def withdraw(self, *keys: str) -> None:
        """Take back what was declared on these keys: tokens, answers to queries, subscriptions."""
        for key in keys:
            self._inbox.leave(key)
            declared = self._declared.pop(key, None)
            if declared is not None:
                with contextlib.suppress(zenoh.ZError):  # the session may be closed by now
                    declared.undeclare()

    def flush(self, expression: str, s_max: float) -> bool:
        """Wait until the nodes that answer queries on such keys have had what was sent.

        Waits ``s_max`` s at most: a node that is frozen never answers. Returns whether any has.
        """
        # A query takes the same way as what was sent before it with its priority, and cannot
        # overtake that.
        with contextlib.suppress(zenoh.ZError):
            queries = [
                self._session.get(expression, timeout=s_max, priority=_priority(chosen))
                for chosen in (SURE, ROUND)
            ]
            replies = [reply for pending in queries for reply in pending]
            return any(reply.ok is not None for reply in replies)
        return False

    def query_info(self, key: str, s_max: float) -> NodeInfo | None:
        """What a node says of itself on a key; None if nothing comes that can be understood."""
        with contextlib.suppress(ProtocolError, zenoh.ZError):  # such as: closed meanwhile
            reply = query(self._session, key, s_max)
            return None if reply is None else decode_info(reply.payload)
        return None

    def close(self) -> None:
        """Close the session and wake whoever waits in ``receive``; may be called twice.

        On a loaded machine what was sent last may get lost with that: ``flush`` before.
        """
        with self._closing:
            self._closed.set()
            if not self._session.is_closed():
                # Zenoh's own threads wait while the inbox is full, and closing waits for them.
                emptying = threading.Thread(target=self._drain, name="emptying", daemon=True)
                emptying.start()
                close_session(self._session)
                self._inbox.close()
                emptying.join(CLOSE_S_MAX)

    def _drain(self) -> None:
        with contextlib.suppress(ConnectionClosed):
            while True:
                self.receive()


def _priority(message_priority: str) -> zenoh.Priority:
    priority: zenoh.Priority = getattr(zenoh.Priority, message_priority.upper())
    return priority
