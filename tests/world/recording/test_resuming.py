"""Runs that broke off are gone on with: the same digest and the same recording as the unbroken."""

import contextlib
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers_world import RUN, answers, arena, begun, departures_of, played, small

from encircle.cli.main import main
from encircle.protocol.codec import decode, encode
from encircle.protocol.messages import Command
from encircle.replay.replaying import replay
from encircle.runner.hunts import resume, run
from encircle.runner.memory import run_in_memory
from encircle.world.coordinator.membership import DepartureCause
from encircle.world.coordinator.world_core import WorldCore
from encircle.world.recording.recording import Recording, RecordingError, read_recording
from encircle.world.recording.resuming import digest_of, rebuild
from encircle.world.recording.run_directory import set_aside, versions

LIVELY = (
    "target.behaviour=flee",
    "channel.delay={model='uniform', low_s=0.0, high_s=0.5}",
    "channel.loss={model='bernoulli', rate=0.3}",
)
BAD_RADIO = [
    "channel.loss={model='gilbert-elliott', good_to_bad=0.1, bad_to_good=0.3}",
    "channel.delay={model='gamma', mean_s=0.3, std_s=0.2}",
    "sensing.noise_m_std=0.05",
]
CRASHES = [
    'events=[{kind="crash", robot="r3", tick=15, ticks=20}, {kind="crash", robot="r1", tick=50}]',
]
LONG = ["ticks_max=120", "target.step_m_max=0.6"]
WEAK = [
    "channel.loss={model='path-loss', range_m=9, coherence_s=0.5, shadowing_db=6, shadowing_s=4}",
    "channel.contention.packet_s=0.004",
]
FAULTY = {
    "quiet": LONG,
    "radio": [*LONG, *BAD_RADIO],
    "weak signals": [*LONG, *WEAK],
    "crashes": [*LONG, *BAD_RADIO, *CRASHES],
}


@pytest.fixture(scope="module", params=FAULTY)
def unbroken(request, tmp_path_factory):
    path = tmp_path_factory.mktemp(request.param) / "run"
    return run("sim1", link="memory", out=path, overrides=FAULTY[request.param]), path


def broken(path, into, share):
    """The directory of a run whose world was killed when so much of its recording was written."""
    into.mkdir()
    whole = (path / "recording.mcap").read_bytes()
    (into / "recording.mcap").write_bytes(whole[: int(share * len(whole))])
    return into


@pytest.mark.parametrize("share", [0.1, 0.37, 0.8, 0.95])
def test_a_run_that_was_cut_off_goes_on_to_the_same_end(unbroken, tmp_path, share):
    hunt, path = unbroken
    into = broken(path, tmp_path / "run", share)
    before = (into / "recording.mcap").read_bytes()
    resumed = resume(into, link="memory")
    assert resumed.digest == hunt.digest
    assert resumed.result == hunt.result
    whole = read_recording(into)
    assert whole.complete
    assert whole.messages == read_recording(path).messages
    assert replay(into).same
    assert (into / "recording-broken-1.mcap").read_bytes() == before
    assert json.loads((into / "summary.json").read_text())["digest"] == hunt.digest


def test_robots_lost_by_chance_at_any_point_of_a_round_are_lost_again(tmp_path):
    """Before their answer, after it, several at once, and back again in some later round."""
    messages = []
    core = WorldCore(arena("ticks_max=60", *LIVELY), RUN, record=lambda *m: messages.append(m))
    begun(core)
    fates = np.random.default_rng(3)
    while core.ended is None:
        tick, waiting = core.state.tick, core.rounds.table.waiting()
        for robot in core.rounds.lost:
            if fates.random() < 0.3:
                core.join(robot)
        said = {r: [] for r in waiting}
        for key, payload in answers(core):
            said.get(key.split("/")[3], []).append((key, payload))
        for robot in waiting:
            if core.state.tick != tick:
                break
            # One robot always answers: without any, the run would just run out.
            for answer in said[robot][: 2 if robot == "r3" else fates.choice([0, 1, 2, 2, 2])]:
                core.receive(*answer)
            if core.state.tick == tick and (
                robot in core.rounds.table.waiting() or (robot != "r3" and fates.random() < 0.05)
            ):
                core.leave(robot, DepartureCause.NO_ANSWER)
    core.rounds.commit()
    losses = [what for _, _, what in departures_of(core)]
    assert losses.count("back") > 20
    assert losses.count("lost: no answer") > 20
    scenario = small("ticks_max=60", *LIVELY)
    for length in range(40, len(messages), 7):
        resumed = rebuild(recording_of(messages[:length], scenario))
        common = min(length, len(resumed.messages))
        assert resumed.messages[:common] == messages[:common]
        at = resumed.core.state.tick
        assert at >= messages[length][0] - 1
        assert told(departures_of(resumed.core), at) == told(departures_of(core), at)


