"""The digest of a run: what it covers and what it does not; and that the counters add up."""

import random
from collections import Counter

import msgpack
import pytest
from helpers_world import RUN, answers, arena, begun, command, played, pose, small
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.protocol.codec import decode, encode
from encircle.protocol.keys import robot_key
from encircle.protocol.messages import Observation, Pose, Radio, State
from encircle.world.arena import engine
from encircle.world.channel.channel import CAUSES
from encircle.world.coordinator.world_core import WorldCore

LIVELY = (
    "target.behaviour=flee",
    "channel.delay={model='uniform', low_s=0.0, high_s=0.5}",
    "channel.loss={model='bernoulli', rate=0.3}",
)
PLAIN = played(arena(*LIVELY)).rounds.result()


def test_the_same_run_has_the_same_digest_recorded_or_not_whatever_it_is_called():
    assert played(arena(*LIVELY)).rounds.result() == PLAIN
    assert played(arena(*LIVELY), record=lambda *_: None).rounds.result() == PLAIN
    for name in ("x", "z" * 31):
        assert played(arena(*LIVELY), name).rounds.result() == PLAIN


def test_the_runs_name_takes_no_time_to_send():
    # Thirty bytes more than the hundred or so of a packet would fill the queue much sooner.
    limit = "channel.rate_limit={bytes_per_s=900, queue_packets_max=2}"
    results = [played(arena(*LIVELY, limit), name).rounds.result() for name in ("x", "z" * 31)]
    assert results[0] == results[1]
    assert results[0].packets_lost["queue-full"] > 0


def test_the_runs_name_does_not_show_if_robots_put_their_fields_in_another_order():
    # As a robot in another language may; decoding asks for no order.
    digests = set()
    for name in ("a", "another"):
        core = begun(WorldCore(arena("ticks_max=2"), name))
        while core.ended is None:
            for where, payload in answers(core):
                fields = reversed(msgpack.unpackb(payload).items())
                core.receive(where, msgpack.packb(dict(fields)))
        assert core.rounds.result().refused == {}
        digests.add(core.rounds.result().digest)
    assert len(digests) == 1


@settings(deadline=None, derandomize=True, max_examples=25)
@given(seed=st.integers(0, 2**32))
def test_neither_the_order_of_joining_nor_of_answering_shows_in_the_digest(seed):
    shuffle = random.Random(seed).shuffle
    core = WorldCore(arena(*LIVELY), RUN)
    ids = list(core.arena.ids)
    shuffle(ids)
    for robot in ids:
        core.join(robot)
    core.begin()
    while core.ended is None:
        sent = answers(core)
        shuffle(sent)
        for where, payload in sent:
            core.receive(where, payload)
    assert core.rounds.result() == PLAIN


def test_when_it_is_settled_does_not_show_in_the_digest():
    core = begun(WorldCore(arena(*LIVELY), RUN))
    while core.ended is None:
        for where, payload in answers(core):
            core.receive(where, payload)
            core.rounds.commit()
        core.rounds.result()
    assert core.rounds.result() == PLAIN


def test_what_strangers_sent_to_the_robots_does_not_show_in_the_digest():
    core = begun(WorldCore(arena(*LIVELY), RUN))
    while core.ended is None:
        for where, payload in answers(core, refused={"malformed": core.state.tick + 3}):
            core.receive(where, payload)
    assert core.rounds.result() == PLAIN


@pytest.mark.parametrize("change", ["title='Another'", "description='About it'"])
def test_words_about_a_scenario_do_not_show_in_the_digest(change):
    assert played(arena(*LIVELY, change)).rounds.result().digest == PLAIN.digest


