"""What a recording shows: where everything was at every tick, who saw whom, how close they came.

The truth is read from the world's ``state`` messages, never from what robots believed; who sees
whom and how far surfaces are apart is worked out again by the world's own sensing, from positions
alone. What the robots planned is in their commands.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from math import dist, pi

import numpy as np
from numpy.typing import NDArray

from encircle.protocol.endings import EndReason
from encircle.protocol.messages import Command, End, Point, State
from encircle.world.arena.engine import Arena, build, initial, truth
from encircle.world.arena.sensing import geometry, in_sight
from encircle.world.recording.recording import Recording, decoded
from encircle.world.scenario.model import MoveTarget, Scenario

Floats = NDArray[np.float64]
RING_MISFIT_M_MAX = 0.5


@dataclass(frozen=True)
class GroundTruth:
    """The truth of a run, tick by tick.

    ``ticks``: (T,); ``positions``: (T, N + 1, 2) in m, robots in robot order, then the target;
    ``contacts``: for each tick the pairs of names that touched; ``ended``: the reason that the
    world gave, None if the recording does not reach the end of the run; ``lost``: (T, N) which
    robots were not asked, because they were lost.
    """

    scenario: Scenario
    arena: Arena
    ticks: NDArray[np.int64]
    positions: Floats
    contacts: tuple[tuple[tuple[str, str], ...], ...]
    captured: bool
    ended: str | None
    lost: NDArray[np.bool_]

    @property
    def robots(self) -> Floats:
        """(T, N, 2) positions of the robots in m."""
        return self.positions[:, :-1]

    @property
    def target(self) -> Floats:
        """(T, 2) positions of the target in m."""
        return self.positions[:, -1]

    @property
    def last_tick(self) -> int:
        """The last tick that the recording shows."""
        return int(self.ticks[-1])

    @property
    def capture_tick(self) -> int | None:
        """The tick of the capture, None without one."""
        return self.last_tick if self.captured else None

    @property
    def outcome(self) -> str:
        """How the run ended, in a few words."""
        tick = self.last_tick
        if self.captured:
            text = f"captured at tick {tick} ({tick * self.scenario.tick_s:.1f} s)"
            if len(self.captors) == len(self.arena.ids):
                return text
            needed = min(self.scenario.capture_count, int((~self.lost[-1]).sum()))
            return f"{text} by {', '.join(self.captors)} ({needed} needed)"
        if self.ended == EndReason.TICKS:
            return f"not captured in {tick} ticks ({tick * self.scenario.tick_s:.1f} s)"
        return self.ended or f"unfinished, the recording ends at tick {tick}"

    @cached_property
    def captors(self) -> tuple[str, ...]:
        """The robots that captured: near enough, and not lost; none without a capture."""
        rays = self.robots[-1] - self.target[-1]
        near = (rays * rays).sum(axis=1) <= self.scenario.capture.stop_distance_m**2
        took_part = near & ~self.lost[-1] & self.captured
        return tuple(robot for robot, so in zip(self.arena.ids, took_part, strict=True) if so)

    @cached_property
    def silent(self) -> NDArray[np.bool_]:
        """(T, N) which robots' radios were off by the scenario; not those that were lost."""
        off = np.zeros(self.lost.shape, bool)
        for robot, first, after in self.arena.silences:
            during = (first <= self.ticks) & (self.ticks < after)
            off[during, self.arena.ids.index(robot)] = True
        return off & ~self.lost

    @cached_property
    def moved_by_hand(self) -> tuple[int, ...]:
        """Ticks at which the target had been moved by hand."""
        events = [e.tick for e in self.scenario.events if isinstance(e, MoveTarget)]
        return tuple(sorted(t for t in set(events) if self.ticks[0] < t <= self.last_tick))

    @cached_property
    def visible(self) -> NDArray[np.bool_]:
        """(T, N + 1, N + 1) whether row body sensed column body, the target last."""
        count = self.positions.shape[1]
        seen = [
            in_sight(
                geometry(positions, self.arena.radii, count), self.arena.ranges, self.arena.radii
            )
            for positions in self._with_obstacles
        ]
        return np.array(seen)

    @cached_property
    def gaps(self) -> Floats:
        """(T, N + 1, N + 1 + O) free distance in m between surfaces, obstacles last."""
        count = self.positions.shape[1]
        return np.array(
            [geometry(points, self.arena.radii, count).gaps for points in self._with_obstacles]
        )

    @cached_property
    def _with_obstacles(self) -> Floats:
        fixed = np.array([o.position for o in self.scenario.obstacles]).reshape(-1, 2)
        return np.concatenate(
            [self.positions, np.broadcast_to(fixed, (len(self.ticks), *fixed.shape))], axis=1
        )

    def row(self, tick: int) -> int:
        """The row of a tick; the nearest one that the recording has."""
        return int(np.abs(self.ticks - tick).argmin())

    def heading_rad(self, tick: int) -> float:
        """The direction in rad of the step that the target makes from this tick to the next."""
        step = self.target[self.row(tick + 1)] - self.target[self.row(tick)]
        return float(np.arctan2(step[1], step[0]))

    def first_sight(self, robot: str) -> int | None:
        """The first tick at which the target detects the robot, None if it never does."""
        rows = np.flatnonzero(self.visible[:, -1, self.arena.ids.index(robot)])
        return int(self.ticks[rows[0]]) if len(rows) else None

    def least_gap(self) -> tuple[float, int, tuple[str, str]]:
        """The least free distance in m between two bodies, when, and who; overlap is below 0."""
        row, body, other = np.unravel_index(int(self.gaps.argmin()), self.gaps.shape)
        names = self.arena.names
        return float(self.gaps.min()), int(self.ticks[row]), (names[body], names[other])