@pytest.mark.parametrize("answers_given", [0, 1, 2], ids=["none", "its pose", "both"])
def test_a_robot_lost_and_back_within_one_round_is_so_again(answers_given):
    """A process that is killed and started anew, quicker than the others answer."""
    messages = []
    core = begun(WorldCore(arena(*LIVELY), RUN, record=lambda *m: messages.append(m)))
    while core.ended is None:
        tick, said = core.state.tick, answers(core)
        if tick == 3:
            own = [answer for answer in said if "/r2/" in answer[0]]
            for answer in own[:answers_given]:
                core.receive(*answer)
            core.leave("r2", DepartureCause.NO_ANSWER)
            core.join("r2")
            said = [answer for answer in said if answer not in own]
        for answer in said:
            core.receive(*answer)
    core.rounds.commit()
    assert departures_of(core) == [(3, "r2", "lost: no answer"), (4, "r2", "back")]
    scenario = small(*LIVELY)
    whole = recording_of(messages, scenario, complete=True)
    assert digest_of(whole) == core.rounds.journal.digest
    for length in range(20, len(messages), 5):
        resumed = rebuild(recording_of(messages[:length], scenario))
        common = min(length, len(resumed.messages))
        assert resumed.messages[:common] == messages[:common]


def test_cut_between_any_two_messages_a_run_with_a_crash_goes_on_to_the_same_end():
    """Also after the state of the tick at which the robot is back, with nothing yet to show it."""
    crash = 'events=[{kind="crash", robot="r2", tick=3, ticks=2}]'
    scenario, hunted, messages = small(*LIVELY, crash), arena(*LIVELY, crash), []
    whole = run_in_memory(hunted, RUN, _drop, lambda *m: messages.append(m))
    assert [what for _, _, what in whole.departures] == ["lost: a crash in the scenario", "back"]
    for length in range(len(messages)):
        resumed = rebuild(recording_of(messages[:length], scenario))
        again = list(resumed.messages)
        result = run_in_memory(
            hunted, RUN, _drop, lambda *m, into=again: into.append(m), resumed=resumed
        )
        assert again == messages, f"cut after {length} messages"
        assert result.digest == whole.digest


def _drop(_line):
    """Nobody reads it."""


def told(departures, before):
    """Why a robot was lost is not recorded, nor in which order within a tick."""
    return sorted((tick, what[:4], robot) for tick, robot, what in departures if tick < before)


def recording_of(messages, scenario, **changes):
    """A recording of a run of the script, as if it had been read."""
    values = {
        "path": Path("recording.mcap"),
        "scenario": scenario,
        "seed": scenario.seed,
        "run": RUN,
        "messages": tuple((tick, key.split("/", 2)[2], body) for tick, key, body in messages),
        "complete": False,
        "versions": versions(),
    }
    return Recording(**(values | changes))


@pytest.fixture(scope="module")
def script():
    """A run by the script: its scenario, and what would be recorded of it."""
    messages = []
    played(arena(*LIVELY), RUN, lambda *message: messages.append(message))
    return small(*LIVELY), messages


@pytest.mark.parametrize("channel", ["state", "observation", "radio"])
def test_a_recording_that_was_changed_is_refused_with_the_place(script, channel):
    scenario, messages = script
    place = next(k for k, (t, key, _) in enumerate(messages) if t == 4 and key.endswith(channel))
    tick, key, payload = messages[place]
    at = payload.index(b"tick")
    changed = payload[: at - 1] + payload[at - 1 :].replace(b"\xa4tick\x04", b"\xa4tick\x05", 1)
    tampered = [*messages[:place], (tick, key, changed), *messages[place + 1 :]]
    with pytest.raises(RecordingError, match=rf"{channel} of tick 4"):
        rebuild(recording_of(tampered, scenario))


def test_a_command_that_was_changed_shows_in_the_next_state(script):
    scenario, messages = script
    place = next(k for k, (t, key, _) in enumerate(messages) if t == 4 and key.endswith("command"))
    tick, key, payload = messages[place]
    other = encode(replace(decode(Command, payload, RUN), step=(0.0, 0.0)), RUN)
    tampered = [*messages[:place], (tick, key, other), *messages[place + 1 :]]
    with pytest.raises(RecordingError, match="world/state of tick 5 is recorded otherwise"):
        rebuild(recording_of(tampered, scenario))


@pytest.mark.parametrize("name", ["encircle", "protocol"])
def test_a_recording_of_another_version_is_refused_with_both(script, name):
    scenario, messages = script
    old = versions() | {name: "0.0.9"}
    with pytest.raises(RecordingError, match=rf"{name} 0\.0\.9, this is {name} {versions()[name]}"):
        rebuild(recording_of(messages[:90], scenario, versions=old))