@pytest.mark.parametrize(
    "change",
    [
        "seed=2",
        "tick_s=0.2",
        "ticks_max=9",
        "team.radius_m=0.51",
        "team.step_m_max=0.31",
        "team.sensing_range_m=6.5",
        "team.motion=unicycle",
        "team.strategy=xi-3",
        "team.positions.2.1=0.25",
        "target.behaviour=gap",
        "target.parameters.obstacle_range_m=1.6",
        "target.step_m_max=0.21",
        "target.position=[0.25, 0.0]",
        "target.heading_rad=0.1",
        "robot.xi_weight=0.06",
        "sensing.noise_m_std=0.1",
        "sensing.rays=25",
        "obstacles=[{position=[9.0, 9.0], radius_m=1.0}]",
        "events=[{kind='move-target', tick=5, position=[1.0, 1.0]}]",
        "events=[{kind='silence', tick=5, ticks=1, robot='r1'}]",
        "channel.loss.rate=0.31",
        "channel.delay.high_s=0.6",
        "channel.order=kept",
        "channel.links=[{sender='r1', delay={mean_s=0.3}}]",
        "channel.duplication.rate=0.1",
        "channel.rate_limit.packets_per_s=30.0",
        "channel.loss={model='trace', values=[0, 1]}",
        "channel.loss={model='burst', rate=0.3, burst_packets=1.5}",
        "events=[{kind='outage', tick=5, ticks=1}]",
        "events=[{kind='partition', tick=5, ticks=1, groups=[['r1'], ['r2']]}]",
        "team.jitter_m=0.001",
        "team.robots.r2.step_m_max=0.31",
        "team.robots.r2.sensing_range_m=6.5",
        "team.robots.r2.radio_range_m=90.0",
        "team.robots.r2.loss_rate=0.01",
        "team.robots.r2.strategy=xi-3",
        "sensing.localisation_noise_m_std=0.001",
        "sensing.localisation_drift_m_per_sqrt_s=0.001",
        "capture.stop_distance_m=1.4",
        "capture.count=2",
    ],
)
def test_everything_else_in_a_scenario_shows_in_the_digest(change):
    assert played(arena(*LIVELY, change)).rounds.result().digest != PLAIN.digest


def disturbed(at, robot, **changes):
    """The digest of a run in which one robot says something else at one tick."""
    core = begun(WorldCore(arena(*LIVELY), RUN))
    while core.ended is None:
        tick = core.state.tick
        sent = dict(answers(core))
        if tick == at:
            for channel, message in (("pose", pose), ("command", command)):
                where = robot_key(RUN, robot, channel)
                kind = type(message(robot, tick))
                said = decode(kind, sent[where], RUN)
                # A pose's estimate is no point, as that of a command is: it would be refused.
                own = set(kind.__slots__) - ({"estimate"} if kind is Pose else set())
                known = {n: v for n, v in changes.items() if n in own}
                fields = {n: getattr(said, n) for n in kind.__slots__} | known
                sent[where] = encode(kind(**fields), RUN)
        for where, payload in sent.items():
            core.receive(where, payload)
        assert core.ended or core.state.tick == tick + 1, f"refused: {core.rounds.refused}"
    return core.rounds.result().digest


@pytest.mark.parametrize(
    "changes",
    [
        {"step": (0.1, 0.1)},
        {"goal": (1.0, 1.0)},
        {"estimate": (1.0, 1.0)},
        {"mode": "other"},
        {"xi": 2.0},
        {"velocity": (0.1, 0.0)},
        {"detection": (0.0, 0.0)},
        {"team": ("r1",)},
        {"say": {"bid": 1}},
    ],
)
@pytest.mark.parametrize(("tick", "robot"), [(0, "r1"), (9, "r4")])
def test_every_word_that_a_robot_says_shows_in_the_digest(tick, robot, changes):
    assert disturbed(tick, robot) == PLAIN.digest
    assert disturbed(tick, robot, **changes) != PLAIN.digest


def nudged(after, fates):
    positions = after.positions.copy()
    positions[4, 0] += 2.0**-20
    return after._replace(positions=positions), fates


def delayed(after, fates):
    due = fates.due.copy()
    due[0, 1] += 1
    return after, fates._replace(due=due)


