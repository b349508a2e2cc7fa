"""Who is there: tokens, silence and signs of life, and what the world makes of them."""

import pytest
from helpers_world import RUN, answers, arena, command, departures_of, pose

from encircle.agents.brain.robot_core import RobotCore
from encircle.protocol.codec import encode
from encircle.protocol.errors import OutOfTurn
from encircle.protocol.keys import robot_key
from encircle.world.coordinator.failure_detector import FailureDetector, RunCannotContinue
from encircle.world.coordinator.membership import DepartureCause
from encircle.world.coordinator.world_core import WorldCore

ROBOTS = ("r1", "r2", "r3", "r4")


def attended(when_lost="go-on", begun=True, changes=()):
    core = WorldCore(arena(*changes), RUN)
    roll = FailureDetector(core, when_lost)
    for robot in ROBOTS:
        roll.token_appeared(robot)
    if begun:
        roll.begin()
    return core, roll


def answer(core, *robots):
    """The answers of some robots to the round that is open."""
    for key, payload in answers(core):
        if key.split("/")[3] in robots:
            core.receive(key, payload)


def said_by(robot, tick):
    return [
        (robot_key(RUN, robot, "pose"), encode(pose(robot, tick), RUN)),
        (robot_key(RUN, robot, "command"), encode(command(robot, tick), RUN)),
    ]


def test_the_run_waits_for_everyone_and_for_who_was_there_before():
    core = WorldCore(arena(), RUN)
    roll = FailureDetector(core)
    assert roll.expected == ROBOTS
    for robot in ("r3", "r1", "r4"):
        assert [key for key, _ in roll.token_appeared(robot)] == [robot_key(RUN, robot, "setup")]
    roll.token_vanished("r3")
    assert roll.expected == ("r2", "r3")
    roll.token_appeared("r2")
    assert [key for key, _ in roll.token_appeared("r3")] == [robot_key(RUN, "r3", "setup")]
    assert roll.expected == ()
    assert [key for key, _ in roll.begin()] == [robot_key(RUN, r, "observation") for r in ROBOTS]
    assert departures_of(core) == []


@pytest.mark.parametrize("robot", ["r9", "", "*"])
def test_strangers_do_not_count(robot):
    roll = FailureDetector(WorldCore(arena(), RUN))
    with pytest.raises(OutOfTurn, match="not in this team"):
        roll.token_appeared(robot)
    assert roll.token_vanished(robot) == []
    assert roll.expected == ROBOTS


def test_a_robot_whose_token_goes_is_lost_and_counted_in_again_with_its_token():
    core, roll = attended()
    answer(core, "r1", "r3", "r4")
    outgoing = roll.token_vanished("r2")
    assert {key for key, _ in outgoing} == {
        robot_key(RUN, robot, "observation") for robot in ("r1", "r3", "r4")
    }
    assert departures_of(core) == [(0, "r2", "lost: it is gone")]
    assert roll.token_vanished("r2") == []
    assert roll.token_appeared("r2") == []
    answer(core, "r1", "r3", "r4")
    assert departures_of(core)[1:] == [(2, "r2", "back")]
    assert core.rounds.table.waiting() == ROBOTS


def test_those_that_do_not_answer_are_lost_and_a_late_answer_brings_them_back():
    core, roll = attended()
    answer(core, "r1", "r3")
    roll.answer_overdue(0, 3.0)
    assert departures_of(core) == [(0, r, "lost: no answer for 3 s") for r in ("r2", "r4")]
    assert core.state.tick == 1
    for key, payload in said_by("r4", 0):
        assert core.receive(key, payload) == []
        roll.sign_of_life(key, payload)
    answer(core, "r1", "r3")
    assert departures_of(core)[2:] == [(2, "r4", "back")]
    assert core.rounds.lost == ("r2",)


def test_a_robot_that_missed_what_it_was_asked_is_asked_anew_until_it_answers():
    core, roll = attended()
    deaf = RobotCore("r2", RUN)
    answer(core, *ROBOTS)
    assert roll.reminders() == []
    answer(core, "r1", "r3", "r4")
    roll.answer_overdue(1, 3.0)
    answer(core, "r1", "r3", "r4")
    asked = roll.reminders()
    assert asked == roll.reminders()
    assert [key for key, _ in asked] == [
        robot_key(RUN, "r2", channel) for channel in ("setup", "observation")
    ]
    said = [reply for message in asked for reply in deaf.receive(*message)]
    assert (dict(deaf.refused), len(said)) == ({}, 2)
    for message in said:
        core.receive(*message)
        roll.sign_of_life(*message)
    assert roll.reminders() == []
    answer(core, "r1", "r3", "r4")
    assert departures_of(core) == [(1, "r2", "lost: no answer for 3 s"), (4, "r2", "back")]


