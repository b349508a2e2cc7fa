"""Mixed teams and robots that err about where they are, in whole hunts, every way that one runs."""

import numpy as np
import pytest

from encircle.measures.belief import peer_error_m_mean
from encircle.protocol.codec import decode
from encircle.protocol.messages import QUANTUM_M, Observation, Pose, Setup, State
from encircle.replay.replaying import replay
from encircle.runlog.recorded_log import log_of_recording
from encircle.runlog.runlog import RunLogCollector
from encircle.runner.hunts import resume, run
from encircle.runner.memory import run_in_memory
from encircle.world.arena.engine import build
from encircle.world.loading.load import load
from encircle.world.recording.recording import read_recording
from encircle.world.scenario.errors import ScenarioError

MIXED = [
    "ticks_max=60",
    "target.step_m_max=0.6",
    "team.robots.r1={step_m_max=0.1, sensing_range_m=3.0}",
    "team.robots.r2.strategy=pursuit",
    "team.robots.r3={radio_range_m=8.0, loss_rate=0.3}",
    "channel.delay={model='gamma', mean_s=0.2, std_s=0.2}",
]
LOST = ["sensing.localisation_noise_m_std=0.1", "sensing.localisation_drift_m_per_sqrt_s=0.2"]
BOTH = [*MIXED, *LOST, "sensing.noise_m_std=0.05"]


@pytest.fixture(scope="module")
def mixed(tmp_path_factory):
    out = tmp_path_factory.mktemp("mixed") / "run"
    return run("sim1", link="memory", out=out, overrides=BOTH), out


def messages(recording, kind, channel):
    """All messages of a kind, each with its robot."""
    return [
        decode(kind, payload, recording.run)
        for _, topic, payload in recording.messages
        if topic.endswith(channel)
    ]


def test_it_is_the_same_hunt_over_zenoh(mixed, tmp_path):
    over = run("sim1", link="zenoh", out=tmp_path / "run", overrides=BOTH)
    assert over.digest == mixed[0].digest
    assert replay(tmp_path / "run").same


def test_it_is_replayed_and_goes_on_where_it_broke_off(mixed, tmp_path):
    hunt, out = mixed
    assert replay(out).same
    whole = (out / "recording.mcap").read_bytes()
    for share in (0.2, 0.7):
        into = tmp_path / f"cut-{share}"
        into.mkdir()
        (into / "recording.mcap").write_bytes(whole[: int(share * len(whole))])
        assert resume(into, link="memory").digest == hunt.digest
        assert read_recording(into).messages == read_recording(out).messages


def test_each_robot_is_set_up_as_itself(mixed):
    setups = messages(read_recording(mixed[1]), Setup, "/setup")
    own = {s.robot: (s.strategy, s.parameters["step_m_max"]) for s in setups}
    assert own == {
        "r1": ("xi-star", 0.1),
        "r2": ("pursuit", 0.3),
        "r3": ("xi-star", 0.3),
        "r4": ("xi-star", 0.3),
    }
    assert [s.parameters["sensing_range_m"] for s in setups] == [3.0, 6.0, 6.0, 6.0]


def test_the_modes_and_steps_are_each_robots_own(mixed):
    log = log_of_recording(read_recording(mixed[1]))
    assert "pursue" in set(log.modes[:, 1])
    assert not {"encircle", "shrink"} & set(log.modes[:, 1])
    assert "pursue" not in set(log.modes[:, [0, 2, 3]].ravel())
    moved = np.hypot(*np.moveaxis(np.diff(log.robots, axis=0), -1, 0))
    assert moved[:, 0].max() <= 0.1 + 1e-4 < moved[:, 3].max()


def test_what_robots_tell_of_positions_is_off_by_their_error_and_the_truth_is_not(mixed):
    """The oracle is the recorded truth: what is told less what is true is one error per robot."""
    recording = read_recording(mixed[1])
    truth = {state.tick: state for state in messages(recording, State, "/state")}
    observed = {(o.robot, o.tick): o for o in messages(recording, Observation, "/observation")}
    poses = messages(recording, Pose, "/pose")
    errors = []
    for pose in poses:
        own = int(pose.robot[1:]) - 1
        seen = observed[pose.robot, pose.tick]
        error = np.subtract(pose.position, truth[pose.tick].robots[own])
        assert pose.position == seen.position
        assert pose.detection == seen.target
        for robot, x, y in seen.seen:
            off = np.subtract((x, y), truth[pose.tick].robots[int(robot[1:]) - 1])
            assert off.tolist() == error.tolist()
        errors.append((pose.tick, *error))
    assert len(poses) == 4 * 60
    early, late = (np.array([e[1:] for e in errors if low <= e[0] < low + 15]) for low in (0, 45))
    # After 5.25 s on average the variance is 0.1^2 + 0.2^2 * 5.25, after 0.75 s it is a fifth.
    assert 0.3 < np.sqrt((late**2).mean()) < 0.8
    assert (early**2).mean() < (late**2).mean() / 2


