"""Liveliness tokens: Zenoh's sign that a node is there, which goes when the node does.

A token is a key that a session declares. Others ask for tokens, or subscribe to their coming and
going, which Zenoh reports on threads of its own.

One node per name: a second robot of one id, or a second world of one run, does not start.
A liveliness token shows that a node is there, not which process declared it. So a node looks for a
token of its own name before it declares one. The token of a process that was killed goes at once,
that of a host that vanished only when Zenoh gives it up; a node that is started anew waits a moment
for that.

Two that start within the same instant may both find no token. That harms nothing: both get the same
observations and decide the same, and the messages of the later one are refused, and counted.
"""

import contextlib
import queue
import threading
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import zenoh

from encircle.protocol.keys import is_plain
from encircle.protocol.zenoh.endpoints import ConnectionFailed

ROUTER_S_MAX = 10.0
"""How long a router may be away, in s, before those that were reached through it count as gone."""
SETTLE_S = 0.2
"""How long after a token a connection may be seen to go, if one router took both with it."""
STEP_S = 0.1
FREE_S_MAX = 2.0
LOOK_S_MAX = 5.0
PERIOD_S = 0.1


class TokenFilter:
    """Passes changes of tokens on, but none that a restarted router makes and takes back.

    A client sees every token go when its router does, its own included. So this waits a moment.
    If the router then is not the one it was, it waits ``ROUTER_S_MAX`` for the tokens of the nodes
    that were reached through it.
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
        threading.Thread(target=self._run, name="token-filter", daemon=True).start()

    def take(self, key: str, alive: bool) -> None:
        """Queue a change, on Zenoh's own thread, from which no Zenoh call may be made."""
        self._changes.put((key, alive))

    def _connected(self) -> frozenset[str]:
        with contextlib.suppress(zenoh.ZError):  # the session was closed meanwhile
            return frozenset(map(str, self._session.info.routers_zid()))
        return frozenset()

    def _run(self) -> None:
        while not self._closed.is_set():
            with contextlib.suppress(queue.Empty):
                self._change(*self._changes.get(timeout=STEP_S))
            self._look(time.monotonic())

    def _change(self, key: str, alive: bool) -> None:
        if not alive:
            self._missing[key] = _Missing(time.monotonic() + SETTLE_S, final=False)
        elif self._missing.pop(key, None) is None:
            self._tell(key, True)
        elif not self._missing:
            self._routers = self._connected()

    def _look(self, now_s: float) -> None:
        """Report the tokens that have been missing for long enough."""
        for key, (until_s, final) in list(self._missing.items()):
            if now_s < until_s or self._session.is_closed():
                continue
            if final or self._routers & self._connected():
                del self._missing[key]
                self._tell(key, False)
            else:
                self._missing[key] = _Missing(now_s + ROUTER_S_MAX, final=True)


class _Missing(NamedTuple):
    """A token that has gone, and until when it may be back.

    ``final``: then it is reported as gone, whatever became of the router.
    """

    until_s: float
    final: bool


def subscribe_alive(
    session: zenoh.Session, expression: str, tell: Callable[[str, bool], None]
) -> Any:
    """Have ``tell(key, alive)`` called on Zenoh's own thread for tokens that are there, come or go.

    A token may be declared on an expression, such as ``**``, and then matches every key that it
    stands for. It is nobody's, and left out. The calls go on as long as what is returned is kept.
    """

    def take_sample(sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        if is_plain(key):
            tell(key, sample.kind == zenoh.SampleKind.PUT)

    # The default is a Python thread per subscriber, which may outlive the session and then keeps
    # the process from ending.
    callback = zenoh.handlers.Callback(take_sample, indirect=False)
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


class NameInUse(ConnectionFailed):
    """A node of that name is there; the message says which."""


def check_name_free(session: Any, token: str, who: str, s_max: float = FREE_S_MAX) -> None:
    """Raise ``NameInUse`` if a token is there, and still so after ``s_max`` seconds.

    ``session``: a Zenoh session without subscriptions. ``who``: the name of the node for people.
    """
    deadline_s = time.monotonic() + s_max
    while is_alive(session, token, LOOK_S_MAX):
        if time.monotonic() >= deadline_s:
            raise NameInUse(f"there is a {who} already")
        time.sleep(PERIOD_S)
