"""A world whose robots share processes: the same run, whoever answers in envelopes or apart."""

import random

import pytest
from helpers_scenarios import scenario_of

from encircle.agents.brain.robot_core import RobotCore
from encircle.live.rounds import RoundCollector
from encircle.protocol.envelopes import (
    ANSWERS,
    ANSWERS_BYTES_MAX,
    OBSERVATIONS,
    Enclosed,
    opened,
    sealed,
)
from encircle.protocol.keys import channel_of, parse_key, robot_key
from encircle.world.arena.engine import build
from encircle.world.coordinator.membership import DepartureCause
from encircle.world.coordinator.world_core import WorldCore
from encircle.world.loading.load import load

RUN = "shared"
CHANGES = (
    "ticks_max=25",
    "target.step_m_max=0.5",
    "team.sensing_range_m=100.0",
    "channel.loss={model='bernoulli',rate=0.3}",
    "events=[{kind='crash',robot='r3',tick=8,ticks=6}]",
)


class Shared:
    """A run in memory: groups of robots whose answers go in envelopes, and robots that send apart.

    ``order``: in which the answers of processes come, by its own generator.
    """

    def __init__(self, groups, changes=CHANGES, scenario="sim1", seed=1) -> None:
        loaded = load(scenario, list(changes)) if isinstance(scenario, str) else scenario
        self.arena = build(loaded, seed)
        self.recorded: list[tuple[int, str, bytes]] = []
        record = lambda *message: self.recorded.append(message)  # noqa: E731
        self.world = WorldCore(self.arena, RUN, record=record)
        self.cores = {robot: RobotCore(robot, RUN) for robot in self.arena.ids}
        self.groups = [tuple(group) for group in groups]
        self.host = {robot: group[0] for group in self.groups for robot in group}
        self.order = random.Random(seed)
        self.kinds: set[str] = set()
        self.heard: list[tuple[str, bytes]] = []

    def deliver(self, messages):
        """Messages to robots; what their processes answer, in whatever order."""
        answers: dict[str, list[tuple[str, bytes]]] = {}
        self.heard += messages
        for key, payload in messages:
            self.kinds.add(channel_of(key))
            enclosed = channel_of(key) == OBSERVATIONS
            for inner_key, inner in (
                opened(OBSERVATIONS, payload, RUN) if enclosed else [(key, payload)]
            ):
                robot = parse_key(inner_key).robot
                said = self.cores[robot].receive(inner_key, inner)
                answers.setdefault(self.host.get(robot, robot), []).extend(said)
        sent = []
        for process, said in answers.items():
            if process in self.host:
                contents = [Enclosed(*parse_key(key)[1:], payload) for key, payload in said]
                key = robot_key(RUN, process, ANSWERS)
                sent += [(key, e) for e in sealed(contents, RUN, ANSWERS_BYTES_MAX)]
            else:
                sent += said
        self.order.shuffle(sent)
        self.heard += sent
        return sent

    def play(self, at=lambda _tick: []):
        joined = [message for robot in self.arena.ids for message in self.world.join(robot)]
        mail = joined + self.world.begin()
        while mail and self.world.ended is None:
            sent = self.deliver(mail)
            mail = [m for key, payload in sent for m in self.world.receive(key, payload)]
            mail += at(self.world.state.tick)
            self.heard += self.world.rounds.commit()
        self.heard += mail
        self.world.rounds.commit()
        return self


@pytest.fixture(scope="module")
def apart():
    return Shared([]).play()


@pytest.mark.parametrize(
    "groups",
    [
        [("r1",), ("r2",), ("r3",), ("r4",)],
        [("r1", "r2", "r3", "r4")],
        [("r2", "r4"), ("r3",)],
        [("r4", "r1", "r3")],
    ],
)
def test_digest_and_recording_are_the_same_however_robots_answer(apart, groups):
    shared = Shared(groups).play()
    assert shared.world.rounds.result() == apart.world.rounds.result()
    assert shared.recorded == apart.recorded
    assert shared.world.rounds.refused == {}
    assert (OBSERVATIONS in shared.kinds) == any(len(group) > 1 for group in groups)
    assert OBSERVATIONS not in apart.kinds


@pytest.mark.parametrize("number", range(8))
def test_of_scenarios_drawn_at_random(number):
    scenario, draw = scenario_of(number), random.Random(number)
    robots = [*scenario.ids]
    draw.shuffle(robots)
    cut = draw.randint(0, len(robots))
    shared = Shared([robots[:cut]] if cut else [], (), scenario).play()
    alone = Shared([], (), scenario).play()
    assert shared.world.rounds.result() == alone.world.rounds.result()
    assert shared.recorded == alone.recorded


def test_who_looks_on_sees_the_same(apart):
    def rounds(run):
        collector = RoundCollector(RUN, run.arena.ids, 25, by_clock=False)
        found = [one for message in run.heard for one in collector.take(*message)]
        assert collector.refused == 0
        return [one for one in [*found, *collector.flush()] if one.whole]

    apart.world.rounds.journal.publishes = True
    shared = Shared([("r1", "r2"), ("r3",)])
    shared.world.rounds.journal.publishes = True
    alone = Shared([])
    alone.world.rounds.journal.publishes = True
    seen = rounds(shared.play())
    assert len(seen) >= 24
    assert seen == rounds(alone.play())


def test_a_robot_that_is_lost_is_set_up_by_itself_and_then_shares_again():
    shared = Shared([("r1", "r2", "r4")])
    lost_at = 5

    def lose(tick):
        nonlocal lost_at
        if tick != lost_at:
            return []
        lost_at = -1
        shared.world.leave("r2", DepartureCause.GONE)
        assert "r2" not in shared.world.hosts
        return shared.world.join("r2")

    shared.play(lose)
    assert shared.world.ended == "ticks"
    assert [
        what for _, robot, what in shared.world.rounds.result().departures if robot == "r2"
    ] == [
        "lost: it is gone",
        "back",
    ]
    assert shared.world.hosts["r2"] == "r1"


def test_an_envelope_of_a_stranger_is_counted_and_leads_nobody_astray(apart):
    shared = Shared([("r1", "r2")])

    def disturb(tick):
        for payload in (b"garbage", *sealed([Enclosed("r2", "command", b"no")], RUN, 100)):
            assert shared.world.receive(robot_key(RUN, "r9", ANSWERS), payload) == []
        late = [
            Enclosed("r2", "command", p) for t, k, p in shared.recorded if k.endswith("r2/command")
        ]
        for payload in sealed(late[-1:], RUN, 100):
            assert shared.world.receive(robot_key(RUN, "r9", ANSWERS), payload) == []
        assert "r9" not in shared.world.hosts.values()
        return []

    shared.play(disturb)
    assert shared.world.rounds.journal.digest == apart.world.rounds.journal.digest
    assert shared.world.rounds.refused["malformed"] == 50
    assert shared.world.rounds.refused["out-of-turn"] >= 20
    wrong_run = robot_key("other", "r1", ANSWERS)
    shared.world.receive(wrong_run, b"")
    assert shared.world.rounds.refused["wrong-run"] == 1
