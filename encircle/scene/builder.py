"""From the messages of a run to frames: the same for a recording and for a run under way.

Messages are taken in one by one; no file, no socket, no clock is needed.

The frame of a tick is whole when the round of that tick is known: the truth after it, the fates of
its packets, and the command of every robot that was asked. If some of that is missing, because a
robot was lost in the round or a message did not get here, the frame is given out with what is there
as soon as the truth two ticks later is known. Memory is bounded by the rounds that are open and the
packets in flight, time is linear in ticks.

By the clock (``clock = "wall"``) commands may come late, and every frame waits for those two ticks.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import chain
from typing import Any

from encircle.protocol.codec import decode, encode
from encircle.protocol.errors import MalformedMessage, ProtocolError, UnknownKey, WrongSender
from encircle.protocol.messages import Command, CommandMode, End, Observation, Radio, Setup, State
from encircle.scene import events
from encircle.scene.beliefs import LockStepBeliefs
from encircle.scene.frame import Belief, Event, Frame, Packet, Values
from encircle.scene.radio_watch import RadioWatch, age_mean
from encircle.scene.stage import Stage, stage_of
from encircle.scene.values import TruthValues, conflicts
from encircle.world.arena.engine import build, initial, truth
from encircle.world.recording.recording import Recording, RecordingError
from encircle.world.scenario.model import Scenario

ROUNDS_AHEAD = 2
"""How many ticks later the truth must be known for a frame to be given out though parts miss."""


@dataclass(slots=True)
class _Round:
    """What is known of the round of one tick."""

    state: State | None = None
    radio: Radio | None = None
    asked: set[str] = field(default_factory=set)
    commands: dict[str, Command] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Scene:
    """A whole run. ``complete``: whether its recording was finished."""

    stage: Stage
    frames: tuple[Frame, ...]
    complete: bool


class SceneBuilder:
    """Makes the frames of one run from its messages.

    ``stage``: the run's constants; ``beliefs``: whether to work out what robots believe, which
    takes as long as the robots took to decide. ``ended``: the reason for which the run ended, None
    as long as that is not known.
    """

    def __init__(self, scenario: Scenario, seed: int, run: str, beliefs: bool = True) -> None:
        self.stage = stage_of(scenario, seed, run)
        self.ended: str | None = None
        self._run = run
        self._robots = scenario.ids
        self._by_clock = scenario.clock == "wall"
        self._rounds: dict[int, _Round] = {}
        follows = beliefs and not self._by_clock
        self._beliefs = LockStepBeliefs(scenario, run) if follows else None
        self._radio = RadioWatch(len(scenario.ids))
        self._truth_values = TruthValues(scenario)
        self._schedule = events.Schedule(scenario)
        self._newest = -1
        self._last: Frame | None = None
        self._there = (True,) * len(scenario.ids)
        self._doubts: dict[str, str] = {}

    def take(self, tick: int | None, topic: str, payload: bytes) -> list[Frame]:
        """Take one message in; returns the frames that are whole now, in order.

        ``tick``: as recorded, None to read it from the message; ``topic``: as in a recording, the
        key without ``encircle/RUN/``. Raises ``ProtocolError`` for a message that is not one of
        this run's; nothing has changed then.
        """
        prefix, _, channel = topic.rpartition("/")
        sender = prefix.rpartition("/")[2]
        if channel not in _KINDS:
            if channel not in ("pose", "alive"):
                raise UnknownKey(f"topic {topic[:200]!r} is not part of the protocol")
            return []
        if sender != "world" if channel in ("state", "radio") else sender not in self._robots:
            raise WrongSender(f"{topic[:200]}: the team is {', '.join(self._robots)}")
        if channel in ("setup", "observation"):
            self._take_for_robot(tick, sender, channel, payload)
            return []
        if channel == "end":
            self.ended = decode(End, payload, self._run).reason
            return []
        return self._take_of_round(sender, decode(_KINDS[channel], payload, self._run))

    def finish(self) -> list[Frame]:
        """No more messages come; returns the frames that are left, the last one among them."""
        frames = []
        while (tick := self._next_tick()) is not None:
            frames.append(self._frame(tick, is_last=tick == self._newest))
        return frames

    def _take_of_round(self, sender: str, message: State | Radio | Command) -> list[Frame]:
        self._check(message)
        if self._last is not None and message.tick <= self._last.tick:
            return []  # it came too late
        a_round = self._rounds.setdefault(message.tick, _Round())
        match message:
            case State():
                a_round.state = message
                self._newest = max(self._newest, message.tick)
            case Radio():
                a_round.radio = message
            case Command() if message.mode != CommandMode.STOP:
                a_round.commands.setdefault(sender, message)
        return list(self._whole_frames())

    def _take_for_robot(self, tick: int | None, robot: str, channel: str, payload: bytes) -> None:
        """A setup or an observation, which only its robot's core reads in full."""
        if channel == "setup":
            decode(Setup, payload, self._run)
            if self._beliefs is not None:
                self._beliefs.take_setup(robot, payload)
            return
        if tick is None:
            tick = decode(Observation, payload, self._run).tick
        if self._last is not None and tick <= self._last.tick:
            return
        self._rounds.setdefault(tick, _Round()).asked.add(robot)
        if self._beliefs is not None:
            self._beliefs.take_observation(robot, tick, payload)

    def _check(self, message: object) -> None:
        """``MalformedMessage`` for a message that is of another team."""
        count = len(self._robots)
        if isinstance(message, Radio) and len(message.fates) != count:
            raise MalformedMessage("Radio: is of another team")
        if isinstance(message, State):
            obstacles = [f"obstacle-{k + 1}" for k in range(len(self.stage.obstacles))]
            bodies = {*self._robots, "target", *obstacles}
            if len(message.robots) != count or not bodies.issuperset(chain(*message.contacts)):
                raise MalformedMessage("State: shows bodies of another scenario")

    def _next_tick(self) -> int | None:
        """The tick of the next frame: the first one whose truth is known; those before go."""
        for tick in sorted(self._rounds):
            if self._rounds[tick].state is not None:
                return tick
            if tick >= self._newest:
                return None
            del self._rounds[tick]
        return None

    def _whole_frames(self) -> Iterator[Frame]:
        while (tick := self._next_tick()) is not None and self._is_whole(tick):
            yield self._frame(tick)

    def _is_whole(self, tick: int) -> bool:
        if self._newest >= tick + ROUNDS_AHEAD:
            return True
        after, a_round = self._rounds.get(tick + 1), self._rounds[tick]
        return (
            not self._by_clock
            and after is not None
            and after.state is not None
            and a_round.radio is not None
            and a_round.asked <= a_round.commands.keys()
        )

    def _frame(self, tick: int, is_last: bool = False) -> Frame:
        """The frame of a tick, which is the next one; of the last tick only the truth is shown."""
        a_round = self._rounds.pop(tick)
        state = a_round.state
        assert state is not None, "frames are of ticks whose truth is known"
        commands = {} if is_last else a_round.commands
        self._radio.arrive(tick)
        before = self._last
        if is_last:
            lost = before.lost if before else (False,) * len(self._robots)
        else:
            lost = tuple([robot not in a_round.asked for robot in self._robots])
            self._there = tuple([robot in commands for robot in self._robots])
        there = tuple([not so for so in lost]) if self._by_clock else self._there
        radio = None if is_last else a_round.radio
        packets = () if radio is None else self._radio.send(radio)
        beliefs, doubts = ((None,) * len(lost), {}) if is_last else self._beliefs_at(tick, commands)
        happened = self._events_at(state, lost, doubts, there, is_last)
        frame = self._assembled(state, lost, commands, packets, beliefs, doubts, there, happened)
        self._last, self._doubts = frame, doubts
        return frame

    def _assembled(
        self,
        state: State,
        lost: tuple[bool, ...],
        commands: Mapping[str, Command],
        packets: tuple[Packet, ...],
        beliefs: tuple[Belief | None, ...],
        doubts: Mapping[str, str],
        there: tuple[bool, ...],
        happened: tuple[Event, ...],
    ) -> Frame:
        tick = state.tick
        decided = [commands.get(robot) for robot in self._robots]
        ages = self._radio.ages(tick)
        off = self._schedule.silent(tick)
        values = Values(
            self._truth_values.distances_m(state),
            self._truth_values.gap_rad(state, there),
            self._truth_values.slack_rad(state, there),
            age_mean(ages, there, tick, self._radio.first_tick == 0),
            conflicts(commands, self.stage.radius_m),
            self._radio.delivery(tick),
        )
        return Frame(
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
            values=values,
            events=happened,
        )

    def _beliefs_at(
        self, tick: int, commands: Mapping[str, Command]
    ) -> tuple[tuple[Belief | None, ...], dict[str, str]]:
        """What each robot believes at a tick, and of which robots that is not known, and why."""
        if self._beliefs is not None:
            return self._beliefs.take_back(tick, commands)
        return (None,) * len(self._robots), {}

    def _events_at(
        self,
        state: State,
        lost: tuple[bool, ...],
        doubts: Mapping[str, str],
        there: tuple[bool, ...],
        is_last: bool,
    ) -> tuple[Event, ...]:
        before = self._last
        happened = self._schedule.at(state.tick)
        was_lost = before.lost if before else (False,) * len(lost)
        happened += events.lost_and_back(self._robots, was_lost, lost)
        touched = before.contacts if before else ()
        happened += events.new_contacts(self._robots, touched, state.contacts)
        happened += events.new_doubts(self._doubts, doubts)
        if is_last:
            reach_m = self.stage.stop_distance_m
            happened += events.ending(state, self._robots, there, self.ended, reach_m)
        return tuple(happened)


