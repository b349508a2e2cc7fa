"""Zenoh links over real sessions on the loopback interface, on ports the system chooses."""

import queue
import socket
import threading
import time
from concurrent.futures import Future
from contextlib import ExitStack

import pytest

from protocol.errors import LinkClosed
from protocol.zenoh_link import LinkError, ZenohLink

WAIT_S_MAX = 15.0
RETRY_S = 0.02


@pytest.fixture
def endpoint():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    return f"tcp/127.0.0.1:{port}"


@pytest.fixture
def closing():
    with ExitStack() as stack:
        yield stack


@pytest.fixture
def pair(endpoint, closing):
    """A link that listens and one that connected to it, known to reach each other."""
    links = []
    for listens in (True, False):
        link = ZenohLink(endpoint, listens, "t/**", WAIT_S_MAX)
        closing.callback(link.close)
        links.append(link)
    for sender, receiver in (links, links[::-1]):
        until_heard(sender, receiver)
    return links


def in_thread(function, *arguments):
    """A future of the call, on a thread that does not outlive a failed test."""
    future = Future()

    def run():
        try:
            future.set_result(function(*arguments))
        except BaseException as error:
            future.set_exception(error)

    threading.Thread(target=run, daemon=True).start()
    return future


def received(link, count=1):
    return [in_thread(link.receive).result(timeout=WAIT_S_MAX) for _ in range(count)]


def until_heard(sender, receiver):
    """Send until something arrives, then until all that was sent before has."""
    heard = in_thread(receiver.receive)
    for _ in range(int(WAIT_S_MAX / RETRY_S)):
        sender.send("t/hello", b"hello")
        if heard.done():
            break
        time.sleep(RETRY_S)
    assert heard.result(timeout=WAIT_S_MAX) == ("t/hello", b"hello")
    sender.send("t/synced", b"")
    while received(receiver) != [("t/synced", b"")]:
        pass


def test_messages_go_both_ways_unchanged_and_in_order(pair):
    payloads = [b"", bytes(range(256)), b"x" * 100_000, *(str(k).encode() for k in range(200))]
    for sender, receiver in (pair, pair[::-1]):
        sent = [(f"t/{k % 3}", payload) for k, payload in enumerate(payloads)]
        for key, payload in sent:
            sender.send(key, payload)
        assert received(receiver, len(sent)) == sent


def test_own_messages_do_not_come_back(pair):
    for sender, receiver in (pair, pair[::-1]):
        receiver.send("t/own", b"own")
        sender.send("t/other", b"other")
        assert received(receiver) == [("t/other", b"other")]
        assert received(sender) == [("t/own", b"own")]


def test_only_the_keys_taken_are_received(pair):
    listener, connected = pair
    connected.send("u/1", b"not taken")
    connected.send("t/1", b"taken")
    assert received(listener) == [("t/1", b"taken")]


def test_a_token_is_seen_to_come_and_go(pair):
    listener, connected = pair
    seen = queue.Queue()
    listener.watch("t/*/alive", lambda key, alive: seen.put((key, alive)))
    connected.announce("t/r1/alive")
    assert seen.get(timeout=WAIT_S_MAX) == ("t/r1/alive", True)
    connected.close()
    assert seen.get(timeout=WAIT_S_MAX) == ("t/r1/alive", False)


def test_a_token_that_was_there_before_the_watch_is_told_of(pair):
    listener, connected = pair
    listener.announce("t/world/alive")
    connected.send("t/announced", b"")
    received(listener)
    seen = queue.Queue()
    connected.watch("t/world/alive", lambda key, alive: seen.put((key, alive)))
    assert seen.get(timeout=WAIT_S_MAX) == ("t/world/alive", True)


def test_closing_wakes_who_waits(pair):
    for link in pair:
        waiting = in_thread(link.receive)
        time.sleep(0.1)  # let it get to where it waits
        in_thread(link.close).result(timeout=WAIT_S_MAX)
        with pytest.raises(LinkClosed):
            waiting.result(timeout=WAIT_S_MAX)


def test_what_was_sent_before_closing_still_arrives(pair):
    listener, connected = pair
    payloads = [bytes([k]) * 1000 for k in range(100)]
    for payload in payloads:
        connected.send("t/1", payload)
    connected.close()
    assert received(listener, 100) == [("t/1", payload) for payload in payloads]


def test_a_link_may_be_closed_twice_and_stays_closed(pair):
    link = pair[1]
    link.send("t/declared", b"")
    for _ in range(2):
        link.close()
    for _ in range(2):
        with pytest.raises(LinkClosed):
            link.receive()
        for key in ("t/declared", "t/new"):
            with pytest.raises(LinkClosed):
                link.send(key, b"late")


def test_a_link_whose_other_end_is_gone_waits_on(pair):
    listener, connected = pair
    waiting = in_thread(connected.receive)
    listener.close()
    with pytest.raises(TimeoutError):
        waiting.result(timeout=0.3)
    connected.close()
    with pytest.raises(LinkClosed):
        waiting.result(timeout=WAIT_S_MAX)


def test_connecting_where_nobody_listens_fails_and_names_the_endpoint(endpoint):
    with pytest.raises(LinkError, match=f"cannot connect to {endpoint}: .+"):
        ZenohLink(endpoint, False, "t/**", connect_s_max=0.5)


def test_listening_where_somebody_else_does_fails_and_names_the_endpoint(closing):
    taken = closing.enter_context(socket.socket())
    taken.bind(("127.0.0.1", 0))
    taken.listen()
    endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
    with pytest.raises(LinkError, match=f"cannot listen on {endpoint}: .+"):
        ZenohLink(endpoint, True, "t/**")


@pytest.mark.parametrize("endpoint", ["nonsense", "tcp/", ""])
def test_an_endpoint_that_is_none_is_a_link_error(endpoint):
    with pytest.raises(LinkError):
        ZenohLink(endpoint, False, "t/**", connect_s_max=0.5)


def test_connecting_waits_for_a_listener_that_comes_a_little_later(endpoint, closing):
    connecting = in_thread(ZenohLink, endpoint, False, "t/**", WAIT_S_MAX)
    listener = ZenohLink(endpoint, True, "t/**")
    closing.callback(listener.close)
    connected = connecting.result(timeout=WAIT_S_MAX)
    closing.callback(connected.close)
    until_heard(connected, listener)
