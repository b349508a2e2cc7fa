"""A run that is looked on at: messages late, twice, missing, foreign; a viewer that comes later."""

import random
from collections import defaultdict
from dataclasses import replace

import pytest
from helpers_scene import RUN, frames_of, hunted

from encircle.protocol.codec import decode, encode
from encircle.protocol.errors import MalformedMessage, ProtocolError
from encircle.protocol.messages import Command, Intervention, Radio, State
from encircle.runner.hunts import run
from encircle.runner.interventions import Interventions
from encircle.scene.builder import SceneBuilder, scene_of_recording
from encircle.world.recording.recording import read_recording

LOSS = "channel.loss={model='bernoulli', rate=0.3}"
CRASH = "events=[{kind='crash', tick=6, ticks=4, robot='r2'}]"


def lossy(*changes):
    return hunted("sim1", [LOSS, "ticks_max=20", "sensing.noise_m_std=0.05", *changes])[0]


def kind_of(message):
    return message[1].rpartition("/")[2]


def as_seen_live(messages, seed):
    """In an order in which a viewer may get them.

    The truth comes after the questions; answers and fates come mixed, and up to a round late.
    """
    draws, rounds, late = random.Random(seed), defaultdict(list), []
    for message in messages:
        rounds[message[0]].append(message)
    for tick in sorted(rounds):
        asked = [m for m in rounds[tick] if kind_of(m) in ("setup", "observation", "end")]
        rest, later = late, []
        for message in rounds[tick]:
            if message not in asked:
                is_late = message[1] != "world/state" and draws.random() < 0.3
                (later if is_late else rest).append(message)
        draws.shuffle(rest)
        yield from asked
        yield from rest
        late = later
    yield from late


@pytest.mark.parametrize("seed", range(8))
def test_frames_do_not_depend_on_the_order_in_which_answers_come(seed):
    recording = lossy(CRASH)
    seen = list(as_seen_live(recording.messages, seed))
    assert seen != list(recording.messages)
    assert frames_of(recording, seen) == frames_of(recording)


def test_frames_are_given_out_as_soon_as_the_round_after_is_known():
    recording = lossy()
    builder, states = SceneBuilder(recording.scenario, recording.seed, RUN), 0
    for tick, topic, payload in recording.messages:
        frames = builder.take(tick, topic, payload)
        states += topic == "world/state"
        assert [frame.tick for frame in frames] == [states - 2] * (
            topic == "world/state" and states > 1
        )


def test_the_tick_is_read_from_a_message_that_comes_without_one():
    recording = lossy(CRASH)
    without = [(None, topic, payload) for _, topic, payload in recording.messages]
    assert frames_of(recording, without) == frames_of(recording)


def test_what_comes_twice_changes_nothing():
    recording = lossy()
    twice = [m for m in recording.messages for _ in range(1 + (kind_of(m) == "observation"))]
    assert frames_of(recording, twice) == frames_of(recording)


def without(recording, channel, tick, robot):
    return [m for m in recording.messages if m[:2] != (tick, f"robots/{robot}/{channel}")]


def test_a_missing_command_leaves_one_robots_decision_out():
    recording = lossy()
    whole, frames = (
        frames_of(recording),
        frames_of(recording, without(recording, "command", 7, "r3")),
    )
    assert [f.tick for f in frames] == [f.tick for f in whole]
    assert frames[7].modes[2] is frames[7].beliefs[2] is None
    for tick, (frame, expected) in enumerate(zip(frames, whole, strict=True)):
        assert not frame.beliefs_unsure
        if tick != 7:
            assert replace(frame, values=None, lost=()) == replace(expected, values=None, lost=())


def test_after_a_missing_observation_a_robot_is_unsure_until_it_begins_anew():
    recording = lossy(CRASH)
    missing = without(recording, "observation", 3, "r2")
    frames, whole = frames_of(recording, missing), frames_of(recording)
    for frame, expected in zip(frames[:-1], whole[:-1], strict=True):
        # It is lost from tick 6, and gets a setup at tick 10.
        doubtful = 3 < frame.tick < 6
        assert frame.beliefs_unsure == (("r2",) if doubtful else ())
        if doubtful or frame.tick == 3:
            assert frame.beliefs[1] is None
        else:
            assert frame.beliefs == expected.beliefs
    told = [(f.tick, e.text) for f in frames for e in f.events if e.kind == "unsure"]
    assert told == [(4, "what r2 believes is not known: its observation of tick 3 was not seen")]


@pytest.mark.parametrize("joined", [1, 4, 9])
def test_a_viewer_that_comes_later_is_sure_of_who_begins_anew_and_of_nobody_else(joined):
    recording = lossy(CRASH)
    later = [message for message in recording.messages if message[0] >= joined]
    frames, whole = frames_of(recording, later), frames_of(recording)[joined:]
    assert [f.tick for f in frames] == [f.tick for f in whole]
    for frame, expected in zip(frames[:-1], whole[:-1], strict=True):
        back = frame.tick >= 10
        lost = 6 <= frame.tick < 10
        unsure = {"r1", "r2", "r3", "r4"} - ({"r2"} if back or lost else set())
        assert set(frame.beliefs_unsure) == unsure
        assert frame.beliefs[1] == (expected.beliefs[1] if back else None)
        assert {frame.beliefs[k] for k in (0, 2, 3)} == {None}
        assert frame.packets == expected.packets
        # What was sent before is not known, and what is known is right.
        for row, right in zip(frame.ages, expected.ages, strict=True):
            assert all(age in (-1, known) for age, known in zip(row, right, strict=True))
    assert frames[-2].ages == whole[-2].ages


