"""The world's side of the protocol when the clock ends the ticks, sans I/O and clock.

The arena, its step, the radio and the membership of robots are those of ``WorldCore``; only who is
waited for is different: nobody. What has come by a tick's end is used. A command for an earlier
tick is late, and counted; its step is taken all the same while nothing newer is there, as long as
``team.hold_ticks_max`` allows (``encircle.world.coordinator.deadlines``). A packet goes on the
modelled radio in the tick in which it reaches the world; of several from one robot the newest, the
others are counted as superseded. Where robots hear each other (``radio = "direct"``) the packets
themselves are not passed on: with a modelled radio that is not perfect, observations say which of
them it admits.

Times are given by the caller, in us of the world's clock. Runs by the clock differ from each other,
so the digest only tells whether two are the same one.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from typing import Any, cast

from encircle.protocol.codec import decode, decode_pose
from encircle.protocol.errors import OutOfTurn
from encircle.protocol.keys import robot_key
from encircle.protocol.lockstep import Move, Phase
from encircle.protocol.messages import Command, CommandMode, Observation, Pose, Radio
from encircle.world.arena.engine import Arena
from encircle.world.coordinator.deadlines import ZERO_STEP, HeldCommand, step_at
from encircle.world.coordinator.world_core import Outgoing, Record, WorldCore, _Answer
from encircle.world.network.message_ledger import MessageLedger
from encircle.world.scenario.channel_model import ChannelModel, Outage, Partition, Silence

TimedRecord = Callable[[int, str, bytes, int], None]
STAND_IN = b"-"
"""In the place of a command that has not come: the robot is there, but not heard of."""
NOTED_MAX = 65_536
"""Messages of one tick that are kept for the recording; more are left out, and counted."""


class RealTimeWorldCore(WorldCore):
    """The protocol around one arena whose ticks end by the clock.

    Its caller calls ``take`` for what arrives and ``end_tick`` at every deadline. ``counts``: by
    robot, how many of its commands were late, for how many ticks its step was held or it stood
    still for want of one, and how many of its packets were superseded. ``clock``, if there is one,
    tells the time at which observations are sent, which else is that of the tick's end.
    """

    def __init__(
        self,
        arena: Arena,
        run: str,
        log: Callable[[str], None] = lambda _line: None,
        record: Record | None = None,
    ) -> None:
        super().__init__(arena, run, log, record)
        scenario = arena.scenario
        self._direct = scenario.radio == "direct"
        self.ledger = MessageLedger(arena.ids, scenario.tick_s, self._direct)
        self.counts: dict[str, Counter[str]] = {robot: Counter() for robot in arena.ids}
        self._perfect = has_perfect_channel(arena)
        self._hold_ticks_max = scenario.team.hold_ticks_max
        self._held: dict[str, HeldCommand] = {}
        self._stopped: set[str] = set()
        self._heard_tick: dict[str, int] = {}
        self._sequences: dict[str, int] = {}
        self._packets: dict[str, tuple[bytes, bytes]] = {}
        self._commands: dict[str, tuple[bytes, bytes]] = {}
        self._noted: list[tuple[int, str, bytes, int]] = []
        self._now_us = 0
        self.clock: Callable[[], int] | None = None

    def at(self, now_us: int) -> None:
        """What happens next happens at this time."""
        self._now_us = now_us

    def begin(self) -> Outgoing:
        """The first observations, once everyone has joined."""
        return self._messages(self.ask())

    def take(self, key: str, payload: bytes, arrival_us: int) -> Outgoing:
        """Take in a message that came at a time; there is something to send if it ends the run.

        Never raises for remote input.
        """
        self._now_us = arrival_us
        return super().receive(key, payload)

    def end_tick(self, now_us: int) -> Outgoing:
        """End the tick with what has come, and begin the next; returns the messages to send."""
        if self.ended is not None:
            return []
        self._now_us = now_us
        tick = self.table.tick
        for robot in self.table.waiting():
            self.table.move(robot, Move.COMMAND_ALONE, tick)
            self._answers[robot] = self._answer_of(robot, tick)
        self._packets, self._commands = {}, {}
        return self._messages(self.ask())

    def silent(self, ticks_max: int) -> tuple[str, ...]:
        """The robots of which nothing has come for more ticks than that, robot order."""
        tick = self.table.tick
        return tuple(
            robot
            for robot in self.table.waiting()
            if tick - self._heard_tick.get(robot, tick) > ticks_max
        )

    def ask(self) -> list[Observation]:
        """As in ``WorldCore``, with the times noted."""
        begins = self.table.tick < 0
        observations = super().ask()
        if self.plugin_failure is not None:
            return []
        back = {key for key, _ in self.setups}
        for robot in self.arena.ids:
            if begins or robot_key(self.run, robot, "setup") in back:
                self.ledger.joined(robot, self.state.tick)
                self._held.pop(robot, None)
                self._sequences[robot] = self.state.tick - 1
                self._heard_tick[robot] = self.state.tick
        for observation in observations:
            self.ledger.asked(observation.robot, observation.tick, self._now_us)
        if self.fates is not None and not begins:
            due, copies = self.fates
            rows = () if copies is None else tuple(map(tuple, copies.tolist()))
            self.ledger.fates_drawn(
                Radio(self.state.tick - 1, tuple(map(tuple, due.tolist())), rows)
            )
        return observations

    def commit(self) -> Outgoing:
        """As in ``WorldCore``; what has come is recorded as it came, with the time."""
        keep = self.record
        if keep is None:
            return super().commit()
        timed = cast(TimedRecord, keep)

        def record(tick: int, key: str, payload: bytes) -> None:
            channel = key.rsplit("/", 1)[1]
            if channel == "radio" or (channel == "end" and self._noted):
                for noted in self._noted:
                    timed(*noted)
                self._noted = []
            if channel not in ("pose", "command"):
                timed(tick, key, payload, self._now_us)

        self.record = record
        try:
            return super().commit()
        finally:
            self.record = keep

    def refused_for_room(self, messages: int) -> None:
        """So many messages have come for which there was no room."""
        if messages:
            self.refused["no-room"] += messages

    def summary(self) -> dict[str, Any]:
        """What there is to say of commands and packets that were not on time, by robot."""
        names = ("late", "held", "stood_still", "superseded")
        return {
            robot: {**dict.fromkeys(names, 0), **counts} for robot, counts in self.counts.items()
        }

    def _next_round(self) -> Outgoing:
        # The clock says when, not that everyone has answered.
        return []

    def restart_messages(self, robot: str) -> Outgoing:
        """As there; of a robot that begins anew nothing has come yet."""
        setup, *asked = super().restart_messages(robot)
        observations = [decode(Observation, payload, self.run) for _, payload in asked]
        return [
            setup,
            *(self._encode(robot, "observation", replace(o, answered=None)) for o in observations),
        ]

    def _messages(self, observations: list[Observation]) -> Outgoing:
        if self.ended is not None:
            return self._end_messages()
        encoded = self._encoded if self.record is not None else []
        encoded = encoded or [self._encode(o.robot, "observation", o) for o in observations]
        self._round_messages = [*self.setups, *encoded]
        return self._round_messages

    def _to_tell(self, observations: list[Observation]) -> list[Observation]:
        if self.clock is not None:
            # The step has taken a while, which is no delay of the network.
            self._now_us = self.clock()
        return [
            replace(o, sent_us=self._now_us, answered=self._answered(o), **self._radio_part(o))
            for o in observations
        ]

    def _answered(self, observation: Observation) -> int | None:
        """The tick of the newest command that has come from the robot since its setup."""
        if robot_key(self.run, observation.robot, "setup") in dict(self.setups):
            return None
        participations, held_command = (
            self.ledger.participations[observation.robot],
            self._held.get(observation.robot),
        )
        begun = participations[-1].first_tick if participations else 0
        return (
            held_command.tick if held_command is not None and held_command.tick >= begun else None
        )

    def _radio_part(self, observation: Observation) -> dict[str, Any]:
        if not self._direct:
            return {}
        if self._perfect:
            return {"inbox": ()}
        poses = [decode_pose(packet, self.run) for packet in observation.inbox]
        return {"inbox": (), "admitted": tuple([(p.robot, p.sequence) for p in poses])}

    def _check_clock(self, name: str, value: object) -> None:
        """Who shows nothing of its clock takes part all the same."""

    def _take_pose(self, pose: Pose, packet: bytes) -> None:
        try:
            self._check_turn(pose.robot, pose.tick, "pose")
        except OutOfTurn:
            # Others may have heard it: what they did is to be understood from the recording.
            if self._direct and pose.robot in self.counts and pose.tick <= self.table.tick:
                self._note(pose.tick, pose.robot, "pose", packet)
                self.ledger.packet(pose, self._now_us)
            raise
        known = self._sequences.get(pose.robot, -1)
        if pose.sequence <= known:
            raise OutOfTurn(f"packet {pose.sequence} of {pose.robot} after packet {known}")
        self._sequences[pose.robot] = pose.sequence
        self._heard_tick[pose.robot] = self.table.tick
        if pose.robot in self._packets:
            self.counts[pose.robot]["superseded"] += 1
        self._packets[pose.robot] = packet, self._digested(pose, packet)
        self._note(pose.tick, pose.robot, "pose", packet)
        self.ledger.packet(pose, self._now_us)

    def _take_command(self, command: Command, payload: bytes) -> None:
        robot, tick = command.robot, command.tick
        self._check_turn(robot, tick, "command")
        known = self._held.get(robot)
        stops = command.mode == CommandMode.STOP
        again = stops and command.step == ZERO_STEP and not command.published
        if known is not None and (tick < known.tick or (tick == known.tick and not again)):
            raise OutOfTurn(f"command of {robot} for tick {tick} after that for {known.tick}")
        if tick < self.table.tick and not stops:
            self.counts[robot]["late"] += 1
        self._heard_tick[robot] = self.table.tick
        self._held[robot] = HeldCommand(tick, command.step)
        if tick == self.table.tick:
            self._commands[robot] = payload, self._digested(command, payload)
        self._note(tick, robot, "command", payload)
        self.ledger.answered(command, self._now_us)

    def _check_turn(self, robot: str, tick: int, what: str) -> None:
        """``OutOfTurn`` for what cannot be from this robot now."""
        if robot not in self.counts:
            raise OutOfTurn(f"robot {robot!r} is not in this team ({', '.join(self.arena.ids)})")
        if robot in self.table.in_phase(Phase.LEFT, Phase.ABSENT):
            raise OutOfTurn(f"{what} of {robot} at tick {self.table.tick}: it is not there")
        participations = self.ledger.participations[robot]
        if tick > self.table.tick or not participations or tick < participations[-1].first_tick:
            raise OutOfTurn(f"{what} of {robot} is for tick {tick}, this is {self.table.tick}")

    def _answer_of(self, robot: str, tick: int) -> _Answer:
        """What a robot does at a tick that ends, and what it sends."""
        answer, held_command = _Answer(), self._held.get(robot)
        step = step_at(held_command, tick, self._hold_ticks_max)
        answer.step = ZERO_STEP if step is None else step
        if held_command is None or held_command.tick < tick:
            self.counts[robot]["stood_still" if step is None else "held"] += 1
        answer.command, answer.digested_command = self._commands.get(robot, (STAND_IN, b""))
        if robot in self._packets:
            answer.packet, answer.digested_pose = self._packets[robot]
        return answer

    def _note(self, tick: int, robot: str, channel: str, payload: bytes) -> None:
        if self.record is None:
            return
        if len(self._noted) >= NOTED_MAX:
            self.counts[robot]["unrecorded"] += 1
        else:
            self._noted.append((tick, robot_key(self.run, robot, channel), payload, self._now_us))


def has_perfect_channel(arena: Arena) -> bool:
    """Whether the modelled radio delivers everything at once: then it has nothing to say."""
    channel = arena.scenario.channel.model_copy(update={"order": "free"})
    switched = any(isinstance(e, Silence | Outage | Partition) for e in arena.scenario.events)
    return channel == ChannelModel() and not switched
