"""One robot's side of the protocol in real time, sans I/O and clock: times come in with messages.

The world does not wait. So a robot answers the newest observation that it has and passes over those
before it; only the packets that the channel delivered, or admitted, with those are still used. In
its commands it reports how many observations it has passed over and how many never came, when the
observation came that it answers, when it answers, and receipts of what it has received
(``encircle.agents.brain.unacknowledged``). From that the world works out what the network does
(``encircle.world.network.transport``).

``RobotCore`` checks and decides as in lock-step; here it is chosen what it is given.
"""

from collections import deque
from dataclasses import replace

from encircle.agents.brain.brain import Action
from encircle.agents.brain.direct_inbox import DirectInbox
from encircle.agents.brain.robot_core import RobotCore
from encircle.agents.brain.unacknowledged import UnacknowledgedReceipts
from encircle.protocol.codec import decode, decode_pose, encode
from encircle.protocol.errors import (
    MalformedMessage,
    OutOfTurn,
    ProtocolError,
    WrongRun,
    WrongSender,
)
from encircle.protocol.keys import parse_key, robot_key
from encircle.protocol.messages import Command, CommandMode, Observation, PoseCarrier
from encircle.protocol.real_time import ReceiptKind, ReceptionCount, Timing

BACKLOG_MAX = 1024
"""Packets of peers that are kept until the next decision; the oldest ones are dropped, counted."""

Outgoing = list[tuple[str, bytes]]


