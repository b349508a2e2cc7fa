"""Messages from robots: what is accepted as an answer, and the count of what is refused."""

from collections import Counter
from collections.abc import Callable

from encircle.protocol.codec import decode, decode_pose
from encircle.protocol.errors import (
    MalformedMessage,
    OutOfTurn,
    ProtocolError,
    WrongRun,
    WrongSender,
)
from encircle.protocol.keys import parse_key
from encircle.protocol.messages import Command, CommandMode, Pose

NO_ROOM = "no-room"
"""The cause under which messages are counted that arrived faster than they could be handled."""


class Refusals:
    """What was refused: counted by cause, and one line to ``log`` for each message."""

    def __init__(self, log: Callable[[str], None]) -> None:
        self.counts: Counter[str] = Counter()
        self._log = log

    def add(self, key: str, error: ProtocolError) -> None:
        """A message on a key was refused."""
        self.counts[error.cause] += 1
        self._log(f"world refused a message on {key}: {error}")

    def add_dropped(self, messages: int) -> None:
        """So many messages were dropped, because there was no room for them."""
        if messages:
            self.counts[NO_ROOM] += messages


def read_answer(key: str, payload: bytes, run: str) -> Pose | Command:
    """The pose or command that arrived on a key, from the robot whose key it is.

    Raises a ``ProtocolError`` for anything else.
    """
    key_run, robot, channel = parse_key(key)
    if key_run != run:
        raise WrongRun(f"key of run {key_run!r}, this is {run!r}")
    message: Pose | Command
    if channel == "pose":
        message = decode_pose(payload, run)
    elif channel == "command":
        message = decode(Command, payload, run)
    else:
        raise OutOfTurn(f"the world does not listen to {channel!r}")
    if message.robot != robot:
        raise WrongSender(f"{type(message).__name__} says it is from {message.robot!r}")
    return message


def check_without_times(message: Pose | Command) -> None:
    """``MalformedMessage`` if a message shows a time: in lock-step nothing may depend on clocks."""
    if isinstance(message, Pose):
        name, times = "sent_us", message.sent_us is not None
    else:
        name, times = "timing", message.timing is not None
    if times:
        raise MalformedMessage(f"{name} must be null in lock-step")


def reported_failure(message: Pose | Command) -> str | None:
    """The reason for ending the run if a command says that its robot's own code has failed."""
    if not isinstance(message, Command) or message.mode != CommandMode.FAILED:
        return None
    # Only the robot's own process can say how.
    return f"robot {message.robot} has failed at tick {message.tick}, and says itself how"
