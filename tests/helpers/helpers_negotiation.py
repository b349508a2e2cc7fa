"""A team that negotiates over a made-up network: policies, a graph, and what becomes of packets.

No world, no brain: views are built by hand, bodies stand where they are put, and every packet goes
through what a policy's answer has to stand anyway, check and codec of payloads.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from math import cos, hypot, pi, sin
from random import Random
from typing import Any

import numpy as np
from hypothesis import strategies as st

from encircle.agents.estimation.kalman import Estimate
from encircle.agents.policies.decision_check import validated
from encircle.agents.policies.interface import Decision, View
from encircle.protocol.messages import Point, Pose
from encircle.protocol.parameters import Parameters
from encircle.protocol.wire.payload import NOTHING_SAID, payload

NEVER_SHRINKS = replace(Parameters(), near_factor=0.1)
"""A ring is closed by robots within 0.4 m of the target alone, where these tests put none."""
RING_M = NEVER_SHRINKS.ring_radius_m
SEARCH = Decision("search", (0.1, 0.0), (1.0, 1.0))


@dataclass(frozen=True)
class Channel:
    """What becomes of packets sent before ``quiet_tick``; later ones all come a tick later.

    ``loss`` and ``duplication``: probabilities; ``delay_ticks_max``: a packet takes 1 to this many
    ticks, so that later ones overtake it.
    """

    loss: float = 0.0
    duplication: float = 0.0
    delay_ticks_max: int = 1
    quiet_tick: int = 0
    seed: int = 0

    def delays(self, tick: int, sender: int, receiver: int) -> list[int]:
        """How long each copy of a packet takes; none if it is lost."""
        if tick >= self.quiet_tick:
            return [1]
        random = Random(f"{self.seed} {tick} {sender} {receiver}")
        copies = 2 if random.random() < self.duplication else 1
        delays = [random.randint(1, self.delay_ticks_max) for _ in range(copies)]
        return [delay for delay in delays if random.random() >= self.loss]


@dataclass
class Negotiation:
    """N robots, all running one policy, that stand still unless they are moved.

    ``links``: who hears whom, both ways. ``targets``: where each robot believes the target to be,
    None if it knows nothing of it. ``planned``: whom each robot plans with, all by default.
    """

    policy: Callable[..., Any]
    positions: list[Point]
    links: Iterable[tuple[int, int]]
    channel: Channel = Channel()
    targets: list[Point | None] = field(default_factory=list)
    planned: list[tuple[int, ...]] = field(default_factory=list)
    silent: set[int] = field(default_factory=set)
    """Robots that are lost: they are not asked, and what they forget they do not get back."""
    tick: int = 0

    def __post_init__(self) -> None:
        count = len(self.positions)
        self.team = tuple([f"r{k + 1}" for k in range(count)])
        self.neighbours = [
            sorted({b for a, b in self._both_ways() if a == k}) for k in range(count)
        ]
        self.targets = self.targets or [(0.0, 0.0)] * count
        self.planned = self.planned or [tuple(range(count))] * count
        self.memories: list[Any] = [None] * count
        self.newest: list[list[Pose | None]] = [[None] * count for _ in range(count)]
        self.arriving: dict[int, list[tuple[int, Pose]]] = {}
        self.decisions: list[Decision | None] = [None] * count

    def _both_ways(self) -> list[tuple[int, int]]:
        return [pair for a, b in self.links for pair in ((a, b), (b, a))]

    def step(self) -> list[int | None]:
        """One tick of all robots; each one's point."""
        inboxes: list[list[Pose]] = [[] for _ in self.team]
        for receiver, packet in self.arriving.pop(self.tick, []):
            inboxes[receiver].append(packet)
        for robot in range(len(self.team)):
            if robot in self.silent:
                self.memories[robot] = self.decisions[robot] = None
            else:
                self._decide(robot, inboxes[robot])
        self.tick += 1
        return [decision and decision.point for decision in self.decisions]

    def run(self, ticks: int) -> list[int | None]:
        """So many ticks; each robot's point after the last."""
        for _ in range(ticks):
            self.step()
        return [decision and decision.point for decision in self.decisions]

    def view(self, robot: int, inbox: Sequence[Pose] = ()) -> View:
        """What a robot sees at this tick."""
        heard = sorted(inbox, key=lambda p: (p.tick, self.team.index(p.robot), p.sequence))
        for packet in heard:
            sender = self.team.index(packet.robot)
            known = self.newest[robot][sender]
            if known is None or packet.tick > known.tick:
                self.newest[robot][sender] = packet
        members, target = self.planned[robot], self.targets[robot]
        return View(
            self.tick,
            0.1,
            self.team[robot],
            self.team,
            self.positions[robot],
            members.index(robot),
            tuple([self.positions[k] for k in members]),
            Estimate(*target, 0.0, 0.0, (1.0, 0.0, 1.0)) if target else None,
            partial(drifting, target or (0.0, 0.0)),
            NEVER_SHRINKS,
            members=members,
            heard=tuple(heard),
            search=None if target else SEARCH,
            known=tuple([(self.tick, *position, 0.0, 0.0) for position in self.positions]),
            packets=tuple(self.newest[robot]),
        )

    def _decide(self, robot: int, inbox: list[Pose]) -> None:
        answer = self.policy(self.memories[robot], self.view(robot, inbox))
        self.memories[robot], decision = validated(answer)
        self.decisions[robot] = decision
        packet = Pose(
            self.team[robot],
            self.tick,
            self.tick,
            self.positions[robot],
            (0.0, 0.0),
            None,
            decision.mode,
            decision.xi,
            decision.point,
            (),
            None,
            NOTHING_SAID if decision.say is None else payload(decision.say),
        )
        for receiver in self.neighbours[robot]:
            for delay in self.channel.delays(self.tick, robot, receiver):
                self.arriving.setdefault(self.tick + delay, []).append((receiver, packet))


