"""A client of the page's server that is no browser: requests, and a feed, message by message."""

import asyncio
import contextlib
import json
import threading
from collections.abc import Callable, Coroutine, Iterator
from typing import Any

from helpers_waiting import joined
from tornado.httpclient import AsyncHTTPClient, HTTPRequest, HTTPResponse
from tornado.websocket import WebSocketClientConnection, websocket_connect

from encircle.viewer.server import PageServer

_opened: list[WebSocketClientConnection] = []


def run(look: Callable[[], Coroutine[Any, Any, None]]) -> None:
    """Run what a client does, and close all feeds that it has opened."""

    async def closed() -> None:
        try:
            await look()
        finally:
            for feed in _opened:
                feed.close()
                while await feed.read_message() is not None:
                    pass
            _opened.clear()

    asyncio.run(closed())


@contextlib.contextmanager
def flooding(address: str) -> Iterator[None]:
    """While this lasts, nonsense is sent to a page's server, again whenever it has enough of it."""
    over = threading.Event()

    async def send() -> None:
        while not over.is_set():
            with contextlib.suppress(Exception):
                feed = await websocket_connect(address.replace("http", "ws", 1) + "feed")
                try:
                    while not over.is_set() and feed.close_code is None:
                        await feed.write_message('{"x": "' + 1000 * "y" + '"}')
                finally:
                    feed.close()
                    while await feed.read_message() is not None:
                        # Until then its socket is open.
                        pass

    thread = threading.Thread(target=lambda: asyncio.run(send()), name="flood", daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        joined(thread)


async def fetched(server: PageServer, name: str, **headers: str) -> HTTPResponse:
    """What the server answers to a request for a file, whatever it is."""
    request = HTTPRequest(
        f"http://127.0.0.1:{server.port}/{name}", headers=headers, request_timeout=0
    )
    with contextlib.closing(AsyncHTTPClient(force_instance=True)) as client:
        return await client.fetch(request, raise_error=False)


async def connected(
    server: PageServer, query: str = "", **headers: str
) -> WebSocketClientConnection:
    """A feed, as a page has it."""
    request = HTTPRequest(f"ws://127.0.0.1:{server.port}/feed{query}", headers=headers)
    _opened.append(await websocket_connect(request))
    return _opened[-1]


async def resumed(
    server: PageServer, run: str | None = None, tick: int = 0, query: str = ""
) -> WebSocketClientConnection:
    """A feed that has asked for what it does not have."""
    feed = await connected(server, query)
    await say(feed, resume={"run": run, "from": tick})
    return feed


async def say(feed: WebSocketClientConnection, **said: Any) -> None:
    await feed.write_message(json.dumps(said))


async def read(feed: WebSocketClientConnection) -> dict[str, Any] | None:
    """The next message; None if the connection is closed."""
    message = await feed.read_message()
    if message is None:
        # It is told once.
        _opened.remove(feed)
        feed.close()
        return None
    return json.loads(message)


async def read_until_ended(feed: WebSocketClientConnection) -> dict[str, Any]:
    """All messages up to the end of the run, put together as a page does."""
    whole: dict[str, Any] = {"frames": [], "status": {}}
    while whole["status"].get("state") != "ended":
        message = await read(feed)
        assert message is not None, whole
        whole["frames"] += message.get("frames", [])
        whole["status"] |= message.get("status", {})
        whole |= {"stage": message["stage"]} if "stage" in message else {}
    return whole
