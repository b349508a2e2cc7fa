"""From the messages of a run to frames: the same for a recording and for a run under way.

Messages are taken in one by one; no file, no socket, no clock is needed.

The frame of a tick is whole when the round of that tick is known: the truth after it, the fates of
its packets, and the command of every robot that was asked. If some of that is missing, because a
robot was lost in the round or a message did not get here, the frame is given out with what is there
as soon as the truth two ticks later is known. Memory is bounded by the rounds that are open and the
packets in flight, time is linear in ticks.

By the clock (``clock = "wall"``) commands may come late, and every frame waits for those two ticks.
"""

import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from typing import Any

from encircle.protocol.codec import decode, encode
from encircle.protocol.errors import (
    MalformedMessage,
    OutOfTurn,
    ProtocolError,
    UnknownKey,
    WrongSender,
)
from encircle.protocol.keys import WORLD_CHANNELS
from encircle.protocol.messages import (
    Command,
    CommandMode,
    End,
    Intervention,
    Observation,
    Pose,
    Radio,
    Setup,
    State,
)
from encircle.protocol.process.interrupts import check
from encircle.scene.beliefs import LockStepBeliefs
from encircle.scene.beliefs_by_clock import BeliefsByClock
from encircle.scene.events import UNSURE
from encircle.scene.frame import Frame
from encircle.scene.frame_maker import FrameMaker, Round
from encircle.scene.stage import Stage, stage_of
from encircle.world.arena.engine import build, initial, truth
from encircle.world.loading.interventions import recorded_event
from encircle.world.recording.recording import Recording, RecordingError
from encircle.world.scenario.model import Scenario

ROUNDS_AHEAD = 2
"""How many ticks later the truth must be known for a frame to be given out though parts miss."""
ROUNDS_OPEN_MAX = 100
"""So many rounds are kept open at most, and none is opened that is so far ahead."""


class BeliefsLeftOut(UserWarning):
    """The warning for a recording of which not all that robots believed can be worked out here."""


@dataclass(frozen=True, slots=True)
class Scene:
    """A whole run. ``complete``: whether its recording was finished."""

    stage: Stage
    frames: tuple[Frame, ...]
    complete: bool


