"""Taking up a run that broke off: the world as it was when its recording ends.

Nothing but poses and commands, interventions, and which robots were lost and came back, goes into a
world, and all of that is recorded: a robot without an observation is lost, and one that has not
answered an observation was lost in that round. So a new world is fed with it, round by round, and
has to come to the same messages, byte by byte, as far as they are recorded; else the recording is
of another program, or not what it was. What robots have said in a round that is not whole is left
out: they decide the same again. Interventions in it are kept: nobody would give them again.

Each robot is brought up to date with its setup and the observations it has had since, which it
takes in without answering. Only why a robot was lost is not recorded.
"""

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from encircle.protocol.codec import decode, encode
from encircle.protocol.errors import ProtocolError
from encircle.protocol.keys import parse_key
from encircle.protocol.messages import Intervention, Observation, Setup
from encircle.protocol.process.interrupts import check
from encircle.protocol.wire.earlier_versions import VERSION_BEFORE, VERSION_SINCE
from encircle.world.arena.engine import build
from encircle.world.coordinator.membership import DepartureCause, is_crashed
from encircle.world.coordinator.outgoing import Outgoing
from encircle.world.coordinator.world_core import WorldCore
from encircle.world.loading.interventions import InterventionRefused
from encircle.world.recording.recording import Recording, RecordingError, read_recording
from encircle.world.recording.run_directory import attempts, versions
from encircle.world.scenario.channel_model import Crash

MUST_BE_EQUAL = ("encircle", "protocol")
"""Versions without which it makes no sense to try; the rest shows in what is decided."""
READ_AS_EQUAL = {"protocol": {str(VERSION_BEFORE): str(VERSION_SINCE)}}
"""Earlier versions whose messages are read as those of a later one."""
LOST_BEFORE = DepartureCause.BEFORE_RESUMING

Recorded = tuple[int, str, bytes]


class Resumed(NamedTuple):
    """A run to go on with.

    ``core`` waits for the answers of the round that was under way, or the run has ended in it.
    ``messages``: all that is to be recorded of the run so far, as (tick, key, payload).
    ``briefings``: what each robot that is asked has to know before this round.
    """

    core: WorldCore
    messages: list[Recorded]
    histories: dict[str, Outgoing]


@dataclass(slots=True)
class _Round:
    """What is recorded of one round. ``interventions``: the events that were given in it.

    ``lost``: who was lost at its beginning, None if that is not recorded.

    ``back``: who was set up at its beginning. ``answers``: each robot's pose, if any, and command.
    ``whole``: whether it came to its end.
    """

    lost: tuple[str, ...] | None = None
    back: set[str] = field(default_factory=set)
    answers: dict[str, Outgoing] = field(default_factory=dict)
    whole: bool = False
    interventions: list[Mapping[str, Any]] = field(default_factory=list)


class _ReplayedCore(WorldCore):
    """A world that is fed with a recording. ``rounds_to_play``: what is recorded of each tick.

    Rounds in which no robot takes part follow each other at once: what was given by hand in one of
    them is given while it is open, and who is set up in the next one is present by then.
    """

    rounds_to_play: Mapping[int, _Round] = MappingProxyType({})

    def ask(self) -> list[Observation]:
        observations = super().ask()
        if not observations and self.ended is None:
            tick = self.state.tick
            _intervene(self, self.rounds_to_play.get(tick, _Round()))
            for robot in self.rounds_to_play.get(tick + 1, _Round()).back:
                self.join(robot)
        return observations


def read_last(directory: Path) -> Recording:
    """The recording in a run's directory that reaches furthest, of one attempt or more.

    ``RecordingError`` if there is none that can be read.
    """
    if not directory.is_dir():
        raise RecordingError(f"{directory} is not the directory of a run")
    furthest, rounds = None, -1
    error = RecordingError(f"{directory}: there is no recording to go on with")
    for path in attempts(directory):
        try:
            recording = read_recording(path)
        except RecordingError as unreadable:
            # Of an attempt that broke off at once; another one may have come further.
            error = unreadable
            continue
        reached = sum(1 for _ in recording.of_channel("radio"))
        if reached > rounds:
            furthest, rounds = recording, reached
    if furthest is None:
        raise error
    return furthest


