"""What policies say goes through the radio: all that is heard was said, by whom and when it says.

``speaker`` says its name, the tick, how often it has spoken and some ballast, and remembers all
that it hears. What it should hear is read off the recording: who said what, and the radio's record
of which packet is delivered to whom at which tick. Rate limits are held against a queue worked out
packet by packet.
"""

from math import ceil

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import encircle
from encircle.protocol.codec import decode
from encircle.protocol.messages import Observation, Pose, Radio
from encircle.protocol.plugin_files import FOLDERS
from encircle.protocol.plugins import PluginFailed
from encircle.replay.replaying import replay
from encircle.runner.memory import run_in_memory
from encircle.world.arena.engine import build
from encircle.world.channel.loss_causes import CAUSES
from encircle.world.loading.load import load

POLICY = '''
from encircle import Decision
from encircle.agents.policies.paper import xi_star


def speaker(memory, view, *, ballast: int = 0, first: int = 0):
    """Counts what it says from ``first`` on, and remembers what it hears."""
    count, heard = memory or (first, ())
    heard += tuple((view.tick, p.robot, p.tick, p.sequence, p.say) for p in view.heard)
    say = {"by": view.robot, "tick": view.tick, "count": count, "ballast": b"x" * ballast}
    return (count + 1, heard), xi_star(None, view)[1]._replace(say=say)


def silent(memory, view):
    return memory, xi_star(None, view)[1]
'''
RUN = "radio"
TICKS = 40
QUEUE_FULL = next(code for code, cause in CAUSES.items() if cause == "queue-full")
SETTINGS = settings(
    deadline=None,
    derandomize=True,
    max_examples=40,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
LOSSES = st.one_of(
    st.builds(lambda rate: {"model": "bernoulli", "rate": rate}, st.sampled_from([0.0, 0.2, 0.7])),
    st.just({"model": "gilbert-elliott", "good_to_bad": 0.2, "bad_to_good": 0.3}),
)
DELAYS = st.one_of(
    st.just({"model": "constant", "mean_s": 0.25}),
    st.just({"model": "uniform", "low_s": 0.0, "high_s": 0.9}),
    st.just({"model": "gamma", "mean_s": 0.3, "std_s": 0.3}),
)
RATES = st.sampled_from(
    [{"bytes_per_s": 1500.0}, {"packets_per_s": 7.0, "bytes_per_s": 4000.0, "queue_packets_max": 2}]
)
CHANNELS = st.fixed_dictionaries(
    {},
    optional={
        "loss": LOSSES,
        "delay": DELAYS,
        "duplication": st.just({"rate": 0.4}),
        "rate_limit": RATES,
        "order": st.sampled_from(["kept", "free"]),
    },
)
ROBOTS = st.fixed_dictionaries(
    {},
    optional={
        "publish_every_ticks": st.sampled_from([1, 3]),
        "publish": st.just("event"),
        "detections": st.just("relay"),
    },
)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv(FOLDERS, str(tmp_path))
    (tmp_path / "talk.py").write_text(POLICY)
    return tmp_path


def scenario(channel, robot=None, seed=1, function="speaker", **own):
    tree = {
        "ticks_max": TICKS,
        "seed": seed,
        "team": {"robots": 4, "strategy": f"talk.py:{function}"},
        "target": {"behaviour": "flee", "step_m_max": 0.3},
        "channel": channel,
        "robot": robot or {},
    }
    if own:
        tree["team"]["policy_parameters"] = own
    return load(tree)


class Hunt:
    """A hunt in memory: what was said and heard, and what the radio did."""

    def __init__(self, given):
        self.memories, self.messages = {}, []
        self.ids = given.ids
        record = lambda tick, key, payload: self.messages.append((tick, key, payload))  # noqa: E731
        self.result = run_in_memory(build(given, given.seed), RUN, print, record, observer=self)
        self.sent = {
            (pose.robot, pose.tick): (pose, len(payload) - len(RUN))
            for pose, payload in self.of(Pose)
        }
        self.radio = {radio.tick: radio for radio, _ in self.of(Radio)}

    def of(self, kind):
        channel = kind.__name__.lower()
        found = [payload for _, key, payload in self.messages if key.endswith(f"/{channel}")]
        return [(decode(kind, payload, RUN), payload) for payload in found]

    def decided(self, world, robots, answers):
        for robot in robots:
            self.memories[robot.robot] = robot.state.memory

    def ended(self, world):
        pass

    def expected_of(self, receiver):
        """What a robot should hear, from the radio's record and from what was said."""
        index, last = self.ids.index(receiver), max(self.radio)
        expected = []
        for tick, radio in self.radio.items():
            for table in (radio.fates, radio.copies):
                for sender, row in zip(self.ids, table, strict=False):
                    if 0 < row[index] <= last:
                        pose = self.sent[sender, tick][0]
                        expected.append((row[index], sender, tick, pose.sequence, pose.say))
        return expected


def ordered(heard):
    return sorted(heard, key=lambda entry: entry[:4])


@SETTINGS
@given(CHANNELS, ROBOTS, st.integers(0, 2**31))
def test_all_that_is_heard_was_said_at_its_tick_and_comes_when_the_radio_says(channel, robot, seed):
    hunt = Hunt(scenario(channel, robot, seed, ballast=seed % 500))
    for receiver in hunt.ids:
        count, heard = hunt.memories[receiver]
        assert count == len(hunt.radio)
        assert ordered(heard) == ordered(hunt.expected_of(receiver))
        for heard_tick, sender, tick, _, say in heard:
            assert sender != receiver
            assert tick < heard_tick
            # It counts from 0 and speaks at every tick, whether that is published or not.
            ballast = b"x" * (seed % 500)
            assert say == {"by": sender, "tick": tick, "count": tick, "ballast": ballast}
        # By tick, sender and sequence within one tick.
        assert [entry[:4] for entry in heard] == sorted(
            (entry[:4] for entry in heard), key=lambda e: (e[0], e[2], hunt.ids.index(e[1]), e[3])
        )


def test_such_channels_lose_delay_overtake_and_copy(folder):
    channel = {
        "loss": {"model": "bernoulli", "rate": 0.2},
        "delay": {"model": "uniform", "low_s": 0.0, "high_s": 0.9},
        "duplication": {"rate": 0.4},
    }
    hunt = Hunt(scenario(channel))
    heard = [entry for _, memory in hunt.memories.values() for entry in memory]
    by_way = {}
    for receiver, (_, memory) in hunt.memories.items():
        for heard_tick, sender, tick, _, _ in memory:
            by_way.setdefault((sender, receiver), []).append((heard_tick, tick))
    ticks = [[tick for _, tick in entries] for entries in by_way.values()]
    assert any(each != sorted(each) for each in ticks)
    assert any(len(set(each)) < len(each) for each in ticks)
    assert 0.5 * 12 * TICKS < len(heard) < 1.4 * 12 * TICKS
    assert max(heard_tick - tick for heard_tick, _, tick, _, _ in heard) == 9


def queue_of(sizes_bytes, bytes_per_s, waiting_max, tick_s=0.1):
    """By tick, when a packet has left a transmitter in ticks, None if it found no room."""
    leaving, waiting = {}, []
    for tick, size in sorted(sizes_bytes.items()):
        waiting = [left for left in waiting if left > tick + 1e-9]
        if len(waiting) > waiting_max:
            leaving[tick] = None
            continue
        begins = max([tick, *waiting])
        waiting.append(begins + size / (bytes_per_s * tick_s))
        leaving[tick] = waiting[-1]
    return leaving


@pytest.mark.parametrize("ballast", [0, 100, 400, 900])
@pytest.mark.parametrize(("bytes_per_s", "waiting_max"), [(2000.0, 3), (3511.0, 0), (9000.0, 1)])
def test_its_bytes_count_for_the_rate_limit(bytes_per_s, waiting_max, ballast):
    limit = {"bytes_per_s": bytes_per_s, "queue_packets_max": waiting_max}
    hunt = Hunt(scenario({"rate_limit": limit}, ballast=ballast))
    for index, sender in enumerate(hunt.ids):
        sizes = {tick: size for (robot, tick), (_, size) in hunt.sent.items() if robot == sender}
        for tick, left in queue_of(sizes, bytes_per_s, waiting_max).items():
            fates = [f for k, f in enumerate(hunt.radio[tick].fates[index]) if k != index]
            due = -QUEUE_FULL if left is None else max(tick + 1, ceil(left - 1e-6))
            assert fates == [due] * 3, (sender, tick)


def test_who_says_more_is_throttled_more():
    channel = {"rate_limit": {"bytes_per_s": 2000.0, "queue_packets_max": 2}}
    hunts = [Hunt(scenario(channel, ballast=ballast)) for ballast in (0, 300, 900)]
    hunts.insert(0, Hunt(scenario(channel, function="silent")))
    counts = [hunt.result.packets_delivered for hunt in hunts]
    assert counts == sorted(set(counts), reverse=True)
    sizes = [{size for _, size in hunt.sent.values()} for hunt in hunts]
    assert max(sizes[0]) < min(sizes[1]) <= max(sizes[1]) < min(sizes[2])
    # What nobody says takes no bytes.
    assert all(pose.say == {} for pose, _ in hunts[0].sent.values())


BAD = {
    "loss": {"model": "gilbert-elliott", "good_to_bad": 0.1, "bad_to_good": 0.3},
    "delay": {"model": "gamma", "mean_s": 0.3, "std_s": 0.2},
    "duplication": {"rate": 0.3},
    "rate_limit": {"bytes_per_s": 5000.0},
}


def test_it_is_replayed_resumed_and_over_zenoh_the_same(folder):
    given = scenario(BAD, ballast=40)
    memory = encircle.run(given, link="memory", out=folder / "memory")
    over_zenoh = encircle.run(given, out=folder / "zenoh")
    assert over_zenoh.digest == memory.digest
    assert replay(folder / "zenoh").same
    whole = (folder / "memory" / "recording.mcap").read_bytes()
    for share in (0.3, 0.9):
        broken = folder / f"broken-{share}"
        broken.mkdir()
        (broken / "recording.mcap").write_bytes(whole[: int(share * len(whole))])
        assert encircle.resume(broken, link="memory").digest == memory.digest
        assert replay(broken).same


def test_a_run_in_which_something_else_is_said_is_another_run():
    """The robots do the same all the time: what is said shows in the digest, and only there."""
    hunts = [Hunt(scenario({}, first=first)) for first in (0, 0, 1)]
    digests = [hunt.result.digest for hunt in hunts]
    assert digests[0] == digests[1] != digests[2]
    silent = Hunt(scenario({}, function="silent"))
    assert silent.result.digest not in digests
    states = [
        [payload for _, key, payload in hunt.messages if key.endswith(("/state", "/command"))]
        for hunt in (*hunts, silent)
    ]
    assert states[0] == states[1] == states[2] == states[3]


def test_a_replay_by_a_policy_that_says_something_else_is_refused_with_its_name(folder):
    given = scenario(BAD)
    encircle.run(given, link="memory", out=folder / "run")
    (folder / "talk.py").write_text(POLICY.replace('"count": count', '"count": count + 1'))
    with pytest.raises(PluginFailed, match=r"policy 'talk.py:speaker' .* its source here has SHA"):
        replay(folder / "run")


def test_nothing_of_it_is_passed_on():
    """A robot that relays repeats detections; whoever hears nobody is told nothing through it."""
    hunt = Hunt(scenario(BAD, {"detections": "relay"}))
    assert any(pose.relayed for pose, _ in hunt.sent.values())
    for (robot, tick), (pose, _) in hunt.sent.items():
        assert (pose.say["by"], pose.say["tick"]) == (robot, tick)
    seen = [observation for observation, _ in hunt.of(Observation)]
    for observation in seen:
        for packet in observation.inbox:
            pose = decode(Pose, packet, RUN)
            assert pose.say == hunt.sent[pose.robot, pose.tick][0].say