class RealTimeRobotCore:
    """The protocol in real time around one robot's core, which must have its setup."""

    def __init__(self, core: RobotCore) -> None:
        self.core = core
        self._begin()

    def _begin(self) -> None:
        """Begin anew, as the brain does with a new setup."""
        setup = self.core.setup
        assert setup is not None, "real time begins with a setup"
        self._setup = setup
        self._is_direct = setup.radio == PoseCarrier.DIRECT
        for name in (ReceptionCount.PASSED_OVER, ReceptionCount.MISSED):
            self.core.refused.pop(name, None)
        self._direct_inbox = DirectInbox(
            [robot for robot in setup.team if robot != self.core.robot]
        )
        self._backlog: deque[tuple[int, str, bytes]] = deque()
        self._waiting: list[tuple[int, Observation]] = []
        self._next_tick = setup.first_tick
        self._sequence = setup.first_tick
        self._receipts = UnacknowledgedReceipts(setup.team)
        self._arrival_us = 0
        self._last_command: Command | None = None

    @property
    def observation_timeout_s(self) -> float:
        """After how long without an observation the robot is to stop."""
        config = self.core.config
        assert config is not None, "real time begins with a setup"
        return config.tick_s * config.parameters.silence_ticks_max

    def take(self, arrival_us: int, key: str, payload: bytes) -> None:
        """Take in a message that came at a time by this robot's clock; never raises for it."""
        try:
            self._take(arrival_us, key, payload)
        except ProtocolError as error:
            self.core.refuse(key, error)

    def _take(self, arrival_us: int, key: str, payload: bytes) -> None:
        run, robot, channel = parse_key(key)
        if run != self.core.run:
            raise WrongRun(f"key of run {run!r}, this is {self.core.run!r}")
        if channel == "pose" and robot != self.core.robot:
            self._backlog.append((arrival_us, key, payload))
            if len(self._backlog) > BACKLOG_MAX:
                self._backlog.popleft()
                self._count(ReceptionCount.OVERHEARD, 1)
        elif channel == "observation" and robot == self.core.robot:
            observation = decode(Observation, payload, run)
            self.core.check(observation)
            if observation.inbox and self._is_direct:
                raise MalformedMessage(
                    "Observation: inbox must be empty where robots hear each other"
                )
            if observation.tick < self._next_tick:
                raise OutOfTurn(
                    f"observation of tick {observation.tick}, next is {self._next_tick}"
                )
            self.core.accepted += 1
            self._count(ReceptionCount.MISSED, observation.tick - self._next_tick)
            self._next_tick = observation.tick + 1
            self._receipts.acknowledge(observation.answered)
            if not self._receipts.has_room(len(self._waiting)):
                self._count(ReceptionCount.MISSED, 1)
                return
            self._waiting.append((arrival_us, observation))
        else:
            self.core.receive(key, payload)
            if self.core.setup is not self._setup:
                self._begin()

    def decide(self) -> Action | None:
        """Answer the newest observation; None if there is none, or it is refused."""
        if not self._waiting:
            return None
        waiting, self._waiting = self._waiting, []
        self._arrival_us, newest = waiting[-1]
        self._take_backlog()
        for _, observation in waiting:
            self._direct_inbox.admit(observation.admitted, observation.tick)
        self._count(ReceptionCount.PASSED_OVER, len(waiting) - 1)
        for arrival_us, observation in waiting[:-1]:
            self._receipts.add_observation(ReceiptKind.PASSED_OVER, observation.tick, arrival_us)
        inbox = [packet for _, observation in waiting for packet in observation.inbox]
        if self._is_direct:
            inbox += self._direct_inbox.take(newest.tick)
        try:
            action = self.core.answer(replace(newest, inbox=tuple(inbox)))
        except ProtocolError as error:
            self.core.refuse("observation", error)
            self._count(ReceptionCount.PASSED_OVER, 1)
            self._receipts.add_observation(ReceiptKind.PASSED_OVER, newest.tick, self._arrival_us)
            return None
        self._receipts.add_observation(ReceiptKind.ANSWERED, newest.tick, self._arrival_us)
        return action

    def messages(self, action: Action, now_us: int) -> Outgoing:
        """The messages that an action makes, sent at ``now_us`` by this robot's clock."""
        receipts = self._receipts.carried_by(action.command.tick)
        timing = Timing(self._arrival_us, now_us, receipts)
        self._last_command = replace(action.command, timing=timing)
        messages = [self._message("command", self._last_command)]
        if action.pose is not None:
            # Numbered one by one, so that a gap is a packet that was lost and nothing else.
            pose = replace(action.pose, sequence=self._sequence, sent_us=now_us)
            self._sequence += 1
            messages.insert(0, self._message("pose", pose))
        return messages

    def stop(self, now_us: int) -> Outgoing:
        """No observation for ``observation_timeout_s``: stand still and say so once."""
        if self._last_command is None or self._last_command.mode == CommandMode.STOP:
            return []
        assert self._last_command.timing is not None, "commands by the clock have it"
        # Whether this or the one before has come cannot be told apart: both tell the same.
        timing = Timing(self._arrival_us, now_us, self._last_command.timing.receipts)
        self._last_command = replace(
            self._last_command,
            step=(0.0, 0.0),
            mode=CommandMode.STOP,
            published=False,
            timing=timing,
        )
        return [self._message("command", self._last_command)]

    def _take_backlog(self) -> None:
        """Take in what peers have sent, as far as there is room for receipts."""
        while self._backlog and self._receipts.has_room():
            arrival_us, key, packet = self._backlog.popleft()
            try:
                pose = decode_pose(packet, self.core.run)
                if pose.robot != parse_key(key).robot:
                    raise WrongSender(f"pose says it is from {pose.robot!r}")
                if pose.robot not in self._setup.team:
                    raise WrongSender(f"pose from {pose.robot}")
            except ProtocolError as error:
                self.core.refuse(key, error)
                continue
            self._direct_inbox.add_packet(pose.robot, pose.sequence, pose.tick, packet)
            self._receipts.add_packet(pose.robot, pose.sequence, arrival_us)

    def count_dropped(self, packets: int) -> None:
        """So many messages were dropped, because there was no room for them."""
        self._count(ReceptionCount.OVERHEARD, packets)

    def _count(self, name: str, number: int) -> None:
        if number:
            self.core.refused[name] += number

    def _message(self, channel: str, message: object) -> tuple[str, bytes]:
        core = self.core
        return robot_key(core.run, core.robot, channel), encode(message, core.run)  # type: ignore[arg-type]