def digest_of(recording: Recording) -> str:
    """The digest of a recorded run, played again by this program's world; of one cut off, so far.

    ``RecordingError`` as ``rebuild``, and for a recording of which something comes out otherwise.
    """
    _check_lock_step(
        recording, "played again by a world", "what came when is not all in its recording"
    )
    return _played(recording).core.rounds.journal.digest


def rebuild(recording: Recording, log: Callable[[str], None] = lambda _line: None) -> Resumed:
    """The world as the recording leaves it; ``RecordingError`` if it cannot be gone on with."""
    _check_lock_step(recording, "resumed", "for its robots have answered as fast as they could")
    resumed = _played(recording, log)
    core = resumed.core
    if recording.complete and core.ended is not None:
        raise RecordingError(
            f"{recording.path}: this run has come to its end (tick {core.state.tick},"
            f" {core.ended}), there is nothing to go on with"
        )
    return resumed


def _played(recording: Recording, log: Callable[[str], None] = lambda _line: None) -> Resumed:
    """The world as the recording leaves it, which has come to the recorded messages."""
    messages: list[Recorded] = []
    core = _ReplayedCore(
        build(recording.scenario_as_written, recording.seed),
        recording.run,
        log,
        lambda tick, key, payload: messages.append((tick, key, payload)),
    )
    for robot in core.arena.ids:
        core.join(robot)
    core.rounds_to_play = _rounds_of(recording)
    try:
        core.begin()
        _play_all(core, recording.path)
    except InterventionRefused as error:
        raise RecordingError(f"{recording.path}: tick {core.state.tick}: {error}") from None
    core.rounds_to_play = {}
    core.rounds.commit()
    _check_same(recording, messages)
    return Resumed(core, messages, _histories(core, messages))


def _check_lock_step(recording: Recording, done: str, why: str) -> None:
    _check_versions(recording)
    if recording.scenario.clock != "lockstep":
        raise RecordingError(
            f"{recording.path}: clock = {recording.scenario.clock!r}: a run by the clock cannot be"
            f" {done}, {why}"
        )


def _play_all(core: _ReplayedCore, path: Path) -> None:
    """Play all whole rounds, and give the events of the one that was under way."""
    rounds = core.rounds_to_play
    while core.ended is None and rounds.get(core.state.tick, _Round()).whole:
        check()
        tick = core.state.tick
        _play(core, rounds[tick], rounds.get(tick + 1, _Round()))
        if core.state.tick == tick and core.rounds.plugin_failure is None:
            raise RecordingError(f"{path}: not all that robots said at tick {tick} counts")
    if core.ended is None:
        _intervene(core, rounds.get(core.state.tick, _Round()))


def _play(core: WorldCore, now: _Round, then: _Round) -> None:
    """Play a whole round; ``then`` is the next one, in which it shows who was lost in this one."""
    _intervene(core, now)
    asked, tick = core.rounds.table.waiting(), core.state.tick
    for robot in core.rounds.lost:
        if robot in then.back or (then.lost is not None and robot not in then.lost):
            core.join(robot)
        elif then.lost is not None and not _crashed(core, robot, tick + 1):
            core.leave(robot, LOST_BEFORE)
    # The recording may end before any observation of the next round, which would tell who is lost:
    # then whoever is lost stays so, unless the scenario brings it back.
    lost_then = then.lost or ()
    # A robot may be lost after its answer, but not after the last one, which begins a new round.
    answered = [robot for robot in asked if robot in now.answers]
    early = [r for r in answered if r in lost_then and not _crashed(core, r, tick + 1)]
    # One that is lost and is back within a round is set up in the next: others end this one.
    back = [r for r in asked if r in then.back]
    for robot in (*back, *early, *(r for r in answered if r not in (*back, *early))):
        for message in now.answers.get(robot, []):
            core.receive(*message)
        if robot in back or robot in early:
            core.leave(robot, LOST_BEFORE)
        if robot in back:
            core.join(robot)
    for robot in asked:
        if robot not in answered and robot not in back:
            core.leave(robot, LOST_BEFORE)


