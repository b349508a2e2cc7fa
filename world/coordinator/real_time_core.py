"""The world's side of the protocol when the clock ends the ticks, sans I/O and clock.

The run is the same ``RoundEngine`` that ``WorldCore`` drives in lock-step; only its driver differs:
it waits for no robot. At the end of a tick, what has come by then is used, and for a robot without
a command the step that it holds (``encircle.world.coordinator.real_time_answers``). Where robots
hear each other (``radio = "direct"``) packets are not passed on; if the modelled channel is not
perfect, observations say which packets it admits.

The caller gives all times, in us of the world's clock. Runs by the clock differ from each other, so
the digest only tells whether two are the same one.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from encircle.protocol.codec import decode_pose
from encircle.protocol.errors import ProtocolError
from encircle.protocol.lockstep import Move
from encircle.protocol.messages import Observation, Pose
from encircle.world.arena.engine import Arena, ArenaState
from encircle.world.coordinator.arrivals import Arrivals, TimedJournalRecord, TimedRecord
from encircle.world.coordinator.incoming import read_answer, reported_failure
from encircle.world.coordinator.membership import DepartureCause
from encircle.world.coordinator.outgoing import OpenRound, Outgoing, radio_of
from encircle.world.coordinator.real_time_answers import RealTimeAnswers
from encircle.world.coordinator.round_engine import RoundEngine
from encircle.world.network.message_ledger import MessageLedger
from encircle.world.scenario.channel_events import Change, Cut
from encircle.world.scenario.channel_model import ChannelModel
from encircle.world.scenario.model import Event


class RealTimeWorldCore:
    """The protocol around one run whose ticks end by the clock. ``rounds``: the run itself.

    Its caller calls ``take`` for what arrives and ``end_tick`` at every deadline. ``arrivals``
    takes in what robots send; ``answers`` holds the newest of it, and ``ledger`` every message with
    its times. ``now_us``: the time of what happens next. ``clock``, if there is one, tells the time
    at which observations are sent; without one that is the time of the tick's end.
    """

    def __init__(
        self, arena: Arena, run: str, log: Callable[[str], None] = lambda _line: None
    ) -> None:
        scenario = arena.scenario
        self.run = run
        self.rounds = RoundEngine(arena, run, log)
        self.answers = RealTimeAnswers(arena.ids, run, scenario.team.hold_ticks_max)
        self.ledger = MessageLedger(arena.ids, scenario.tick_s, scenario.is_direct)
        self.now_us = 0
        self.clock: Callable[[], int] | None = None
        self.arrivals = Arrivals(self.rounds.table, self.answers, self.ledger, run)
        self._perfect = has_perfect_channel(arena)

    @property
    def arena(self) -> Arena:
        """The constants of the run, with all events that were given so far."""
        return self.rounds.arena

    @property
    def state(self) -> ArenaState:
        """The truth at the tick that is open."""
        return self.rounds.state

    @property
    def ended(self) -> str | None:
        """Why the run is over, None as long as it is not."""
        return self.rounds.ended

    def record_with(self, record: TimedRecord) -> None:
        """Record from now on."""
        timed_record = TimedJournalRecord(record, lambda: self.now_us)
        self.rounds.journal.record = self.arrivals.record = timed_record

    def join(self, robot: str) -> Outgoing:
        """A robot is present: its setup, as ``RoundEngine.join``."""
        return self.rounds.join(robot)

    def leave(self, robot: str, cause: DepartureCause, detail: str = "") -> Outgoing:
        """A robot is lost; there is nothing to send before the tick ends."""
        self.rounds.leave(robot, cause, detail)
        return []

    def intervene(self, given: Mapping[str, Any]) -> Event:
        """Give the run an event, as ``RoundEngine.intervene``."""
        event = self.rounds.intervene(given)
        # From the next observation on robots are told which packets the channel admits.
        self._perfect = has_perfect_channel(self.arena)
        return event

    def begin(self) -> Outgoing:
        """The first observations, once every robot has joined."""
        return self._next_round()

    def take(self, key: str, payload: bytes, arrival_us: int) -> Outgoing:
        """Take in a message that came at a time; there is something to send if it ends the run.

        Never raises for remote input.
        """
        self.now_us = arrival_us
        was_over = self.ended is not None
        try:
            message = read_answer(key, payload, self.run)
            if isinstance(message, Pose):
                self.arrivals.take_pose(message, payload, arrival_us)
            else:
                self.arrivals.take_command(message, payload, arrival_us)
        except ProtocolError as error:
            self.rounds.refusals.add(key, error)
            return []
        failure = reported_failure(message)
        if failure is not None:
            self.rounds.fail(failure)
        return self.rounds.end_messages() if self.ended is not None and not was_over else []

    def end_tick(self, now_us: int) -> Outgoing:
        """End the tick with what has come, and begin the next; returns the messages to send."""
        if self.ended is not None:
            return []
        self.now_us = now_us
        return self._next_round()

    def silent(self, ticks_max: int) -> tuple[str, ...]:
        """The robots of which nothing has come for more ticks than that, robot order."""
        tick = self.rounds.table.tick
        return tuple(
            robot
            for robot in self.rounds.table.waiting()
            if self.answers.ticks_without_message(robot, tick) > ticks_max
        )

    def _next_round(self) -> Outgoing:
        """End the open tick, if any, and begin the next; the messages that say so."""
        rounds, table = self.rounds, self.rounds.table
        begins, answers = table.tick < 0, {}
        for robot in table.waiting():
            table.move(robot, Move.COMMAND_ALONE, table.tick)
            answers[robot] = self.answers.answer_at(robot, table.tick)
        self.answers.end_tick()
        rounds.next_round(answers, self._with_times)
        if rounds.plugin_failure is None:
            for robot in self.arena.ids if begins else rounds.open_round.returned:
                self.ledger.joined(robot, self.state.tick)
                self.answers.begin_anew(robot, self.state.tick)
            for observation in rounds.open_round.observations:
                self.ledger.asked(observation.robot, observation.tick, self.now_us)
            if rounds.fates is not None and not begins:
                self.ledger.fates_drawn(radio_of(self.state.tick - 1, rounds.fates))
        if self.ended is not None:
            return rounds.end_messages()
        # While no robot is there nothing else is sent, and what is noted must not pile up.
        return rounds.open_round.messages or rounds.commit()

    def _with_times(self, opened: OpenRound) -> list[Observation]:
        """The observations of a round, with what robots have to know where clocks count."""
        if self.clock is not None:
            # The step has taken a while, which is no delay of the network.
            self.now_us = self.clock()
        observations = opened.observations
        if self.ledger.direct:
            observations = [_without_packets(o, self.run, self._perfect) for o in observations]
        newest_ticks = {
            robot: self.answers.newest_command_tick(robot)
            for robot in self.arena.ids
            if robot not in opened.returned
        }
        return [
            replace(o, sent_us=self.now_us, answered=newest_ticks.get(o.robot))
            for o in observations
        ]


def _without_packets(observation: Observation, run: str, perfect: bool) -> Observation:
    """An observation for robots that hear each other: which packets the channel admits, at most.

    A channel that is ``perfect`` admits all of them, which needs no list.
    """
    if perfect:
        return replace(observation, inbox=())
    poses = [decode_pose(packet, run) for packet in observation.inbox]
    return replace(observation, inbox=(), admitted=tuple([(p.robot, p.sequence) for p in poses]))


def has_perfect_channel(arena: Arena) -> bool:
    """Whether the modelled channel delivers everything at once: then it has nothing to say."""
    channel = arena.scenario.channel.model_copy(update={"order": "free"})
    switched = any(isinstance(e, Cut | Change) for e in arena.scenario.events)
    return channel == ChannelModel() and arena.channel.radios is None and not switched