def ground_truth_of(recording: Recording) -> GroundTruth:
    """The ground truth in a recording; of one cut off before the first tick, the start alone."""
    arena = build(recording.scenario, recording.seed)
    states = [decoded(State, recording, t, p) for t, _, p in recording.of_channel("state")]
    ends = [decoded(End, recording, t, p) for t, _, p in recording.of_channel("end")]
    states = states or [truth(arena, initial(arena))]
    ticks = [s.tick for s in states]
    return GroundTruth(
        recording.scenario,
        arena,
        np.array(ticks),
        np.array([[*s.robots, s.target] for s in states]),
        tuple(s.contacts for s in states),
        states[-1].captured,
        ends[0].reason if ends else None,
        _lost(recording, ticks),
    )


def _lost(recording: Recording, ticks: Sequence[int]) -> NDArray[np.bool_]:
    """(T, N) which robots got no observation; where nobody was asked, as in the tick before.

    Of a recording that was cut off, the last round may be incomplete.
    """
    asked = {(tick, robot) for tick, robot, _ in recording.of_channel("observation")}
    whole = max((tick for tick, _ in asked), default=-1) + recording.complete
    lost = np.zeros((len(ticks), len(recording.scenario.ids)), bool)
    for row, tick in enumerate(ticks):
        if tick < whole:
            lost[row] = [(tick, robot) not in asked for robot in recording.scenario.ids]
        elif row:
            lost[row] = lost[row - 1]
    return lost


def spans(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """The stretches of rows where (T,) flags are set: first row, and the row after the last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int)))
    return [(int(first), int(after)) for first, after in edges.reshape(-1, 2)]


def commands_at(recording: Recording, tick: int) -> tuple[Command, ...]:
    """The robots' commands of a tick, in robot order; none at the tick at which a run ends."""
    commands = recording.of_channel("command")
    return tuple(decoded(Command, recording, t, p) for t, _, p in commands if t == tick)


def ring_centre(commands: Sequence[Command], radius_m: float) -> Point | None:
    """Centre in m of the ring of encirclement that the commands plan; None if none encircles.

    A command holds a robot's own point of the ring (goal) and that point's number q. By Eq. 1 the
    goals are ``centre + radius * R(q theta) u``, linear in the centre and the unit vector u; two
    robots determine them. Robots with different views plan different rings: if no common one fits
    to ``RING_MISFIT_M_MAX``, or a single robot encircles, the centre is the mean of the estimates.
    """
    encircling = [c for c in commands if c.goal is not None and c.point is not None and c.estimate]
    if not encircling:
        return None
    rows, goals = [], []
    for command in encircling:
        assert command.goal is not None
        assert command.point is not None
        angle = 2.0 * pi * command.point / max(1, len(command.team))
        c, s = radius_m * np.cos(angle), radius_m * np.sin(angle)
        rows += [[1.0, 0.0, c, -s], [0.0, 1.0, s, c]]
        goals += [*command.goal]
    solution, _, rank, _ = np.linalg.lstsq(np.array(rows), np.array(goals))
    misfit = float(np.abs(np.array(rows) @ solution - goals).max())
    unit = abs(float(np.hypot(solution[2], solution[3])) - 1.0) * radius_m
    if rank == 4 and max(misfit, unit) <= RING_MISFIT_M_MAX:
        return float(solution[0]), float(solution[1])
    x, y = np.mean([c.estimate for c in encircling if c.estimate], axis=0).tolist()
    return x, y


def points_shared(recording: Recording) -> tuple[int, int]:
    """Ticks at which two encircling robots had one goal, and ticks with two or more such robots.

    Positions are compared, not numbers of points: each robot counts from its own reference.
    """
    by_tick: dict[int, list[tuple[float, float]]] = {}
    for tick, _, payload in recording.of_channel("command"):
        command = decoded(Command, recording, tick, payload)
        if command.point is not None and command.goal is not None:
            by_tick.setdefault(tick, []).append(command.goal)
    several = [goals for goals in by_tick.values() if len(goals) > 1]
    apart_m = 2.0 * recording.scenario.team.radius_m
    shared = sum(any(dist(a, b) < apart_m for a, b in combinations(g, 2)) for g in several)
    return shared, len(several)


def estimates_agree(
    recording: Recording, ground_truth: GroundTruth, tick: int, within_m: float
) -> int | None:
    """The first tick from ``tick`` on at which every robot's estimate is near the target."""
    agreeing: dict[int, int] = {}
    for at, _, payload in recording.of_channel("command"):
        if at < tick:
            continue
        estimate = decoded(Command, recording, at, payload).estimate
        if estimate is not None:
            off = np.hypot(*(ground_truth.target[ground_truth.row(at)] - estimate))
            agreeing[at] = agreeing.get(at, 0) + int(off <= within_m)
    return next(
        (at for at, n in sorted(agreeing.items()) if n == len(ground_truth.arena.ids)), None
    )
