"""The log of a run from its messages.

What robots believed is in no message. It is worked out again by feeding the recorded setup and
observations to new robot cores, as a replay does. It is checked that these decide as the recorded
ones did, since their beliefs would mean nothing otherwise.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import chain

import numpy as np

from encircle.agents.brain.robot_core import RobotCore
from encircle.protocol.codec import decode
from encircle.protocol.errors import ProtocolError
from encircle.protocol.keys import WORLD_CHANNELS, robot_key
from encircle.protocol.messages import Command, CommandMode, End, Observation, Radio, State
from encircle.runlog.runlog import Belief, Rounds, RunLog, belief_of, log_of
from encircle.world.arena.engine import Arena, build, initial, truth
from encircle.world.loading.interventions import as_played
from encircle.world.recording.recording import Recording, RecordingError
from encircle.world.scenario.model import Scenario


def log_of_recording(recording: Recording) -> RunLog:
    """The log of a recorded run; raises as ``log_of_messages``."""
    scenario = recording.scenario_as_written
    return log_of_messages(scenario, recording.seed, recording.run, recording.messages)


def log_of_messages(
    scenario: Scenario, seed: int, run: str, messages: Iterable[tuple[int, str, bytes]]
) -> RunLog:
    """The log of a run from its messages ``(tick, topic, payload)``, in their order.

    ``scenario``: as the run began; the log's is as played, with recorded interventions.
    Raises ``RecordingError`` for messages that cannot be read, and if this program's robots would
    not have sent the recorded commands: what the real ones believed is then unknown.
    """
    if scenario.clock == "wall":
        raise RecordingError(
            "clock = 'wall': in a run by the clock robots miss ticks, and measures are of all;"
            " run it in lock-step, with the network as a trace (encircle trace)"
        )
    builder = _LogBuilder(build(scenario, seed), run)
    for tick, topic, payload in messages:
        try:
            builder.take(tick, topic, payload)
        except ProtocolError as error:
            raise RecordingError(f"{topic} of tick {tick}: {error}") from None
    return builder.log()


class _LogBuilder:
    """A recording as it is read, and new robots that receive what the recorded ones received."""

    def __init__(self, arena: Arena, run: str) -> None:
        self.arena, self.scenario, self.run = arena, arena.scenario, run
        self.numbers = {name: number for number, name in enumerate(arena.names)}
        self.refusals: list[str] = []
        self.cores = {robot: RobotCore(robot, run, self.refusals.append) for robot in arena.ids}
        self.states: dict[int, State] = {}
        self.radios: dict[int, Radio] = {}
        self.commands: dict[tuple[int, str], Command] = {}
        self.decided: dict[tuple[int, str], tuple[Belief, Command]] = {}
        self.set_up: set[tuple[int, str]] = set()
        self.packets: dict[tuple[int, str], bytes] = {}
        self.ended: str | None = None

    def take(self, tick: int, topic: str, payload: bytes) -> None:
        """Take one message in."""
        prefix, _, channel = topic.rpartition("/")
        robot = prefix.rpartition("/")[2]
        if robot not in (("world",) if channel in WORLD_CHANNELS else self.cores):
            raise RecordingError(f"{topic} of tick {tick}: the team is {', '.join(self.cores)}")
        if channel == "state":
            state = self.states[tick] = decode(State, payload, self.run)
            if len(state.robots) != len(self.cores) or not set(chain(*state.contacts)) <= {
                *self.numbers
            }:
                raise RecordingError(f"{topic} of tick {tick}: shows bodies of another scenario")
        elif channel == "radio":
            radio = self.radios[tick] = decode(Radio, payload, self.run)
            if len(radio.fates) != len(self.cores):
                raise RecordingError(f"{topic} of tick {tick}: is of another team")
        elif channel == "intervention":
            self.scenario = as_played(self.scenario, payload, self.run)
        elif channel == "end":
            self.ended = decode(End, payload, self.run).reason
        elif channel == "command":
            self.commands[tick, robot] = decode(Command, payload, self.run)
        elif channel == "pose":
            self.packets[tick, robot] = payload
        elif channel == "setup":
            before = len(self.refusals)
            self.set_up.add((tick, robot))
            self.cores[robot].receive(robot_key(self.run, robot, "setup"), payload)
            if len(self.refusals) > before:
                raise RecordingError(f"{topic} of tick {tick}: {self.refusals[-1]}")
        elif channel == "observation":
            action = self.cores[robot].decide(decode(Observation, payload, self.run))
            self.decided[tick, robot] = belief_of(self.cores[robot]), action.command

    def log(self) -> RunLog:
        """The log of all rounds that are recorded whole."""
        states = self.states or {0: truth(self.arena, initial(self.arena))}
        rounds, numbers = Rounds(), self.numbers
        for tick in self._ticks(states):
            state = states[tick]
            rounds.positions.append(np.array([*state.robots, state.target]))
            rounds.contacts += [(tick, numbers[a], numbers[b]) for a, b in state.contacts]
        last = len(rounds.positions) - 1
        for tick in range(last):
            rounds.due.append(np.array(self.radios[tick].fates, np.int64))
            copies = self.radios[tick].copies
            rounds.copies.append(np.array(copies, np.int64) if copies else None)
            for robot in self.scenario.ids:
                if (tick, robot) not in self.commands:
                    rounds.add_lost_robot()
                    continue
                belief, command = self.decided[tick, robot]
                self._check(tick, robot, command)
                rounds.beliefs.append(belief)
                rounds.commands.append(self.commands[tick, robot])
                rounds.packets.append(self.packets.get((tick, robot)))
        ended = self.ended if last == max(states) else None
        captured = states[last].captured
        return log_of(rounds, self.scenario, self.arena.seed, captured, ended, self.run)

    def _ticks(self, states: dict[int, State]) -> Iterator[int]:
        """Tick 0, and every next one that a whole round led to."""
        for tick in range(max(states) + 1):
            answers = [(tick - 1, robot) for robot in self.scenario.ids]
            if tick > 0 and not (
                tick - 1 in self.radios
                and all(
                    key in self.decided if key in self.commands else self._lost(*key)
                    for key in answers
                )
            ):
                return
            if tick not in states:
                return
            yield tick

    def _lost(self, tick: int, robot: str) -> bool:
        """Whether a robot without a recorded command was lost, so that it gave none."""
        after = (tick + 1, robot)
        return (
            (tick, robot) not in self.decided or after in self.set_up or after not in self.decided
        )

    def _check(self, tick: int, robot: str, decided: Command) -> None:
        """Raise if the new robot decided otherwise; refused messages are no decision."""
        recorded = self.commands[tick, robot]
        if recorded.mode == CommandMode.STEERED:
            return  # decided outside, by whatever beliefs
        if replace(decided, refused={}) != replace(recorded, refused={}):
            raise RecordingError(
                f"{robot} decided otherwise at tick {tick} than a robot of this program would:"
                " what it believed cannot be worked out"
            )
