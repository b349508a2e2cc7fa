"""A link over Eclipse Zenoh. Beside it only ``encircle.protocol.zenoh.configuration`` knows Zenoh.

Messages for this party come in through one bounded first-in-first-out channel, waited on by the
thread that calls ``receive``; on this library a blocking wait costs two thirds of what waking an
asyncio loop does (``docs/architecture.md`` has the figures). Publishers are declared once per key
and lane (``encircle.protocol.zenoh.lanes``), express and blocking on congestion; a run by the clock
asks for the opposite, since there one party that is cut off would hold up all others. Liveliness
comes in through a callback on one of Zenoh's threads, which only hands it over.
"""

import contextlib
import queue
import socket
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import zenoh

from encircle.protocol.errors import ConnectionClosed, ProtocolError
from encircle.protocol.keys import is_plain
from encircle.protocol.mailbox import now_us
from encircle.protocol.process.interrupts import expect_library_threads
from encircle.protocol.zenoh.configuration import configuration, in_one_line
from encircle.protocol.zenoh.endpoints import (
    NETWORK_PROTOCOLS,
    ConnectionFailed,
    Endpoints,
    host_and_port,
)
from encircle.protocol.zenoh.lanes import ROUND, SURE, message_priority
from encircle.protocol.zenoh.node_info import NodeInfo, decode_info, info_replier

__all__ = [
    "ConnectionFailed",
    "ZenohConnection",
    "alive_keys",
    "closing",
    "first_messages",
    "has_neighbours",
    "is_alive",
    "open_session",
    "query",
    "subscribe_alive",
]

INBOX_MAX = 4096
INBOX_BYTES_MAX = 256 * 1024 * 1024
"""What may wait for this party, in messages and in bytes; when it is full, senders wait."""
ROUTER_S_MAX = 10.0
"""How long a router may be away, in s, before those that were reached through it count as gone."""
SETTLE_S = 0.2
"""How long after a token a connection may be seen to go, if one router took both with it."""
PATIENCE_STEP_S = 0.1
OVERHEARD_MAX = 1024
CLOSE_S_MAX = 1.0
"""How long to take leave of the others, in s: one that is frozen takes ten seconds each."""


