"""A session for other people's keys: what it puts arrives as it is, what it declares is seen."""

import queue
from contextlib import ExitStack

import pytest
from helpers_connections import connecting_to, listening
from helpers_waiting import LONGEST_S, taken, until

from encircle.protocol.errors import ConnectionClosed
from encircle.protocol.zenoh.endpoints import ConnectionFailed
from encircle.protocol.zenoh.liveliness import alive_keys
from encircle.protocol.zenoh.raw_session import RawSession
from encircle.protocol.zenoh.session import closing, open_session
from encircle.runner.launch import free_endpoint

KEY, TOKEN = "7/some/topic", "@other/7/token"


@pytest.fixture
def endpoint():
    return free_endpoint()


@pytest.fixture
def pair(endpoint):
    """One that listens and one that is connected to it."""
    with ExitStack() as stack:
        where = (listening(endpoint), connecting_to(endpoint))
        yield tuple(stack.enter_context(RawSession(access)) for access in where)


def test_what_is_put_arrives_at_others_as_it_is_and_not_at_oneself(pair):
    ours, theirs = pair
    heard, own = queue.Queue(), queue.Queue()
    theirs.subscribe("7/**", lambda *message: heard.put(message))
    ours.subscribe("7/**", lambda *message: own.put(message))
    put = ours.publisher(KEY)
    until(lambda: put(b"try", b"") or not heard.empty(), "the subscription to be known")
    put(b"\x00\xff", b"beside it")
    until(lambda: taken(heard) == (KEY, b"\x00\xff"), "the message")
    assert own.empty()


def test_the_attachment_goes_along(pair, endpoint):
    ours, _ = pair
    put = ours.publisher(KEY)
    attached = queue.Queue()
    with closing(open_session(connecting_to(endpoint))) as session:
        session.declare_subscriber(KEY, lambda sample: attached.put(sample.attachment.to_bytes()))
        until(lambda: put(b"payload", b"\x01\x02") or not attached.empty(), "a message")
    assert taken(attached) == b"\x01\x02"


def test_a_token_is_there_as_long_as_the_session(pair, endpoint):
    ours, theirs = pair
    changes = queue.Queue()
    theirs.watch("@other/**", lambda *change: changes.put(change))
    ours.declare_token(TOKEN)
    assert taken(changes) == (TOKEN, True)
    with closing(open_session(connecting_to(endpoint))) as session:
        assert alive_keys(session, "@other/**", LONGEST_S) == {TOKEN}
    ours.close()
    assert taken(changes) == (TOKEN, False)


def test_after_its_end_nothing_can_be_put(pair):
    ours, _ = pair
    put = ours.publisher(KEY)
    ours.close()
    ours.close()
    with pytest.raises(ConnectionClosed):
        put(b"late", b"")


def test_sessions_have_ids_of_their_own(pair):
    ours, theirs = pair
    assert ours.id != theirs.id
    assert ours.id == ours.id.lower()
    assert int(ours.id, 16)


def test_where_nobody_listens_it_says_so(endpoint):
    with pytest.raises(ConnectionFailed, match=f"cannot connect to {endpoint}"):
        RawSession(connecting_to(endpoint, 0.1))