def _intervene(core: WorldCore, now: _Round) -> None:
    """Give the events again that were given in the open round."""
    for given in now.interventions:
        core.intervene(given)


def _crashed(core: WorldCore, robot: str, tick: int) -> bool:
    """Whether the scenario has taken a robot away at a tick."""
    return any(
        isinstance(event, Crash) and event.robot == robot and is_crashed(event, tick)
        for event in core.arena.scenario.events
    )


def _rounds_of(recording: Recording) -> dict[int, _Round]:
    """What is recorded, by round; ``RecordingError`` for what is no recording of ours."""
    rounds: dict[int, _Round] = {}
    for tick, topic, payload in recording.messages:
        key = f"encircle/{recording.run}/{topic}"
        try:
            _, robot, channel = parse_key(key)
            a_round = rounds.setdefault(tick, _Round())
            if channel == "observation" and a_round.lost is None:
                a_round.lost = decode(Observation, payload, recording.run).lost
            elif channel == "setup" and robot is not None:
                a_round.back.add(robot)
            elif channel in ("pose", "command") and robot is not None:
                a_round.answers.setdefault(robot, []).append((key, payload))
            elif channel == "intervention":
                given = decode(Intervention, payload, recording.run).event
                a_round.interventions.append(given)
            elif channel == "radio":
                a_round.whole = True
        except ProtocolError as error:
            raise RecordingError(f"{recording.path}: {topic} of tick {tick}: {error}") from None
    return rounds


def _check_versions(recording: Recording) -> None:
    here = versions()
    for name in MUST_BE_EQUAL:
        there = recording.versions.get(name, "unknown")
        if READ_AS_EQUAL.get(name, {}).get(there, there) != here[name]:
            raise RecordingError(
                f"{recording.path}: recorded with {name} {there}, this is {name} {here[name]}:"
                " resume it with that, nothing was changed"
            )


def _check_same(recording: Recording, messages: list[Recorded]) -> None:
    prefix = f"encircle/{recording.run}/"
    # What is recorded beyond is of the round that is to be played again.
    for (tick, topic, payload), ours in zip(recording.messages, messages, strict=False):
        if (tick, prefix + topic, payload) != ours:
            _check_policy(recording, topic, payload, ours[2])
            raise RecordingError(
                f"{recording.path}: {topic} of tick {tick} is recorded otherwise than this program"
                " comes to: the recording was changed, or this is not the program that made it;"
                " nothing was changed"
            )


def _check_policy(recording: Recording, topic: str, recorded: bytes, ours: bytes) -> None:
    """``RecordingError`` if it is the policy's file that is another one now."""
    if not topic.endswith("/setup"):
        return
    with suppress(ProtocolError):
        there, here = (decode(Setup, payload, recording.run) for payload in (recorded, ours))
        if there.strategy == here.strategy and there.policy_source != here.policy_source:
            digests = [
                source[:12] or "none" for source in (there.policy_source, here.policy_source)
            ]
            raise RecordingError(
                f"{recording.path}: policy {there.strategy!r} was recorded with a source of SHA-256"
                f" {digests[0]}, here it is {digests[1]}: resume it with that; nothing was changed"
            )


def _histories(core: WorldCore, messages: list[Recorded]) -> dict[str, Outgoing]:
    tick, again = core.state.tick, {key for key, _ in core.rounds.unanswered()}
    histories: dict[str, Outgoing] = {robot: [] for robot in core.rounds.table.waiting()}
    for sent_tick, key, payload in messages:
        _, robot, channel = parse_key(key)
        if robot not in histories:
            continue
        # What belongs to this round is sent with it.
        if channel == "setup" and key not in again:
            setup = replace(decode(Setup, payload, core.run), answer_tick=tick)
            histories[robot] = [(key, encode(setup, core.run))]
        elif channel == "observation" and sent_tick < tick:
            histories[robot].append((key, payload))
        elif channel == "setup":
            histories[robot] = []
    return histories
