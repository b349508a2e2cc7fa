"""One robot by the clock: it answers the newest observation and loses nothing that it was told."""

from dataclasses import replace

import pytest
from helpers_agents import BODIES
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.agents.brain.real_time_core import BACKLOG_MAX, RealTimeRobotCore
from encircle.agents.brain.robot_core import RobotCore
from encircle.protocol.codec import decode, encode
from encircle.protocol.keys import robot_key
from encircle.protocol.messages import Command, Observation, Pose, Setup
from encircle.protocol.wire.limits import RECEIPTS_MAX

RUN = "clocked"
# The words of the wire, as docs/protocol.md has them.
ANSWERED, PASSED_OVER, MISSED, OVERHEARD = "world", "passed-over", "missed", "overheard"
STOPPED = "stop"
UNACKNOWLEDGED_MAX = 2 * RECEIPTS_MAX
TEAM = ("r1", "r2", "r3")
SETUP = Setup("r1", TEAM, 0.02, "xi-star", BODIES, "direct")


def robot(setup: Setup = SETUP) -> RealTimeRobotCore:
    core = RobotCore("r1", RUN)
    core.receive(robot_key(RUN, "r1", "setup"), encode(setup, RUN))
    return RealTimeRobotCore(core)


def observation(tick: int, **changes) -> Observation:
    position = (4.0 - 0.25 * tick, 0.0)
    seen = Observation("r1", tick, position, 0.0, (0.0, 0.0), (6.0,) * 8, (), (), sent_us=tick)
    return replace(seen, **changes)


def tell(core: RealTimeRobotCore, *told: Observation, arrival_us: int = 50) -> None:
    for one in told:
        core.take(arrival_us, robot_key(RUN, "r1", "observation"), encode(one, RUN))


def packet(sender: str, sequence: int, tick: int, x: float = 1.0) -> Pose:
    return Pose(
        *(sender, tick, sequence, (x, 2.0), (0.0, 0.0), None, "encircle", None, None),
        sent_us=1,
    )


def hear(core: RealTimeRobotCore, pose: Pose, arrival_us: int = 7, key: str = "") -> None:
    core.take(arrival_us, robot_key(RUN, key or pose.robot, "pose"), encode(pose, RUN))


def answered(core: RealTimeRobotCore, now_us: int = 99) -> tuple[Command, Pose | None]:
    action = core.decide()
    assert action is not None
    said = {key.rsplit("/", 1)[1]: payload for key, payload in core.messages(action, now_us)}
    pose = decode(Pose, said["pose"], RUN) if "pose" in said else None
    return decode(Command, said["command"], RUN), pose


def test_the_newest_observation_is_answered_and_the_others_are_counted():
    core = robot()
    tell(core, observation(0), observation(1), observation(2))
    command, pose = answered(core)
    assert command.tick == pose.tick == 2
    assert command.refused == {PASSED_OVER: 2}
    assert core.decide() is None


def test_observations_that_never_came_are_counted():
    core = robot()
    tell(core, observation(0))
    assert answered(core)[0].refused == {}
    tell(core, observation(4))
    assert answered(core)[0].refused == {MISSED: 3}


def test_older_observations_than_the_newest_are_refused():
    core = robot()
    tell(core, observation(3))
    answered(core)
    tell(core, observation(2), observation(3))
    assert core.decide() is None
    assert core.core.refused["out-of-turn"] == 2


def test_velocity_is_the_way_made_by_the_time_it_took():
    core = robot()
    tell(core, observation(0))
    answered(core)
    tell(core, observation(4))
    # 0.25 m per tick of 20 ms, whatever was missed in between.
    assert answered(core)[1].velocity == pytest.approx((-12.5, 0.0))


def test_packets_are_numbered_one_by_one_and_carry_the_clock():
    core = robot(replace(SETUP, first_tick=30, answer_tick=30))
    sequences = []
    for tick in (30, 33, 34):
        tell(core, observation(tick))
        _, pose = answered(core, now_us=1000 + tick)
        sequences.append(pose.sequence)
        assert pose.sent_us == 1000 + tick
    assert sequences == [30, 31, 32]


