"""What can be wrong with a message that another node sent.

Remote input raises one of these errors; the shell that received it counts it under ``cause``, logs
it with its key and goes on. Our own misuse of the protocol raises ``AssertionError`` instead.

And what a mistyped name may have meant, for messages of errors.
"""

from collections.abc import Iterable

LIKENESS_MIN = 0.6
NAMED_MAX = 3


class ProtocolError(Exception):
    """Remote input that is refused. ``cause`` is the name under which it is counted."""

    cause = "refused"


class MalformedMessage(ProtocolError):
    """Not msgpack, not a map, or a field is missing, unknown, twice there or beyond its limits."""

    cause = "malformed"


class OversizedMessage(ProtocolError):
    """Longer than the limit for its kind."""

    cause = "oversized"


class WrongVersion(ProtocolError):
    """Written for another version of the wire format."""

    cause = "wrong-version"


class WrongRun(ProtocolError):
    """Belongs to another run."""

    cause = "wrong-run"


class WrongSender(ProtocolError):
    """The robot named inside the message is not the one whose key it came on."""

    cause = "wrong-sender"


class UnknownKey(ProtocolError):
    """A key that is not part of the protocol."""

    cause = "unknown-key"


class OutOfTurn(ProtocolError):
    """What the lock-step table does not allow now: an unknown robot, a wrong tick, or twice."""

    cause = "out-of-turn"


class ConnectionClosed(Exception):
    """The connection was closed while a thread waited on it; not an error of the peer."""


def did_you_mean(name: object, known: Iterable[str], likeness_min: float = LIKENESS_MIN) -> str:
    """`` (did you mean 'flee'?)``, or nothing if no known name is similar."""
    # Imported late: it is needed only where a name is refused.
    from difflib import get_close_matches

    matches = get_close_matches(str(name), list(known), 1, likeness_min)
    return suggestion(matches)


def suggestion(names: Iterable[str]) -> str:
    """The first few names, as a question whether one was meant; empty if there are none."""
    matches = list(dict.fromkeys(names))[:NAMED_MAX]
    return f" (did you mean {' or '.join(map(repr, matches))}?)" if matches else ""
