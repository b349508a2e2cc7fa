"""One frame after the other from what is known of the rounds, in the order of their ticks.

What a frame takes from those before it is kept here: packets in flight, who was lost, who touched.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

from encircle.protocol.messages import Command, Radio, State
from encircle.protocol.process.log import printable
from encircle.scene import events
from encircle.scene.beliefs import Believed
from encircle.scene.frame import Event, Frame, Values
from encircle.scene.radio_watch import RadioWatch, age_mean, ages_of_row
from encircle.scene.values import TruthValues, conflicts
from encircle.world.scenario.model import Event as ScenarioEvent
from encircle.world.scenario.model import Scenario

Flags = tuple[bool, ...]


@dataclass(slots=True)
class Round:
    """What is known of the round of one tick. ``asked``: who got an observation."""

    state: State | None = None
    radio: Radio | None = None
    asked: set[str] = field(default_factory=set)
    commands: dict[str, Command] = field(default_factory=dict)


class FrameMaker:
    """Makes the frames of one run of a scenario."""

    def __init__(self, scenario: Scenario) -> None:
        self._robots = scenario.ids
        self._radius_m = scenario.team.radius_m
        self._reach_m = scenario.capture.stop_distance_m
        self._by_clock, self._is_direct = scenario.clock == "wall", scenario.is_direct
        self._radio = RadioWatch(len(scenario.ids))
        self._truth_values = TruthValues(scenario)
        self._schedule = events.Schedule(scenario)
        self._last: Frame | None = None
        self._there: Flags = (True,) * len(scenario.ids)
        self._doubts: dict[str, str] = {}

    def forget_radio(self) -> None:
        """Ages and delivery begin anew: ticks were missed, and what arrived in them."""
        self._radio = RadioWatch(len(self._robots))

    def add_event(self, event: ScenarioEvent) -> None:
        """An event was given to the run while it goes on."""
        self._schedule.add(event)

    def frame(
        self,
        a_round: Round,
        believed: Believed | None,
        heard: Mapping[str, tuple[int, ...]],
        ended: str | None,
        is_last: bool,
    ) -> Frame:
        """The frame of the next round, whose truth is known; of the last one the truth alone.

        ``believed``: what robots believe, None if that is not asked for; ``heard``: by robot, the
        tick of the newest packet that it has of each, where robots hear each other; ``ended``: why
        the run ended, as far as is known.
        """
        state = a_round.state
        assert state is not None, "frames are of ticks whose truth is known"
        tick = state.tick
        commands = {} if is_last else a_round.commands
        decided = [commands.get(robot) for robot in self._robots]
        beliefs, doubts = believed or ((None,) * len(self._robots), {})
        self._radio.arrive(tick)
        lost = self._lost(a_round, is_last)
        there = self._there_of(lost, commands, is_last)
        radio = None if is_last else a_round.radio
        packets = () if radio is None else self._radio.send(radio)
        ages = self._ages(tick, heard)
        off = self._schedule.silent(tick)
        ending = events.ending(state, self._robots, there, ended, self._reach_m) * is_last
        told = (*self._events(state, lost, doubts), *ending)
        frame = Frame(
            tick=tick,
            robots=state.robots,
            headings_rad=state.headings_rad,
            target=state.target,
            captured=state.captured,
            contacts=state.contacts,
            lost=lost,
            silent=tuple([k in off and not is_lost for k, is_lost in enumerate(lost)]),
            modes=tuple([c.mode if c else None for c in decided]),
            xi=tuple([c.xi if c else None for c in decided]),
            points=tuple([c.point if c else None for c in decided]),
            goals=tuple([c.goal if c else None for c in decided]),
            packets=packets,
            ages=ages,
            beliefs=beliefs,
            beliefs_unsure=tuple([robot for robot in self._robots if robot in doubts]),
            values=self._values(state, there, ages, commands),
            events=tuple([event._replace(text=printable(event.text)) for event in told]),
        )
        self._last, self._doubts = frame, doubts
        return frame

    def _lost(self, a_round: Round, is_last: bool) -> Flags:
        """Who takes no part; at the last tick, at which nobody is asked, as before."""
        if is_last:
            return self._last.lost if self._last else (False,) * len(self._robots)
        takes_part = a_round.asked | a_round.commands.keys()
        return tuple([robot not in takes_part for robot in self._robots])

    def _there_of(self, lost: Flags, commands: Mapping[str, Command], is_last: bool) -> Flags:
        """Who hunts: in lock-step who gave a command, by the clock, where one may be late, all."""
        if self._by_clock:
            return tuple([not is_lost for is_lost in lost])
        if not is_last:
            self._there = tuple([robot in commands for robot in self._robots])
        return self._there

    def _ages(self, tick: int, heard: Mapping[str, tuple[int, ...]]) -> tuple[tuple[int, ...], ...]:
        """Ages by the packets' fates; where robots hear each other, by what they have heard."""
        ages = self._radio.ages(tick)
        if not self._is_direct:
            return ages
        return tuple(
            [
                ages_of_row(k, heard[robot], tick) if robot in heard else row
                for k, (robot, row) in enumerate(zip(self._robots, ages, strict=True))
            ]
        )

    def _values(
        self,
        state: State,
        there: Flags,
        ages: tuple[tuple[int, ...], ...],
        commands: Mapping[str, Command],
    ) -> Values:
        from_start = self._radio.first_tick == 0
        return Values(
            self._truth_values.distances_m(state),
            self._truth_values.gap_rad(state, there),
            self._truth_values.slack_rad(state, there),
            age_mean(ages, there, state.tick, from_start),
            conflicts(commands, self._radius_m),
            self._radio.delivery(state.tick),
        )

    def _events(self, state: State, lost: Flags, doubts: Mapping[str, str]) -> list[Event]:
        before = self._last
        was_lost = before.lost if before else (False,) * len(lost)
        touched = before.contacts if before else ()
        return [
            *self._schedule.at(state.tick),
            *events.lost_and_back(self._robots, was_lost, lost),
            *events.new_contacts(self._robots, touched, state.contacts),
            *events.new_doubts(self._doubts, doubts),
        ]
