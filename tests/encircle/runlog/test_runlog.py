"""The log of a run: the same from a hunt in memory, its messages, its recording and over Zenoh."""

from collections import defaultdict
from dataclasses import fields, replace

import numpy as np
import pytest
from helpers_scenarios import scenario_of

from encircle.protocol.codec import decode, encode
from encircle.protocol.messages import QUANTUM_M, Command, Pose, Radio, State
from encircle.runlog.recorded_log import log_of_messages, log_of_recording
from encircle.runlog.runlog import RunLog, RunLogCollector
from encircle.runner.hunts import run
from encircle.runner.memory import run_in_memory
from encircle.world.arena.engine import build
from encircle.world.loading.load import load
from encircle.world.recording.recording import RecordingError, read_recording
from encircle.world.scenario.model import Scenario

NAME = "tested"
LOSS = "channel.loss={model='bernoulli', rate=0.3}"
DELAY = "channel.delay={model='uniform', low_s=0.05, high_s=0.6}"
NOISE = "sensing.noise_m_std=0.05"
BURSTS = "channel.loss={model='gilbert-elliott', good_to_bad=0.1, bad_to_good=0.2}"
CASES = [
    ("sim1", [LOSS, DELAY, NOISE]),
    ("sim2", [LOSS, NOISE, "ticks_max=60"]),
    ("sim3", [BURSTS, "robot.peer_policy=hold", "robot.peer_age_ticks_max=3", "ticks_max=60"]),
    ("sim4", ["team.strategy=pursuit", "team.motion=unicycle", "ticks_max=30"]),
    ("sim1", ["events=[{kind='silence', tick=3, ticks=9, robot='r1'}]", "ticks_max=25"]),
    ("sim1", ["team.positions=[[5.0, 0.0]]", "ticks_max=9"]),
    ("sim1", ["team.positions=[[1.1,0.0],[-1.1,0.0],[0.0,1.1],[0.0,-1.1]]"]),
]
DATA = [f.name for f in fields(RunLog) if f.init]


def hunted(scenario, changes=(), seed=2, name=NAME):
    """A hunt in memory: its scenario, messages, result, and log as collected."""
    loaded = scenario if isinstance(scenario, Scenario) else load(scenario, changes)
    messages, collector = [], RunLogCollector()
    result = run_in_memory(
        build(loaded, seed),
        name,
        lambda line: None,
        lambda *message: messages.append(message),
        observer=collector,
    )
    return loaded, messages, result, collector.log()


def assert_same(one, other, ticks=None):
    """All data equal, NaN where NaN, and of equal type; or equal for so many rounds."""
    for name in DATA:
        mine, theirs = getattr(one, name), getattr(other, name)
        if isinstance(mine, np.ndarray) and ticks is not None:
            if name == "contacts":
                theirs = theirs[theirs[:, 0] <= ticks]
            else:
                theirs = theirs[: ticks + (name == "positions")]
        if isinstance(mine, np.ndarray):
            assert mine.dtype.kind == theirs.dtype.kind, name
            assert mine.shape == theirs.shape, name
            assert np.array_equal(mine, theirs, equal_nan=mine.dtype.kind == "f"), name
        elif ticks is None:
            assert mine == theirs, name


@pytest.mark.parametrize(("scenario", "changes"), CASES)
def test_messages_give_the_log_that_was_collected(scenario, changes):
    loaded, messages, result, log = hunted(scenario, changes)
    assert_same(log_of_messages(loaded, 2, NAME, messages), log)
    assert (log.ticks, log.captured, log.ended) == (result.ticks, result.captured, result.ended)
    assert log.count == len(loaded.ids)
    assert len(log.contacts) == result.contacts


def same_log_of_a_drawn_run(seed):
    scenario, messages, _, log = hunted(scenario_of(seed), seed=seed)
    assert_same(log_of_messages(scenario, seed, NAME, messages), log)


@pytest.mark.parametrize("seed", range(6))
def test_messages_of_a_drawn_run_give_the_log_that_was_collected(seed):
    same_log_of_a_drawn_run(seed)


@pytest.mark.nightly
@pytest.mark.parametrize("seed", range(1_000, 1_200))
def test_messages_of_many_drawn_runs_give_the_log_that_was_collected(seed):
    same_log_of_a_drawn_run(seed)


def test_to_look_on_changes_nothing():
    loaded, _, result, _ = hunted("sim1", [LOSS, NOISE])
    assert run_in_memory(build(loaded, 2), NAME, lambda line: None) == result


def test_the_length_of_the_runs_name_is_not_in_the_log():
    _, _, _, log = hunted("sim1", [LOSS, "ticks_max=8"])
    _, _, _, other = hunted("sim1", [LOSS, "ticks_max=8"], name="another-name-for-it")
    assert_same(log, other)


