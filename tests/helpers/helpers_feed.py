"""A small server of the page, with a feed that sends what a test tells it to."""

import asyncio
import json
import queue
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from tornado.httpserver import HTTPServer
from tornado.netutil import bind_sockets
from tornado.web import Application, HTTPError, RequestHandler
from tornado.websocket import WebSocketHandler

from encircle.viewer.page_files import INDEX, page_text, page_type


class Feed:
    """What the page's feed sends, and what it got from pages; lives in a thread of its own."""

    def __init__(self) -> None:
        self.heard: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self.pages: set[WebSocketHandler] = set()
        self.answer: list[dict[str, Any]] = []
        self.accepts = True
        self.loop = asyncio.new_event_loop()
        self.port = 0
        self._ready = threading.Event()
        self._thread = threading.Thread(target=self._serve, name="feed", daemon=True)
        self._thread.start()
        self._ready.wait()

    @property
    def address(self) -> str:
        """Where the page is."""
        return f"http://127.0.0.1:{self.port}/"

    def send(self, **message: Any) -> None:
        """Send a message to all pages that are connected."""
        text = json.dumps(message)
        self._call(lambda: [page.write_message(text) for page in self.pages])

    def drop(self, accepts: bool = False) -> None:
        """Close all connections; new ones are refused, or accepted."""

        def close() -> None:
            self.accepts = accepts
            for page in list(self.pages):
                page.close()

        self._call(close)

    def close(self) -> None:
        """End the server."""
        self._call(self.loop.stop)
        self._thread.join()

    def _call(self, act: Any) -> None:
        self.loop.call_soon_threadsafe(act)

    def _serve(self) -> None:
        asyncio.set_event_loop(self.loop)
        feed = self

        class Files(RequestHandler):
            def get(self, name: str) -> None:
                try:
                    self.set_header("Content-Type", page_type(name or INDEX))
                    self.finish(page_text(name or INDEX))
                except FileNotFoundError:
                    raise HTTPError(404) from None

        class Socket(WebSocketHandler):
            def prepare(self) -> None:
                if not feed.accepts:
                    raise HTTPError(503)

            def open(self, *_args: str, **_kwargs: str) -> None:
                feed.pages.add(self)

            def on_message(self, message: str | bytes) -> None:
                said = json.loads(message)
                feed.heard.put(said)
                if "resume" in said:
                    for answer in feed.answer:
                        self.write_message(json.dumps(answer))

            def on_close(self) -> None:
                feed.pages.discard(self)

        application = Application(
            [("/feed", Socket), ("/(.*)", Files)], log_function=lambda _: None
        )
        server = HTTPServer(application)
        sockets = bind_sockets(0, "127.0.0.1")
        self.port = sockets[0].getsockname()[1]
        server.add_sockets(sockets)
        self._ready.set()
        self.loop.run_forever()
        server.stop()
        self.loop.run_until_complete(server.close_all_connections())
        self.loop.close()


@contextmanager
def feed() -> Iterator[Feed]:
    """A feed, ended at the end."""
    served = Feed()
    try:
        yield served
    finally:
        served.close()
