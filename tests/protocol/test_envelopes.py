"""Envelopes: what comes out is what went in, byte for byte, and nothing that should not."""

from dataclasses import replace

import msgpack
import pytest
from helpers_agents import observation
from hypothesis import given
from hypothesis import strategies as st

from encircle.protocol import VERSION
from encircle.protocol.codec import decode, encode, encode_any_length
from encircle.protocol.envelopes import ANSWERS, OBSERVATIONS, Enclosed, opened, sealed, with_inbox
from encircle.protocol.errors import MalformedMessage, OversizedMessage, WrongRun, WrongVersion
from encircle.protocol.keys import robot_key
from encircle.protocol.messages import Observation

RUN = "run"
PACKETS = st.lists(
    st.binary(max_size=40) | st.just(b"\xa5inbox\x90") | st.binary(min_size=250, max_size=300),
    max_size=20,
)


def asked(robot: str, inbox=()) -> Observation:
    return replace(observation(robot, 3, inbox=tuple(inbox)), lost=("r8", "r9"))


@given(st.lists(PACKETS, min_size=1, max_size=6), st.integers(1, 3000))
def test_observations_come_out_as_they_would_have_come_by_themselves(inboxes, bytes_max):
    whole = [asked(f"r{number}", inbox) for number, inbox in enumerate(inboxes, 1)]
    enclosed = [
        Enclosed(o.robot, "observation", encode_any_length(o, RUN, inbox=()), o.inbox)
        for o in whole
    ]
    envelopes = list(sealed(enclosed, RUN, bytes_max))
    found = [message for envelope in envelopes for message in opened(OBSERVATIONS, envelope, RUN)]
    assert found == [(robot_key(RUN, o.robot, "observation"), encode(o, RUN)) for o in whole]
    for envelope in envelopes:
        packets = msgpack.unpackb(envelope)["packets"]
        assert len(packets) == len(set(packets))


def test_an_envelope_is_not_much_longer_than_it_may_be():
    messages = [Enclosed(f"r{n}", "command", bytes(1000)) for n in range(1, 40)]
    envelopes = list(sealed(messages, RUN, 10_000))
    assert len(envelopes) == 4
    assert max(map(len, envelopes)) < 11_000
    assert [key.split("/")[3] for e in envelopes for key, _ in opened(ANSWERS, e, RUN)] == [
        f"r{n}" for n in range(1, 40)
    ]
    assert list(sealed([], RUN, 10)) == []
    assert len(list(sealed(messages[:1], RUN, 10))) == 1


def envelope(**changes) -> bytes:
    row = ["r1", "command", b"x", []]
    body = {"v": VERSION, "run": RUN, "packets": [b"p"], "messages": [row]} | changes
    return msgpack.packb({name: value for name, value in body.items() if value is not ...})


@pytest.mark.parametrize(
    ("payload", "error"),
    [
        (b"\xc1", MalformedMessage),
        (b"", MalformedMessage),
        (msgpack.packb([1]), MalformedMessage),
        (envelope(more=1), MalformedMessage),
        (envelope(packets=...), MalformedMessage),
        (envelope(v=VERSION - 1), WrongVersion),
        (envelope(v=True), WrongVersion),
        (envelope(run="other"), WrongRun),
        (envelope(packets=["text"]), MalformedMessage),
        (envelope(packets={}), MalformedMessage),
        (envelope(messages=3), MalformedMessage),
        (envelope(messages=[["r1", "command", b"x"]]), MalformedMessage),
        (envelope(messages=[["r1", "command", "x", []]]), MalformedMessage),
        (envelope(messages=[["r1", "setup", b"x", []]]), MalformedMessage),
        (envelope(messages=[["r1", "observation", b"x", []]]), MalformedMessage),
        (envelope(messages=[["r1", "command", b"x", [1]]]), MalformedMessage),
        (envelope(messages=[["r1", "command", b"x", [-1]]]), MalformedMessage),
        (envelope(messages=[["r1", "command", b"x", [True]]]), MalformedMessage),
        (envelope(messages=[["r1", "command", b"x", [0]]]), MalformedMessage),
    ],
)
def test_what_is_no_envelope_is_refused(payload, error):
    with pytest.raises(error):
        list(opened(ANSWERS, payload, RUN))


def test_few_bytes_do_not_become_more_than_an_observation_may_have():
    lean = encode_any_length(asked("r1"), RUN, inbox=())
    with pytest.raises(OversizedMessage):
        with_inbox(lean, [bytes(1024 * 1024)] * 5)
    assert len(decode(Observation, with_inbox(lean, [b"p"] * 300), RUN).inbox) == 300


def test_the_messages_before_one_that_is_wrong_are_there():
    rows = [["r1", "command", b"x", []], ["r1", "end", b"x", []]]
    found = opened(ANSWERS, envelope(messages=rows), RUN)
    assert next(found) == (robot_key(RUN, "r1", "command"), b"x")
    with pytest.raises(MalformedMessage):
        next(found)