class ZenohConnection:
    """A ``encircle.protocol.connections.Link`` over one Zenoh session.

    ``takes``: key expression of the messages to receive; what this session sends itself never
    comes back. ``check``: called before anything is received, and may raise to go no further.
    Raises ``ConnectionFailed``.
    """

    def __init__(
        self,
        endpoints: Endpoints,
        subscription: str,
        check: Callable[[zenoh.Session], None] = lambda _session: None,
    ) -> None:
        self._session = open_session(endpoints)
        try:
            # Before: what nobody receives would soon fill the inbox, and then hold up the others.
            check(self._session)
        except BaseException:
            _close(self._session)
            raise
        self._publishers: dict[tuple[str, str], zenoh.Publisher] = {}
        self._last_payloads: dict[str, bytes] = {}
        self._waits = True
        self._tokens: list[zenoh.LivelinessToken] = []
        self._watchers: list[Any] = []
        self._closing = threading.Lock()
        self._closed = threading.Event()
        # Zenoh bounds a channel by count alone, and a message by its bytes.
        count_max = min(INBOX_MAX, INBOX_BYTES_MAX // endpoints.message_bytes_max)
        self._inbox = self._session.declare_subscriber(
            subscription,
            zenoh.handlers.FifoChannel(count_max),
            allowed_origin=zenoh.Locality.REMOTE,
        )

    @property
    def session(self) -> zenoh.Session:
        """The session itself, for what a link does not offer."""
        return self._session

    def send(self, key: str, payload: bytes) -> None:
        """Publish; blocks while the transport is congested, or drops after ``drop_when_congested``.

        What becomes of it on its way is said in ``encircle.protocol.zenoh.lanes``.
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
        try:
            sample = self._inbox.recv()
        except zenoh.ZError as error:
            raise ConnectionClosed(str(error)) from None
        return str(sample.key_expr), sample.payload.to_bytes()

    def waiting(self) -> Iterator[tuple[str, bytes]]:
        """The messages that are there now, one by one; ``ConnectionClosed`` as in ``receive``."""
        try:
            while (sample := self._inbox.try_recv()) is not None:
                yield str(sample.key_expr), sample.payload.to_bytes()
        except zenoh.ZError as error:
            raise ConnectionClosed(str(error)) from None

    def subscribe(self, expression: str, tell: Callable[[str, bytes], None]) -> Callable[[], None]:
        """As in ``protocol.connections.Link``; ``tell`` is called on one of Zenoh's threads."""

        def handed_over(sample: zenoh.Sample) -> None:
            tell(str(sample.key_expr), sample.payload.to_bytes())

        callback = zenoh.handlers.Callback(handed_over, indirect=False)
        subscriber = self._session.declare_subscriber(
            expression, callback, allowed_origin=zenoh.Locality.REMOTE
        )

        def end() -> None:
            with contextlib.suppress(zenoh.ZError):  # the session may be closed by now
                subscriber.undeclare()  # type: ignore[no-untyped-call]

        return end

    def drop_when_congested(self) -> None:
        """As in ``encircle.protocol.connections.Link``."""
        self._waits = False
        self._publishers.clear()

    def declare_alive(self, key: str) -> None:
        """Declare a liveliness token: it is gone when this process is, however it ends."""
        self._tokens.append(self._session.liveliness().declare_token(key))

    def watch(self, expression: str, tell: Callable[[str, bool], None]) -> None:
        """Call ``tell(key, alive)`` for tokens that are there, come or go, from another thread.

        A router that goes takes all tokens with it: then those alone are told of that are not back
        ``ROUTER_S_MAX`` later.
        """
        if self._session.info.routers_zid():
            tell = _TokenFilter(self._session, tell, self._closed).tell
        self._watchers.append(subscribe_alive(self._session, expression, tell))

    def answer_info_queries(self, key: str, node: str) -> None:
        """Answer whoever asks what this party is, which versions it has, what its clock shows."""
        self._watchers.append(serve_queries(self._session, key, info_replier(node, now_us)))

    def flush(self, expression: str, s_max: float) -> bool:
        """Wait until the parties that tell about themselves on such keys have had what was sent.

        At most for ``s_max`` s: one that is frozen never answers. Whether any has.
        """
        # A question takes the same way as what was sent on its lane before it, and cannot overtake
        # that.
        with contextlib.suppress(zenoh.ZError):
            questions = [
                self._session.get(expression, timeout=s_max, priority=_priority(asked))
                for asked in (SURE, ROUND)
            ]
            replies = [reply for question in questions for reply in question]
            return any(reply.ok is not None for reply in replies)
        return False

    def query_info(self, key: str, s_max: float) -> NodeInfo | None:
        """What a party says of itself on a key; None if nothing comes that can be understood."""
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
                _close(self._session)
                emptying.join(CLOSE_S_MAX)

    def _drain(self) -> None:
        with contextlib.suppress(ConnectionClosed):
            while True:
                self.receive()


def _priority(message_priority: str) -> zenoh.Priority:
    found: zenoh.Priority = getattr(zenoh.Priority, message_priority.upper())
    return found


class _TokenFilter:
    """Tells of tokens, but not of those that a restarted router brings back.

    A client sees every token go when its router does, its own included. So it waits a moment, and
    if its router is not the one it had, it waits for those that were reached through it.
    """

    def __init__(
        self, session: zenoh.Session, tell: Callable[[str, bool], None], closed: threading.Event
    ) -> None:
        self._session = session
        self._tell = tell
        self._closed = closed
        self._changes: queue.SimpleQueue[tuple[str, bool]] = queue.SimpleQueue()
        self._missing: dict[str, _Missing] = {}
        self._routers = self._connected()
        threading.Thread(target=self._run, name="patience", daemon=True).start()

    def tell(self, key: str, alive: bool) -> None:
        """Take a change in, on Zenoh's own thread, from which no Zenoh call may be made."""
        self._changes.put((key, alive))

    def _connected(self) -> frozenset[str]:
        with contextlib.suppress(zenoh.ZError):  # the session was closed meanwhile
            return frozenset(map(str, self._session.info.routers_zid()))
        return frozenset()

    def _run(self) -> None:
        while not self._closed.is_set():
            with contextlib.suppress(queue.Empty):
                self._change(*self._changes.get(timeout=PATIENCE_STEP_S))
            self._look(time.monotonic())

    def _change(self, key: str, alive: bool) -> None:
        if not alive:
            self._missing[key] = _Missing(time.monotonic() + SETTLE_S, decided=False)
        elif self._missing.pop(key, None) is None:
            self._tell(key, True)
        elif not self._missing:
            self._routers = self._connected()

    def _look(self, now_s: float) -> None:
        """Decide about what has been missing for long enough."""
        for key, (until_s, decided) in list(self._missing.items()):
            if now_s < until_s or self._session.is_closed():
                continue
            if decided or self._routers & self._connected():
                del self._missing[key]
                self._tell(key, False)
            else:
                self._missing[key] = _Missing(now_s + ROUTER_S_MAX, decided=True)


class _Missing(NamedTuple):
    """A token that has gone; ``decided``: it is gone for good if it is not back until then."""

    until_s: float
    decided: bool


def subscribe_alive(
    session: zenoh.Session, expression: str, tell: Callable[[str, bool], None]
) -> Any:
    """Have ``tell(key, alive)`` called on Zenoh's own thread for tokens that are there, come or go.

    A token may be declared on an expression, such as ``**``, and then matches every key that it
    stands for. It is nobody's. What is returned is to be kept as long as it is to go on.
    """

    def handed_over(sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        if is_plain(key):
            tell(key, sample.kind == zenoh.SampleKind.PUT)

    # The default is a Python thread per subscriber, which may outlive the session and then keeps
    # the process from ending.
    callback = zenoh.handlers.Callback(handed_over, indirect=False)
    return session.liveliness().declare_subscriber(expression, callback, history=True)


def is_alive(session: zenoh.Session, key: str, s_max: float) -> bool:
    """Whether a token of this very key is there, as far as can be learned within ``s_max`` s."""
    replies = session.liveliness().get(key, timeout=s_max)
    return any(reply.ok is not None and str(reply.ok.key_expr) == key for reply in replies)


def alive_keys(session: zenoh.Session, expression: str, s_max: float) -> set[str]:
    """The keys of the tokens that match, as far as can be learned within ``s_max`` seconds.

    As in ``subscribe_alive``, tokens of many keys are left out.
    """
    replies = session.liveliness().get(expression, timeout=s_max)
    return set(filter(is_plain, (str(r.ok.key_expr) for r in replies if r.ok is not None)))


def serve_queries(session: zenoh.Session, key: str, reply: Callable[[], bytes]) -> Any:
    """Answer queries on a key, on Zenoh's own thread, as long as what is returned is kept."""

    def asked(query: zenoh.Query) -> None:
        query.reply(key, reply())

    return session.declare_queryable(key, zenoh.handlers.Callback(asked, indirect=False))


class QueryReply(NamedTuple):
    """What came back of a query, and when it was asked and heard by this machine's clock."""

    payload: bytes
    asked_us: int
    arrival_us: int


def query(session: zenoh.Session, key: str, s_max: float) -> QueryReply | None:
    """Query a key once; None if nobody answers within ``s_max`` seconds."""
    asked_us = now_us()
    for reply in session.get(key, timeout=s_max):
        arrival_us = now_us()
        if reply.ok is not None:
            return QueryReply(reply.ok.payload.to_bytes(), asked_us, arrival_us)
    return None


def first_messages(session: zenoh.Session, expression: str, s_max: float) -> dict[str, bytes]:
    """The first message on each key that matches, of those sent in the next ``s_max`` seconds."""
    found: dict[str, bytes] = {}

    def heard(sample: zenoh.Sample) -> None:
        if len(found) < OVERHEARD_MAX:
            found.setdefault(str(sample.key_expr), sample.payload.to_bytes())

    callback = zenoh.handlers.Callback(heard, indirect=False)
    subscriber = session.declare_subscriber(
        expression, callback, allowed_origin=zenoh.Locality.REMOTE
    )
    time.sleep(s_max)
    subscriber.undeclare()  # type: ignore[no-untyped-call]
    return dict(found)


def has_neighbours(session: zenoh.Session) -> bool:
    """Whether the session is connected to a router or a peer."""
    return bool(session.info.routers_zid() or session.info.peers_zid())


def open_session(endpoints: Endpoints) -> zenoh.Session:
    """A session that has bound and connected as asked; else ``ConnectionFailed`` says where."""
    zenoh.init_log_from_env_or("off")
    expect_library_threads()
    config = configuration(endpoints)
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        reason = in_one_line(error)
        connecting = "connect to" in reason
        doing = "connect to" if connecting else "listen on"
        where = ", ".join(endpoints.connect if connecting else endpoints.listen) or endpoints
        unknown = [e for e in endpoints.connect if connecting and not _acknowledge(e)]
        if unknown:
            reason = f"no address is known for the host of {', '.join(unknown)}"
        raise ConnectionFailed(f"cannot {doing} {where}: {reason}") from None


@contextlib.contextmanager
def closing(session: zenoh.Session) -> Iterator[zenoh.Session]:
    """As ``contextlib.closing``; it takes ``CLOSE_S_MAX`` at most."""
    try:
        yield session
    finally:
        _close(session)


def _close(session: zenoh.Session) -> None:
    """Zenoh waits for each party in turn to read what it was sent, and fails if one does not."""

    def close() -> None:
        with contextlib.suppress(zenoh.ZError):
            session.close()  # type: ignore[no-untyped-call]

    thread = threading.Thread(target=close, name="closing", daemon=True)
    thread.start()
    thread.join(CLOSE_S_MAX)


def _acknowledge(endpoint: str) -> bool:
    """Whether an endpoint's host, a name or an address already, can be turned into an address."""
    if endpoint.partition("/")[0] not in NETWORK_PROTOCOLS:
        return True
    with contextlib.suppress(OSError, UnicodeError):
        return bool(socket.getaddrinfo(*host_and_port(endpoint)))
    return False
