"""The world's side of the protocol in lock-step, sans I/O: joins and messages in, messages out.

A round is over when every robot that was asked has answered with a command, and with a pose unless
the command says that none comes. Then the arena makes its step and the next round is opened
(``encircle.world.coordinator.round_engine``). What is refused is counted by cause, and ``log`` gets
a line of it.

The journal (``rounds.commit()``) is work that nobody waits for; call it after the outgoing
messages were sent.
"""

from collections.abc import Callable, Mapping
from typing import Any

from encircle.protocol.envelopes import ANSWERS, opened
from encircle.protocol.errors import ProtocolError, WrongRun
from encircle.protocol.keys import channel_of, parse_key
from encircle.protocol.lockstep import Move
from encircle.protocol.messages import Command, Observation, Pose
from encircle.world.arena.engine import Arena, ArenaState
from encircle.world.coordinator.answers import Answer, digested_part, digested_part_of_own
from encircle.world.coordinator.incoming import check_without_times, read_answer, reported_failure
from encircle.world.coordinator.journal import Record
from encircle.world.coordinator.membership import DepartureCause
from encircle.world.coordinator.outgoing import Outgoing
from encircle.world.coordinator.round_engine import RoundEngine
from encircle.world.scenario.model import Event


class WorldCore:
    """The protocol around one run in lock-step. ``rounds``: the run itself.

    ``record`` gets every message of the run. ``hosts``: of each robot whose last answer came in an
    envelope, the robot on whose key that was; it is asked by an envelope on that robot's key.
    """

    def __init__(
        self,
        arena: Arena,
        run: str,
        log: Callable[[str], None] = lambda _line: None,
        record: Record | None = None,
    ) -> None:
        self.run = run
        self.rounds = RoundEngine(arena, run, log)
        self.rounds.journal.record = record
        self.answers: dict[str, Answer] = {}
        self.hosts: dict[str, str] = {}
        self._host: str | None = None

    @property
    def arena(self) -> Arena:
        """The constants of the run, with all events that were given so far."""
        return self.rounds.arena

    @property
    def state(self) -> ArenaState:
        """The truth at the tick of the open round."""
        return self.rounds.state

    @property
    def ended(self) -> str | None:
        """Why the run is over, None as long as it is not."""
        return self.rounds.ended

    def record_with(self, record: Record | None) -> None:
        """Record from now on, or record nothing any more if ``record`` is None."""
        self.rounds.journal.record = record

    def join(self, robot: str) -> Outgoing:
        """A robot is present: its setup, as ``RoundEngine.join``."""
        return self.rounds.join(robot)

    def leave(self, robot: str, cause: DepartureCause, detail: str = "") -> Outgoing:
        """A robot is lost: an open round no longer waits for it; returns the messages to send.

        An answer that it has given in full stands. If nobody is left that the scenario does not
        bring back, the rounds that remain are played without any robot: the caller should rather
        fail such a run.
        """
        self.hosts.pop(robot, None)
        if self.rounds.leave(robot, cause, detail):
            self.answers.pop(robot, None)
            if self.rounds.table.complete:
                return self._next_round()
        return []

    def intervene(self, given: Mapping[str, Any]) -> Event:
        """Give the run an event, as ``RoundEngine.intervene``."""
        return self.rounds.intervene(given)

    def begin(self) -> Outgoing:
        """The first observations, once every robot has joined."""
        return self._next_round()

    def receive(self, key: str, payload: bytes) -> Outgoing:
        """Take one message in; returns the messages to send. Never raises for remote input."""
        if channel_of(key) == ANSWERS:
            return self._open(key, payload)
        was_over = self.ended is not None
        try:
            message = read_answer(key, payload, self.run)
            check_without_times(message)
            if isinstance(message, Pose):
                self._take_pose(message, payload)
            else:
                self._take_command(message, payload)
        except ProtocolError as error:
            self.rounds.refusals.add(key, error)
            return []
        failure = reported_failure(message)
        if failure is not None:
            self.rounds.fail(failure)
        if self.ended is not None:
            return [] if was_over else self.rounds.end_messages()
        return self._next_round() if self.rounds.table.complete else []

    def _open(self, key: str, envelope: bytes) -> Outgoing:
        """Take in the messages of an envelope, each as if it had come by itself."""
        outgoing: Outgoing = []
        try:
            run, host, _ = parse_key(key)
            if run != self.run:
                raise WrongRun(f"key of run {run!r}, this is {self.run!r}")
            self._host = host
            for inner_key, payload in opened(ANSWERS, envelope, self.run):
                outgoing += self.receive(inner_key, payload)
        except ProtocolError as error:
            self.rounds.refusals.add(key, error)
        finally:
            self._host = None
        return outgoing

    def ask(self) -> list[Observation]:
        """Finish the round that every robot has answered, if any, and open the next one.

        Returns the observations to be answered, as ``RoundEngine.next_round``.
        """
        answers, self.answers = self.answers, {}
        return self.rounds.next_round(answers)

    def answer(self, pose: Pose | None, packet: bytes, command: Command, payload: bytes) -> None:
        """Take one robot's answer, decoded and as it was sent; ``OutOfTurn`` as in ``receive``.

        For hunts inside one process, whose own encoder has just made the bytes.
        """
        table, answer = self.rounds.table, Answer()
        if pose is not None:
            table.move(pose.robot, Move.POSE, pose.tick)
            answer.packet = packet
            answer.digested_pose = digested_part_of_own(pose, packet, self.run)
        table.move(command.robot, _move_of(command), command.tick)
        answer.step, answer.command = command.step, payload
        answer.digested_command = digested_part_of_own(command, payload, self.run)
        self.answers[command.robot] = answer

    def _next_round(self) -> Outgoing:
        """The messages that open the next round in which a robot takes part, or end the run.

        Before them, what viewers are shown of the rounds that went by without a robot.
        """
        shown: Outgoing = []
        # Ends: each of these rounds is a tick, and a run has no more than ticks_max.
        while not self.ask():
            if self.ended is not None:
                return [*shown, *self.rounds.end_messages()]
            # What is noted holds whole states: it must not pile up while no robot is there.
            shown += self.rounds.commit()
        return [*shown, *self.rounds.open_round.messages_by(self.hosts)]

    def _take_pose(self, pose: Pose, packet: bytes) -> None:
        self.rounds.table.move(pose.robot, Move.POSE, pose.tick)
        answer = self.answers.setdefault(pose.robot, Answer())
        answer.packet, answer.digested_pose = packet, digested_part(pose, packet, self.run)

    def _take_command(self, command: Command, payload: bytes) -> None:
        self.rounds.table.move(command.robot, _move_of(command), command.tick)
        answer = self.answers.setdefault(command.robot, Answer())
        answer.step, answer.command = command.step, payload
        answer.digested_command = digested_part(command, payload, self.run)
        if self._host is None:
            self.hosts.pop(command.robot, None)
        else:
            self.hosts[command.robot] = self._host


def _move_of(command: Command) -> Move:
    """The move that a command is."""
    return Move.COMMAND if command.published else Move.COMMAND_ALONE
