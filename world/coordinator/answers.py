"""One robot's answer to one observation, and the parts of it that go into the run's digest.

What a robot has refused depends on what strangers sent to it, and the run's name on who started the
run. Neither may change the digest, so both are left out of what is digested.
"""

from encircle.protocol.codec import begins_canonically, body_of, encode_any_length
from encircle.protocol.messages import Command, Point, Pose


class Answer:
    """A robot's step in m and its messages as they were sent, for the digest and the recording.

    A new one is no answer: a robot that is lost stands still and sends nothing. ``packet`` is None
    as long as there is no pose, and ``command`` empty as long as there is no command.
    """

    __slots__ = ("command", "digested_command", "digested_pose", "packet", "step")

    step: Point
    packet: bytes | None
    command: bytes
    digested_pose: bytes
    digested_command: bytes

    def __init__(self) -> None:
        self.step, self.command, self.packet = (0.0, 0.0), b"", None


def digested_part(message: Pose | Command, payload: bytes, run: str) -> bytes:
    """What the digest takes of a message: its body as sent, without the run's name.

    The message is encoded anew if the name cannot be cut off what was sent, and if it is a command
    that counts refused messages.
    """
    if not begins_canonically(type(message), payload, run):
        payload = encode_any_length(message, run)
    return digested_part_of_own(message, payload, run)


def digested_part_of_own(message: Pose | Command, payload: bytes, run: str) -> bytes:
    """As ``digested_part``, of a payload that this process has encoded itself."""
    if isinstance(message, Command) and message.refused:
        payload = encode_any_length(message, run, refused={})
    return body_of(payload, run)
