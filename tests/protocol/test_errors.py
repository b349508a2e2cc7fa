"""Refusals are counted under their cause: each kind has its own, and closing a link is none."""

import pytest

from encircle.protocol import errors
from encircle.protocol.errors import ConnectionClosed, ProtocolError

REFUSALS = [
    error
    for error in vars(errors).values()
    if isinstance(error, type) and issubclass(error, ProtocolError) and error is not ProtocolError
]
CAUSES = {
    "MalformedMessage": "malformed",
    "OversizedMessage": "oversized",
    "WrongVersion": "wrong-version",
    "WrongRun": "wrong-run",
    "WrongSender": "wrong-sender",
    "UnknownKey": "unknown-key",
    "OutOfTurn": "out-of-turn",
}


def test_causes_are_the_published_ones():
    assert {error.__name__: error.cause for error in REFUSALS} == CAUSES


@pytest.mark.parametrize("error", REFUSALS, ids=lambda error: error.__name__)
def test_a_refusal_says_what_was_wrong_and_is_caught_as_a_protocol_error(error):
    with pytest.raises(ProtocolError, match=r"^said$"):
        raise error("said")


def test_a_closed_link_is_not_counted_as_a_refusal():
    assert not issubclass(ConnectionClosed, ProtocolError)
