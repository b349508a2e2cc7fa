"""One run of an arena, round by round, whoever decides when a round is over. Sans I/O.

A round is an observation to every robot that takes part, their answers, and one step of the arena.
``RoundEngine`` holds what a run is at any moment (its state, its members, its journal and the
messages of the open round) and makes that step. The two cores drive it: ``WorldCore`` ends a round
when every robot has answered, ``RealTimeWorldCore`` when the clock says so.

A robot that is lost is not asked, and its body coasts to a stop; one that is back is set up anew
and asked again. Which robots the scenario itself takes away follows from the tick alone.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from encircle.protocol.endings import EndReason, failure_reason
from encircle.protocol.lockstep import LockStep
from encircle.protocol.messages import Observation
from encircle.protocol.plugins import PluginFailed, policy_source
from encircle.world.arena import engine
from encircle.world.channel.channel import Fates
from encircle.world.channel.delay_means import requested_delay
from encircle.world.coordinator.answers import Answer
from encircle.world.coordinator.incoming import Refusals
from encircle.world.coordinator.journal import Journal
from encircle.world.coordinator.membership import DepartureCause, Membership
from encircle.world.coordinator.outgoing import OpenRound, Outgoing, end_messages, setup_message
from encircle.world.coordinator.result import Result
from encircle.world.loading.interventions import (
    INTERVENTIONS_MAX,
    InterventionRefused,
    event_of,
    table_of,
)
from encircle.world.scenario.model import Event

Completion = Callable[[OpenRound], list[Observation]]
"""Gives the observations of a round that is being opened what the engine does not know of."""


class RoundEngine:
    """One run. ``ended`` holds the reason once it is over.

    ``table``: which robot has been asked and has answered; ``open_round``: what they were asked;
    ``arena``: as the scenario has been played so far; ``written``: the scenario as the run began;
    ``interventions``: the events that were given since.
    ``refused``: counts by cause; ``departures``: which robots were lost and came back so far;
    ``fates``: of the packets of the round before, None in the first. ``plugin_failure``: how a
    plug-in of this process has ended the run, if one has.
    """

    def __init__(self, arena: engine.Arena, run: str, log: Callable[[str], None]) -> None:
        self.arena = arena
        self.written = arena.scenario
        self.interventions: list[Event] = []
        self.run = run
        self.table = LockStep(arena.ids)
        self.members = Membership(self.table, arena.scenario.events)
        self.journal = Journal(arena, run)
        self.refusals = Refusals(log)
        self.refused = self.refusals.counts
        self.departures = self.members.departures
        self.state = engine.initial(arena)
        self.fates: Fates | None = None
        self.open_round = OpenRound(run)
        self.ended: str | None = None
        self.plugin_failure: PluginFailed | None = None
        self._foreseen: engine.Foreseen | None = None
        self._all_sent_before = True
        self._sources: dict[str, str] = {}

    @property
    def lost(self) -> tuple[str, ...]:
        """The robots that are lost now, in robot order."""
        return self.members.lost

    def join(self, robot: str) -> Outgoing:
        """A robot is present: its setup. ``OutOfTurn`` if it is not of the team or joined before.

        One that was lost gets its setup with its next observation, which is that of the next round,
        or of the tick at which the scenario lets it come back.
        """
        self.members.join(robot)
        return [] if self.members.begun else [self._setup(robot)]

    def leave(self, robot: str, cause: DepartureCause, detail: str = "") -> bool:
        """A robot is lost; whether the open round has waited for it, which it no longer does.

        Before the run has begun the robot may join again as if it had never been present.
        """
        if self.ended is not None:
            return False
        return self.members.leave(robot, self.state.tick, cause, detail)

    def intervene(self, given: Mapping[str, Any]) -> Event:
        """Give the run an event, as a scenario's file has it, from the next tick on or a later one.

        All goes on as if the scenario had had it from the start. ``InterventionRefused`` if it
        makes no sense or comes at the wrong time; then nothing has changed.
        """
        if self.table.tick < 0 or self.ended is not None:
            when = "has not begun" if self.table.tick < 0 else "is over"
            raise InterventionRefused(f"intervention: the run {when}")
        if len(self.interventions) >= INTERVENTIONS_MAX:
            raise InterventionRefused(
                f"intervention: the run has had {INTERVENTIONS_MAX} of them, which is the most"
            )
        event = event_of(given, self.arena.scenario, self.state.tick)
        # It is of a later tick, so that nothing of the open round depends on it; but what was
        # foreseen is of the arena without it.
        self.arena = engine.with_event(self.arena, event)
        self._foreseen = None
        self.members.add_event(event)
        self.interventions.append(event)
        self.journal.note_intervention(self.state.tick, table_of(event))
        return event

    def next_round(
        self, answers: Mapping[str, Answer], complete: Completion | None = None
    ) -> list[Observation]:
        """Finish the open round, if any, with the answers to it, and open the next one.

        Returns the observations to be answered: none when the run is over (``ended``), and none
        while no robot takes part. The setups in ``open_round`` go before them.
        """
        self.open_round = OpenRound(self.run)
        if self.table.tick < 0:
            # Recorded here and in robot order, whatever the order in which the robots joined.
            self.journal.note_first_setups([self._setup(robot) for robot in self.arena.ids])
        else:
            try:
                self._advance(answers)
            except PluginFailed as error:
                self.fail(str(error), error)
                return []
        state = self.state
        if state.captured or state.tick >= self.arena.scenario.ticks_max:
            reason = EndReason.CAPTURED if state.captured else EndReason.TICKS
            self.ended = reason.value
            self.journal.note_state(state, [], self.end_messages)
            return []
        returned = self.members.open_round(state.tick)
        self.open_round = OpenRound(
            self.run,
            returned,
            [self._setup(robot) for robot in returned],
            engine.observe(self.arena, state, self.lost),
        )
        if complete is not None:
            self.open_round.observations = complete(self.open_round)
        opened = self.open_round
        self.journal.note_state(state, opened.setups, lambda: opened.messages)
        return self.open_round.observations

    def _advance(self, answers: Mapping[str, Answer]) -> None:
        tick = self.state.tick
        in_order = [answers.get(robot) or Answer() for robot in self.arena.ids]
        silent = [not answer.command for answer in in_order]
        lost = np.array(silent) if any(silent) else None
        steps = np.array([answer.step for answer in in_order])
        packets = [answer.packet for answer in in_order]
        self.state, self.fates = engine.advance(
            self.arena, self.state, steps, packets, len(self.run), lost, self._foreseen
        )
        self._foreseen = None
        self._all_sent_before = lost is None and None not in packets
        self.journal.note_answers(tick, self.fates, in_order)

    def foresee(self) -> None:
        """Do what the next step can do without the answers, of which some are still to come.

        It holds if every robot sends; where one did not in the round before, it would be in vain.
        """
        if self.ended is None and self._foreseen is None and self._all_sent_before:
            self._foreseen = engine.foresee(self.arena, self.state)

    def unanswered(self) -> Outgoing:
        """The observations whose answers are still to come, to be sent again: both may be lost.

        With the setups that went before them; a robot that had its setup decides the same anew.
        """
        return self.open_round.messages_to(self.table.waiting())

    def restart_messages(self, robot: str) -> Outgoing:
        """A setup, and the robot's observation of the open round: it begins anew with that."""
        return [self._setup(robot), *self.open_round.observation_of_beginner(robot)]

    def fail(self, reason: str, plugin_failure: PluginFailed | None = None) -> Outgoing:
        """End the run as failed; returns the messages that tell the robots.

        ``plugin_failure``: the failure of a plug-in of this process, if that is the reason.
        """
        if plugin_failure is not None:
            self.plugin_failure = plugin_failure
        if self.ended is None:
            self.ended = failure_reason(reason)
        return self.end_messages()

    def end_messages(self) -> Outgoing:
        """The end of the run, to every robot of the team."""
        return end_messages(self.arena.ids, self.run, self.state.tick, self.ended or "")

    def commit(self) -> Outgoing:
        """Digest and record what is new since the last call; returns what viewers are shown."""
        return self.journal.commit()

    def result(self) -> Result:
        """What came of the run, so far if it has not ended."""
        self.commit()
        state, scenario, count = self.state, self.arena.scenario, len(self.arena.ids)
        packets = self.journal.packets.totals(state)
        requested = requested_delay(scenario.channel, scenario.ids)
        mean, direct = packets.delay_ticks_mean, scenario.is_direct
        return Result(
            state.captured,
            state.tick if state.captured else None,
            state.tick,
            self.ended or "running",
            tuple(state.geometry.distances[:count, count].tolist()),
            packets.sent,
            packets.lost,
            packets.copied,
            packets.delivered,
            packets.in_flight,
            requested.model,
            requested.s_mean,
            None if mean is None or direct else mean * scenario.tick_s,
            self.journal.contacts,
            dict(sorted(self.refused.items())),
            self.journal.digest,
            tuple(departure.row for departure in self.departures),
            tuple(map(table_of, self.interventions)),
        )

    def first_setups(self) -> tuple[bytes, ...]:
        """Each robot's setup for tick 0, encoded, in robot order."""
        return tuple(self._setup(robot, 0)[1] for robot in self.arena.ids)

    def _setup(self, robot: str, first_tick: int | None = None) -> tuple[str, bytes]:
        policy = self.arena.scenario.strategy_of(robot)
        if policy not in self._sources:
            # Once in a run, so that who comes back later has the policy that the others have.
            self._sources[policy] = policy_source(policy)
        tick = max(self.table.tick, 0) if first_tick is None else first_tick
        return setup_message(self.arena, self.run, robot, tick, self._sources[policy])
