"""A witness of one run: knows only what the world records, and what was done to its robots.

What it holds a run to, at every tick:

1. Every packet that is sent has exactly one fate on each link, and every copy too: it is lost, with
   a cause, or due at a tick. In the end it is lost, delivered or in flight, and the sums agree.
2. No packet is due before the tick after it was sent, none on a link from a robot to itself or to
   one that is lost, and none twice but by duplication.
3. An inbox holds the packets that were due at its tick, byte for byte, and nothing else.
4. Bodies never overlap, in exact arithmetic; nothing moves further than its own limit and what
   contacts give back; who is lost rolls out and stands.
5. Who is lost is not asked and not planned with; who is back is set up once; losses and returns
   alternate; the run ends by a capture that is one, or at its last tick.
6. What world and robots remember is bounded by the size of the team and what is in flight.
7. What is refused is counted under few causes, and nothing raises.

Every check is made from the recorded messages with arithmetic of its own; none asks the code that
is under test. The state of world and robots is looked at for its size alone.
"""

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from math import atan2, hypot, pi
from typing import Any

import numpy as np
from helpers_world import overlapping

from encircle.agents.brain.robot_core import RobotCore
from encircle.protocol.codec import decode
from encircle.protocol.messages import (
    QUANTUM_M,
    Command,
    End,
    Intervention,
    Observation,
    Pose,
    Radio,
    Setup,
    State,
)
from encircle.world.arena.engine import Arena
from encircle.world.channel.loss_causes import CAUSES
from encircle.world.coordinator.result import Result
from encircle.world.coordinator.round_engine import RoundEngine
from encircle.world.coordinator.world_core import WorldCore
from encircle.world.scenario.channel_model import Crash
from encircle.world.scenario.model import MoveTarget

STEP_TOLERANCE_M = 64 * QUANTUM_M
"""61 um. Two that touch get their skin of four quanta back, one between several more than once in a
tick (``world/arena/collisions.py``): a body that nobody moves has been seen to make 15 quanta."""
COAST_TICKS = 5
REFUSALS_MAX = 10
KINDS: dict[str, type[Any]] = {
    "setup": Setup,
    "observation": Observation,
    "pose": Pose,
    "command": Command,
    "end": End,
    "state": State,
    "radio": Radio,
    "intervention": Intervention,
}