def test_commands_tell_what_came_when_until_the_world_has_one_that_told():
    core = robot()
    hear(core, packet("r2", 0, 0), arrival_us=5)
    hear(core, packet("r3", 0, 0), arrival_us=6)
    tell(core, observation(1), arrival_us=8)
    first = (("r2", 0, 5), ("r3", 0, 6), (ANSWERED, 1, 8))
    assert answered(core, 12)[0].timing == (8, 12, first)
    tell(core, observation(2), arrival_us=28)
    tell(core, observation(3), arrival_us=48)
    second = ((PASSED_OVER, 2, 28), (ANSWERED, 3, 48))
    assert answered(core, 50)[0].timing == (48, 50, (*first, *second))
    tell(core, observation(4, answered=1), arrival_us=68)
    third = ((ANSWERED, 4, 68),)
    assert answered(core, 70)[0].timing == (68, 70, (*second, *third))
    # That of tick 1 once more, a command that never was, and all that there was.
    for tick, known in ((5, 1), (6, 2)):
        tell(core, observation(tick, answered=known), arrival_us=80 + tick)
        answered(core)
    tell(core, observation(7, answered=6), arrival_us=99)
    assert answered(core, 99)[0].timing == (99, 99, ((ANSWERED, 7, 99),))


@settings(deadline=None)
@given(
    st.lists(st.tuples(st.integers(0, 3), st.booleans(), st.booleans()), min_size=1, max_size=40),
    st.integers(1, 6),
)
def test_whatever_is_lost_what_has_come_tells_of_all_that_was_heard_before(rounds, room):
    """Each round: so many packets heard, and whether the command, and news of it, gets through."""
    core = robot()
    core._receipts.carried_max = room
    heard, known, has, number = [], [], None, 0
    for tick, (packets, command_comes, news_comes) in enumerate(rounds, 1):
        for _ in range(packets):
            hear(core, packet("r2", number, 0), arrival_us=number)
            heard.append(("r2", number, number))
            number += 1
        tell(core, observation(tick, answered=has if news_comes else None), arrival_us=tick)
        heard.append((ANSWERED, tick, tick))
        told = answered(core)[0].timing.receipts
        assert len(told) <= room
        if command_comes:
            has = tick
            known += [one for one in told if one not in known]
        # In order, without a gap.
        assert known == heard[: len(known)]


def test_what_is_heard_goes_into_the_plan_unless_the_radio_does_not_admit_it():
    for admitted, team in ((None, ("r1", "r2")), ((), ("r1",)), ((("r2", 0),), ("r1", "r2"))):
        core = robot()
        hear(core, packet("r2", 0, 0))
        tell(core, observation(1, admitted=admitted))
        assert answered(core)[0].team == team


def test_what_was_admitted_in_an_observation_passed_over_is_heard_all_the_same():
    core = robot()
    hear(core, packet("r2", 0, 0))
    tell(core, observation(1, admitted=(("r2", 0),)), observation(2, admitted=()))
    assert answered(core)[0].team == ("r1", "r2")


def test_what_the_worlds_radio_brought_in_an_observation_passed_over_is_heard_all_the_same():
    core = robot(replace(SETUP, radio="world"))
    brought = encode(packet("r3", 0, 0), RUN)
    tell(core, observation(1, inbox=(brought,)), observation(2))
    assert answered(core)[0].team == ("r1", "r3")


@pytest.mark.parametrize(
    ("pose", "key", "cause"),
    [
        (packet("r2", 0, 0), "r3", "wrong-sender"),
        (packet("r9", 0, 0), "r9", "wrong-sender"),
        (packet("r1", 0, 0), "r1", "out-of-turn"),
    ],
)
def test_packets_that_cannot_be_are_refused_and_counted(pose, key, cause):
    core = robot(replace(SETUP, first_tick=1, answer_tick=1))
    hear(core, pose, key=key)
    core.take(1, robot_key(RUN, "r2", "pose"), b"garbage")
    tell(core, observation(1))
    command, _ = answered(core)
    assert command.refused == {cause: 1, "malformed": 1}
    assert command.timing.receipts == ((ANSWERED, 1, 50),)
    assert command.team == ("r1",)


