"""What the page's server answers: its files, and a feed of what there is to see.

Each page is sent what it does not have, one bounded message after the other: the next when the one
before has left this process. So a page that does not read costs one message; when it is back, it
asks for what it missed.

A browser may be told by any website to ask here. So a request counts only if its ``Host`` is an
address or ``localhost``, which no other website can have, and a feed only for a page of this very
server. Whoever has the token may send more than questions.
"""

import asyncio
import contextlib
import hmac
import json
import secrets
import time
from collections import deque
from collections.abc import Callable
from typing import Any
from urllib.parse import urlsplit

from tornado.iostream import StreamClosedError
from tornado.web import HTTPError, RequestHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from encircle.viewer.addresses import is_loopback, is_meant_for
from encircle.viewer.history import History, Position, as_text
from encircle.viewer.page_files import ICON, INDEX, page_text, page_type

PAGES_MAX = 32
TAKEN_PER_S_MAX, TAKEN_AT_ONCE_MAX = 100.0, 300
"""How many messages a page may send, on average and at once, before it is shut out."""
ANSWERS_MAX = 64
"""How many answers may wait for a page that does not read; then the oldest go."""
SEND_PERIOD_S = 1.0 / 30.0
TRY_AGAIN_LATER, POLICY = 1013, 1008
"""Codes of WebSocket with which a page is sent away."""
STANDS_FOR = {"": INDEX, "favicon.ico": ICON}
"""Names that are asked for, also by what has not read the page, and the files that answer."""
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


class Site:
    """What the handlers know of their server: where it is, what it shows, which pages are open.

    ``port``: the one that it listens at, as soon as it does; ``on_message``: None if there is no
    control; ``opened``: how many pages were opened so far. Methods are for the server's thread.
    """

    def __init__(self, history: History, host: str, port: int, on_message: Taken | None) -> None:
        self.history = history
        self.host, self.port = host, port
        self.token = secrets.token_urlsafe(16) if is_loopback(host) else ""
        self.on_message = on_message
        self.pages: set[_Feed] = set()
        self.opened = 0
        self.last_closed_s = time.monotonic()

    @property
    def routes(self) -> list[tuple[str, type[RequestHandler], dict[str, Any]]]:
        """Which handler answers what, as Tornado takes it."""
        own = {"site": self}
        return [(r"/feed", _Feed, own), (r"/([\w.-]*)", _File, own)]

    def has_token(self, given: str) -> bool:
        """Whether a page may change the run."""
        return bool(self.token) and hmac.compare_digest(given.encode(), self.token.encode())

    def wake(self) -> None:
        """Let all pages know that there may be something to send."""
        for page in self.pages:
            page.news.set()

    def tell(self, text: str) -> None:
        """Send a text to all pages with the token."""
        for page in self.pages:
            page.tell_starter(text)


class _Guarded(RequestHandler):
    """A request that is refused if it is meant for another website."""

    def initialize(self, site: Site) -> None:
        self.site = site

    def prepare(self) -> None:
        if not is_meant_for(self.request.host, self.site.host, self.site.port):
            raise HTTPError(403, reason="Not this server")


class _File(_Guarded):
    """A file of the page."""

    def set_default_headers(self) -> None:
        self.clear_header("Server")
        for name, value in HEADERS.items():
            self.set_header(name, value)

    def get(self, name: str) -> None:
        name = STANDS_FOR.get(name, name)
        try:
            text = page_text(name)
        except FileNotFoundError:
            raise HTTPError(404) from None
        self.set_header("Content-Type", page_type(name))
        self.finish(text)


class _Feed(_Guarded, WebSocketHandler):
    """The feed to one page. ``news`` is set when there may be something to send."""

    def initialize(self, site: Site) -> None:
        super().initialize(site)
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
        if len(self.site.pages) >= PAGES_MAX:
            self.close(TRY_AGAIN_LATER, f"{PAGES_MAX} pages are open already")
            return
        self._has_token = self.site.has_token(self.get_query_argument("token", ""))
        self.site.pages.add(self)
        self.site.opened += 1
        self._sending = asyncio.create_task(self._send())

    def on_message(self, message: str | bytes) -> None:
        if self not in self.site.pages:
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
        elif self.site.on_message is not None:
            answer = self.site.on_message(self._has_token, said)
            if answer is not None:
                self._tell(as_text(answer))

    def on_close(self) -> None:
        if self._sending is not None:
            self._sending.cancel()
        if self in self.site.pages:
            self.site.pages.discard(self)
            self.site.last_closed_s = time.monotonic()

    def _resume(self, position: Any) -> None:
        """Send what the page does not have: all of it, if it shows another run."""
        is_known = type(position) is dict and position.get("run") == self.site.history.run
        tick = position.get("from") if is_known else 0
        is_tick = type(tick) is int and tick >= 0
        self._position = Position(tick if is_tick else 0, has_stage=is_known and is_tick)
        self.news.set()

    async def _send(self) -> None:
        control = self._has_token and self.site.on_message is not None
        with contextlib.suppress(WebSocketClosedError, StreamClosedError):
            while True:
                await self.news.wait()
                self.news.clear()
                while self._answers:
                    await self.write_message(self._answers.popleft())
                while self._position is not None:
                    at = self._position
                    found = self.site.history.next_message(at, {"control": control})
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