def test_a_recorded_hunt_over_zenoh_gives_the_log_of_the_same_hunt_in_memory(tmp_path):
    changes = [LOSS, DELAY, NOISE, "ticks_max=20"]
    run("sim1", seed=2, link="zenoh", overrides=changes, out=tmp_path / "run")
    log = log_of_recording(read_recording(tmp_path / "run"))
    # The scenario as read back has its overrides written out.
    _, _, _, collected = hunted("sim1", [*changes, "seed=2"])
    assert_same(log, collected)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    path = tmp_path_factory.mktemp("recorded") / "run"
    run("sim2", link="memory", out=path, overrides=[LOSS, DELAY, NOISE])
    return path / "recording.mcap"


@pytest.mark.parametrize("share", [0.3, 0.5, 0.8, 0.9])
def test_a_recording_cut_off_gives_the_log_of_its_whole_rounds(recorded, tmp_path, share):
    whole = log_of_recording(read_recording(recorded))
    data = recorded.read_bytes()
    path = tmp_path / "cut.mcap"
    path.write_bytes(data[: int(share * len(data))])
    recording = read_recording(path)
    log = log_of_recording(recording)
    assert log.ended is None
    assert not log.captured
    assert_same(log, whole, log.ticks)
    # At most the round under way is left out.
    last = max(tick for tick, topic, _ in recording.messages if topic.endswith("observation"))
    assert 0 < last - 1 <= log.ticks <= last + 1


def test_every_cut_between_two_messages_is_one_between_two_rounds():
    loaded, messages, _, whole = hunted("sim1", [LOSS, "ticks_max=3"])
    # A round of four robots: 8 answers, the radio, the next state.
    for end in range(len(messages) + 1):
        log = log_of_messages(loaded, 2, NAME, messages[:end])
        shown = [tick for tick, topic, _ in messages[:end] if topic.endswith("/state")]
        assert log.ticks == max(shown, default=0)
        assert_same(log, whole, log.ticks)
        assert (log.ended == "ticks") == any(m[1].endswith("/end") for m in messages[:end])


def test_the_log_is_what_the_messages_say():
    loaded, messages, _, log = hunted("sim2", [LOSS, DELAY, NOISE])
    said = defaultdict(dict)
    kinds = {"state": State, "radio": Radio, "command": Command, "pose": Pose}
    for tick, key, payload in messages:
        *_, robot, channel = key.split("/")
        if channel in kinds:
            said[channel][tick, robot] = decode(kinds[channel], payload, NAME), len(payload)
    for tick in range(log.ticks):
        state, radio = said["state"][tick, "world"][0], said["radio"][tick, "world"][0]
        assert log.robots[tick].tolist() == [list(p) for p in state.robots]
        assert log.target[tick].tolist() == list(state.target)
        assert log.due[tick].tolist() == [list(row) for row in radio.fates]
        for i, robot in enumerate(loaded.ids):
            command, _ = said["command"][tick, robot]
            pose, size = said["pose"][tick, robot]
            assert log.sizes_bytes[tick, i] == size - len(NAME)
            assert log.steps[tick, i].tolist() == list(command.step)
            assert log.goals[tick, i].tolist() == list(command.goal)
            assert log.modes[tick, i] == command.mode == pose.mode
            assert (None if np.isnan(log.xi[tick, i]) else log.xi[tick, i]) == command.xi
            assert (None if log.points[tick, i] < 0 else log.points[tick, i]) == command.point
            members = [loaded.ids[k] for k in np.flatnonzero(log.members[tick, i])]
            assert members == list(command.team)
            assert log.believed[tick, i, i].tolist() == list(pose.position)
            if command.estimate is None:
                assert np.isnan([*log.estimates[tick, i], *log.covariances[tick, i]]).all()
            else:
                off = np.abs(log.estimates[tick, i, :2] - command.estimate)
                assert (off <= QUANTUM_M / 2).all()
                assert (log.covariances[tick, i, [0, 2]] > 0.0).all()


def test_what_is_believed_of_peers_out_of_sight_is_the_newest_that_came_moved_on():
    _, _, _, log = hunted("sim1", ["channel.delay={model='constant', mean_s=0.3}", "ticks_max=12"])
    robots, compared = log.robots, 0
    away = np.linalg.norm(robots[:, :, None] - robots[:, None], axis=3)
    for tick in range(4, 12):
        moved = robots[tick - 3] + 3 * (robots[tick - 3] - robots[tick - 4])
        unseen = (away[: tick + 1] > 6.0).all(axis=0)
        for i, j in np.argwhere(unseen).tolist():
            np.testing.assert_allclose(log.believed[tick, i, j], moved[j], atol=1e-9)
            compared += np.linalg.norm(moved[j] - robots[tick - 3, j]) > 0.1
    assert compared > 20
    assert np.isnan(log.believed[2, 0, 1:]).all()