def test_more_packets_than_a_command_can_tell_of_wait_for_the_next():
    core = robot()
    for number in range(RECEIPTS_MAX + 5):
        hear(core, packet("r2", number, 0))
    told = []
    for tick in (1, 2):
        tell(core, observation(tick, answered=tick - 1))
        told.append([number for _, number, _ in answered(core)[0].timing.receipts])
    assert told == [list(range(RECEIPTS_MAX)), [*range(RECEIPTS_MAX, RECEIPTS_MAX + 5), 1, 2]]


def test_as_long_as_there_is_no_room_to_tell_nothing_more_is_heard_or_answered(monkeypatch):
    monkeypatch.setattr(
        "encircle.agents.brain.unacknowledged.UNACKNOWLEDGED_MAX", UNACKNOWLEDGED_MAX
    )
    core = robot()
    for tick in range(UNACKNOWLEDGED_MAX):
        tell(core, observation(tick))
        answered(core)
    hear(core, packet("r2", 0, 0))
    later = range(UNACKNOWLEDGED_MAX, 3 * UNACKNOWLEDGED_MAX)
    for tick in later:
        tell(core, observation(tick))
        assert core.decide() is None
    tell(core, observation(later.stop, answered=UNACKNOWLEDGED_MAX - 1))
    command, _ = answered(core)
    assert command.timing.receipts[0] == (ANSWERED, RECEIPTS_MAX, 50)
    assert command.refused == {MISSED: len(later)}


def test_however_long_its_peers_names_are_a_command_is_short_enough():
    names = tuple(f"r{k}" + "x" * 29 for k in range(4))
    core = RobotCore(names[0], RUN)
    setup = replace(SETUP, robot=names[0], team=names)
    core.receive(robot_key(RUN, names[0], "setup"), encode(setup, RUN))
    timed = RealTimeRobotCore(core)
    for number in range(500):
        for name in names[1:]:
            hear(timed, packet(name, number, 0), arrival_us=2**53 - 1)
    seen = replace(observation(1), robot=names[0])
    timed.take(1, robot_key(RUN, names[0], "observation"), encode(seen, RUN))
    assert len(answered(timed, 2**53 - 1)[0].timing.receipts) > 50


def test_a_flood_of_packets_is_bounded_and_counted():
    core = robot(replace(SETUP, first_tick=1, answer_tick=1))
    for number in range(BACKLOG_MAX + 9):
        hear(core, packet("r2", number, 0))
    tell(core, observation(1))
    assert answered(core)[0].refused == {OVERHEARD: 9}


def test_without_observations_it_stops_once_and_then_keeps_silent():
    core = robot(replace(SETUP, parameters=BODIES | {"silence_ticks_max": 25}))
    assert core.observation_timeout_s == 0.5
    assert core.stop(1) == []
    tell(core, observation(0), arrival_us=3)
    answered(core)
    [(key, payload)] = core.stop(77)
    command = decode(Command, payload, RUN)
    assert key == robot_key(RUN, "r1", "command")
    assert (command.tick, command.step, command.mode) == (0, (0.0, 0.0), STOPPED)
    assert not command.published
    assert command.timing == (3, 77, ((ANSWERED, 0, 3),))
    assert core.stop(99) == []
    tell(core, observation(9))
    assert answered(core)[0].mode != STOPPED
    assert len(core.stop(100)) == 1


def test_a_setup_in_mid_run_begins_afresh():
    core = robot()
    hear(core, packet("r2", 0, 0))
    tell(core, observation(0), observation(1))
    answered(core)
    again = replace(SETUP, first_tick=9, answer_tick=9)
    core.take(1, robot_key(RUN, "r1", "setup"), encode(again, RUN))
    tell(core, observation(8), observation(9))
    command, pose = answered(core)
    assert command.tick == pose.sequence == 9
    assert command.team == ("r1",)
    assert pose.velocity == (0.0, 0.0)
    assert MISSED not in command.refused