def log_in_memory(overrides):
    scenario, collector = load("sim1", overrides), RunLogCollector()
    run_in_memory(build(scenario, 1), "tested", lambda line: None, observer=collector)
    return collector.log()


def test_what_is_believed_of_peers_is_measured_against_the_truth():
    """Robots that hardly move are where they say, but for the error of what they say."""
    still = ["ticks_max=300", "team.step_m_max=0.001", "team.sensing_range_m=1.0"]
    still += ["target.behaviour=still", "target.position=[90, 90]", "robot.peer_policy=hold"]
    exact = log_in_memory(still)
    off = log_in_memory([*still, "sensing.localisation_noise_m_std=0.2"])
    assert peer_error_m_mean(exact) < 0.003
    # A distance with independent normal errors along both axes is Rayleigh's: std sqrt(pi / 2).
    assert peer_error_m_mean(off) == pytest.approx(0.2 * np.sqrt(np.pi / 2), rel=0.05)
    assert peer_error_m_mean(off) > 50 * peer_error_m_mean(exact)


def test_errors_of_localisation_cost_no_packet_and_change_no_fate():
    """Fates are of seed, link and sequence; what is in a packet does not count."""
    channel = ["channel.loss={model='burst', rate=0.4, burst_packets=3}", "ticks_max=50"]
    common = [*channel, "channel.delay={model='uniform', low_s=0, high_s=0.5}"]
    common += ["target.step_m_max=0.6"]
    exact, off = log_in_memory(common), log_in_memory([*common, *LOST])
    ticks = min(exact.ticks, off.ticks)
    assert ticks > 20
    assert (exact.due[:ticks] == off.due[:ticks]).all()
    assert (exact.robots[:ticks] != off.robots[:ticks]).any()


WALKERS = """
from typing import Annotated

from encircle.agents.policies.interface import Decision
from encircle.protocol.parameters import Meaning, Range, Unit


def east(
    memory,
    view,
    *,
    length_m: Annotated[float, Range(0.0, 1.0), Unit("m"), Meaning("Its step.")] = 0.01,
    turns: Annotated[int, Range(0, 9), Meaning("Quarter turns.")] = 0,
):
    x, y = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[turns % 4]
    return memory, Decision("walk", (length_m * x, length_m * y), view.position)
"""


def test_own_parameters_of_a_policy_are_the_teams_with_a_robots_own_in_place(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "walkers.py").write_text(WALKERS)
    overrides = [
        *("ticks_max=4", "team.strategy=walkers.py:east", "team.sensing_range_m=90"),
        "team.policy_parameters.length_m=0.2",
        "team.robots.r2.policy_parameters={length_m=0.1, turns=1}",
        "team.robots.r3.policy_parameters.turns=2",
        "team.robots.r4.strategy=pursuit",
    ]
    log = log_in_memory(overrides)
    assert log.modes[3].tolist() == ["walk", "walk", "walk", "pursue"]
    expected = [[0.2, 0.0], [0.0, 0.1], [-0.2, 0.0]]
    np.testing.assert_allclose(log.steps[3, :3], expected, atol=QUANTUM_M)
    over, inside = (run("sim1", link=k, overrides=overrides) for k in ("zenoh", "memory"))
    assert over.digest == inside.digest


@pytest.mark.parametrize(
    ("own", "line"),
    [
        ("r2.policy_parameters.length_m=2", "team.robots.r2.policy_parameters.length_m = 2: must"),
        ("r2.policy_parameters.length=1", "team.robots.r2.policy_parameters.length = 1: unknown"),
        ("r2={strategy='xi-0', policy_parameters={turns=1}}", "policy_parameters.turns = 1: "),
    ],
)
def test_own_parameters_that_a_robots_policy_does_not_take_are_refused(
    own, line, tmp_path, monkeypatch
):
    (tmp_path / "walkers.py").write_text(WALKERS)
    monkeypatch.setenv("ENCIRCLE_POLICIES", str(tmp_path))
    with pytest.raises(ScenarioError) as caught:
        load("sim1", ["team.strategy=walkers.py:east", f"team.robots.{own}"])
    assert str(caught.value).count("\n") == 1
    assert line in str(caught.value)