def test_a_moved_target_is_known_to_have_been_moved():
    _, _, _, log = hunted("sim3", ["ticks_max=30"])
    jumps = np.linalg.norm(np.diff(log.target, axis=0), axis=1)
    assert log.moved_by_hand == (25,)
    assert np.flatnonzero(jumps > 1.0).tolist() == [24]


def changed(messages, tick, topic, change):
    return [
        (at, key, change(payload))
        if (at, key) == (tick, f"encircle/{NAME}/{topic}")
        else (at, key, payload)
        for at, key, payload in messages
    ]


def test_commands_that_are_not_those_of_this_programs_robots_are_refused():
    loaded, messages, _, _ = hunted("sim1", ["ticks_max=6"])

    def other(payload):
        return encode(replace(decode(Command, payload, NAME), mode="mine"), NAME)

    strange = changed(messages, 3, "robots/r2/command", other)
    with pytest.raises(RecordingError, match="r2 decided otherwise at tick 3"):
        log_of_messages(loaded, 2, NAME, strange)

    def refusing(payload):
        return encode(replace(decode(Command, payload, NAME), refused={"malformed": 1}), NAME)

    log_of_messages(loaded, 2, NAME, changed(messages, 3, "robots/r2/command", refusing))


def test_copies_are_read_where_there_are_any():
    loaded, messages, _, log = hunted("sim1", ["ticks_max=5"])
    copies = np.where(log.due[3] > 0, 7, 0)
    copies[2] = 0

    def copied(payload):
        radio = decode(Radio, payload, NAME)
        return encode(replace(radio, copies=tuple(map(tuple, copies.tolist()))), NAME)

    found = log_of_messages(loaded, 2, NAME, changed(messages, 3, "world/radio", copied))
    assert found.copies[3].tolist() == copies.tolist()
    assert not np.delete(found.copies, 3, axis=0).any()
    assert not log.copies.any()


@pytest.mark.parametrize("topic", ["robots/r2/command", "world/radio", "robots/r2/observation"])
def test_a_round_that_is_not_whole_ends_the_log(topic):
    loaded, messages, _, log = hunted("sim1", ["ticks_max=5"])
    tick = 4 if "observation" in topic else 3  # without it, the robot's next one is out of turn
    rest = [m for m in messages if m[:2] != (tick, f"encircle/{NAME}/{topic}")]
    found = log_of_messages(loaded, 2, NAME, rest)
    assert (found.ticks, found.ended, found.captured) == (tick, None, False)
    assert_same(found, log, tick)


@pytest.mark.parametrize(
    ("topic", "payload", "said"),
    [
        ("robots/r1/command", b"nonsense", "robots/r1/command of tick 3"),
        ("world/state", b"", "world/state of tick 3"),
        ("world/pose", b"", "world/pose of tick 3: the team is r1, r2, r3, r4"),
        ("robots/r9/pose", b"", "robots/r9/pose of tick 3: the team is r1, r2, r3, r4"),
        ("robots/r1/setup", b"", "robots/r1/setup of tick 3"),
    ],
)
def test_messages_that_cannot_be_read_are_refused_with_their_name(topic, payload, said):
    loaded, messages, _, _ = hunted("sim1", ["ticks_max=2"])
    with pytest.raises(RecordingError, match=said):
        log_of_messages(loaded, 2, NAME, [*messages, (3, topic, payload)])


def test_a_recording_of_another_scenario_is_refused():
    _, messages, _, _ = hunted("sim1", ["ticks_max=2"])
    smaller = load("sim1", ["team.positions=[[-5.0,0.5],[-3.0,-9.0],[11.0,-1.0]]"])
    with pytest.raises(RecordingError):
        log_of_messages(smaller, 2, NAME, messages)
    states = [m for m in messages if m[1].endswith("/state")]
    with pytest.raises(RecordingError, match="bodies of another scenario"):
        log_of_messages(smaller, 2, NAME, states)


def test_an_observation_out_of_turn_or_without_setup_is_refused():
    loaded, messages, _, _ = hunted("sim1", ["ticks_max=4"])
    without = [m for m in messages if not m[1].endswith("/setup")]
    with pytest.raises(RecordingError, match="before setup"):
        log_of_messages(loaded, 2, NAME, without)
    left_out = [m for m in messages if m[:2] != (1, f"encircle/{NAME}/robots/r3/observation")]
    with pytest.raises(RecordingError, match="r3/observation of tick 2"):
        log_of_messages(loaded, 2, NAME, left_out)