_KINDS: dict[str, Any] = {
    "state": State,
    "radio": Radio,
    "command": Command,
    "end": End,
    "setup": Setup,
    "observation": Observation,
}


def scene_of_recording(recording: Recording, beliefs: bool = True) -> Scene:
    """All frames of a recorded run; raises as ``frames_of_recording``."""
    stage = stage_of(recording.scenario, recording.seed, recording.run)
    frames = tuple(frames_of_recording(recording, beliefs))
    return Scene(stage, frames, recording.complete)


def frames_of_recording(recording: Recording, beliefs: bool = True) -> Iterator[Frame]:
    """The frames of a recorded run; of one cut off before the first tick, the start alone.

    Raises ``RecordingError`` for a message that cannot be read.
    """
    scenario, seed, run = recording.scenario, recording.seed, recording.run
    builder, is_empty = SceneBuilder(scenario, seed, run, beliefs), True
    for tick, topic, payload in recording.messages:
        try:
            for frame in builder.take(tick, topic, payload):
                yield frame
                is_empty = False
        except ProtocolError as error:
            raise RecordingError(f"{recording.path}: {topic} of tick {tick}: {error}") from None
    for frame in builder.finish():
        yield frame
        is_empty = False
    if is_empty:
        arena = build(scenario, seed)
        builder.take(0, "world/state", encode(truth(arena, initial(arena)), run))
        yield from builder.finish()
