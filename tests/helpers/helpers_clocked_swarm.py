"""Short random hunts by the clock with everything wrong that can go wrong, and their witness.

A seed makes a scenario whose ticks end by the clock, a network with delay, loss and reordering,
clocks that are off, and a fate: robots freeze, are killed and started anew, strangers send garbage,
somebody intervenes. All of it is made up, so that a seed is one run here too. World and robots are
the real cores (``helpers_real_time``).
"""

import random
from collections import Counter
from pathlib import Path

from helpers_interventions import drawn_event
from helpers_real_time import EPOCH_US, RUN, Simulated
from helpers_scenarios import scenario_of
from helpers_swarm import Played, junk_bytes
from helpers_witness import Witness

from encircle.agents.brain.real_time_core import RealTimeRobotCore
from encircle.agents.brain.robot_core import RobotCore
from encircle.protocol.codec import decode_pose
from encircle.protocol.keys import robot_key, world_key
from encircle.protocol.messages import Command, CommandMode, Observation, Radio
from encircle.replay.replaying import replay
from encircle.world.arena.engine import Arena
from encircle.world.coordinator.membership import DepartureCause
from encircle.world.coordinator.real_time_core import has_perfect_channel
from encircle.world.loading.interventions import InterventionRefused, as_played
from encircle.world.loading.load import load
from encircle.world.recording.recording import INTERVENTION, Recording
from encircle.world.recording.run_directory import versions
from encircle.world.scenario.model import Scenario

KILLED_PER_TICK, JUNK_PER_TICK, BY_HAND_PER_TICK = 0.02, 0.3, 0.1
TWICE_EVERY = 8
AWAY_TICKS = (1, 12)
DELAY_TICKS = (0.01, 0.3, 1.2, 4.0)


def clocked_scenario(seed: int) -> Scenario:
    """The drawn scenario of a seed, by the clock; poses go through the world or directly."""
    draws = random.Random(f"clocked scenario {seed}")
    tree = scenario_of(seed).model_dump()
    return load(tree | {"clock": "wall", "radio": draws.choice(("world", "direct"))})


def checked_by_clock(seed: int) -> Played:
    """A run of a seed by the clock; fresh brains decide the same, and once more it is the same."""
    played = play_by_clock(seed)
    if seed // TWICE_EVERY % 2:
        assert played.messages == play_by_clock(seed).messages, "played twice it is another run"
        played.faults["check: the_same_once_more, by the clock"] += 1
    scenario = played.scenario
    for _, topic, payload in played.messages:
        if topic == INTERVENTION:
            scenario = as_played(scenario, payload, RUN)
    messages = tuple(played.messages)
    path, seeded = Path("recording.mcap"), scenario.seed
    check = replay(
        Recording(path, scenario, seeded, RUN, messages, True, versions(), written=played.scenario)
    )
    assert check.differences == (), f"fresh brains decide otherwise: {check.differences[:3]}"
    played.faults["check: replayed, by the clock"] += 1
    return played


def play_by_clock(seed: int) -> Played:
    """One run of a seed by the clock, watched."""
    run = _Faulty(clocked_scenario(seed), seed)
    world = run.run()
    result = world.rounds.result()
    run.witness.ended(result, run.cores.values())
    counted = run.faults + run.witness.faults
    counted.update(f"event {event.kind}" for event in run.scenario.events)
    for channels in run.sent.values():
        counted["lost on the network"] += sum(channels)
    return Played(run.scenario, run.messages, frozenset(), result, counted)


