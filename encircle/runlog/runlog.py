"""A run as arrays: the truth at every tick, what each robot believed and chose, each packet's fate.

Measures (``encircle.measures.registry``) are functions of this and of nothing else. A log of T
rounds holds T + 1 ticks of truth and T rounds of decisions: round t is what the robots decide at
tick t, on what they have sensed and received by then, and it leads to the truth at tick t + 1.

There are two sources of a log, and both give the same arrays. A ``RunLogCollector`` looks on at a
hunt in memory; it only keeps references to what the hunt makes anyway, and arrays are made once, at
the end. ``recorded_log.log_of_recording`` takes the recording of a hunt, in memory or over Zenoh;
one that was cut off gives the log of its whole rounds.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from encircle.agents.brain.robot_core import RobotCore
from encircle.agents.estimation.kalman import Estimate
from encircle.agents.teamwork.peers import PeerTable, without_lost
from encircle.protocol.messages import Command, Point
from encircle.protocol.parameters import Parameters
from encircle.runlog.packet_parts import NO_PARTS, parts_bytes
from encircle.runlog.team_beliefs import believed_positions
from encircle.runner.memory import RobotAnswer, rare_garbage_collection
from encircle.world.coordinator.world_core import WorldCore
from encircle.world.scenario.model import MoveTarget, Scenario

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

NAN = float("nan")
NOWHERE = (NAN, NAN)
UNKNOWN = (NAN,) * 7
LOST = "lost"
"""In place of a lost robot's mode."""


@dataclass(frozen=True, eq=False)
class RunLog:
    """All that measures need of one run of T rounds with N robots; lengths in m, robot order.

    ``positions``: (T + 1, N + 1, 2) of the robots, then the target. ``contacts``: (C, 3) rows
    ``tick, body, other`` of bodies whose motion was cut short by touching since the tick before;
    bodies count robots, target, obstacles. ``steps``: (T, N, 2) as commanded. ``modes``: (T, N).
    ``xi``: (T, N), NaN without one. ``points``: (T, N) number of the encirclement point, -1 without
    one. ``goals``: (T, N, 2), NaN without one. ``estimates``: (T, N, 4) ``x, y, vx, vy`` in m and
    m/s, and ``covariances``: (T, N, 3) ``p00, p01, p11`` of each axis, NaN while nothing is known.
    ``believed``: (T, N, N, 2) where robot i at tick t assumes the members of its planning team to
    be, itself included, NaN for those it leaves out. ``due`` and ``copies``: (T, N, N) fates as in
    ``encircle.protocol.messages.Radio``, copies 0 where there are none. ``sizes_bytes``: (T, N) of
    the pose packets without the run's name, whose length is no property of the run; 0 where none
    was sent. ``parts_bytes``: (T, N, 3) how much of it are the parts that ``packet_parts.PARTS``
    names. ``there``: (T, N) whether the robot took part in the round. One that was lost has a
    step of zero, the mode ``lost``, and else the values of a robot that knows and sends nothing.
    ``ended``: the reason that the world gave, None if the recording does not reach the end.
    """

    scenario: Scenario
    seed: int
    captured: bool
    ended: str | None
    positions: Floats
    contacts: Integers
    steps: Floats
    modes: NDArray[np.str_]
    xi: Floats
    points: Integers
    goals: Floats
    estimates: Floats
    covariances: Floats
    believed: Floats
    due: Integers
    copies: Integers
    sizes_bytes: Integers
    parts_bytes: Integers
    there: NDArray[np.bool_]
    cached_results: dict[str, Any] = field(init=False, default_factory=dict, repr=False)
    """What several measures share, by name; see ``encircle.measures.common.once``."""

    @property
    def ticks(self) -> int:
        """T, the number of rounds, which is the last tick."""
        return len(self.positions) - 1

    @property
    def count(self) -> int:
        """N, the number of robots."""
        return len(self.scenario.ids)

    @property
    def robots(self) -> Floats:
        """(T + 1, N, 2) positions of the robots."""
        return self.positions[:, :-1]

    @property
    def target(self) -> Floats:
        """(T + 1, 2) positions of the target."""
        return self.positions[:, -1]

    @property
    def members(self) -> NDArray[np.bool_]:
        """(T, N, N) whether column robot is in the team that row robot plans with."""
        return ~np.isnan(self.believed[..., 0])

    @cached_property
    def parameters(self) -> Parameters:
        """The robots' parameters."""
        return Parameters.from_mapping(self.scenario.parameters)

    @property
    def moved_by_hand(self) -> tuple[int, ...]:
        """Ticks at which the target had been moved by hand."""
        moves = {e.tick for e in self.scenario.events if isinstance(e, MoveTarget)}
        return tuple(sorted(tick for tick in moves if tick <= self.ticks))


class Belief(NamedTuple):
    """What one robot believes at a tick: of itself, of peers that are not lost, of the target."""

    position: Point
    peers: PeerTable
    estimate: Estimate | None


def belief_of(core: RobotCore) -> Belief:
    """What a robot that has decided at least once believes now."""
    state = core.state
    assert state is not None, "no setup yet"
    assert state.position is not None, "no decision yet"
    # Not the whole state: its track holds a window of estimates.
    return Belief(state.position, without_lost(state.peers, state.lost), state.track.estimate)