@pytest.mark.parametrize("fell_silent_before", [False, True])
def test_a_robot_whose_token_went_and_that_is_there_all_the_same_is_back(fell_silent_before):
    core, roll = attended()
    alive = RobotCore("r2", RUN)
    answer(core, *ROBOTS)
    answer(core, "r1", "r3", "r4")
    if fell_silent_before:
        roll.answer_overdue(1, 3.0)
    roll.token_vanished("r2")
    lost = departures_of(core)[-1]
    # What comes in the next moment was under way when it went.
    for _ in range(2):
        for message in said_by("r2", 1):
            roll.sign_of_life(*message)
        assert core.rounds.lost == ("r2",)
        answer(core, "r1", "r3", "r4")
        assert core.rounds.lost == ("r2",)
        asked = roll.reminders()
    assert [key for key, _ in asked] == [
        robot_key(RUN, "r2", channel) for channel in ("setup", "observation")
    ]
    said = [reply for message in asked for reply in alive.receive(*message)]
    assert (dict(alive.refused), len(said)) == ({}, 2)
    for message in said:
        roll.sign_of_life(*message)
    assert roll.reminders() == []
    answer(core, "r1", "r3", "r4")
    assert departures_of(core) == [lost, (core.state.tick, "r2", "back")]
    # Its token, if that comes yet, brings nobody else, and counts from then on.
    assert roll.token_appeared("r2") == []
    assert core.rounds.refused == {}
    roll.token_vanished("r2")
    assert departures_of(core)[2:] == [(core.state.tick, "r2", "lost: it is gone")]
    roll.token_appeared("r2")
    answer(core, "r1", "r3", "r4")
    assert departures_of(core)[3:] == [(core.state.tick, "r2", "back")]


def test_a_robot_that_spoke_without_a_token_and_fell_silent_is_back_with_one():
    core, roll = attended()
    roll.token_vanished("r2")
    for _ in range(2):
        roll.reminders()
    for message in said_by("r2", 0):
        roll.sign_of_life(*message)
    answer(core, "r1", "r3", "r4")
    assert core.rounds.lost == ()
    answer(core, "r1", "r3", "r4")
    roll.answer_overdue(core.state.tick, 3.0)
    roll.token_appeared("r2")
    answer(core, "r1", "r3", "r4")
    assert core.rounds.lost == ()


def test_a_robot_that_is_gone_is_not_asked_anew_at_once():
    core, roll = attended()
    answer(core, "r1", "r3", "r4")
    roll.answer_overdue(0, 3.0)
    roll.token_vanished("r2")
    assert roll.reminders() == []
    roll.token_appeared("r2")
    answer(core, "r1", "r3", "r4")
    assert departures_of(core)[1:] == [(2, "r2", "back")]
    assert roll.reminders() == []


def test_an_answer_that_comes_in_the_last_moment_makes_nobody_else_late():
    core, roll = attended()
    answer(core, *ROBOTS)
    assert core.state.tick == 1
    assert roll.answer_overdue(0, 3.0) == []
    assert departures_of(core) == []


def test_a_robot_that_goes_as_the_run_begins_is_lost_in_its_first_round_and_may_come_back():
    core, roll = attended(begun=False)
    roll.token_vanished("r2")
    roll.begin()
    assert departures_of(core) == [(0, "r2", "lost: it is gone")]
    assert core.rounds.table.waiting() == ("r1", "r3", "r4")
    roll.token_appeared("r2")
    answer(core, "r1", "r3", "r4")
    assert departures_of(core)[1:] == [(1, "r2", "back")]


def test_only_its_own_whole_messages_are_a_robots_sign_of_life():
    core, roll = attended()
    answer(core, "r1", "r3", "r4")
    roll.answer_overdue(0, 3.0)
    [(key, sound), _] = said_by("r2", 0)
    [(_, of_another), _] = said_by("r3", 0)
    for where, payload in [
        (key, b""),
        (key, sound[:-1]),
        (key, of_another),
        (key, encode(pose("r2", 0), "another")),
        (robot_key(RUN, "r2", "alive"), sound),
        (robot_key("another", "r2", "pose"), encode(pose("r2", 0), "another")),
        (robot_key("another", "r2", "pose"), sound),
        (robot_key("*", "r2", "pose"), sound),
        ("nonsense", sound),
    ]:
        roll.sign_of_life(where, payload)
    answer(core, "r1", "r3", "r4")
    assert core.rounds.lost == ("r2",)


