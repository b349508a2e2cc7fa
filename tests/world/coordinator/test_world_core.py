"""The world's side of the protocol: rounds, refusals, the digest, and what is counted."""

from collections import Counter

import msgpack
import numpy as np
import pytest
from helpers_world import (
    RUN,
    SQUARE,
    answers,
    arena,
    begun,
    command,
    played,
    pose,
    rounds,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.protocol import VERSION
from encircle.protocol.codec import BYTES_MAX, decode, encode
from encircle.protocol.errors import OutOfTurn
from encircle.protocol.keys import robot_key, world_key
from encircle.protocol.lockstep import Phase
from encircle.protocol.messages import Command, End, Observation, Pose, Setup
from encircle.world.coordinator.world_core import WorldCore

LIVELY = (
    "target.behaviour=flee",
    "channel.delay={model='uniform', low_s=0.0, high_s=0.5}",
    "channel.loss={model='bernoulli', rate=0.3}",
)


def key(robot, channel, run=RUN):
    return robot_key(run, robot, channel)


def encode_any_length(message, **changes):
    """The message's bytes with fields changed, or left out where the change is ``...``."""
    body = msgpack.unpackb(encode(message, RUN)) | changes
    return msgpack.packb({name: value for name, value in body.items() if value is not ...})


def refusals(tick):
    """What nobody should send at a tick, by the cause under which it is counted."""
    said, asked = pose("r1", tick), command("r1", tick)
    return [
        ("malformed", key("r1", "pose"), b""),
        ("malformed", key("r1", "pose"), b"\xc1"),
        ("malformed", key("r1", "pose"), msgpack.packb([1, 2, 3])),
        ("malformed", key("r1", "pose"), encode(said, RUN)[:-1]),
        ("malformed", key("r1", "pose"), encode(said, RUN) + b"\x00"),
        ("malformed", key("r1", "pose"), encode(asked, RUN)),
        ("malformed", key("r1", "command"), encode_any_length(asked, step=...)),
        ("malformed", key("r1", "command"), encode_any_length(asked, colour="red")),
        ("malformed", key("r1", "command"), encode_any_length(asked, step=[float("nan"), 0.0])),
        ("malformed", key("r1", "command"), encode_any_length(asked, step=[float("inf"), 0.0])),
        ("malformed", key("r1", "command"), encode_any_length(asked, step=[0.1])),
        ("malformed", key("r1", "command"), encode_any_length(asked, tick="now")),
        ("malformed", key("r1", "command"), encode_any_length(asked, tick=-1)),
        ("oversized", key("r1", "pose"), encode_any_length(said, mode="x" * BYTES_MAX[Pose])),
        (
            "oversized",
            key("r1", "command"),
            encode_any_length(asked, mode="x" * BYTES_MAX[Command]),
        ),
        ("wrong-version", key("r1", "pose"), encode_any_length(said, v=VERSION + 1)),
        ("wrong-version", key("r1", "pose"), encode_any_length(said, v=...)),
        ("wrong-run", key("r1", "pose"), encode_any_length(said, run="another")),
        ("wrong-run", key("r1", "command"), encode(asked, "another")),
        ("wrong-sender", key("r2", "pose"), encode(said, RUN)),
        ("wrong-sender", key("r2", "command"), encode(asked, RUN)),
        ("out-of-turn", key("r1", "pose"), encode(pose("r1", tick + 1), RUN)),
        ("out-of-turn", key("r1", "command"), encode(command("r1", tick + 7), RUN)),
        ("out-of-turn", key("r9", "pose"), encode(pose("r9", tick), RUN)),
        ("out-of-turn", key("r1", "setup"), encode(said, RUN)),
        ("out-of-turn", key("r1", "observation"), b""),
        ("out-of-turn", world_key(RUN, "state"), b""),
        ("unknown-key", "encircle", b""),
        ("unknown-key", key("r1", "weather"), encode(said, RUN)),
        ("unknown-key", "elsewhere/" + key("r1", "pose"), encode(said, RUN)),
    ]


def test_what_should_not_have_been_sent_is_refused_counted_logged_and_changes_nothing():
    undisturbed = played(arena(*LIVELY)).rounds.result()
    log, expected = [], Counter()
    core = begun(WorldCore(arena(*LIVELY), RUN, log.append))
    while core.ended is None:
        tick = core.state.tick
        good = answers(core)
        for answered in (0, 3):
            # Bad ones come before any answer and again when half have been given.
            for sent in good[:answered]:
                core.receive(*sent)
            waiting = core.rounds.table.waiting()
            for cause, where, payload in refusals(tick):
                before, state = core.rounds.refused[cause], core.state
                assert core.receive(where, payload) == []
                assert core.rounds.refused[cause] == before + 1, (cause, where, payload)
                assert where in log[-1]
                assert core.state is state
                assert core.rounds.table.waiting() == waiting
                expected[cause] += 1
        for repeated in good[:2]:
            core.receive(*repeated)
            expected["out-of-turn"] += 1
        for sent in good[3:]:
            core.receive(*sent)
    result = core.rounds.result()
    assert result.digest == undisturbed.digest
    assert result.refused == dict(expected)
    assert len(log) == sum(expected.values())
    assert (result.ticks, result.distances_m) == (undisturbed.ticks, undisturbed.distances_m)


@settings(deadline=None, derandomize=True, max_examples=100)
@given(
    stray=st.lists(
        st.tuples(
            st.sampled_from([key("r1", "pose"), key("r2", "command"), key("r9", "pose"), "", "*"])
            | st.text(max_size=30),
            st.binary(max_size=60)
            | st.recursive(
                st.none() | st.booleans() | st.integers(-9, 9) | st.floats() | st.text(max_size=3),
                lambda inner: st.lists(inner) | st.dictionaries(st.text(max_size=4), inner),
                max_leaves=6,
            ).map(msgpack.packb),
        ),
        max_size=6,
    )
)
def test_whatever_strangers_send_the_run_stays_the_same(stray):
    core = begun(WorldCore(arena("ticks_max=2"), RUN))
    for _ in rounds(core):
        for where, payload in stray:
            assert core.receive(where, payload) == []
    assert core.rounds.result().digest == played(arena("ticks_max=2")).rounds.result().digest
    assert sum(core.rounds.result().refused.values()) == 2 * len(stray)


@pytest.mark.parametrize("size", [0.31, 1e3, 9e8])
def test_a_step_however_large_is_made_as_far_as_the_robot_can(size):
    core = begun(WorldCore(arena(), RUN))
    for robot in core.arena.ids:
        core.receive(key(robot, "pose"), encode(pose(robot, 0), RUN))
        core.receive(key(robot, "command"), encode(command(robot, 0, (0.0, size)), RUN))
    gone = core.state.positions[:4] - np.array(SQUARE)
    np.testing.assert_allclose(gone, [[0.0, 0.3]] * 4, atol=1e-6)


@pytest.mark.parametrize("size", [1e9, -1e200, 1e308, 2**60])
def test_a_step_beyond_all_measure_is_refused(size):
    core = begun(WorldCore(arena(), RUN))
    core.receive(key("r1", "command"), encode_any_length(command("r1", 0), step=[size, 0.0]))
    assert core.rounds.result().refused == {"malformed": 1}
    assert "r1" in core.rounds.table.waiting()


def test_before_the_run_and_after_its_end_everything_is_out_of_turn():
    core = WorldCore(arena("ticks_max=1"), RUN)
    core.receive(key("r1", "pose"), encode(pose("r1", 0), RUN))
    begun(core)
    for _ in rounds(core):
        pass
    digest = core.rounds.result().digest
    for tick in (0, 1):
        core.receive(key("r1", "pose"), encode(pose("r1", tick), RUN))
    assert core.rounds.result().refused == {"out-of-turn": 3}
    assert core.rounds.result().digest == digest


@pytest.mark.parametrize("robot", ["r5", "", "R1", "world", "*"])
def test_an_unknown_robot_cannot_join(robot):
    core = WorldCore(arena(), RUN)
    with pytest.raises(OutOfTurn, match="not in this team"):
        core.join(robot)
    assert core.rounds.table.in_phase(Phase.IDLE) == ()


def test_a_robot_cannot_join_twice():
    core = WorldCore(arena(), RUN)
    for robot in ("r3", "r1", "r2"):
        core.join(robot)
    with pytest.raises(OutOfTurn, match="r3"):
        core.join("r3")
    assert core.rounds.table.in_phase(Phase.ABSENT) == ("r4",)
    core.join("r4")
    assert core.rounds.table.in_phase(Phase.ABSENT) == ()


def test_a_robot_that_joins_is_told_all_it_needs():
    core = WorldCore(arena("robot.xi_weight=0.2", "team.strategy=xi-3"), RUN)
    [(where, payload)] = core.join("r2")
    setup = decode(Setup, payload, RUN)
    assert where == key("r2", "setup")
    assert (setup.robot, setup.team) == ("r2", ("r1", "r2", "r3", "r4"))
    assert (setup.tick_s, setup.strategy) == (0.1, "xi-3")
    assert setup.parameters == core.arena.scenario.parameters
    assert setup.parameters["xi_weight"] == 0.2


def test_a_round_ends_with_the_last_answer_and_opens_the_next_for_everyone():
    core = WorldCore(arena(), RUN)
    for robot in core.arena.ids:
        core.join(robot)
    sent = core.begin()
    for tick in range(10):
        assert [where for where, _ in sent] == [key(r, "observation") for r in core.arena.ids]
        observations = [decode(Observation, payload, RUN) for _, payload in sent]
        assert [(o.robot, o.tick) for o in observations] == [(r, tick) for r in core.arena.ids]
        *early, last = answers(core)
        assert all(core.receive(*answer) == [] for answer in early)
        assert core.state.tick == tick
        sent = core.receive(*last)
        assert core.state.tick == tick + 1
    ends = [decode(End, payload, RUN) for _, payload in sent]
    assert [where for where, _ in sent] == [key(r, "end") for r in core.arena.ids]
    assert {(e.tick, e.reason) for e in ends} == {(10, "ticks")}
    assert core.ended == core.rounds.result().ended == "ticks"


def test_only_those_whose_answers_are_missing_are_asked_again_for_the_same_tick():
    core = WorldCore(arena(), RUN)
    for robot in core.arena.ids:
        core.join(robot)
    asked = dict(core.begin())
    assert dict(core.rounds.unanswered()) == asked
    said = answers(core)
    half = [(k, payload) for k, payload in said if k != key("r2", "command")]
    for k, payload in half:
        assert core.receive(k, payload) == []
    again = key("r2", "observation")
    assert core.rounds.unanswered() == [(again, asked[again])]
    # Its answer comes twice now: what had come before is refused, and the round is the same.
    core.receive(key("r2", "pose"), dict(said)[key("r2", "pose")])
    following = core.receive(key("r2", "command"), dict(said)[key("r2", "command")])
    assert core.rounds.refused == {"out-of-turn": 1}
    assert core.rounds.unanswered() == following != []


def test_a_capture_ends_the_run_at_its_tick():
    near = {"positions": [[1.5, 0.0], [-0.8, 1.2], [-0.8, -1.2]]}
    core = begun(WorldCore(arena(team=near), RUN))
    while core.ended is None:
        for robot in core.arena.ids:
            x, y = core.state.positions[core.arena.ids.index(robot)].tolist()
            tick = core.state.tick
            core.receive(key(robot, "pose"), encode(pose(robot, tick), RUN))
            inward = command(robot, tick, (-0.1 * x, -0.1 * y))
            core.receive(key(robot, "command"), encode(inward, RUN))
    # From 1.5 m and 1.44 m in steps of a tenth of what is left: within 1.3 m after two.
    result = core.rounds.result()
    assert (result.ended, result.captured, result.capture_tick, result.ticks) == (
        "captured",
        True,
        2,
        2,
    )
    assert all(1.1 < distance <= 1.3 for distance in result.distances_m)


def test_a_failed_run_says_why_to_everyone_and_keeps_its_first_reason():
    core = begun(WorldCore(arena(), RUN))
    sent = core.rounds.fail("robot r2 is gone")
    assert {decode(End, payload, RUN).reason for _, payload in sent} == {"failed: robot r2 is gone"}
    core.rounds.fail("something later")
    assert core.rounds.result().ended == "failed: robot r2 is gone"
    assert not core.rounds.result().captured