@pytest.mark.parametrize("version", ["2", "5", "unknown", ""])
def test_of_earlier_wires_only_that_whose_messages_are_read_is_gone_on_with(script, version):
    scenario, messages = script
    before = versions() | {"protocol": "3"}
    now = rebuild(recording_of(messages[:90], scenario))
    assert rebuild(recording_of(messages[:90], scenario, versions=before)).messages == now.messages
    with pytest.raises(RecordingError, match=f"recorded with protocol {version}, this is"):
        rebuild(recording_of(messages[:90], scenario, versions=before | {"protocol": version}))


def test_a_run_by_the_clock_is_refused(script):
    scenario, messages = script
    by_clock = scenario.model_copy(update={"clock": "wall"})
    with pytest.raises(RecordingError, match="clock = 'wall'"):
        rebuild(recording_of(messages[:90], by_clock))


def test_a_run_that_is_complete_is_refused_and_left_as_it_is(unbroken):
    _, path = unbroken
    before = {p.name: p.read_bytes() for p in path.iterdir()}
    with pytest.raises(RecordingError, match="has come to its end"):
        resume(path, link="memory")
    assert {p.name: p.read_bytes() for p in path.iterdir()} == before


def test_a_run_that_had_ended_but_not_its_recording_is_finished_without_robots(unbroken, tmp_path):
    hunt, path = unbroken
    into = broken(path, tmp_path / "run", 0.9999)
    assert resume(into, link="zenoh").digest == hunt.digest
    assert read_recording(into).complete


def test_of_several_attempts_the_one_that_reaches_furthest_is_gone_on_with(unbroken, tmp_path):
    hunt, path = unbroken
    into = broken(path, tmp_path / "run", 0.8)
    set_aside(into)
    whole = (path / "recording.mcap").read_bytes()
    (into / "recording.mcap").write_bytes(whole[: len(whole) // 3])
    assert resume(into, link="memory").digest == hunt.digest
    names = sorted(p.name for p in into.iterdir())
    assert names[:3] == ["recording-broken-1.mcap", "recording-broken-2.mcap", "recording.mcap"]


@pytest.mark.parametrize("content", [None, b""])
def test_an_attempt_that_broke_off_at_once_stands_in_nobodys_way(
    unbroken, tmp_path, capsys, content
):
    hunt, path = unbroken
    into = broken(path, tmp_path / "run", 0.8)
    set_aside(into)
    if content is not None:
        (into / "recording.mcap").write_bytes(content)
    status = main(["run", "--resume", str(into), "--link", "memory", "--json"])
    printed = capsys.readouterr()
    assert status == 0, printed.err
    assert json.loads(printed.out)["digest"] == hunt.digest


@pytest.mark.parametrize("content", [None, b"no recording"])
def test_a_directory_without_a_recording_is_refused(tmp_path, content):
    if content is not None:
        (tmp_path / "recording.mcap").write_bytes(content)
    with pytest.raises(RecordingError, match=str(tmp_path)):
        resume(tmp_path, link="memory")
    assert len(list(tmp_path.iterdir())) == (content is not None)


def test_what_is_no_directory_is_refused(tmp_path):
    for name in ("absent", "file"):
        (tmp_path / "file").touch()
        with pytest.raises(RecordingError, match=f"{name} is not the directory of a run"):
            resume(tmp_path / name, link="memory")


def test_damage_in_the_middle_is_found_and_what_comes_before_it_gone_on_with(unbroken, tmp_path):
    hunt, path = unbroken
    into = broken(path, tmp_path / "run", 1.0)
    commands = [body for _, _, body in read_recording(path).of_channel("command")]
    damaged = bytearray((path / "recording.mcap").read_bytes())
    damaged[damaged.index(commands[len(commands) // 2]) + 1] ^= 1
    (into / "recording.mcap").write_bytes(damaged)
    recording = read_recording(into)
    assert not recording.complete
    assert recording.messages[-1][0] < 0.6 * hunt.result.ticks
    assert resume(into, link="memory").digest == hunt.digest


def test_no_damage_is_more_than_a_recording_can_bear(unbroken, tmp_path):
    """Lengths of any size among it."""
    _, path = unbroken
    whole = (path / "recording.mcap").read_bytes()
    places = np.random.default_rng(11)
    for _ in range(15):
        at = int(places.integers(len(whole)))
        blank = bytes([0xFF]) * 4096
        (tmp_path / "recording.mcap").write_bytes(whole[:at] + blank + whole[at + 4096 :])
        with contextlib.suppress(RecordingError):
            read_recording(tmp_path)