class SceneBuilder:
    """Makes the frames of one run from its messages.

    ``scenario``: as the run began; events that are given to it come as messages. ``stage``: the
    run's constants; ``beliefs``: whether to work out what robots believe, which
    takes as long as the robots took to decide. ``ended``: the reason for which the run ended, None
    as long as that is not known.
    """

    def __init__(self, scenario: Scenario, seed: int, run: str, beliefs: bool = True) -> None:
        self.stage = stage_of(scenario, seed, run)
        self.ended: str | None = None
        self._run = run
        self._robots = scenario.ids
        self._by_clock = scenario.clock == "wall"
        self._rounds: dict[int, Round] = {}
        self._beliefs: LockStepBeliefs | BeliefsByClock | None = None
        if beliefs:
            kind = BeliefsByClock if self._by_clock else LockStepBeliefs
            self._beliefs = kind(scenario, run)
        self._maker = FrameMaker(scenario)
        self._newest = self._given = -1

    def take(self, tick: int | None, topic: str, payload: bytes) -> list[Frame]:
        """Take one message in; returns the frames that are whole now, in order.

        ``tick``: as recorded, None to read it from the message; ``topic``: as in a recording, the
        key without ``encircle/RUN/``. Raises ``ProtocolError`` for a message that is not one of
        this run's; nothing has changed then.
        """
        prefix, _, channel = topic.rpartition("/")
        sender = prefix.rpartition("/")[2]
        if channel not in _KINDS:
            if channel != "alive":
                raise UnknownKey(f"topic {topic[:200]!r} is not part of the protocol")
            return []
        if sender != "world" if channel in WORLD_CHANNELS else sender not in self._robots:
            raise WrongSender(f"{topic[:200]}: the team is {', '.join(self._robots)}")
        match channel:
            case "setup":
                self._take_setup(sender, payload)
            case "observation":
                self._take_observation(tick, sender, payload)
            case "pose":
                if isinstance(self._beliefs, BeliefsByClock):
                    self._beliefs.take_packet(sender, payload)
            case "intervention":
                self._take_intervention(payload)
            case "end":
                self.ended = decode(End, payload, self._run).reason
            case _:
                message = decode(_KINDS[channel], payload, self._run)
                self._check(message, sender)
                return self._take_of_round(message)
        return []

    def skip_to(self, tick: int) -> list[Frame]:
        """Nothing will come of the ticks before this one; returns the frames of what came of them.

        For who looks on and has missed something: a message of a tick far ahead is refused else.
        What packets had delivered is then not known any more.
        """
        frames = []
        while (left := self._next_tick()) is not None and left < tick:
            frames.append(self._frame(left))
        self._newest = max(self._newest, tick - 1)
        self._maker.forget_radio()
        return frames

    def finish(self) -> list[Frame]:
        """No more messages come; returns the frames that are left, the last one among them."""
        frames = []
        while (tick := self._next_tick()) is not None:
            frames.append(self._frame(tick, is_last=tick == self._newest))
        return frames

    def _take_setup(self, robot: str, payload: bytes) -> None:
        self._check(decode(Setup, payload, self._run), robot)
        if self._beliefs is not None:
            self._beliefs.take_setup(robot, payload)

    def _take_intervention(self, payload: bytes) -> None:
        """An event was given while the run goes on; it takes effect at a later tick."""
        self._maker.add_event(recorded_event(payload, self._run, self._robots))

    def _take_observation(self, tick: int | None, robot: str, payload: bytes) -> None:
        if tick is None:
            tick = decode(Observation, payload, self._run).tick
        self._round_of(tick)
        if self._beliefs is not None:
            # One that comes late, or once more, may be one that the robot's core is in want of.
            self._beliefs.take_observation(robot, tick, payload)
        if (a_round := self._round_of(tick)) is not None:
            a_round.asked.add(robot)

    def _take_of_round(self, message: State | Radio | Command) -> list[Frame]:
        a_round = self._round_of(message.tick)
        if isinstance(message, Command):
            if message.mode == CommandMode.STOP:
                return []
            if isinstance(self._beliefs, BeliefsByClock):
                self._beliefs.take_command(message.robot, message)
        if a_round is None:
            return []
        match message:
            case State():
                a_round.state = message
                self._newest = max(self._newest, message.tick)
            case Radio():
                a_round.radio = message
            case Command():
                a_round.commands.setdefault(message.robot, message)
        return list(self._whole_frames())

    def _round_of(self, tick: int) -> Round | None:
        """The round of a tick, None if its frame has been given out.

        ``OutOfTurn`` for a tick that is too far ahead, or not of the run.
        """
        if tick <= self._given:
            return None
        if tick > self.stage.ticks_max:
            raise OutOfTurn(f"a message of tick {tick}, the run has {self.stage.ticks_max} at most")
        if self._newest >= 0 and tick > self._newest + ROUNDS_OPEN_MAX:
            raise OutOfTurn(f"a message of tick {tick}, the newest truth is of {self._newest}")
        if tick not in self._rounds and len(self._rounds) >= ROUNDS_OPEN_MAX:
            del self._rounds[min(self._rounds)]
        return self._rounds.setdefault(tick, Round())

    def _check(self, message: object, sender: str) -> None:
        """``ProtocolError`` for a message that is of another robot or of another team."""
        count = len(self._robots)
        if getattr(message, "robot", sender) != sender:
            raise WrongSender(f"{type(message).__name__} on a key of {sender} is of another robot")
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

    def _frame(self, tick: int, is_last: bool = False) -> Frame:
        a_round = self._rounds.pop(tick)
        beliefs = None if is_last or self._beliefs is None else self._beliefs
        believed = None if beliefs is None else beliefs.take_back(tick, a_round.commands)
        heard = self._beliefs.newest if isinstance(self._beliefs, BeliefsByClock) else {}
        self._given = tick
        return self._maker.frame(a_round, believed, heard, self.ended, is_last)

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


_KINDS: dict[str, Any] = {
    "pose": Pose,
    "state": State,
    "radio": Radio,
    "intervention": Intervention,
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

    Raises ``RecordingError`` for a message that cannot be read, and ``Interrupted`` if a signal is
    held (``encircle.protocol.process.interrupts``). Warns with ``BeliefsLeftOut``, once
    in the end, if it cannot be worked out what some robots believed.
    """
    scenario, seed, run = recording.scenario_as_written, recording.seed, recording.run
    builder = SceneBuilder(scenario, seed, run, beliefs)
    is_empty, doubts = True, []
    for frame in _taken(builder, recording):
        is_empty = False
        doubts += [event for event in frame.events if event.kind == UNSURE]
        yield frame
    if is_empty:
        arena = build(scenario, seed)
        builder.take(0, "world/state", encode(truth(arena, initial(arena)), run))
        yield from builder.finish()
    if doubts:
        robots = ", ".join(dict.fromkeys(robot for event in doubts for robot in event.robots))
        line = f"what {robots} believed is left out, at some ticks or all: {doubts[0].text}"
        warnings.warn(f"{recording.path}: {line}", BeliefsLeftOut, stacklevel=2)


def _taken(builder: SceneBuilder, recording: Recording) -> Iterator[Frame]:
    """The frames that a builder makes of a recording's messages."""
    for tick, topic, payload in recording.messages:
        check()
        try:
            yield from builder.take(tick, topic, payload)
        except ProtocolError as error:
            raise RecordingError(f"{recording.path}: {topic} of tick {tick}: {error}") from None
    yield from builder.finish()
