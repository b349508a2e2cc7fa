"""Replay: an honest recording checks out, and one that was tampered with is found out."""

from dataclasses import replace

import pytest

from encircle.protocol.codec import decode, encode
from encircle.protocol.messages import Command, Observation, Pose
from encircle.replay.replaying import replay
from encircle.runner.hunts import run
from encircle.world.recording.recorder import Recorder
from encircle.world.recording.recording import RecordingError, read_recording

NOISY = ["channel.loss={model='bernoulli', rate=0.2}", "sensing.noise_m_std=0.05"]
KINDS = {"pose": Pose, "command": Command, "observation": Observation}


@pytest.fixture(scope="module")
def honest(tmp_path_factory):
    path = tmp_path_factory.mktemp("honest") / "run"
    run("sim2", link="memory", out=path, overrides=NOISY)
    return path


def rewritten(recording, path, change):
    """A recording with each message (tick, topic, payload) replaced by ``change``, or left out."""
    metadata = {
        "run": recording.run,
        "seed": str(recording.seed),
        "scenario": recording.scenario.model_dump_json(),
    }
    recorder = Recorder(path, recording.scenario.tick_s, metadata)
    for message in recording.messages:
        changed = change(*message)
        if changed is not None:
            tick, topic, payload = changed
            recorder.record(tick, f"encircle/{recording.run}/{topic}", payload)
    recorder.close()
    return path


def tampered(honest, path, channel, tick, robot, /, **changes):
    """The recording with fields of one message changed."""
    recording = read_recording(honest)
    hits = []

    def change(at, topic, payload):
        if (at, topic) == (tick, f"robots/{robot}/{channel}"):
            hits.append(topic)
            message = decode(KINDS[channel], payload, recording.run)
            payload = encode(replace(message, **changes), recording.run)
        return at, topic, payload

    rewritten(recording, path, change)
    assert len(hits) == 1
    return path


@pytest.mark.parametrize(
    ("scenario", "changes"),
    [
        ("sim1", []),
        ("sim2", NOISY),
        ("sim3", ["channel.delay={model='gamma', mean_s=0.3, std_s=0.3}", "ticks_max=60"]),
        ("sim4", ["team.motion=unicycle", "ticks_max=60"]),
        ("sim1", ["events=[{kind='silence', tick=3, ticks=9, robot='r1'}]", "ticks_max=60"]),
    ],
)
def test_an_honest_recording_is_the_same_to_fresh_brains(tmp_path, scenario, changes):
    hunt = run(scenario, link="memory", out=tmp_path, overrides=changes)
    check = replay(tmp_path)
    assert check.same
    assert check.complete
    assert check.differences == ()
    assert check.robots == len(hunt.scenario.ids)
    assert check.ticks == hunt.result.ticks
    assert check.compared == 2 * check.robots * hunt.result.ticks
    assert replay(tmp_path / "recording.mcap") == check


@pytest.mark.parametrize(("tick", "robot"), [(0, "r1"), (7, "r3"), (20, "r2")])
@pytest.mark.parametrize(
    ("channel", "changes"),
    [
        ("command", {"step": (0.125, -0.125)}),
        ("command", {"mode": "else"}),
        ("command", {"team": ("r2", "r9")}),
        ("command", {"estimate": (99.0, 0.0)}),
        ("pose", {"position": (50.0, 50.0)}),
        ("pose", {"velocity": (0.5, 0.5)}),
        ("pose", {"sequence": 12345}),
    ],
)
def test_a_tampered_decision_is_the_one_difference_and_is_named(
    honest, tmp_path, tick, robot, channel, changes
):
    check = replay(tampered(honest, tmp_path / "bad.mcap", channel, tick, robot, **changes))
    assert not check.same
    assert check.differences == ((tick, robot, channel),)


@pytest.mark.parametrize(("tick", "robot"), [(0, "r1"), (7, "r3"), (20, "r2")])
@pytest.mark.parametrize(
    "changes", [{"position": (50.0, 50.0)}, {"target": (1.0, 1.5)}, {"tick": 900}, {"robot": "r9"}]
)
def test_a_tampered_observation_shows_first_in_its_robot_at_its_tick(
    honest, tmp_path, tick, robot, changes
):
    check = replay(tampered(honest, tmp_path / "bad.mcap", "observation", tick, robot, **changes))
    assert not check.same
    assert check.differences[0][:2] == (tick, robot)
    assert {name for _, name, _ in check.differences} == {robot}


def test_how_many_messages_a_robot_refused_is_no_decision(honest, tmp_path):
    path = tampered(honest, tmp_path / "ok.mcap", "command", 5, "r2", refused={"malformed": 7})
    assert replay(path).same


@pytest.mark.parametrize("channel", ["pose", "command", "observation"])
def test_a_message_left_out_is_a_difference(honest, tmp_path, channel):
    recording = read_recording(honest)

    def leave_out(tick, topic, payload):
        return None if (tick, topic) == (9, f"robots/r2/{channel}") else (tick, topic, payload)

    check = replay(rewritten(recording, tmp_path / "bad.mcap", leave_out))
    assert not check.same
    assert check.differences[0][:2] == (9, "r2")


def test_another_setup_makes_a_difference(honest, tmp_path):
    recording = read_recording(honest)

    def slower(tick, topic, payload):
        return tick, topic, payload.replace(b"xi-star", b"pursuit")

    check = replay(rewritten(recording, tmp_path / "bad.mcap", slower))
    assert not check.same
    assert {robot for _, robot, _ in check.differences} == {"r1", "r2", "r3"}


@pytest.mark.parametrize("share", [0.4, 0.75, 0.99])
def test_a_recording_cut_off_is_checked_up_to_its_end(honest, tmp_path, share):
    whole = (honest / "recording.mcap").read_bytes()
    path = tmp_path / "cut.mcap"
    path.write_bytes(whole[: int(share * len(whole))])
    check = replay(path)
    messages = read_recording(path).messages
    decided = [m for m in messages if m[1].endswith(("/pose", "/command"))]
    assert check.same
    assert not check.complete
    assert check.compared == len(decided) > 0
    assert check.ticks == messages[-1][0]


def test_a_difference_before_the_cut_is_found(honest, tmp_path):
    path = tampered(honest, tmp_path / "bad.mcap", "command", 2, "r1", step=(0.125, -0.125))
    whole = path.read_bytes()
    path.write_bytes(whole[: int(0.75 * len(whole))])
    check = replay(path)
    assert not check.complete
    assert check.differences == ((2, "r1", "command"),)


def test_a_recording_without_any_decision_is_not_called_the_same(honest, tmp_path):
    recording = read_recording(honest)
    path = rewritten(recording, tmp_path / "empty.mcap", lambda *_: None)
    check = replay(path)
    assert not check.same
    assert check.compared == 0


def test_a_recording_with_a_robot_outside_the_team_is_refused_or_different(honest, tmp_path):
    recording = read_recording(honest)

    def rename(tick, topic, payload):
        return tick, topic.replace("robots/r2/", "robots/r7/"), payload

    path = rewritten(recording, tmp_path / "bad.mcap", rename)
    try:
        check = replay(path)
    except RecordingError:
        return
    assert not check.same
    assert "r7" in {robot for _, robot, _ in check.differences}
