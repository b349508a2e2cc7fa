"""The world by the clock: what has come by a tick's end is used, the rest held or counted."""

import pytest
from helpers_real_time import EPOCH_US, RUN, by_clock
from helpers_world import command, departures_of, pose

from encircle.agents.brain.robot_core import RobotCore
from encircle.protocol.codec import decode, encode
from encircle.protocol.keys import parse_key, robot_key
from encircle.protocol.messages import Observation, Setup
from encircle.world.arena.engine import build
from encircle.world.coordinator.membership import DepartureCause
from encircle.world.coordinator.real_time_core import RealTimeWorldCore, has_perfect_channel

STEP = (0.125, 0.0)


def world(*overrides: str) -> RealTimeWorldCore:
    core = RealTimeWorldCore(build(by_clock(*overrides), 1), RUN)
    for robot in core.arena.ids:
        core.join(robot)
    core.now_us = EPOCH_US
    core.told = observations(core.begin())
    return core


def observations(messages):
    return {
        parse_key(key).robot: decode(Observation, payload, RUN)
        for key, payload in messages
        if key.endswith("/observation")
    }


def ended_tick(core: RealTimeWorldCore, now_us: int = EPOCH_US):
    return observations(core.end_tick(now_us))


def commanded(core: RealTimeWorldCore, robot: str, tick: int, step=STEP, **changes) -> None:
    said = command(robot, tick, step, timing=(1, 2, ()), **changes)
    core.take(robot_key(RUN, robot, "command"), encode(said, RUN), EPOCH_US)


def sent(core: RealTimeWorldCore, robot: str, tick: int, sequence: int) -> bytes:
    packet = encode(pose(robot, tick, sequence=sequence, sent_us=5), RUN)
    core.take(robot_key(RUN, robot, "pose"), packet, EPOCH_US)
    return packet


def moved(core: RealTimeWorldCore, robot: str) -> float:
    """How far a robot goes in x in the tick that ends now."""
    place = core.arena.ids.index(robot)
    before = core.state.positions[place, 0]
    ended_tick(core)
    return float(core.state.positions[place, 0] - before)


def test_observations_carry_the_time_at_which_they_are_sent():
    core = world()
    assert {o.sent_us for o in core.told.values()} == {EPOCH_US}
    assert {o.sent_us for o in ended_tick(core, EPOCH_US + 20_000).values()} == {EPOCH_US + 20_000}


def test_nobody_is_waited_for():
    core = world()
    commanded(core, "r1", 0)
    assert core.state.tick == 0
    assert set(ended_tick(core)) == set(core.arena.ids)
    assert core.state.tick == 1


def test_a_command_in_time_moves_its_robot_and_the_step_is_held_then_nothing():
    core = world("team.hold_ticks_max=2")
    commanded(core, "r2", 0)
    assert [moved(core, "r2") for _ in range(5)] == [0.125, 0.125, 0.125, 0.0, 0.0]
    assert core.answers.summary()["r2"] == {"late": 0, "held": 2, "stood_still": 2, "superseded": 0}
    assert core.answers.summary()["r1"]["stood_still"] == 5


def test_a_late_command_is_counted_and_holds_from_its_own_tick():
    core = world("team.hold_ticks_max=2")
    assert [moved(core, "r2") for _ in range(2)] == [0.0, 0.0]
    commanded(core, "r2", 1)
    # Of tick 1, it may be held up to tick 3.
    assert [moved(core, "r2") for _ in range(3)] == [0.125, 0.125, 0.0]
    assert core.answers.summary()["r2"] == {"late": 1, "held": 2, "stood_still": 3, "superseded": 0}


def test_an_order_to_stand_still_ends_the_holding():
    core = world()
    commanded(core, "r2", 0)
    assert moved(core, "r2") == 0.125
    commanded(core, "r2", 0, (0.0, 0.0), mode="stop", published=False)
    assert moved(core, "r2") == 0.0
    assert core.answers.summary()["r2"]["late"] == 0


@pytest.mark.parametrize("tick", [0, 1, 3])
def test_commands_that_cannot_be_now_are_refused(tick):
    core = world()
    ended_tick(core)
    ended_tick(core)
    commanded(core, "r1", 2)
    commanded(core, "r1", 2 if tick == 1 else tick)
    assert core.rounds.refused == {"out-of-turn": 1}
    assert core.answers.summary()["r1"]["late"] == 0


