"""The server of the page: its files, and a feed of what there is to see, on loopback.

It runs in a thread with an event loop of its own, so that nobody waits for it. Each page is sent
what it does not have, one bounded message after the other: the next when the one before has left
this process. So a page that does not read costs one message, and a browser that does not even
answer pings is dropped; when it is back, it asks for what it missed.

A browser may be told by any website to ask here. So a request counts only if its ``Host`` is an
address or ``localhost``, which no other website can have, and a feed only for a page of this very
server. Whoever has the token, which is in the address that the starter is given, may send more than
questions; that is off where others can reach the server.
"""

import asyncio
import contextlib
import hmac
import json
import os
import secrets
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any
from urllib.parse import urlsplit

from tornado.httpserver import HTTPServer
from tornado.iostream import StreamClosedError
from tornado.web import Application, HTTPError, RequestHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from encircle.viewer.addresses import is_loopback, is_meant_for, listening_socket
from encircle.viewer.history import History, Position, as_text
from encircle.viewer.page_files import INDEX, page_text, page_type
from encircle.viewer.server_log import quiet_tornado

LOOPBACK = "127.0.0.1"
PAGES_MAX = 32
TAKEN_BYTES_MAX = 64 * 1024
TAKEN_PER_S_MAX, TAKEN_AT_ONCE_MAX = 100.0, 300
"""How many messages a page may send, on average and at once, before it is shut out."""
ANSWERS_MAX = 64
"""How many answers may wait for a page that does not read; then the oldest go."""
SEND_PERIOD_S = 1.0 / 30.0
PING_S, PONG_S_MAX = 10.0, 10.0
START_S_MAX = 10.0
TRY_AGAIN_LATER, POLICY = 1013, 1008
"""Codes of WebSocket with which a page is sent away."""
HEADERS = {
    "Cache-Control": "no-cache",
    "Content-Security-Policy": "frame-ancestors 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}

Taken = Callable[[bool, dict[str, Any]], dict[str, Any] | None]
"""Takes in an object from a page, and whether that page has the token; the answer, if any, is sent
to that page. It is called in the server's thread and must not wait."""


class ServerFailed(Exception):
    """The page cannot be served; the message says why."""


class PageServer:
    """Serves the page of one run, from ``start`` to ``stop``.

    ``host``, ``port``: where to listen, port 0 is any that is free. ``on_message``: takes in what
    pages send beside questions; without it there is no control.
    """

    def __init__(
        self,
        history: History,
        host: str = LOOPBACK,
        port: int = 0,
        on_message: Taken | None = None,
    ) -> None:
        self.history = history
        self.host, self.port = host, port
        self.token = secrets.token_urlsafe(16) if is_loopback(host) else ""
        self.on_message = on_message
        self.pages: set[_Feed] = set()
        self.opened = 0
        self.last_closed_s = time.monotonic()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._stopping: asyncio.Event | None = None
        self._started = threading.Event()
        self._failure = ""
        self._thread = threading.Thread(target=self._run, name="page-server", daemon=True)

    @property
    def address(self) -> str:
        """The address to be opened in a browser, with the token if there is control."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        token = f"?token={self.token}" if self.on_message is not None and self.token else ""
        return f"http://{host}:{self.port}/{token}"

    def start(self) -> None:
        """Listen, and serve from now on; ``ServerFailed`` if that cannot be."""
        self._thread.start()
        if not self._started.wait(START_S_MAX):
            raise ServerFailed(f"the page's server did not start within {START_S_MAX:g} s")
        if self._failure:
            raise ServerFailed(self._failure)

    def stop(self) -> None:
        """Serve no longer; pages are told. May be called twice, and before ``start``."""
        loop, stopping = self._loop, self._stopping
        if loop is not None and stopping is not None:
            with contextlib.suppress(RuntimeError):  # the loop has ended already
                loop.call_soon_threadsafe(stopping.set)
            self._thread.join(START_S_MAX)

    def tell(self, answer: dict[str, Any]) -> None:
        """Send an object to all pages with the token, from any thread; nothing waits for it."""
        loop, text = self._loop, as_text(answer)
        if loop is not None:
            with contextlib.suppress(RuntimeError):  # the loop has ended already
                loop.call_soon_threadsafe(self._tell, text)

    def _tell(self, text: str) -> None:
        for page in self.pages:
            page.tell_starter(text)

    def has_token(self, given: str) -> bool:
        """Whether a page may change the run."""
        return bool(self.token) and hmac.compare_digest(given.encode(), self.token.encode())

    def _run(self) -> None:
        quiet_tornado()
        try:
            asyncio.run(self._serve())
        except OSError as error:
            where = f"port {self.port} of {self.host}" if self.port else self.host
            # Python's own words name the address once more.
            code = error.errno or 0
            why = os.strerror(code) if code > 0 else error.strerror or str(error)
            self._failure = f"{where} cannot be used for the page: {why}"
        finally:
            self._started.set()

    async def _serve(self) -> None:
        self._loop, self._stopping = asyncio.get_running_loop(), asyncio.Event()
        listening = listening_socket(self.host, self.port)
        self.port = listening.getsockname()[1]
        own = {"server": self}
        application = Application(
            [(r"/feed", _Feed, own), (r"/([\w.-]*)", _File, own)],
            log_function=lambda _handler: None,
            websocket_ping_interval=PING_S,
            websocket_ping_timeout=PONG_S_MAX,
            websocket_max_message_size=TAKEN_BYTES_MAX,
        )
        server = HTTPServer(application, max_body_size=TAKEN_BYTES_MAX)
        server.add_sockets([listening])
        self.history.changed = self._changed
        self._started.set()
        await self._stopping.wait()
        server.stop()
        for page in list(self.pages):
            page.close()
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(server.close_all_connections(), 1.0)

    def _changed(self) -> None:
        loop = self._loop
        if loop is not None:
            with contextlib.suppress(RuntimeError):  # the loop has ended already
                loop.call_soon_threadsafe(self._wake)

    def _wake(self) -> None:
        for page in self.pages:
            page.news.set()


class _Guarded(RequestHandler):
    """A request that is refused if it is meant for another website."""

    def initialize(self, server: PageServer) -> None:
        self.server = server

    def prepare(self) -> None:
        if not is_meant_for(self.request.host, self.server.host, self.server.port):
            raise HTTPError(403, reason="Not this server")


class _File(_Guarded):
    """A file of the page."""

    def set_default_headers(self) -> None:
        self.clear_header("Server")
        for name, value in HEADERS.items():
            self.set_header(name, value)

    def get(self, name: str) -> None:
        name = name or INDEX
        try:
            text = page_text(name)
        except FileNotFoundError:
            raise HTTPError(404) from None
        self.set_header("Content-Type", page_type(name))
        self.finish(text)


class _Feed(_Guarded, WebSocketHandler):
    """The feed to one page. ``news`` is set when there may be something to send."""

    def initialize(self, server: PageServer) -> None:
        super().initialize(server)
        self.news = asyncio.Event()
        self._position: Position | None = None
        self._has_token = False
        self._sending: asyncio.Task[None] | None = None
        self._answers: deque[str] = deque(maxlen=ANSWERS_MAX)
        self._taken_left, self._taken_s = float(TAKEN_AT_ONCE_MAX), time.monotonic()

    def prepare(self) -> None:
        super().prepare()
        origin = self.request.headers.get("Origin")
        if origin is not None and not self.check_origin(origin):
            raise HTTPError(403, reason="Not this server's page")

    def check_origin(self, origin: str) -> bool:
        with contextlib.suppress(ValueError):
            return urlsplit(origin).netloc == self.request.host
        return False

    def open(self) -> None:
        if len(self.server.pages) >= PAGES_MAX:
            self.close(TRY_AGAIN_LATER, f"{PAGES_MAX} pages are open already")
            return
        self._has_token = self.server.has_token(self.get_query_argument("token", ""))
        self.server.pages.add(self)
        self.server.opened += 1
        self._sending = asyncio.create_task(self._send())

    def on_message(self, message: str | bytes) -> None:
        if self not in self.server.pages:
            return
        if not self._may_say_more():
            self.close(POLICY, "too many messages")
            return
        try:
            said = json.loads(message)
        except (ValueError, RecursionError):
            said = None
        if type(said) is not dict:
            self.close(POLICY, "not a JSON object")
        elif "resume" in said:
            self._resume(said["resume"])
        elif self.server.on_message is not None:
            answer = self.server.on_message(self._has_token, said)
            if answer is not None:
                self._tell(as_text(answer))

    def on_close(self) -> None:
        if self._sending is not None:
            self._sending.cancel()
        if self in self.server.pages:
            self.server.pages.discard(self)
            self.server.last_closed_s = time.monotonic()

    def _resume(self, position: Any) -> None:
        """Send what the page does not have: all of it, if it shows another run."""
        is_known = type(position) is dict and position.get("run") == self.server.history.run
        tick = position.get("from") if is_known else 0
        is_tick = type(tick) is int and tick >= 0
        self._position = Position(tick if is_tick else 0, has_stage=is_known and is_tick)
        self.news.set()

    async def _send(self) -> None:
        control = self._has_token and self.server.on_message is not None
        with contextlib.suppress(WebSocketClosedError, StreamClosedError):
            while True:
                await self.news.wait()
                self.news.clear()
                while self._answers:
                    await self.write_message(self._answers.popleft())
                while self._position is not None:
                    at = self._position
                    found = self.server.history.next_message(at, {"control": control})
                    if found is None:
                        break
                    # It comes back when the message has left this process.
                    await self.write_message(found[0])
                    if self._position is at:
                        self._position = found[1]
                await asyncio.sleep(SEND_PERIOD_S)

    def tell_starter(self, text: str) -> None:
        """Send a text if this page has the token."""
        if self._has_token:
            self._tell(text)

    def _tell(self, text: str) -> None:
        self._answers.append(text)
        self.news.set()

    def _may_say_more(self) -> bool:
        now_s = time.monotonic()
        more = (now_s - self._taken_s) * TAKEN_PER_S_MAX
        self._taken_left = min(self._taken_left + more, float(TAKEN_AT_ONCE_MAX)) - 1.0
        self._taken_s = now_s
        return self._taken_left >= 0.0
