"""The page's server: who is served, what a feed gives, and that nobody who does not read costs."""

import asyncio
import json
import socket
from contextlib import ExitStack
from functools import cache

import pytest
from helpers_page_client import connected, fetched, read, read_until_ended, resumed, run, say
from helpers_scene import hunted
from helpers_waiting import until
from tornado.httpclient import HTTPClientError

from encircle.scene.as_json import frame_json, stage_json
from encircle.scene.builder import scene_of_recording
from encircle.viewer import handlers
from encircle.viewer.addresses import ServerFailed
from encircle.viewer.handlers import PAGES_MAX, TAKEN_AT_ONCE_MAX
from encircle.viewer.history import MESSAGE_BYTES_MAX, History
from encircle.viewer.page_files import BOKEH_SCRIPTS, page_names, page_text
from encircle.viewer.server import PageServer

ENDED = {"state": "ended", "complete": True}


@cache
def scene():
    return scene_of_recording(hunted("sim1", ("ticks_max=30",))[0])


def as_read(frames):
    return json.loads(json.dumps([frame_json(frame) for frame in frames]))


@pytest.fixture
def serving():
    """Starts servers of a hunt, of which nothing is shown yet."""
    with ExitStack() as closing:

        def serve(**options):
            made = PageServer(History(scene().stage), **options)
            closing.callback(made.stop)
            made.start()
            return made

        yield serve


def test_the_files_of_the_page_are_served_and_nothing_else(serving):
    server = serving()

    async def ask():
        for name in (*page_names(), *BOKEH_SCRIPTS, ""):
            answer = await fetched(server, name)
            assert answer.code == 200
            assert answer.body.decode() == page_text(name or "index.html")
            assert answer.headers["X-Content-Type-Options"] == "nosniff"
        types = [(await fetched(server, n)).headers["Content-Type"] for n in ("", "page.js")]
        assert types == ["text/html; charset=utf-8", "text/javascript; charset=utf-8"]
        icon = await fetched(server, "favicon.ico")
        assert (icon.code, icon.headers["Content-Type"]) == (200, "image/svg+xml; charset=utf-8")
        assert icon.body.decode() == page_text("icon.svg")
        for name in ("server.py", "../server.py", "%2e%2e/server.py", "page/", "nothing.js"):
            assert (await fetched(server, name)).code == 404

    run(ask)


@pytest.mark.parametrize(
    ("host", "code"),
    [
        ("127.0.0.1:PORT", 200),
        ("localhost:PORT", 200),
        ("[::1]:PORT", 200),
        ("evil.example:PORT", 403),
        ("127.0.0.1.evil.example:PORT", 403),
        ("127.0.0.1", 403),
        ("127.0.0.1:1", 403),
        ("[::1:PORT", 403),
    ],
)
def test_a_request_that_is_meant_for_another_website_is_refused(serving, host, code):
    server = serving()
    named = host.replace("PORT", str(server.port))

    async def ask():
        assert (await fetched(server, "", Host=named)).code == code
        if code == 200:
            await connected(server, Host=named, Origin=f"http://{named}")
            return
        with pytest.raises(HTTPClientError, match="403"):
            await connected(server, Host=named, Origin=f"http://{named}")

    run(ask)


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "http://127.0.0.1:1", "null", "http://["]
)
def test_the_page_of_another_website_gets_no_feed(serving, origin):
    async def ask():
        with pytest.raises(HTTPClientError, match="403"):
            await connected(serving(), Origin=origin)

    run(ask)


def test_a_page_gets_all_there_is_and_what_is_new_and_then_the_end(serving):
    server, frames = serving(), scene().frames

    async def look():
        server.site.history.add(frames[:10], {"state": "running"})
        feed = await resumed(server)
        first = await read(feed)
        assert first["stage"] == json.loads(json.dumps(stage_json(scene().stage)))
        assert first["frames"] == as_read(frames[:10])
        assert (first["status"]["state"], first["status"]["control"]) == ("running", False)
        server.site.history.add(frames[10:12])
        assert await read(feed) == {"frames": as_read(frames[10:12])}
        server.site.history.add(frames[12:], ENDED)
        rest = await read_until_ended(feed)
        assert rest["frames"] == as_read(frames[12:])

    run(look)


@pytest.mark.parametrize(
    ("shown", "tick", "first", "has_stage"),
    [
        ("seen", 7, 7, False),
        ("another", 7, 0, True),
        (None, 0, 0, True),
        ("seen", -3, 0, True),
        ("seen", "x", 0, True),
        ("seen", 10**30, None, False),
    ],
)
def test_a_page_that_comes_back_gets_what_it_does_not_have(serving, shown, tick, first, has_stage):
    server, frames = serving(), scene().frames
    server.site.history.add(frames, ENDED)

    async def look():
        found = await read_until_ended(await resumed(server, shown, tick))
        assert found["frames"] == ([] if first is None else as_read(frames[first:]))
        assert ("stage" in found) == has_stage

    run(look)


