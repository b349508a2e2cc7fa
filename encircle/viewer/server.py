"""The server of the page, on loopback: a thread with an event loop of its own.

So nobody waits for it. What it answers is in ``handlers``. A browser that does not even answer
pings is dropped; when it is back, it asks for what it missed. Whoever has the token, which is in
the address that the starter is given, may send more than questions; that is off where others can
reach the server.
"""

import asyncio
import contextlib
import os
import threading
from typing import Any

from tornado.httpserver import HTTPServer
from tornado.web import Application

from encircle.viewer.addresses import LOOPBACK, ServerFailed, listening_socket
from encircle.viewer.handlers import Site, Taken
from encircle.viewer.history import History, as_text
from encircle.viewer.server_log import quiet_tornado

TAKEN_BYTES_MAX = 64 * 1024
PING_S, PONG_S_MAX = 10.0, 10.0
START_S_MAX = 10.0


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
        self.site = Site(history, host, port, on_message)
        self._loop: asyncio.AbstractEventLoop | None = None
        self._stopping: asyncio.Event | None = None
        self._started = threading.Event()
        self._failure = ""
        self._thread = threading.Thread(target=self._run, name="page-server", daemon=True)

    @property
    def port(self) -> int:
        """The port that it listens at, as soon as it does."""
        return self.site.port

    @property
    def address(self) -> str:
        """The address to be opened in a browser, with the token if there is control."""
        site = self.site
        host = f"[{site.host}]" if ":" in site.host else site.host
        token = f"?token={site.token}" if site.on_message is not None and site.token else ""
        return f"http://{host}:{site.port}/{token}"

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
                loop.call_soon_threadsafe(self.site.tell, text)

    def _run(self) -> None:
        quiet_tornado()
        try:
            asyncio.run(self._serve())
        except OSError as error:
            site = self.site
            where = f"port {site.port} of {site.host}" if site.port else site.host
            # Python's own words name the address once more.
            code = error.errno or 0
            why = os.strerror(code) if code > 0 else error.strerror or str(error)
            self._failure = f"{where} cannot be used for the page: {why}"
        finally:
            self._started.set()

    async def _serve(self) -> None:
        self._loop, self._stopping = asyncio.get_running_loop(), asyncio.Event()
        site = self.site
        listening = listening_socket(site.host, site.port)
        site.port = listening.getsockname()[1]
        application = Application(
            site.routes,
            log_function=lambda _handler: None,
            websocket_ping_interval=PING_S,
            websocket_ping_timeout=PONG_S_MAX,
            websocket_max_message_size=TAKEN_BYTES_MAX,
        )
        server = HTTPServer(application, max_body_size=TAKEN_BYTES_MAX)
        server.add_sockets([listening])
        site.history.changed = self._changed
        self._started.set()
        await self._stopping.wait()
        server.stop()
        for page in list(site.pages):
            page.close()
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(server.close_all_connections(), 1.0)

    def _changed(self) -> None:
        loop = self._loop
        if loop is not None:
            with contextlib.suppress(RuntimeError):  # the loop has ended already
                loop.call_soon_threadsafe(self.site.wake)
