"""The message ledger of a recorded real-time run, rebuilt from its recording.

The messages and their times are fed to ``encircle.world.network.message_ledger`` in the order of
the recording, as the world does it during the run.
"""

from typing import Any

from encircle.protocol.codec import decode
from encircle.protocol.errors import MalformedMessage, ProtocolError, WrongSender
from encircle.protocol.messages import Command, Observation, Pose, Radio, Setup
from encircle.world.network.message_ledger import MessageLedger
from encircle.world.recording.recording import Recording, RecordingError

ROWS_MAX = 20_000_000
MESSAGE_TYPES: dict[str, Any] = {
    "setup": Setup,
    "observation": Observation,
    "pose": Pose,
    "command": Command,
    "radio": Radio,
}


def ledger_of(recording: Recording) -> MessageLedger:
    """The message ledger of a recorded run.

    Raises ``RecordingError`` if the run was not in real time, or if a message in it is
    malformed or from a robot that is not in the team.
    """
    scenario, run = recording.scenario, recording.run
    if scenario.clock != "wall":
        raise RecordingError(
            f"{recording.path}: clock = {scenario.clock!r}: in lock-step no clock is involved,"
            " so there is nothing to measure; run with --set clock=wall"
        )
    ledger = MessageLedger(scenario.ids, scenario.tick_s, scenario.is_direct, ROWS_MAX)
    for (tick, topic, payload), at_us in zip(recording.messages, recording.logged_us, strict=True):
        robot, channel = topic.split("/")[-2:]
        if channel in ("setup", "observation", "pose", "command") and robot not in scenario.ids:
            raise RecordingError(f"{topic} of tick {tick}: the team is {', '.join(scenario.ids)}")
        try:
            _add_message(ledger, robot, channel, payload, run, at_us)
        except ProtocolError as error:
            raise RecordingError(f"{topic} of tick {tick}: {error}") from None
    return ledger


def _add_message(
    ledger: MessageLedger, robot: str, channel: str, payload: bytes, run: str, at_us: int
) -> None:
    kind = MESSAGE_TYPES.get(channel)
    if kind is None:
        return
    message = decode(kind, payload, run)
    if getattr(message, "robot", robot) != robot:
        raise WrongSender(f"it is of {message.robot}")
    if kind is Radio and len(message.fates) != len(ledger.robots):
        raise MalformedMessage("it is of another team")
    match message:
        case Setup():
            ledger.joined(robot, message.first_tick)
        case Observation(sent_us=int(sent_us)):
            ledger.asked(robot, message.tick, sent_us)
        case Pose():
            ledger.packet(message, at_us)
        case Command():
            ledger.answered(message, at_us)
        case Radio():
            ledger.fates_drawn(message)