def test_a_robot_that_decided_otherwise_is_unsure_from_there():
    recording = lossy(CRASH)
    messages = list(recording.messages)
    at = next(k for k, m in enumerate(messages) if m[:2] == (4, "robots/r2/command"))
    command = decode(Command, messages[at][2], RUN)
    messages[at] = (*messages[at][:2], encode(replace(command, mode="dance"), RUN))
    frames, whole = frames_of(recording, messages), frames_of(recording)
    assert [f.tick for f in frames if f.beliefs_unsure] == [4, 5]
    assert frames[4].beliefs_unsure == ("r2",)
    assert frames[10].beliefs == whole[10].beliefs
    (told,) = [e for f in frames for e in f.events if e.kind == "unsure"]
    assert told.text.endswith("it decided otherwise than this program does")


def test_foreign_messages_are_refused_and_change_nothing():
    recording = lossy()
    of_three = encode(State(5, ((0.0, 0.0),) * 3, (0.0,) * 3, (0.0, 0.0), False, ()), RUN)
    foreign = [
        (5, "world/state", b"\x00"),
        (5, "world/state", of_three),
        (5, "world/radio", encode(Radio(5, ((0,),)), RUN)),
        (5, "robots/r9/command", b""),
        (5, "robots/r1/observation", b"nonsense"),
        (5, "robots/r1/setup", b"nonsense"),
        (5, "robots/r1/surprise", b""),
        (900, "world/state", recording.messages[0][2]),
    ]
    builder, frames = SceneBuilder(recording.scenario, recording.seed, RUN), []
    for tick, topic, payload in recording.messages:
        if (tick, topic) == (5, "world/radio"):
            for message in foreign:
                with pytest.raises(ProtocolError):
                    builder.take(*message)
        frames += builder.take(tick, topic, payload)
    assert frames + builder.finish() == frames_of(recording)


def test_a_truth_far_ahead_of_all_others_is_refused():
    recording = lossy()
    builder = SceneBuilder(recording.scenario, recording.seed, RUN)
    state = decode(State, next(p for _, t, p in recording.messages if t == "world/state"), RUN)
    builder.take(0, "world/state", encode(state, RUN))
    with pytest.raises(ProtocolError, match="tick 5000"):
        builder.take(5000, "world/state", encode(replace(state, tick=5000), RUN))
    with pytest.raises(MalformedMessage):
        builder.take(1, "world/state", encode(replace(state, robots=()), RUN))


def test_a_first_truth_beyond_the_end_of_the_run_is_refused():
    # A page would count ticks from 0 to it.
    recording = lossy()
    builder = SceneBuilder(recording.scenario, recording.seed, RUN)
    last = recording.scenario.ticks_max
    state = decode(State, next(p for _, t, p in recording.messages if t == "world/state"), RUN)
    with pytest.raises(ProtocolError, match=f"of tick {last + 1}, the run has {last} at most"):
        builder.take(last, "world/state", encode(replace(state, tick=last + 1), RUN))
    assert builder.take(last, "world/state", encode(replace(state, tick=last), RUN)) == []
    assert [frame.tick for frame in builder.finish()] == [last]


def test_without_beliefs_all_else_is_the_same():
    recording = lossy(CRASH)
    builder, frames = SceneBuilder(recording.scenario, recording.seed, RUN, beliefs=False), []
    for tick, topic, payload in recording.messages:
        frames += builder.take(tick, topic, payload)
    frames += builder.finish()
    nothing = (None,) * 4
    assert frames == [replace(f, beliefs=nothing) for f in frames_of(recording)]


def test_what_is_given_by_hand_is_told_and_shown_as_if_it_were_written(tmp_path):
    silence = {"kind": "silence", "robot": "r1", "tick": 5, "ticks": 3}
    queue = Interventions()
    for event in (silence, {"kind": "loss", "rate": 1.0}):
        queue.give(event)
    out, changes = tmp_path / "run", ["ticks_max=12"]
    run("sim1", link="memory", overrides=changes, interventions=queue, out=out)
    recording = read_recording(out)
    frames = frames_of(recording)
    assert [f.tick for f in frames if f.silent[0]] == [5, 6, 7]
    told = [(f.tick, e.kind, e.text) for f in frames for e in f.events]
    assert told[:3] == [
        (1, "loss", "by hand: every link loses 100 % of packets"),
        (5, "silence", "by hand: r1's radio is off"),
        (8, "silence", "r1's radio is on again"),
    ]
    assert not any(f.beliefs_unsure for f in frames)
    # Of what was sent at the ticks 0, 1 and 2, only the first came before that.
    assert frames[2].values.delivery == pytest.approx(1 / 3)
    assert list(scene_of_recording(recording).frames) == frames
    nonsense = encode(Intervention(1, {"kind": "surprise"}), recording.run)
    with pytest.raises(MalformedMessage, match="surprise"):
        SceneBuilder(recording.scenario, 1, recording.run).take(1, "world/intervention", nonsense)
