"""Runs by the clock without a clock: world and robots of the real cores on a network made up here.

Every clock's offset and drift, every message's delay and loss are chosen by the test, so that what
is worked out of a run can be compared with what was put in.
"""

import heapq
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from encircle.agents.brain.real_time_core import RealTimeRobotCore
from encircle.agents.brain.robot_core import RobotCore
from encircle.protocol.keys import parse_key
from encircle.world.arena.engine import build
from encircle.world.coordinator.real_time_core import RealTimeWorldCore
from encircle.world.loading.load import load
from encircle.world.recording.run_directory import start_recording
from encircle.world.scenario.model import Scenario

RUN = "clocked"
EPOCH_US = 1_700_000_000_000_000
THINK_US = 500
SQUARE = ((4.0, 0.0), (0.0, 4.0), (-4.0, 0.0), (0.0, -4.0))

Delay = Callable[[str, str, str, int], int | None]
"""Delay in us of the n-th message of a channel from one node to another; None if it is lost."""


def by_clock(*overrides: str, **sections: Any) -> Scenario:
    """Four robots and a target that they do not catch, by the clock, in ticks of 20 ms."""
    tree: dict[str, Any] = {
        "ticks_max": 100,
        "tick_s": 0.02,
        "clock": "wall",
        "team": {"positions": SQUARE},
        "target": {
            "behaviour": "patrol",
            "parameters": {"waypoints": [[99, 0], [99, 99], [0, 99], [0, 0]]},
            "step_m_max": 0.5,
        },
        "capture": {"stop_distance_m": 1.0},
    }
    return load({**tree, **sections}, overrides)


def at_once(_sender: str, _receiver: str, _channel: str, _number: int) -> int | None:
    return 1000


@dataclass
class Simulated:
    """A run. ``offsets_us``, ``drifts``: of each robot's clock from the world's, which is true.

    ``frozen_us``: spans of true time in which a robot does nothing, messages waiting for it.
    """

    scenario: Scenario
    delay: Delay = at_once
    offsets_us: Mapping[str, int] = field(default_factory=dict)
    drifts: Mapping[str, float] = field(default_factory=dict)
    frozen_us: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    out: Path | None = None

    def __post_init__(self) -> None:
        self.world = RealTimeWorldCore(build(self.scenario, self.scenario.seed), RUN)
        self.cores = {robot: RobotCore(robot, RUN) for robot in self.scenario.ids}
        self.robots: dict[str, RealTimeRobotCore] = {}
        self.sent: dict[tuple[str, str, str], list[bool]] = {}
        self._events: list[tuple[int, int, Callable[[int], None]]] = []
        self._count = 0
        self._thinking: set[str] = set()

    def run(self) -> RealTimeWorldCore:
        """Play it to its end."""
        world, recorder = self.world, None
        if self.out is not None:
            self.out.mkdir(parents=True, exist_ok=True)
            recorder = start_recording(self.out, self.scenario, RUN)
            world.record_with(recorder.record)
        for robot in self.scenario.ids:
            for key, payload in world.join(robot):
                self.cores[robot].receive(key, payload)
                self.robots[robot] = RealTimeRobotCore(self.cores[robot])
        self._at(0, self._begin)
        while self._events and world.ended is None:
            now_us, _, happen = heapq.heappop(self._events)
            happen(now_us)
        world.rounds.commit()
        if recorder is not None:
            recorder.close()
        return world

    def clock_us(self, robot: str, true_us: int) -> int:
        """What a robot's clock shows at a true time since the beginning."""
        drifted = true_us * (1.0 + self.drifts.get(robot, 0.0))
        return EPOCH_US + self.offsets_us.get(robot, 0) + int(drifted)

    def _at(self, time_us: int, happen: Callable[[int], None]) -> None:
        self._count += 1
        heapq.heappush(self._events, (time_us, self._count, happen))

    def _begin(self, now_us: int) -> None:
        self.world.now_us = EPOCH_US + now_us
        self._from_world(self.world.begin(), now_us)

    def _end_tick(self, now_us: int) -> None:
        self._from_world(self.world.end_tick(EPOCH_US + now_us), now_us)

    def _from_world(self, messages: list[tuple[str, bytes]], now_us: int) -> None:
        self.world.rounds.commit()
        if self.world.ended is None:
            for key, payload in messages:
                self._send("world", parse_key(key).robot or "", key, payload, now_us)
            self._at(now_us + round(self.scenario.tick_s * 1e6), self._end_tick)

    def _send(self, sender: str, receiver: str, key: str, payload: bytes, now_us: int) -> None:
        channel = key.rsplit("/", 1)[1]
        log = self.sent.setdefault((sender, receiver, channel), [])
        # A setup is never overtaken by the observation that follows it.
        delay_us = 0 if channel == "setup" else self.delay(sender, receiver, channel, len(log))
        log.append(delay_us is None)
        if delay_us is not None:
            self._at(now_us + delay_us, lambda at_us: self._arrive(receiver, key, payload, at_us))

    def _arrive(self, receiver: str, key: str, payload: bytes, now_us: int) -> None:
        if receiver == "world":
            self.world.take(key, payload, EPOCH_US + now_us)
            return
        begun_us, until_us = self.frozen_us.get(receiver, (0, 0))
        if begun_us <= now_us < until_us:
            self._at(until_us, lambda at_us: self._arrive(receiver, key, payload, at_us))
            return
        self.robots[receiver].take(self.clock_us(receiver, now_us), key, payload)
        if receiver not in self._thinking:
            self._thinking.add(receiver)
            self._at(now_us + THINK_US, lambda at_us: self._answer(receiver, at_us))

    def _answer(self, robot: str, now_us: int) -> None:
        self._thinking.discard(robot)
        core = self.robots[robot]
        action = core.decide()
        if action is None:
            return
        for key, payload in core.messages(action, self.clock_us(robot, now_us)):
            self._send(robot, "world", key, payload, now_us)
            if key.endswith("/pose") and self.scenario.radio == "direct":
                for peer in self.scenario.ids:
                    if peer != robot:
                        self._send(robot, peer, key, payload, now_us)