def test_a_page_that_does_not_read_costs_one_message_and_gets_all_when_it_does(serving):
    server, frames = serving(), scene().frames
    many = 3000

    def numbered(number):
        return [type(frames[0])(**{**fields(frames[k % len(frames)]), "tick": k}) for k in number]

    async def look():
        frozen = await resumed(server)
        healthy = await resumed(server)
        for part in range(0, many, 100):
            server.site.history.add(numbered(range(part, part + 100)))
        server.site.history.add([], ENDED)
        whole = await read_until_ended(healthy)
        assert [frame["t"] for frame in whole["frames"]] == list(range(many))
        waiting = [page.ws_connection.stream._write_buffer for page in server.site.pages]
        assert all(len(buffer) <= 2 * MESSAGE_BYTES_MAX for buffer in waiting)
        whole = await read_until_ended(frozen)
        assert [frame["t"] for frame in whole["frames"]] == list(range(many))

    run(look)


def fields(frame):
    return {name: getattr(frame, name) for name in frame.__slots__}


def test_a_page_that_floods_is_shut_out_and_others_are_not(serving):
    server = serving()

    async def look():
        good, bad = await resumed(server), await connected(server)
        await read(good)
        for _ in range(3 * TAKEN_AT_ONCE_MAX):
            if bad.close_code is None:
                await say(bad, hello=1)
        assert await read(bad) is None
        assert bad.close_code == 1008
        server.site.history.add(scene().frames[:1])
        assert len((await read(good))["frames"]) == 1

    run(look)


@pytest.mark.parametrize("said", ["", "{", "[]", "3", "[" * 30_000, '{"resume": {"from": 1}'])
def test_a_page_that_says_nonsense_is_shut_out(serving, said):
    async def look():
        feed = await connected(serving())
        await feed.write_message(said)
        assert await read(feed) is None

    run(look)


def test_so_many_pages_at_once_and_no_more(serving):
    server = serving()

    async def look():
        feeds = [await resumed(server) for _ in range(PAGES_MAX)]
        assert await read(await connected(server)) is None
        feeds[0].close()
        until_fewer = asyncio.get_running_loop().run_in_executor
        await until_fewer(None, until, lambda: len(server.site.pages) < PAGES_MAX, "a page to go")
        assert (await read(await resumed(server)))["stage"]["run"] == "seen"

    run(look)


def test_only_who_has_the_token_may_change_the_run(serving):
    taken = []

    def take(has_token, said):
        taken.append((has_token, said))
        return {"taken": len(taken)}

    server = serving(on_message=take)
    token = server.address.partition("?")[2]
    assert token.startswith("token=")

    async def look():
        for query, may in (
            (f"?{token}", True),
            ("", False),
            ("?token=", False),
            (f"?{token}x", False),
        ):
            feed = await resumed(server, query=query)
            assert (await read(feed))["status"]["control"] is may
            await say(feed, event={"kind": "loss"})
            assert await read(feed) == {"taken": len(taken)}
            assert taken[-1] == (may, {"event": {"kind": "loss"}})

    run(look)


def test_beyond_this_machine_nobody_has_a_token(serving):
    server = serving(host="0.0.0.0", on_message=lambda has_token, _said: {"may": has_token})
    assert server.site.token == ""
    assert "token" not in server.address

    async def look():
        feed = await resumed(server, query="?token=")
        assert (await read(feed))["status"]["control"] is False
        await say(feed, x=1)
        assert await read(feed) == {"may": False}

    run(look)


def test_a_port_in_use_is_one_line():
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        server = PageServer(History(scene().stage), port=port)
        with pytest.raises(
            ServerFailed, match=rf"^port {port} of 127\.0\.0\.1 cannot be used .*in use"
        ):
            server.start()
        server.stop()


def test_an_address_of_another_machine_is_one_line():
    server = PageServer(History(scene().stage), host="203.0.113.1")
    with pytest.raises(ServerFailed, match=r"203\.0\.113\.1 cannot be used for the page: "):
        server.start()


def test_a_server_that_stops_tells_its_pages_and_lets_go_of_its_port(serving):
    server = serving()

    async def look():
        feed = await resumed(server)
        await read(feed)
        await asyncio.get_running_loop().run_in_executor(None, server.stop)
        assert await read(feed) is None

    run(look)
    serving(port=server.port)


def test_what_goes_wrong_in_the_server_is_one_line(serving, capsys, monkeypatch):
    def fail(_name):
        raise ZeroDivisionError("of all things")

    monkeypatch.setattr(handlers, "page_text", fail)

    async def ask():
        assert (await fetched(serving(), "")).code == 500

    run(ask)
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 1
    assert "of all things" in said[0]