class Witness:
    """Takes a run's messages in as they are recorded, and asserts what must hold of every tick."""

    def __init__(self, arena: Arena, run: str) -> None:
        self.arena, self.scenario, self.run = arena, arena.scenario, run
        self.count = len(arena.ids)
        self.tick = -1
        self.positions: list[np.ndarray] = []
        self.captured = False
        self.radios: list[Radio] = []
        self.arriving: dict[tuple[int, int], Counter[bytes]] = defaultdict(Counter)
        self.setups: Counter[tuple[int, str]] = Counter()
        self.observations: dict[tuple[int, str], Observation] = {}
        self.commands: dict[tuple[int, str], Command] = {}
        self.poses: dict[tuple[int, str], bytes] = {}
        self.ends: list[str] = []
        self.away: dict[str, list[list[float]]] = {robot: [] for robot in arena.ids}
        self.moved_by_hand = {e.tick for e in arena.scenario.events if isinstance(e, MoveTarget)}
        self.crashes = [
            (e.robot, e.tick, e.ticks) for e in arena.scenario.events if isinstance(e, Crash)
        ]
        self.latest_due: dict[tuple[int, int], int] = {}
        self.faults: Counter[str] = Counter()

    def struck(self, robot: str, tick: int) -> None:
        """A robot was lost while the world stood at a tick: it is asked no more from the next."""
        self.away[robot].append([tick + 1, float("inf")])

    def returned(self, robot: str, tick: int) -> None:
        """A robot that was struck is there again."""
        self.away[robot][-1][1] = tick + 1

    def lost(self, tick: int) -> tuple[str, ...]:
        """The robots that are not to be asked at a tick, in robot order."""
        crashed = {
            robot
            for robot, begin, ticks in self.crashes
            if begin <= tick and (ticks is None or tick < begin + ticks)
        }
        return tuple(
            robot
            for robot in self.arena.ids
            if robot in crashed or any(a <= tick < b for a, b in self.away[robot])
        )

    def record(self, tick: int, key: str, payload: bytes) -> None:
        """The world's recorder."""
        robot, channel = key.split("/")[-2:]
        message = decode(KINDS[channel], payload, self.run)
        if channel == "state":
            assert (tick, message.tick) == (self.tick + 1, self.tick + 1)
            self.tick = tick
            self._state(message)
        elif channel == "radio":
            self._radio(tick, message)
        elif channel == "observation":
            self.observations[tick, robot] = message
            self._observation(message)
        elif channel == "setup":
            assert (message.first_tick, message.answer_tick) == (tick, tick)
            self.setups[tick, robot] += 1
        elif channel == "command":
            self.commands[tick, robot] = message
            self._command(message)
        elif channel == "pose":
            self.poses[tick, robot] = payload
        elif channel == "intervention":
            assert tick == message.tick == self.tick
            self._given(message.event)
        elif channel == "end":
            self.ends.append(message.reason)

    def _given(self, event: Mapping[str, Any]) -> None:
        """The run was given an event by hand, of a later tick."""
        assert event["tick"] > self.tick
        if event["kind"] == "move-target":
            self.moved_by_hand.add(event["tick"])
        elif event["kind"] == "crash":
            self.crashes.append((event["robot"], event["tick"], event.get("ticks")))

    def _state(self, state: State) -> None:
        scenario, tick = self.scenario, state.tick
        fixed = [o.position for o in scenario.obstacles]
        now = np.array([*state.robots, state.target, *fixed])
        assert overlapping(now, self.arena.radii, self.count + 1) == [], f"overlap at {tick}"
        assert not self.captured, "the run goes on after a capture"
        self.captured = state.captured
        self.positions.append(now)
        if tick == 0:
            return
        moved = np.hypot(*(now - self.positions[-2]).T)
        if tick in self.moved_by_hand:
            moved[self.count] = 0.0
        singles = scenario.team.overrides
        own = [singles[r].step_m_max if r in singles else None for r in self.arena.ids]
        limits = [scenario.team.step_m_max if m is None else m for m in own]
        limits.append(scenario.target.step_m_max)
        assert (moved[: self.count + 1] <= np.array(limits) + STEP_TOLERANCE_M).all(), (
            f"steps at {tick}: {moved}"
        )
        self._coasting(tick, moved)
        assert state.captured == self._captures(now, tick), f"capture at {tick}"

    def _coasting(self, tick: int, moved: np.ndarray) -> None:
        """Who gave no command for the step that led here rolls out, and then stands still."""
        for place, robot in enumerate(self.arena.ids):
            without_lost = 0
            while without_lost < tick and not self.took_part(tick - 1 - without_lost, robot):
                without_lost += 1
            if without_lost == 0:
                continue
            before = tick - without_lost
            first = self.positions[before][place] - self.positions[max(before - 1, 0)][place]
            left = max(0.0, 1.0 - without_lost / COAST_TICKS)
            assert moved[place] <= left * hypot(*first) + STEP_TOLERANCE_M, (
                f"{robot} moves {moved[place]} m at {tick}, {without_lost} ticks after it was lost"
            )

    def took_part(self, tick: int, robot: str) -> bool:
        """Whether a robot was there at the end of a tick: in lock-step, if it has answered."""
        return (tick, robot) in self.commands

    def _captures(self, now: np.ndarray, tick: int) -> bool:
        """Whether the robots that took part in the last round hold the target."""
        x, y = now[self.count]
        there = [
            now[place]
            for place, robot in enumerate(self.arena.ids)
            if self.took_part(tick - 1, robot)
        ]
        near = [
            atan2(by - y, bx - x)
            for bx, by in there
            if hypot(bx - x, by - y) <= self.scenario.capture.stop_distance_m
        ]
        if not near or len(near) < min(self.scenario.capture_count, len(there)):
            return False
        near.sort()
        gaps = [b - a for a, b in zip(near, [*near[1:], near[0] + 2 * pi], strict=True)]
        return max(gaps) < pi

    def _radio(self, tick: int, said: Radio) -> None:
        assert tick == len(self.radios)
        self.radios.append(said)
        for table in (said.fates, said.copies):
            for number, row in enumerate(table):
                assert row[number] == 0, f"a packet to its own sender at {tick}"
                for receiver, due in enumerate(row):
                    if due > 0:
                        assert due > tick, f"a packet of {tick} is due at {due}"
                        self.arriving[due, receiver][self.poses[tick, self.arena.ids[number]]] += 1
                        self._count_arrival(tick, number, receiver, due)
                    elif due < 0:
                        self.faults[f"lost: {CAUSES[-due]}"] += 1
        assert all(
            self.scenario.channel.duplication.rate > 0.0 and said.fates[k][to] > 0
            for k, row in enumerate(said.copies)
            for to, due in enumerate(row)
            if due
        ), f"copies at {tick} without duplication, or of what is lost"
        self.faults["duplicated"] += sum(due > 0 for row in said.copies for due in row)
        for place, robot in enumerate(self.arena.ids):
            sent = [fate for k, fate in enumerate(said.fates[place]) if k != place]
            assert all(bool(f) == ((tick, robot) in self.poses) for f in sent), f"row of {robot}"
            for k, receiver in enumerate(self.arena.ids):
                if not self.took_part(tick, receiver):
                    assert said.fates[place][k] <= 0, f"{receiver} is lost, and is sent to"
        self._answers(tick)

    def _answers(self, tick: int) -> None:
        """Who was asked has answered, or was lost."""
        answered = {robot for at, robot in self.commands if at == tick}
        asked = {robot for at, robot in self.observations if at == tick}
        assert answered <= asked
        # Who was asked and gave no command was lost while the round was open.
        assert asked - answered <= set(self.lost(tick + 1)) | self._flickered(tick)

    def _count_arrival(self, tick: int, sender: int, receiver: int, due: int) -> None:
        latest = self.latest_due.get((sender, receiver), 0)
        self.faults["delayed"] += due > tick + 1
        self.faults["overtaken"] += due < latest
        self.latest_due[sender, receiver] = max(due, latest)

    def _flickered(self, tick: int) -> set[str]:
        """Robots lost while this tick's round was open and back in the next."""
        return {
            robot
            for robot, spans in self.away.items()
            if any(begin == tick + 1 for begin, _ in spans)
        }

    def _observation(self, seen: Observation) -> None:
        tick, robot = seen.tick, seen.robot
        assert tick == self.tick
        assert seen.lost == self.lost(tick), f"{robot} at {tick}: {seen.lost}"
        assert robot not in seen.lost
        before = (tick - 1, robot) in self.observations
        fresh = tick == 0 or not before
        assert (self.setups[tick, robot] > 0) == fresh or self.setups[tick, robot] == 1
        self._inbox(seen, self.arriving[tick, self.arena.ids.index(robot)])

    def _inbox(self, seen: Observation, due: Counter[bytes]) -> None:
        assert Counter(seen.inbox) == due, f"inbox of {seen.robot} at {seen.tick}"

    def _command(self, command: Command) -> None:
        lost = self.observations[command.tick, command.robot].lost
        assert not set(command.team) & set(lost), f"{command.robot} plans with one that is lost"

    def look(self, world: WorldCore, robots: Iterable[RobotCore]) -> None:
        """Whether what world and robots remember is bounded, by what it must be."""
        assert len(world.answers) <= self.count
        self.look_at_rounds(world.rounds)
        self.look_at_robots(robots)

    def look_at_rounds(self, rounds: RoundEngine) -> None:
        """Whether what a run remembers is bounded."""
        state = rounds.state
        assert self.tick == state.tick
        assert not rounds.journal.pending
        assert len(rounds.open_round.messages) <= 2 * self.count
        flying = [
            f for due, flights in state.channel_state.flights.items() for f in flights if due > 0
        ]
        assert all(due >= state.tick for due in state.channel_state.flights)
        assert set(state.packets) <= {f.sent_tick for f in flying} | {state.tick - 1}
        links = self.count * (self.count - 1)
        assert sum(int(f.links.sum()) for f in flying) <= 2 * links * (state.tick + 1)
        assert len(rounds.departures) <= 2 * self.count * (state.tick + 1)
        assert len(rounds.refused) <= REFUSALS_MAX

    def look_at_robots(self, robots: Iterable[RobotCore]) -> None:
        """Whether what robots remember is bounded."""
        ids = self.arena.ids
        for core in robots:
            assert len(core.refused) <= REFUSALS_MAX
            if core.state is None or core.config is None:
                continue
            assert len(core.state.peers) == self.count
            assert len(core.state.track.entries) <= core.config.parameters.window_ticks
            assert all(len(e.detections) <= len(ids) for e in core.state.track.entries)
            assert len(core.state.lost) < self.count

    def ended(self, result: Result, robots: Iterable[RobotCore]) -> None:
        """Whether the result is that of the run that was seen."""
        assert result.ticks == self.tick <= self.scenario.ticks_max
        assert result.captured == self.captured
        assert result.ended == ("captured" if self.captured else "ticks")
        assert result.capture_tick == (self.tick if self.captured else None)
        assert self.captured or self.tick == self.scenario.ticks_max
        assert self.ends == [result.ended] * self.count
        last = self.positions[-1]
        away = np.hypot(*(last[: self.count] - last[self.count]).T)
        np.testing.assert_allclose(result.distances_m, away, rtol=0, atol=1e-9)
        self._conserved(result)
        self._departed(result)
        for core in robots:
            assert core.ended in (None, result.ended)

    def _conserved(self, result: Result) -> None:
        """Sent and copied are lost, delivered and in flight together, each as recorded."""
        fates = [fate for said in self.radios for row in said.fates for fate in row]
        copies = [due for said in self.radios for row in said.copies for due in row if due]
        due = [fate for fate in fates if fate > 0] + copies
        assert result.packets_sent == sum(fate != 0 for fate in fates)
        assert result.packets_copied == len(copies)
        lost = Counter(CAUSES[-fate] for fate in fates if fate < 0)
        assert result.packets_lost == dict(lost)
        assert result.packets_delivered == sum(at <= self.tick for at in due)
        assert result.packets_in_flight == sum(at > self.tick for at in due)
        assert result.packets_sent + result.packets_copied == (
            sum(result.packets_lost.values()) + result.packets_delivered + result.packets_in_flight
        )

    def _departed(self, result: Result) -> None:
        """Each robot is lost and back by turns; who is away now is who was lost last."""
        turns: dict[str, list[tuple[int, str]]] = {robot: [] for robot in self.arena.ids}
        for tick, robot, what in result.departures:
            turns[robot].append((tick, what.split(":")[0]))
        for robot, seen in turns.items():
            expected = ["lost", "back"] * len(seen)
            assert [what for _, what in seen] == expected[: len(seen)], (robot, seen)
            assert [tick for tick, _ in seen] == sorted(tick for tick, _ in seen)
            backs = {tick for tick, what in seen if what == "back"}
            assert {t for (t, r) in self.setups if r == robot and t > 0} == backs