class _Faulty(Simulated):
    """A simulated run to which a seed's faults happen."""

    def __init__(self, scenario: Scenario, seed: int) -> None:
        draws = random.Random(f"clocked network {seed}")
        tick_us = scenario.tick_s * 1e6
        usual_us, loss = draws.choice(DELAY_TICKS) * tick_us, draws.choice((0.0, 0.05, 0.3))
        network = random.Random(f"clocked messages {seed}")

        def delay(_sender: str, _receiver: str, channel: str, _number: int) -> int | None:
            if channel != "end" and network.random() < loss:
                return None
            # A message may overtake those before it.
            return int(network.expovariate(1.0 / usual_us))

        frozen: dict[str, tuple[int, int]] = {}
        for robot in scenario.ids:
            if draws.random() < 0.2:
                begin = draws.uniform(0.0, scenario.ticks_max * tick_us)
                frozen[robot] = (int(begin), int(begin + draws.uniform(1.0, 12.0) * tick_us))
        super().__init__(
            scenario,
            delay,
            {robot: draws.randint(-(10**7), 10**7) for robot in scenario.ids},
            {robot: draws.uniform(-1e-4, 1e-4) for robot in scenario.ids},
            frozen,
        )
        self.messages: list[tuple[int, str, bytes]] = []
        self.faults: Counter[str] = Counter({"freeze": len(frozen)})
        self.witness = ClockedWitness(self.world.arena, RUN)
        self.world.record_with(self._record)
        self.draws = random.Random(f"clocked fate {seed}")
        self.by_hand = self.draws.random() < 0.4
        self.back: dict[str, int] = {}

    def _record(self, tick: int, key: str, payload: bytes, _at_us: int) -> None:
        self.messages.append((tick, key.removeprefix(f"encircle/{RUN}/"), payload))
        self.witness.record(tick, key, payload)

    def _end_tick(self, now_us: int) -> None:
        if self.world.ended is None:
            self._strike_some()
            self._intervene()
            self._stray(now_us)
        super()._end_tick(now_us)
        self.witness.look_at_rounds(self.world.rounds)
        self.witness.look_at_robots(core for core in self.cores.values() if core.setup is not None)

    def _strike_some(self) -> None:
        tick = self.world.state.tick
        for robot in [r for r, due in self.back.items() if due <= tick]:
            del self.back[robot]
            self.cores[robot] = RobotCore(robot, RUN)
            assert self.world.join(robot) == [], "its setup comes with its next observation"
            self.witness.returned(robot, tick)
            self.faults["return"] += 1
        for robot in self.scenario.ids:
            hit, away = self.draws.random() < KILLED_PER_TICK, self.draws.randint(*AWAY_TICKS)
            if hit and robot not in self.back and robot not in self.world.rounds.lost:
                self.witness.struck(robot, tick)
                self.world.leave(robot, DepartureCause.NO_ANSWER)
                self.robots.pop(robot, None)
                self.back[robot] = tick + away
                self.faults["kill"] += 1

    def _intervene(self) -> None:
        if not self.by_hand or self.draws.random() > BY_HAND_PER_TICK:
            return
        event = drawn_event(self.draws, self.scenario.ids)
        if event["kind"] not in ("move-target", "heal"):
            event["ticks"] = self.draws.randint(1, 15)
        try:
            self.world.intervene(event)
        except InterventionRefused:
            self.faults["by hand, refused"] += 1
        else:
            self.faults[f"by hand {event['kind']}"] += 1

    def _stray(self, now_us: int) -> None:
        """A stranger sends something to everybody; nothing comes of it."""
        draws = self.draws
        if draws.random() > JUNK_PER_TICK:
            return
        robot = draws.choice((*self.scenario.ids, "r77"))
        for channel in ("pose", "command", "observation", "setup", "end"):
            key, junk = robot_key(RUN, robot, channel), junk_bytes(draws)
            assert self.world.take(key, junk, EPOCH_US + now_us) == []
            for core in self.robots.values():
                core.take(EPOCH_US + now_us, key, junk)
            self.faults["garbage to all"] += 1
        assert self.world.take(world_key(RUN, "state"), b"", EPOCH_US + now_us) == []

    def _arrive(self, receiver: str, key: str, payload: bytes, now_us: int) -> None:
        if receiver in self.back:
            return
        if receiver != "world" and receiver not in self.robots:
            # A process that has just started has nothing until its setup comes.
            if key.endswith("/setup"):
                self.cores[receiver].receive(key, payload)
                self.robots[receiver] = RealTimeRobotCore(self.cores[receiver])
            return
        super()._arrive(receiver, key, payload, now_us)

    def _answer(self, robot: str, now_us: int) -> None:
        if robot in self.robots:
            super()._answer(robot, now_us)
        else:
            self._thinking.discard(robot)


class ClockedWitness(Witness):
    """As the witness of a run in lock-step; who is there takes part without having answered."""

    def __init__(self, arena: Arena, run: str) -> None:
        super().__init__(arena, run)
        self.newest: dict[str, bytes] = {}
        self.last_sent: dict[str, int] = {}

    def took_part(self, tick: int, robot: str) -> bool:
        was_asked = (tick, robot) in self.observations
        return was_asked and all(begin != tick + 1 for begin, _ in self.away[robot])

    def record(self, tick: int, key: str, payload: bytes) -> None:
        robot, channel = key.split("/")[-2:]
        if channel == "pose":
            known = self.newest.get(robot)
            sent_tick = decode_pose(payload, self.run).tick
            self.last_sent[robot] = max(sent_tick, self.last_sent.get(robot, -1))
            begun = max((at for at, who in self.setups if who == robot), default=0)
            if sent_tick < begun:
                # Sent before its robot was lost: peers may have heard it, so that it is recorded.
                assert self.scenario.is_direct
            elif known is None or _sequence(known, self.run) < _sequence(payload, self.run):
                self.newest[robot] = payload
        else:
            super().record(tick, key, payload)

    def _radio(self, tick: int, said: Radio) -> None:
        for robot, packet in self.newest.items():
            if self.took_part(tick, robot):
                self.poses[tick, robot] = packet
        self.newest.clear()
        super()._radio(tick, said)

    def _answers(self, tick: int) -> None:
        """Nobody has to answer."""

    def _inbox(self, seen: Observation, due: Counter[bytes]) -> None:
        if not self.scenario.is_direct:
            super()._inbox(seen, due)
            return
        assert seen.inbox == ()
        poses = [decode_pose(packet, self.run) for packet in due.elements()]
        if seen.admitted is not None and seen.admitted:
            assert Counter(seen.admitted) == Counter((p.robot, p.sequence) for p in poses)
        else:
            assert not poses or has_perfect_channel(self.arena)

    def _command(self, command: Command) -> None:
        """Who is lost is planned with only by one that has passed over its return, or heard it."""
        if command.mode == CommandMode.STOP:
            return
        lost = self.observations[command.tick, command.robot].lost
        for peer in set(command.team) & set(lost):
            reported = min(
                tick
                for (tick, to), seen in self.observations.items()
                if to == command.robot and peer in seen.lost
            )
            assert self.last_sent.get(peer, -1) >= reported, f"{command.robot} plans with {peer}"


def _sequence(packet: bytes, run: str) -> int:
    return decode_pose(packet, run).sequence