@dataclass(slots=True)
class Rounds:
    """A run as it is collected, tick by tick and robot by robot; ``log_of`` makes arrays of it.

    ``positions``: T + 1 arrays (N + 1 or more, 2); ``due`` and ``copies``: T arrays (N, N), or None
    without copies; ``commands``, ``packets`` and ``beliefs``: T times N, None of a robot that is
    lost, and no packet of one that is silent.
    """

    positions: list[Floats] = field(default_factory=list)
    contacts: list[tuple[int, int, int]] = field(default_factory=list)
    commands: list[Command | None] = field(default_factory=list)
    packets: list[bytes | None] = field(default_factory=list)
    beliefs: list[Belief | None] = field(default_factory=list)
    due: list[Integers] = field(default_factory=list)
    copies: list[Integers | None] = field(default_factory=list)

    def add_lost_robot(self) -> None:
        """The next robot in robot order is lost: it has no belief, packet or command."""
        self.commands.append(None)
        self.beliefs.append(None)
        self.packets.append(None)


def log_of(
    rounds: Rounds, scenario: Scenario, seed: int, captured: bool, ended: str | None, run: str
) -> RunLog:
    """The log of a run of that name from its rounds."""
    count, ticks = len(scenario.ids), len(rounds.due)
    commands = rounds.commands
    estimates = _table(
        [
            (*b.estimate[:4], *b.estimate[4]) if b is not None and b.estimate else UNKNOWN
            for b in rounds.beliefs
        ],
        (ticks, count, 7),
    )
    parameters = Parameters.from_mapping(scenario.parameters)
    none = np.zeros((count, count), np.int64)
    copies = [none if table is None else table for table in rounds.copies]
    points = [-1 if c is None or c.point is None else c.point for c in commands]
    sizes = [len(packet) - len(run) if packet else 0 for packet in rounds.packets]
    parts = [parts_bytes(packet) if packet else NO_PARTS for packet in rounds.packets]
    by_robot, by_link = (ticks, count), (ticks, count, count)
    return RunLog(
        scenario=scenario,
        seed=seed,
        captured=captured,
        ended=ended,
        positions=np.array(rounds.positions)[:, : count + 1],
        contacts=np.array(rounds.contacts, np.int64).reshape(-1, 3),
        steps=_table([(0.0, 0.0) if c is None else c.step for c in commands], (*by_robot, 2)),
        modes=np.array([LOST if c is None else c.mode for c in commands], np.str_).reshape(
            by_robot
        ),
        xi=np.array([NAN if c is None or c.xi is None else c.xi for c in commands]).reshape(
            by_robot
        ),
        points=np.array(points, np.int64).reshape(by_robot),
        goals=_table([(c and c.goal) or NOWHERE for c in commands], (*by_robot, 2)),
        estimates=estimates[..., :4],
        covariances=estimates[..., 4:],
        believed=believed_positions(
            [None if b is None else b.peers for b in rounds.beliefs],
            [None if b is None else b.position for b in rounds.beliefs],
            count,
            parameters,
        ),
        due=np.array(rounds.due, np.int64).reshape(by_link),
        copies=np.array(copies, np.int64).reshape(by_link),
        sizes_bytes=np.array(sizes, np.int64).reshape(by_robot),
        parts_bytes=np.array(parts, np.int64).reshape(*by_robot, len(NO_PARTS)),
        there=np.array([c is not None for c in commands], np.bool_).reshape(by_robot),
    )


def _table(rows: Sequence[tuple[float, ...]], shape: tuple[int, ...]) -> Floats:
    """As ``np.array(rows).reshape(shape)``, several times faster."""
    size = int(np.prod(shape))
    return np.fromiter(chain.from_iterable(rows), np.float64, size).reshape(shape)


class RunLogCollector:
    """Looks on at one hunt in memory, as its observer; gives the log afterwards."""

    def __init__(self) -> None:
        self._rounds = Rounds()
        self._world: WorldCore | None = None

    def decided(
        self, world: WorldCore, robots: Sequence[RobotCore], answers: Sequence[RobotAnswer | None]
    ) -> None:
        """Every robot that takes part has answered at the world's tick."""
        self._look(world)
        rounds = self._rounds
        for core, answer in zip(robots, answers, strict=True):
            if answer is None:
                rounds.add_lost_robot()
                continue
            packet, command = answer
            rounds.beliefs.append(belief_of(core))
            rounds.commands.append(command)
            rounds.packets.append(packet)

    def ended(self, world: WorldCore) -> None:
        """The run is over."""
        self._look(world)
        self._world = world

    def _look(self, world: WorldCore) -> None:
        rounds, state = self._rounds, world.state
        rounds.positions.append(state.positions)
        rounds.contacts += [(state.tick, *pair) for pair in state.contacts]
        fates = world.rounds.fates  # those of the round before
        if fates is not None:
            rounds.due.append(fates.due)
            rounds.copies.append(fates.copies)

    def log(self) -> RunLog:
        """The log of the hunt, which must be over."""
        assert self._world is not None, "the hunt is not over"
        world = self._world
        arena, captured = world.arena, world.state.captured
        with rare_garbage_collection():
            return log_of(
                self._rounds, arena.scenario, arena.seed, captured, world.ended, world.run
            )