def test_a_robot_outside_the_team_is_refused():
    core = world()
    commanded(core, "r9", 0)
    sent(core, "r9", 0, 0)
    assert core.rounds.refused == {"out-of-turn": 2}


def test_a_packet_goes_on_the_radio_in_the_tick_in_which_it_comes():
    core = world()
    ended_tick(core)
    packet = sent(core, "r1", 0, 0)
    told = ended_tick(core)
    assert told["r2"].inbox == (packet,)
    assert told["r1"].inbox == ()
    assert ended_tick(core)["r2"].inbox == ()


def test_of_several_packets_in_one_tick_the_newest_goes_and_the_others_are_counted():
    core = world()
    ended_tick(core)
    sent(core, "r1", 0, 0)
    newest = sent(core, "r1", 1, 1)
    assert ended_tick(core)["r3"].inbox == (newest,)
    assert core.answers.summary()["r1"]["superseded"] == 1
    sent(core, "r1", 1, 1)
    assert core.rounds.refused == {"out-of-turn": 1}


def test_direct_with_a_perfect_channel_says_nothing_of_packets():
    core = world("radio=direct")
    sent(core, "r1", 0, 0)
    told = ended_tick(core)["r2"]
    assert (told.inbox, told.admitted) == ((), None)


def test_direct_with_a_channel_that_was_perfect_tells_what_it_admits_once_that_is_changed():
    core = world("radio=direct")
    for number in range(4):
        for robot in core.arena.ids:
            sent(core, robot, number, number)
        if number == 1:
            core.intervene({"kind": "loss", "rate": 1.0})
        told = ended_tick(core)["r2"]
        # What was sent at tick 1 arrives at 2 as ever; what is sent from 2 on is lost.
        expected = [None, ("r1", "r3", "r4"), (), ()][number]
        admitted = told.admitted
        assert admitted == (expected and tuple([(robot, number) for robot in expected]))
    assert core.rounds.result().packets_lost == {"loss": 24}


def test_direct_with_a_channel_tells_which_packets_it_admits_and_draws_fates_as_ever():
    channel = 'channel.delay={model="constant",mean_s=0.05}'
    core, reference = world("radio=direct", channel), world(channel)
    for number in range(6):
        for each in (core, reference):
            for robot in core.arena.ids:
                sent(each, robot, number, number)
        told, delivered = ended_tick(core), ended_tick(reference)
        # 50 ms are three ticks of 20 ms.
        arrives = [(robot, number - 2) for robot in ("r1", "r3", "r4")] if number >= 2 else []
        assert told["r2"].admitted == tuple(arrives)
        assert told["r2"].inbox == ()
        assert len(delivered["r2"].inbox) == len(arrives)
        assert delivered["r2"].admitted is None
    assert core.rounds.fates.due.tolist() == reference.rounds.fates.due.tolist()


def test_by_the_clock_contention_is_among_the_packets_that_came_in_a_tick():
    # Long packets: whoever is not alone is lost. r1 alone sends to silent radios.
    core = world("channel.contention.packet_s=60.0")
    for robots in (["r1"], ["r1", "r2"]):
        tick = len(robots) - 1
        for robot in robots:
            sent(core, robot, tick, tick)
        told = ended_tick(core)
        assert [len(told[robot].inbox) for robot in core.arena.ids] == (
            [0, 1, 1, 1] if robots == ["r1"] else [0, 0, 0, 0]
        )


@pytest.mark.parametrize(
    ("override", "perfect"),
    [
        ("channel.order=kept", True),
        ('channel.loss={model="bernoulli",rate=0.1}', False),
        ('channel.delay={model="constant",mean_s=0.05}', False),
        ("channel.duplication.rate=0.1", False),
        ("channel.loss={model='path-loss', range_m=9}", False),
        ("channel.contention.packet_s=0.001", False),
        ("channel.profile=wifi-office", False),
        ('events=[{kind="silence",tick=1,ticks=1,robot="r1"}]', False),
        ('events=[{kind="move-target",tick=1,position=[9.0,9.0]}]', True),
    ],
)
def test_which_channels_are_perfect(override, perfect):
    assert has_perfect_channel(build(by_clock("radio=direct", override), 1)) is perfect


