"""Links in memory: who gets what, in which order, and how waiting ends."""

import threading
from concurrent.futures import ThreadPoolExecutor

import pytest
from helpers_waiting import result_of
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.protocol.connections import MemoryHub
from encircle.protocol.errors import ConnectionClosed

CHEAP = settings(max_examples=50, deadline=None, derandomize=True)


def drained(connection):
    """All that waits in a link; closes it."""
    connection.close()
    return list(messages(connection))


def messages(connection):
    """Messages until the link is closed."""
    try:
        while True:
            yield connection.receive()
    except ConnectionClosed:
        return


def test_a_message_reaches_every_other_link_that_takes_its_key_and_no_more():
    hub = MemoryHub()
    sender, taker, other_taker, stranger = (
        hub.connection(prefixes) for prefixes in (["a/"], ["a/", "b/"], ["a/1"], ["b/"])
    )
    sender.send("a/1", b"one")
    assert drained(taker) == drained(other_taker) == [("a/1", b"one")]
    assert drained(sender) == drained(stranger) == []


def test_a_link_that_takes_a_key_twice_gets_a_message_once():
    hub = MemoryHub()
    sender, taker = hub.connection([]), hub.connection(["a", "a/", "a/1"])
    sender.send("a/1", b"one")
    assert drained(taker) == [("a/1", b"one")]


def test_a_link_that_takes_nothing_gets_nothing():
    hub = MemoryHub()
    sender, silent = hub.connection(["a/"]), hub.connection([])
    sender.send("a/1", b"one")
    assert drained(silent) == []


@CHEAP
@given(st.lists(st.tuples(st.sampled_from("abc"), st.binary(max_size=4)), max_size=30))
def test_messages_arrive_in_the_order_sent_across_keys(sent):
    hub = MemoryHub()
    sender, taker = hub.connection([]), hub.connection(["a", "c"])
    for key, payload in sent:
        sender.send(key, payload)
    assert drained(taker) == [(key, payload) for key, payload in sent if key != "b"]


def test_hubs_do_not_know_each_other():
    sender, taker = MemoryHub().connection([]), MemoryHub().connection([""])
    sender.send("a", b"one")
    assert drained(taker) == []


def test_receive_waits_for_a_message():
    hub = MemoryHub()
    sender, taker = hub.connection([]), hub.connection(["a"])
    with ThreadPoolExecutor(1) as pool:
        waiting = pool.submit(taker.receive)
        sender.send("a", b"one")
        assert result_of(waiting) == ("a", b"one")


def test_closing_wakes_everyone_who_waits():
    connection = MemoryHub().connection([""])
    started = threading.Barrier(3)

    def wait():
        started.wait()
        return connection.receive()

    with ThreadPoolExecutor(2) as pool:
        waiting = [pool.submit(wait) for _ in range(2)]
        started.wait()
        connection.close()
        for future in waiting:
            with pytest.raises(ConnectionClosed):
                result_of(future)


def test_what_came_before_closing_can_still_be_read():
    hub = MemoryHub()
    sender, taker = hub.connection([]), hub.connection(["a"])
    sender.send("a", b"one")
    taker.close()
    assert taker.receive() == ("a", b"one")
    with pytest.raises(ConnectionClosed):
        taker.receive()


def test_closing_twice_is_allowed_and_sending_on_a_closed_link_is_not():
    connection = MemoryHub().connection(["a"])
    connection.close()
    connection.close()
    with pytest.raises(ConnectionClosed):
        connection.send("a", b"one")


def test_a_closed_link_stays_closed_whatever_the_others_send():
    hub = MemoryHub()
    sender, taker = hub.connection([]), hub.connection(["a"])
    taker.close()
    sender.send("a", b"one")
    for _ in range(3):
        with pytest.raises(ConnectionClosed):
            taker.receive()


def test_overhearing_takes_what_others_send_on_such_keys_until_it_is_ended():
    hub, heard = MemoryHub(), []
    one, other = hub.connection([]), hub.connection([])
    end = one.subscribe("run/*/pose", lambda key, payload: heard.append((key, payload)))
    for key in ("run/r1/pose", "run/r1/command", "other/r1/pose"):
        other.send(key, b"said")
    one.send("run/r2/pose", b"own")
    assert heard == [("run/r1/pose", b"said")]
    end()
    end()
    other.send("run/r1/pose", b"later")
    assert len(heard) == 1
