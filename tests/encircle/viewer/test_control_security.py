"""Who may change a run by its page's server: a page with the token, from this machine, alone."""

import asyncio
import json

import pytest
from tornado.httpclient import HTTPClientError, HTTPRequest
from tornado.websocket import websocket_connect

from encircle.runner.interventions import Interventions
from encircle.scene.stage import stage_of
from encircle.viewer.control import NOT_ALLOWED, Control
from encircle.viewer.showing import Show, ShowOptions
from encircle.world.loading.load import load

LOSS = {"kind": "loss", "rate": 0.6}


class Served:
    """A page's server of a hunt that never runs, and what pages have given to it."""

    def __init__(self, host="127.0.0.1", controlled=True):
        scenario, self.queue = load("sim1"), Interventions()
        control = Control(scenario, self.queue)
        on_message = control.on_message if controlled else None
        options = ShowOptions(host=host, browser=False)
        self.show = Show(stage_of(scenario, 1, "shown"), options, on_message)
        control.tell = self.show.server.tell
        self.control = control
        self.show.server.start()

    def url(self, query=""):
        return f"ws://127.0.0.1:{self.show.server.port}/feed{query}"


@pytest.fixture
def serving():
    made = []

    def make(**options):
        made.append(Served(**options))
        return made[-1]

    yield make
    for served in made:
        served.show.stop()


def answers_to(url, *said, headers=None, count=1):
    """What a page hears that says these things: so many messages."""

    async def talk():
        socket = await websocket_connect(HTTPRequest(url, headers=headers or {}))
        for thing in said:
            await socket.write_message(json.dumps(thing))
        heard = [json.loads(await socket.read_message()) for _ in range(count)]
        socket.close()
        while await socket.read_message() is not None:
            # Until then it is not closed.
            pass
        return heard

    return asyncio.run(talk())


def own_origin(served):
    return {"Origin": f"http://127.0.0.1:{served.show.server.port}"}


def test_the_token_of_the_address_lets_a_page_change_the_run(serving):
    served = serving()
    query = "?" + served.show.server.address.partition("?")[2]
    headers = own_origin(served)
    (radio,) = answers_to(served.url(query), {"intervene": LOSS}, {"radio": True}, headers=headers)
    assert "radio" in radio["control"]
    assert [json.loads(line) for line in served.queue.take()] == [LOSS]
    resume = {"resume": {"run": None, "from": 0}}
    (first,) = answers_to(served.url(query), resume, headers=headers)
    assert first["status"]["control"] is True


@pytest.mark.parametrize("query", ["", "?token=", "?token=wrong", "?token=%00", "?other=1"])
def test_without_the_right_token_nothing_is_given_and_the_page_is_told(serving, query):
    served = serving()
    (answer,) = answers_to(served.url(query), {"intervene": LOSS}, headers=own_origin(served))
    assert answer == {"control": {"refused": NOT_ALLOWED}}
    (first,) = answers_to(served.url(query), {"resume": None}, headers=own_origin(served))
    assert first["status"]["control"] is False
    assert served.queue.take() == []


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "https://127.0.0.1:1"])
def test_a_page_of_another_origin_gets_no_feed_even_with_the_token(serving, origin):
    served = serving()
    query = "?" + served.show.server.address.partition("?")[2]
    with pytest.raises(HTTPClientError, match="403"):
        answers_to(served.url(query), {"intervene": LOSS}, headers={"Origin": origin})
    assert served.queue.take() == []


def test_a_request_that_is_meant_for_another_host_is_refused(serving):
    served = serving()
    query = "?" + served.show.server.address.partition("?")[2]
    headers = {"Host": "evil.example", "Origin": "http://evil.example"}
    with pytest.raises(HTTPClientError, match="403"):
        answers_to(served.url(query), {"intervene": LOSS}, headers=headers)
    assert served.queue.take() == []


def test_beyond_loopback_there_is_no_token_and_no_control(serving):
    served = serving(host="0.0.0.0")
    assert "token" not in served.show.server.address
    for query in ("", "?token="):
        (answer,) = answers_to(served.url(query), {"intervene": LOSS}, headers=own_origin(served))
        assert answer == {"control": {"refused": NOT_ALLOWED}}
    assert served.queue.take() == []


def test_who_watches_a_hunt_of_somebody_else_has_no_control(serving):
    """As ``encircle watch`` shows it: what a page sends is taken in by nobody."""
    served = serving(controlled=False)
    assert "token" not in served.show.server.address
    said = ({"intervene": LOSS}, {"resume": None})
    (first,) = answers_to(served.url(), *said, headers=own_origin(served))
    assert first["status"]["control"] is False
    assert served.queue.take() == []


def test_what_became_of_an_event_is_told_to_pages_with_the_token_alone(serving):
    served = serving()
    query = "?" + served.show.server.address.partition("?")[2]

    async def talk():
        headers = own_origin(served)
        starter = await websocket_connect(HTTPRequest(served.url(query), headers=headers))
        other = await websocket_connect(HTTPRequest(served.url(), headers=headers))
        for socket in (starter, other):
            # What it asks is answered, so that the server knows of it from here on.
            await socket.write_message(json.dumps({"radio": True}))
            await socket.read_message()
        taken = {"given": 3, "event": LOSS | {"tick": 4}}
        served.control.on_report({"intervention": taken})
        told = json.loads(await starter.read_message())
        await other.write_message(json.dumps({"radio": True}))
        after = json.loads(await other.read_message())
        for socket in (starter, other):
            socket.close()
            while await socket.read_message() is not None:
                pass
        return told, after, taken

    told, after, taken = asyncio.run(talk())
    assert told == {"control": {"taken": taken}}
    assert after == {"control": {"refused": NOT_ALLOWED}}