@pytest.mark.parametrize("change", [nudged, delayed])
@pytest.mark.parametrize("tick", [1, 10])
def test_the_truth_at_every_tick_and_every_packets_fate_show_in_the_digest(
    monkeypatch, tick, change
):
    advance = engine.advance

    def changed(*arguments):
        after, fates = advance(*arguments)
        return change(after, fates) if after.tick == tick else (after, fates)

    monkeypatch.setattr(engine, "advance", changed)
    assert played(arena(*LIVELY)).rounds.result().digest != PLAIN.digest


@pytest.mark.parametrize(
    "changes",
    [
        LIVELY,
        (*LIVELY, "channel.order=kept"),
        ("channel.loss={model='bernoulli', rate=1.0}",),
        ("channel.delay.mean_s=5.0",),
        (),
        ("events=[{kind='silence', tick=2, ticks=3, robot='r1'}]",),
        ("channel.loss={model='gilbert-elliott', good_to_bad=0.4, bad_to_good=0.4}",),
        (*LIVELY, "channel.duplication.rate=0.4"),
        (*LIVELY, "channel.duplication.rate=1.0", "channel.order=kept"),
        (*LIVELY, "channel.rate_limit={packets_per_s=7, queue_packets_max=1}"),
        ("channel.loss={model='distance', midpoint_m=5, width_m=1, cutoff_m=7}",),
        ("channel.loss={model='path-loss', range_m=7, coherence_s=0.3, shadowing_db=4}",),
        (*LIVELY, "channel.contention={packet_s=0.01, range_m=8}"),
    ],
)
def test_packets_sent_are_delivered_or_lost_by_cause_or_in_flight_as_the_record_says(changes):
    scenario = small("ticks_max=25", *changes)
    record = []
    core = played(engine.build(scenario, 1), RUN, lambda *message: record.append(message))
    result = core.rounds.result()
    lost, delivered, due_at_the_end, flying, copied = Counter(), 0, 0, 0, 0
    for _, where, payload in record:
        if where.endswith("/radio"):
            radio = decode(Radio, payload, RUN)
            for sender, row in enumerate(radio.fates):
                for receiver, fate in enumerate(row):
                    if fate < 0:
                        lost[CAUSES[-fate]] += 1
                    elif sender != receiver:
                        delivered += fate <= result.ticks
                        due_at_the_end += fate == result.ticks
                        flying += fate > result.ticks
            for due in (due for row in radio.copies for due in row if due > 0):
                copied += 1
                delivered += due <= result.ticks
                due_at_the_end += due == result.ticks
                flying += due > result.ticks
    assert result.packets_lost == dict(lost)
    assert result.packets_copied == copied
    assert (copied > 0) == any("duplication" in change for change in changes)
    assert (result.packets_delivered, result.packets_in_flight) == (delivered, flying)
    assert result.packets_sent == 25 * 12 == delivered + flying + sum(lost.values()) - copied
    # What is due at the last tick has arrived, but no robot is asked to read it any more.
    read = sum(
        len(decode(Observation, payload, RUN).inbox)
        for _, where, payload in record
        if where.endswith("/observation")
    )
    assert read == delivered - due_at_the_end


def test_contacts_are_counted_and_named_in_the_record():
    near = {"positions": [[1.2, 0.0], [-1.2, 0.0], [0.0, 5.0]]}
    record = []
    core = begun(
        WorldCore(arena("ticks_max=3", team=near), RUN, record=lambda *m: record.append(m))
    )
    while core.ended is None:
        tick = core.state.tick
        for robot, step in (("r1", (-0.3, 0.0)), ("r2", (0.3, 0.0)), ("r3", (0.0, 0.3))):
            core.receive(robot_key(RUN, robot, "pose"), encode(pose(robot, tick), RUN))
            asked = encode(command(robot, tick, step), RUN)
            core.receive(robot_key(RUN, robot, "command"), asked)
    assert core.rounds.result().contacts == 6
    states = [decode(State, p, RUN) for _, where, p in record if where.endswith("/state")]
    assert [s.tick for s in states] == [0, 1, 2, 3]
    assert states[0].contacts == ()
    assert all(s.contacts == (("r1", "target"), ("r2", "target")) for s in states[1:])
