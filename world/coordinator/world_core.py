"""The world's side of the protocol, sans I/O: joins and messages in, messages out.

Round by round: an observation to every robot, a pose and a command back from each, one step of the
arena. A robot that is lost is not asked, and its body coasts to a stop; one that is back is set up
afresh and asked again. Which robots the scenario itself takes away follows from the tick alone.

What is refused is counted by cause and told to ``log``. The run's digest covers the truth at every
tick, every packet's fate, every pose and command, in robot order, and so who was lost, and the
setups of robots that are back; not the run's name, and not how or in which order anything arrived.
``settle`` does the work that nobody waits for, digest and recording, and is to be called after the
outgoing messages were sent.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from encircle.protocol.codec import (
    Message,
    begins_canonically,
    body_of,
    decode,
    decode_pose,
    encode,
    encode_any_length,
)
from encircle.protocol.endings import EndReason, failure_reason
from encircle.protocol.errors import (
    MalformedMessage,
    OutOfTurn,
    ProtocolError,
    WrongRun,
    WrongSender,
)
from encircle.protocol.keys import parse_key, robot_key, world_key
from encircle.protocol.lockstep import LockStep, Move
from encircle.protocol.messages import (
    Command,
    CommandMode,
    End,
    Observation,
    Point,
    Pose,
    PoseCarrier,
    Radio,
    Setup,
)
from encircle.protocol.plugins import PluginFailed
from encircle.protocol.wire.limits import REASON_MAX
from encircle.world.arena import engine
from encircle.world.channel import channel as radio
from encircle.world.coordinator.journal import Journal, Outgoing, Record
from encircle.world.coordinator.membership import Membership
from encircle.world.coordinator.result import Result
from encircle.world.scenario.model import digest_header

__all__ = ["Outgoing", "Record", "WorldCore"]


class _Answer:
    """One robot's answer to one observation, as it comes in; ``packet`` stays None without one.

    As it is made, it is no answer: a robot that is lost stands still and says nothing.
    """

    __slots__ = ("command", "digested_command", "digested_pose", "packet", "step")

    step: Point
    packet: bytes | None
    command: bytes
    digested_pose: bytes
    digested_command: bytes

    def __init__(self) -> None:
        self.step, self.command, self.packet = (0.0, 0.0), b"", None


class WorldCore:
    """The protocol around one arena. ``ended`` holds the reason once the run is over.

    ``broken``: the plug-in that has ended it, if one of this process has.

    ``record`` gets every message of the run; ``shows`` says whether ``settle`` returns the state at
    every tick, for viewers. ``setups``: the messages that go before the observations of this round,
    to the robots that are back.
    """

    def __init__(
        self,
        arena: engine.Arena,
        run: str,
        log: Callable[[str], None] = lambda _line: None,
        record: Record | None = None,
    ) -> None:
        self.arena = arena
        self.run = run
        self.table = LockStep(arena.ids)
        self.state = engine.initial(arena)
        self.ended: str | None = None
        self.plugin_failure: PluginFailed | None = None
        self.refused: Counter[str] = Counter()
        self._log = log
        self.record = record
        self.publishes_state = False
        self._state_key = world_key(run, "state")
        self._answers: dict[str, _Answer] = {}
        self._journal = Journal(arena.scenario, digest_header(arena.scenario, arena.seed))
        self._encoded: Outgoing = []
        self._round_messages: Outgoing = []
        self.fates: radio.Fates | None = None
        self.setups: Outgoing = []
        self.members = Membership(self.table, arena.scenario.events)

    def join(self, robot: str) -> Outgoing:
        """A robot is there: its setup. ``OutOfTurn`` if it is not of the team or joined before.

        One that was lost gets its setup with its next observation, which is that of the next round,
        or of the tick at which the scenario lets it come back.
        """
        self.members.join(robot)
        return [] if self.members.begun else [self._setup(robot)]

    def leave(self, robot: str, why: str) -> Outgoing:
        """A robot is lost: an open round no longer waits for it; returns the messages to send.

        An answer that it has given in full stands. Before the run has begun it may join again as if
        it had never been there. If nobody is left that the scenario does not bring back, the rounds
        that remain are played without any: it is for the caller to fail such a run instead.
        """
        if self.ended is not None:
            return []
        if self.members.leave(robot, self.state.tick, why):
            self._answers.pop(robot, None)
            if self.table.complete:
                return self._next_round()
        return []

    @property
    def departures(self) -> list[tuple[int, str, str]]:
        """Who was lost and came back so far, as in ``Result``."""
        return self.members.departures

    @property
    def lost(self) -> tuple[str, ...]:
        """The robots that are lost now, in robot order."""
        return self.members.lost

    def _setup(self, robot: str) -> tuple[str, bytes]:
        scenario, tick = self.arena.scenario, max(self.table.tick, 0)
        setup = Setup(
            robot,
            self.arena.ids,
            scenario.tick_s,
            scenario.team.strategy,
            scenario.parameters,
            PoseCarrier(scenario.radio),
            tick,
            tick,
        )
        return robot_key(self.run, robot, "setup"), encode(setup, self.run)

    def begin(self) -> Outgoing:
        """The first observations, once everyone has joined."""
        return self._next_round()

    def receive(self, key: str, payload: bytes) -> Outgoing:
        """Take one message in; returns the messages to send. Never raises for remote input."""
        was_over = self.ended is not None
        try:
            self._receive(key, payload)
        except ProtocolError as error:
            self.refuse(key, error)
            return []
        if self.ended is not None:
            return [] if was_over else self._end_messages()
        return self._next_round() if self.table.complete else []

    def unanswered(self) -> Outgoing:
        """The observations whose answers are still to come, to be sent again: both may be lost.

        With the setups that went before them; a robot that had its setup decides the same anew.
        """
        waiting = {
            robot_key(self.run, robot, channel)
            for robot in self.table.waiting()
            for channel in ("setup", "observation")
        }
        return [message for message in self._round_messages if message[0] in waiting]

    def restart_messages(self, robot: str) -> Outgoing:
        """A setup, and what the robot was asked for in the open round: it begins anew with that."""
        key = robot_key(self.run, robot, "observation")
        return [
            self._setup(robot),
            *[message for message in self._round_messages if message[0] == key],
        ]

    def refuse(self, key: str, error: ProtocolError) -> None:
        """Count and log something that was refused."""
        self.refused[error.cause] += 1
        self._log(f"world refused a message on {key}: {error}")

    def ask(self) -> list[Observation]:
        """Finish the round that everyone has answered, if any, and open the next one.

        Returns the observations to be answered; none when the run is over (``ended``), and none
        while no robot is there. What is in ``setups`` goes before them.
        """
        self.setups = []
        if self.table.tick < 0:
            # Recorded here and in robot order, whatever the order in which the robots joined.
            self._journal.note(0, [], [self._setup(robot) for robot in self.arena.ids])
        else:
            try:
                self._advance()
            except PluginFailed as error:
                self.give_up(error)
                return []
        state = self.state
        if state.captured or state.tick >= self.arena.scenario.ticks_max:
            reason = EndReason.CAPTURED if state.captured else EndReason.TICKS
            self.ended = reason.value
            self._note_state(self._end_messages() if self.record else [])
            return []
        self.setups = [self._setup(robot) for robot in self.members.open_round(state.tick)]
        observations = self._to_tell(engine.observe(self.arena, state, self.lost))
        if self.record is not None:
            self._encoded = [self._encode(o.robot, "observation", o) for o in observations]
        self._note_state([*self.setups, *self._encoded])
        return observations

    def _to_tell(self, observations: list[Observation]) -> list[Observation]:
        """The observations as they are told; a world by the clock adds to them."""
        return observations

    def answer(self, pose: Pose | None, packet: bytes, command: Command, payload: bytes) -> None:
        """Take one robot's answer, decoded and as it was sent; ``OutOfTurn`` as in ``receive``.

        For hunts inside one process, whose own encoder has just made the bytes.
        """
        if pose is not None:
            self._take_pose(pose, packet)
        self._take_command(command, payload)

    def fail(self, reason: str) -> Outgoing:
        """End the run as failed; returns the messages that tell the robots."""
        if self.ended is None:
            self.ended = failure_reason(reason)
        return self._end_messages()

    def give_up(self, error: PluginFailed) -> None:
        """End the run as failed, because a plug-in of this process has."""
        self.plugin_failure = error
        self.fail(str(error))

    def commit(self) -> Outgoing:
        """Digest and record what has happened since the last call; returns states for viewers."""
        return self._journal.commit(self.record, self._state_key)

    def result(self) -> Result:
        """What came of the run, so far if it has not ended."""
        self.commit()
        return self._journal.result(
            self.state, len(self.arena.ids), self.ended, self.refused, self.departures
        )

    def _receive(self, key: str, payload: bytes) -> None:
        run, robot, channel = parse_key(key)
        if run != self.run:
            raise WrongRun(f"key of run {run!r}, this is {self.run!r}")
        if channel == "pose":
            pose = decode_pose(payload, self.run)
            _check_sender(robot, pose)
            self._check_clock("sent_us", pose.sent_us)
            self._take_pose(pose, payload)
        elif channel == "command":
            command = decode(Command, payload, self.run)
            _check_sender(robot, command)
            self._check_clock("timing", command.timing)
            self._take_command(command, payload)
            if command.mode == CommandMode.FAILED:
                # Only where it happened can it be said how.
                self.fail(f"robot {robot} has failed at tick {command.tick}, and says itself how")
        else:
            raise OutOfTurn(f"the world does not listen to {channel!r}")

    def _check_clock(self, name: str, value: object) -> None:
        """In lock-step nothing may show what a clock says."""
        if value is not None:
            raise MalformedMessage(f"{name} must be null in lock-step")

    def _take_pose(self, pose: Pose, packet: bytes) -> None:
        self.table.move(pose.robot, Move.POSE, pose.tick)
        answer = self._answers.setdefault(pose.robot, _Answer())
        answer.packet, answer.digested_pose = packet, self._digested(pose, packet)

    def _take_command(self, command: Command, payload: bytes) -> None:
        move = Move.COMMAND if command.published else Move.COMMAND_ALONE
        self.table.move(command.robot, move, command.tick)
        answer = self._answers.setdefault(command.robot, _Answer())
        answer.step, answer.command = command.step, payload
        answer.digested_command = self._digested(command, payload)

    def _digested(self, message: Pose | Command, payload: bytes) -> bytes:
        """The body that the digest takes of what a robot said, whichever way it came here.

        As sent, unless the run's name could not be cut off that. What strangers sent to a robot
        must not change the digest: of what it refused nothing is taken.
        """
        if isinstance(message, Command) and message.refused:
            payload = encode_any_length(replace(message, refused={}), self.run)
        elif not begins_canonically(type(message), payload, self.run):
            payload = encode_any_length(message, self.run)
        return body_of(payload, self.run)

    def _encode(self, robot: str, channel: str, message: Message) -> tuple[str, bytes]:
        return robot_key(self.run, robot, channel), encode(message, self.run)

    def _next_round(self) -> Outgoing:
        """What to send for the next round that anyone is there for, or for the end of the run."""
        # Ends: each of these rounds is a tick, and a run has no more than ticks_max.
        while not (observations := self.ask()):
            if self.ended is not None:
                return self._end_messages()
        encoded = self._encoded or [self._encode(o.robot, "observation", o) for o in observations]
        self._round_messages = [*self.setups, *encoded]
        return self._round_messages

    def _note_state(self, messages: Outgoing) -> None:
        """Note the truth at a tick, and the messages sent at it, for ``settle``."""
        state = self.state
        if self.record is not None or self.publishes_state:
            shown = encode(engine.truth(self.arena, state), self.run)
            messages = [(self._state_key, shown), *messages]
        truth = state.positions[: len(self.arena.ids) + 1].tobytes() + bytes([state.captured])
        back = [body_of(payload, self.run) for _, payload in self.setups]
        self._journal.note(state.tick, [truth, *back], messages)

    def _advance(self) -> None:
        tick, ids = self.state.tick, self.arena.ids
        answers = [self._answers.get(robot) or _Answer() for robot in ids]
        silent = [not answer.command for answer in answers]
        lost = np.array(silent) if any(silent) else None
        steps = np.array([answer.step for answer in answers])
        packets = [answer.packet for answer in answers]
        self.state, fates = engine.advance(
            self.arena, self.state, steps, packets, len(self.run), lost
        )
        self._journal.count(tick, fates, len(self.state.contacts))
        digested, messages = [fates.due.tobytes()], []
        if fates.copies is not None:
            digested.append(fates.copies.tobytes())
        for robot, answer in zip(ids, answers, strict=True):
            if not answer.command:
                continue
            if answer.packet is not None:
                digested.append(answer.digested_pose)
                messages.append((robot_key(self.run, robot, "pose"), answer.packet))
            digested.append(answer.digested_command)
            messages.append((robot_key(self.run, robot, "command"), answer.command))
        if self.record is not None:
            message = encode(Radio(tick, _rows(fates.due), _rows(fates.copies)), self.run)
            messages.append((world_key(self.run, "radio"), message))
        self._journal.note(tick, digested, messages)
        self._answers = {}
        self.fates = fates

    def _end_messages(self) -> Outgoing:
        reason = (self.ended or "")[:REASON_MAX]
        return [
            self._encode(robot, "end", End(robot, self.state.tick, reason))
            for robot in self.arena.ids
        ]


def _rows(table: NDArray[np.int64] | None) -> tuple[tuple[int, ...], ...]:
    return () if table is None else tuple(map(tuple, table.tolist()))


def _check_sender(robot: str | None, message: Pose | Command) -> None:
    if message.robot != robot:
        raise WrongSender(f"{type(message).__name__} says it is from {message.robot!r}")
