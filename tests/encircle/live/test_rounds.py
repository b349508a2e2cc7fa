"""Messages of a hunt in any order, some twice and some not at all, put into rounds.

The oracle is the recording of the same hunt: its messages in its order.
"""

import random

import pytest
from helpers_hunt import LONG

import encircle
from encircle.live.rounds import ROUNDS_KEPT_MAX, ROUNDS_WAITED_MAX, RoundCollector
from encircle.protocol.codec import encode
from encircle.protocol.keys import robot_key, world_key
from encircle.protocol.messages import End, State
from encircle.world.recording.recording import read_recording

LOSSY = {"channel": {"loss": {"model": "bernoulli", "rate": 0.4}}, "ticks_max": 60}
CRASH = ({"kind": "crash", "robot": "r2", "tick": 10, "ticks": 15},)
ROBOTS = ("r1", "r2", "r3", "r4")


@pytest.fixture(scope="module", params=["plain", "crash", "by hand"])
def recording(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("recorded") / "run"
    events = list(CRASH) if request.param == "crash" else []
    interventions = encircle.Interventions()
    for rate in (0.1, 0.9, 0.1) if request.param == "by hand" else ():
        interventions.give({"kind": "loss", "rate": rate})
    encircle.run(
        LONG | LOSSY | {"events": events},
        link="memory",
        out=folder,
        interventions=interventions,
    )
    return read_recording(folder)


def collector_of(recording, by_clock=False):
    ids = recording.scenario.ids
    return RoundCollector(recording.run, ids, recording.scenario.ticks_max, by_clock)


def heard(recording):
    """All messages with their ticks and keys, as a viewer hears them."""
    return [
        (tick, f"encircle/{recording.run}/{topic}", payload)
        for tick, topic, payload in recording.messages
    ]


def told_once(messages):
    """Without the end of the run as all but the first are told of it."""
    return {m for m in messages if not m[1].endswith("/end")}


def rounds_of(collector, messages):
    found = [r for _, key, payload in messages for r in collector.take(key, payload)]
    return [*found, *collector.flush()]


def by_round(recording):
    """The recording's messages, each tick's as a set."""
    expected = {}
    for message in recording.messages:
        expected.setdefault(message[0], set()).add(message)
    return {tick: told_once(messages) for tick, messages in expected.items()}


def test_a_hunt_heard_in_order_is_its_recording(recording):
    collector = collector_of(recording)
    found = rounds_of(collector, heard(recording))
    assert {r.tick: told_once(r.messages) for r in found} == by_round(recording)
    assert [r.tick for r in found] == sorted(by_round(recording))
    assert all(r.whole for r in found)
    assert (collector.missed_ticks, collector.refused) == (0, 0)


SHUFFLES = pytest.mark.parametrize(("seed", "spread"), [(k, 1 + k % 3) for k in range(12)])


@SHUFFLES
def test_so_is_one_heard_in_another_order_and_twice(recording, seed, spread):
    draws = random.Random(seed)
    first = [m for m in heard(recording) if m[0] == 0 and m[1].endswith("/setup")]
    shuffled = sorted(
        [*heard(recording), *draws.sample(heard(recording), 20)],
        key=lambda message: message[0] + draws.uniform(0, spread),
    )
    shuffled = [*first, *shuffled]
    collector = collector_of(recording)
    found = rounds_of(collector, shuffled)
    assert {r.tick: told_once(r.messages) for r in found} == by_round(recording)
    assert collector.missed_ticks == 0


def test_a_message_that_does_not_come_is_waited_for_and_then_missed(recording):
    missing = (7, f"encircle/{recording.run}/robots/r1/command")
    messages = [message for message in heard(recording) if message[:2] != missing]
    collector, given_on = collector_of(recording), {}
    for tick, key, payload in messages:
        for found in collector.take(key, payload):
            given_on[found.tick] = tick
    assert given_on[7] == 7 + ROUNDS_WAITED_MAX
    assert collector.missed_ticks == 1
    found = rounds_of(collector_of(recording), messages)
    assert [r.tick for r in found if not r.whole] == [7]


@pytest.mark.parametrize("length", [1, 3, 30])
def test_ticks_that_do_not_come_at_all_are_missed(recording, length):
    messages = [m for m in heard(recording) if not 20 <= m[0] < 20 + length]
    collector = collector_of(recording)
    found = rounds_of(collector, messages)
    assert [r.tick for r in found] == [t for t in by_round(recording) if not 20 <= t < 20 + length]
    assert collector.missed_ticks == length


def test_who_comes_late_begins_with_the_first_whole_round(recording):
    messages = [m for m in heard(recording) if m[0] > 30]
    half_heard = [m for m in heard(recording) if m[0] == 30][5:]
    collector = collector_of(recording)
    found = rounds_of(collector, [*half_heard, *messages])
    assert [r.tick for r in found][:2] == [31, 32]
    assert all(r.whole for r in found)
    assert collector.missed_ticks == 0


def test_what_is_none_of_the_run_is_refused(recording):
    collector = collector_of(recording)
    run = recording.run
    state = next(p for _, topic, p in recording.messages if topic == "world/state")
    far = State(10**9, ((0.0, 0.0),) * 4, (0.0,) * 4, (1.0, 1.0), False, ())
    wrong = [
        ("nonsense", state),
        (world_key("other", "state"), state),
        (world_key(run, "radio"), state),
        (world_key(run, "state"), state[:-1]),
        (world_key(run, "state"), encode(far, run)),
        (robot_key(run, "r2", "end"), encode(End("r1", 3, "ticks"), run)),
        (robot_key(run, "r9", "end"), encode(End("r9", 3, "ticks"), run)),
        (robot_key(run, "r1", "alive"), b""),
    ]
    assert [rounds for key, payload in wrong for rounds in collector.take(key, payload)] == []
    assert collector.refused == len(wrong)
    assert collector.end is None


def test_what_is_kept_is_bounded(recording):
    """As where one sends commands of ticks to come."""
    collector = RoundCollector(recording.run, ROBOTS, 10**6, False)
    for tick in range(10 * ROUNDS_KEPT_MAX):
        payload = encode(End("r1", tick, "ticks"), recording.run)
        collector.take(robot_key(recording.run, "r1", "end"), payload)
    assert len(collector._open) <= ROUNDS_KEPT_MAX


def test_by_the_clock_a_round_goes_on_without_those_who_did_not_answer(recording):
    silent = f"encircle/{recording.run}/robots/r3/command"
    messages = [m for m in heard(recording) if m[1] != silent]
    collector, given_on = collector_of(recording, by_clock=True), {}
    for tick, key, payload in messages:
        for found in collector.take(key, payload):
            given_on[found.tick] = tick
    assert given_on[5] == 6
    assert collector.missed_ticks == 0