def drifting(target: Point, grid: tuple[float, ...]) -> tuple[Any, str]:
    """A target that is predicted to go east, 0.1 m a tick."""
    return np.array(target) + np.array(grid)[:, None] * np.array((0.1, 0.0)), "velocity"


def costs_mm(positions: Sequence[Point], target: Point = (0.0, 0.0)) -> list[list[int]]:
    """Each robot's distance to each point of the ring around the target, in mm."""
    count = len(positions)
    bearings = [2 * pi * k / count for k in range(count)]
    ring = [(target[0] + RING_M * cos(b), target[1] + RING_M * sin(b)) for b in bearings]
    return [[round(1000 * hypot(x - px, y - py)) for px, py in ring] for x, y in positions]


def costs_by_projection(positions: Sequence[Point]) -> list[list[int]]:
    """How far each robot stands out in each point's direction from the origin, in mm, negative."""
    bearings = [2 * pi * k / len(positions) for k in range(len(positions))]
    return [[round(-1000 * (x * cos(b) + y * sin(b))) for b in bearings] for x, y in positions]


def diameter(count: int, links: Iterable[tuple[int, int]]) -> int:
    """The longest of the shortest ways between two robots, in links (Floyd and Warshall)."""
    away = [[0 if a == b else count for b in range(count)] for a in range(count)]
    for a, b in links:
        away[a][b] = away[b][a] = 1
    for via in range(count):
        for a in range(count):
            for b in range(count):
                away[a][b] = min(away[a][b], away[a][via] + away[via][b])
    return max(map(max, away))


def all_links(count: int) -> list[tuple[int, int]]:
    """Everyone hears everyone."""
    return [(a, b) for a in range(count) for b in range(a)]


@st.composite
def teams(draw: st.DrawFn, most: int = 7) -> tuple[list[Point], list[tuple[int, int]]]:
    """Positions 1 to 12 m from the target at the origin, and the links of a connected graph."""
    count = draw(st.integers(1, most))
    places = st.tuples(st.floats(1.0, 12.0), st.floats(-pi, pi))
    polar = [draw(places) for _ in range(count)]
    # A random tree connects them, and a few links more.
    links = [(k, draw(st.integers(0, k - 1))) for k in range(1, count)]
    if count > 2:
        pairs = st.tuples(st.integers(0, count - 1), st.integers(0, count - 1))
        links += [(a, b) for a, b in draw(st.lists(pairs, max_size=4)) if a != b]
    return [(d * cos(b), d * sin(b)) for d, b in polar], links


CHANNELS = st.builds(
    Channel,
    loss=st.sampled_from([0.2, 0.6, 0.9]),
    duplication=st.sampled_from([0.0, 0.5]),
    delay_ticks_max=st.integers(1, 8),
    quiet_tick=st.just(25),
    seed=st.integers(0, 10_000),
)