def test_what_a_robot_had_sent_before_it_was_gone_does_not_bring_it_back():
    core, roll = attended()
    answer(core, "r1", "r3", "r4")
    roll.token_vanished("r2")
    for key, payload in said_by("r2", 0):
        roll.sign_of_life(key, payload)
    answer(core, "r1", "r3", "r4")
    assert core.rounds.lost == ("r2",)


def test_without_any_robot_left_the_run_ends():
    _, roll = attended()
    for robot in ("r3", "r1"):
        roll.token_vanished(robot)
    with pytest.raises(
        RunCannotContinue,
        match=r"no answer from r2, r4 for 3 s at tick 0, and no robot is left \(policy 'xi-s",
    ):
        roll.answer_overdue(0, 3.0)
    roll.token_vanished("r4")
    with pytest.raises(RunCannotContinue, match="robot r2 is gone at tick 0, and no robot is left"):
        roll.token_vanished("r2")


@pytest.mark.parametrize("begun", [False, True])
def test_a_run_may_be_told_to_end_with_the_first_loss(begun):
    core, roll = attended("end", begun)
    with pytest.raises(RunCannotContinue, match="robot r2 is gone"):
        roll.token_vanished("r2")
    assert departures_of(core) == []


def test_nobody_is_lost_of_whom_nothing_is_awaited():
    core, roll = attended()
    core.rounds.fail("for a test")
    assert roll.token_vanished("r2") == []
    core, roll = attended(begun=False)
    assert roll.answer_overdue(0, 3.0) == []


def resumed(lost=(), changes=()):
    """A world that was fed two rounds of a recording in which some robots were lost."""
    core = WorldCore(arena(*changes), RUN)
    for robot in ROBOTS:
        core.join(robot)
    core.begin()
    for robot in lost:
        core.leave(robot, DepartureCause.GONE)
    for _ in range(2):
        answer(core, *core.rounds.table.waiting())
    histories = {r: [(robot_key(RUN, r, "setup"), b"so far")] for r in core.rounds.table.waiting()}
    return core, FailureDetector(core, "go-on", histories)


def test_robots_of_a_run_that_is_resumed_are_told_what_was_and_asked():
    core, roll = resumed(lost=("r2",))
    assert roll.expected == ("r1", "r3", "r4")
    assert not roll.may_begin
    told = roll.token_appeared("r3")
    assert [key for key, _ in told] == [
        robot_key(RUN, "r3", channel) for channel in ("setup", "observation")
    ]
    assert roll.may_begin
    # Gone and there again before the run goes on: told once more.
    assert roll.token_vanished("r3") == []
    assert roll.token_appeared("r3") == told
    for robot in ("r1", "r2", "r4"):
        roll.token_appeared(robot)
    roll.begin()
    answer(core, "r1", "r3", "r4")
    assert departures_of(core)[1:] == [(3, "r2", "back")]
    with pytest.raises(OutOfTurn, match="not in this team"):
        resumed()[1].token_appeared("r9")


def test_a_run_that_is_resumed_goes_on_without_those_that_do_not_come():
    core, roll = resumed()
    for robot in ("r1", "r4"):
        roll.token_appeared(robot)
    roll.begin()
    assert [d[1:] for d in departures_of(core)] == [
        (robot, "lost: it did not come back") for robot in ("r2", "r3")
    ]
    answer(core, "r1", "r4")
    assert core.state.tick == 3


def test_a_robot_that_the_scenario_had_taken_away_and_that_does_not_come_is_not_waited_for():
    crash = 'events=[{kind="crash", robot="r3", tick=1, ticks=3}]'
    core, roll = resumed(changes=[crash])
    for robot in ("r1", "r2", "r4"):
        roll.token_appeared(robot)
    roll.begin()
    for _ in range(4):
        answer(core, "r1", "r2", "r4")
    assert (core.state.tick, core.rounds.lost) == (6, ("r3",))
    roll.token_appeared("r3")
    answer(core, "r1", "r2", "r4")
    assert core.rounds.table.waiting() == ROBOTS
    # Gone once more, it is missed once more.
    roll.token_vanished("r3")
    assert departures_of(core)[-1] == (7, "r3", "lost: it is gone")