def test_the_silent_are_those_of_whom_nothing_has_come_for_so_many_ticks():
    core = world()
    for tick in range(8):
        commanded(core, "r1", tick)
        if tick < 4:
            sent(core, "r2", tick, tick)
        ended_tick(core)
    assert core.silent(4) == ("r2", "r3", "r4")
    assert core.silent(5) == ("r3", "r4")
    assert core.silent(8) == ()


def test_a_lost_robot_is_refused_until_it_is_back_and_then_begins_afresh():
    core = world()
    for tick in range(3):
        for robot in core.arena.ids:
            commanded(core, robot, tick)
        ended_tick(core)
    assert core.leave("r2", DepartureCause.NO_ANSWER) == []
    assert core.state.tick == 3
    told = ended_tick(core)
    assert "r2" not in told
    assert told["r1"].lost == ("r2",)
    commanded(core, "r2", 3)
    assert core.rounds.refused == {"out-of-turn": 1}
    core.join("r2")
    messages = core.end_tick(EPOCH_US)
    [setup] = [decode(Setup, p, RUN) for key, p in messages if key.endswith("/setup")]
    assert (setup.robot, setup.first_tick, setup.answer_tick) == ("r2", 5, 5)
    commanded(core, "r2", 4)
    assert core.rounds.refused == {"out-of-turn": 2}
    assert moved(core, "r2") == 0.0
    commanded(core, "r2", 6)
    assert moved(core, "r2") == 0.125
    assert [what for _, _, what in departures_of(core)] == ["lost: no answer", "back"]


def test_what_comes_is_recorded_as_it_came_with_the_time_and_stand_ins_are_not():
    core = world()
    recorded = []
    core.record_with(lambda *message: recorded.append(message))
    core.take(robot_key(RUN, "r1", "command"), encode(command("r1", 0), RUN), EPOCH_US + 3)
    core.end_tick(EPOCH_US + 20)
    core.rounds.commit()
    core.take(robot_key(RUN, "r2", "command"), encode(command("r2", 0), RUN), EPOCH_US + 23)
    core.end_tick(EPOCH_US + 40)
    core.rounds.commit()
    commands = [(tick, key, at) for tick, key, _, at in recorded if key.endswith("/command")]
    assert commands == [
        (0, robot_key(RUN, "r1", "command"), EPOCH_US + 3),
        (0, robot_key(RUN, "r2", "command"), EPOCH_US + 23),
    ]
    radios = [at for _, key, _, at in recorded if key.endswith("/radio")]
    assert radios == [EPOCH_US + 20, EPOCH_US + 40]


def test_the_end_of_the_run_is_told_to_all():
    core = world("ticks_max=1")
    messages = core.end_tick(EPOCH_US)
    assert [key.rsplit("/", 1)[1] for key, _ in messages] == ["end"] * 4
    assert core.ended == "ticks"
    assert core.end_tick(EPOCH_US) == []


def test_a_robot_that_is_back_is_told_of_no_answer_from_before():
    core = world('events=[{kind="crash",robot="r2",tick=2,ticks=3}]')
    answered = {}
    for tick in range(7):
        for robot in core.arena.ids:
            commanded(core, robot, tick)
        for robot, seen in ended_tick(core).items():
            answered[seen.tick, robot] = seen.answered
    assert answered[1, "r2"] == 0
    assert (answered[5, "r1"], answered[5, "r2"]) == (4, None)
    assert answered[6, "r2"] == 5


def test_what_a_robot_is_asked_anew_a_robot_takes_that_has_just_begun():
    core = world()
    for tick in range(3):
        for robot in core.arena.ids:
            commanded(core, robot, tick)
        told = ended_tick(core)
    assert told["r2"].answered == 2
    (setup_key, setup), (key, asked) = core.rounds.restart_messages("r2")
    assert decode(Setup, setup, RUN).first_tick == decode(Observation, asked, RUN).tick == 3
    robot = RobotCore("r2", RUN)
    robot.receive(setup_key, setup)
    assert robot.receive(key, asked), "it answers"
    assert not robot.refused


def test_what_is_noted_does_not_pile_up_while_no_robot_is_there_and_who_looks_on_sees_it():
    core = world()
    core.rounds.commit()
    core.rounds.journal.publishes = True
    for robot in core.arena.ids:
        core.leave(robot, DepartureCause.GONE)
    for tick in range(1, 9):
        shown = core.end_tick(EPOCH_US)
        assert core.state.tick == tick
        assert [parse_key(key).channel for key, _ in shown] == ["radio", "state"]
        assert core.rounds.journal.pending == []
