"""The robot's side of the protocol: what it answers, what it refuses, and that it never raises."""

from dataclasses import replace
from math import inf, nan, pi

import pytest
from helpers_agents import BODIES, TEAM, observation, pose
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.agents.brain.robot_core import RobotCore
from encircle.protocol.codec import BYTES_MAX, decode, encode
from encircle.protocol.errors import OutOfTurn
from encircle.protocol.keys import robot_key
from encircle.protocol.messages import Command, End, Observation, Pose, Setup, State

CHEAP = settings(max_examples=60, deadline=None, derandomize=True)
RUN = "g1"
SETUP = Setup("r1", TEAM, 0.1, "xi-star", BODIES)


def key(channel, robot="r1"):
    return robot_key(RUN, robot, channel)


class Robot:
    """A robot's core with what it logged."""

    def __init__(self, setup=SETUP):
        self.logged = []
        self.core = RobotCore("r1", RUN, self.logged.append)
        if setup is not None:
            assert self.tell("setup", setup) == []

    def tell(self, channel, message, run=RUN):
        return self.core.receive(key(channel), encode(message, run))

    def answer(self, sensed):
        """Pose and command in answer to an observation, decoded."""
        (pose_key, packet), (command_key, payload) = self.tell("observation", sensed)
        assert (pose_key, command_key) == (key("pose"), key("command"))
        return decode(Pose, packet, RUN), decode(Command, payload, RUN)

    def refuses(self, channel, payload, cause):
        before = dict(self.core.refused)
        assert self.core.receive(key(channel), payload) == []
        assert self.core.refused == before | {cause: before.get(cause, 0) + 1}
        assert len(self.logged) == sum(self.core.refused.values()), "each refusal is logged once"


def test_an_observation_is_answered_with_a_pose_and_a_command_for_its_tick():
    robot = Robot()
    for tick in range(5):
        told, command = robot.answer(observation(tick=tick, position=(1.0, 2.0)))
        assert (told.robot, told.tick, told.position) == ("r1", tick, (1.0, 2.0))
        assert (command.robot, command.tick, command.refused) == ("r1", tick, {})
    assert robot.logged == []


def test_an_observation_before_setup_is_out_of_turn():
    robot = Robot(setup=None)
    robot.refuses("observation", encode(observation(), RUN), "out-of-turn")
    assert robot.tell("setup", SETUP) == []
    assert robot.answer(observation())[1].tick == 0


@pytest.mark.parametrize("tick", [0, 2, 7])
def test_only_the_next_tick_is_answered(tick):
    robot = Robot()
    robot.answer(observation(tick=0))
    other = observation(tick=tick, position=(9.0, 9.0))
    robot.refuses("observation", encode(other, RUN), "out-of-turn")
    assert robot.answer(observation(tick=1))[1].refused == {"out-of-turn": 1}


def test_the_same_observation_again_is_answered_again_and_decides_nothing_anew():
    """The world asks again when an answer may have been lost on the way."""
    robot, once = Robot().core, Robot().core
    for tick in range(3):
        asked = encode(observation(tick=tick), RUN)
        first = robot.receive(key("observation"), asked)
        assert robot.receive(key("observation"), asked) == first
        assert once.receive(key("observation"), asked) == first
        assert len(first) == 2
    assert not robot.refused


def test_a_second_setup_is_taken_and_begins_anew():
    robot = Robot()
    robot.answer(observation(tick=0))
    assert robot.tell("setup", Setup("r1", ("r1",), 0.5, "pursuit", BODIES)) == []
    assert (robot.core.config.team, robot.core.config.tick_s) == (("r1",), 0.5)
    assert robot.answer(observation(tick=0, target=(4.0, 0.0)))[1].mode == "pursue"


@pytest.mark.parametrize(
    "setup",
    [
        Setup("r2", TEAM, 0.1, "xi-star", BODIES),
        Setup("r1", ("r2", "r3"), 0.1, "xi-star", BODIES),
        Setup("r1", (), 0.1, "xi-star", BODIES),
    ],
)
def test_a_setup_for_another_robot_or_without_this_one_is_refused(setup):
    robot = Robot(setup=None)
    robot.refuses("setup", encode(setup, RUN), "wrong-sender")
    assert robot.core.config is None


@pytest.mark.parametrize(
    ("strategy", "parameters", "named"),
    [
        ("dance", {}, "dance"),
        ("xi-star", {"colour": 1}, "colour"),
        ("xi-star", {"ring_radius_m": -1}, "ring_radius_m"),
        ("xi-star", {"ring_radius_m": nan}, "ring_radius_m"),
        ("xi-star", {"window_ticks": inf}, "window_ticks"),
        ("xi-star", {"window_ticks": nan}, "window_ticks"),
        ("xi-star", {"xi_grid": [0.0, nan]}, "xi_grid"),
        ("xi-star", {"xi_grid": "012"}, "xi_grid"),
        ("xi-star", {"search": ["hold"]}, "search"),
    ],
)
def test_a_setup_that_makes_no_sense_is_malformed_and_says_what(strategy, parameters, named):
    robot = Robot(setup=None)
    payload = encode(Setup("r1", TEAM, 0.1, strategy, BODIES | parameters), RUN)
    robot.refuses("setup", payload, "malformed")
    assert named in robot.logged[0]
    assert robot.tell("setup", SETUP) == []
    assert robot.core.config is not None, "a good setup is still taken"


@pytest.mark.parametrize("name", ["search", "ring_radius_m", "xi_grid", "colour"])
@pytest.mark.parametrize("depth", [10, 500, 900, 1000, 1020])
def test_deeply_nested_parameters_are_malformed(name, depth):
    robot = Robot(setup=None)
    payload = bytearray(encode(Setup("r1", TEAM, 0.1, "xi-star", BODIES | {name: None}), RUN))
    payload[-1:] = b"\x91" * depth + b"\xc0"
    robot.refuses("setup", bytes(payload), "malformed")


@pytest.mark.parametrize("tick_s", [0.0, -0.1])
def test_a_tick_without_duration_is_malformed(tick_s):
    robot = Robot(setup=None)
    robot.refuses("setup", encode(Setup("r1", TEAM, tick_s, "xi-star", BODIES), RUN), "malformed")


def test_messages_meant_for_or_naming_another_robot_are_refused():
    robot = Robot()
    assert robot.core.receive(key("observation", "r2"), encode(observation("r2"), RUN)) == []
    assert robot.core.refused == {"wrong-sender": 1}
    robot.refuses("observation", encode(observation("r2"), RUN), "wrong-sender")
    robot.refuses("end", encode(End("r2", 0, "ticks"), RUN), "wrong-sender")
    assert robot.core.ended is None


def test_a_robot_seen_that_is_not_of_the_team_is_malformed_and_the_tick_can_be_had_again():
    robot = Robot()
    stranger = observation(seen=(("r9", 1.0, 1.0),))
    robot.refuses("observation", encode(stranger, RUN), "malformed")
    assert "r9" in robot.logged[0]
    assert robot.answer(observation())[1].tick == 0


@pytest.mark.parametrize("channel", ["pose", "command", "alive"])
def test_channels_a_robot_does_not_listen_to_are_out_of_turn(channel):
    Robot().refuses(channel, encode(pose(), RUN), "out-of-turn")


@pytest.mark.parametrize("channel", ["shout", "", "pose/more"])
def test_keys_outside_the_protocol_are_counted_as_such(channel):
    Robot().refuses(channel, b"", "unknown-key")


def test_the_worlds_own_keys_are_refused():
    robot = Robot()
    state = State(0, (), (), (0.0, 0.0), False, ())
    assert robot.core.receive(f"encircle/{RUN}/world/state", encode(state, RUN)) == []
    assert robot.core.refused == {"wrong-sender": 1}


def test_refusals_are_told_apart_by_cause_and_reported_with_each_command():
    robot = Robot()
    robot.refuses("observation", encode(observation(), "g2"), "wrong-run")
    robot.refuses("observation", b"\xc1" * (BYTES_MAX[Observation] + 1), "oversized")
    robot.refuses("observation", b"\xc1", "malformed")
    robot.refuses("end", b"\x81\xa1v\x01", "wrong-version")
    robot.refuses("end", b"", "malformed")
    counts = {"malformed": 2, "oversized": 1, "wrong-run": 1, "wrong-version": 1}
    for tick in range(2):
        command = robot.answer(observation(tick=tick))[1]
        assert command.refused == counts
        assert list(command.refused) == sorted(counts), "in an order that does not tell of arrival"


INBOX_GARBAGE = [
    (b"", "malformed"),
    (b"\xc1" * 100, "malformed"),
    (b"\x91" * 500 + b"\xc0", "malformed"),
    (b"x" * 10_000, "oversized"),
    (encode(pose("r3"), "g2"), "wrong-run"),
    (encode(pose("r9"), RUN), "wrong-sender"),
    (encode(pose("r1"), RUN), "wrong-sender"),
    (encode(pose("r3", tick=1), RUN), "out-of-turn"),
    (encode(pose("r3", tick=2**40), RUN), "out-of-turn"),
    (encode(observation("r3"), RUN), "malformed"),
]


@pytest.mark.parametrize(("packet", "cause"), INBOX_GARBAGE)
def test_garbage_in_the_inbox_is_counted_and_the_rest_is_used(packet, cause):
    robot = Robot()
    robot.answer(observation(tick=0))
    good = encode(pose("r2", 0, detection=(8.0, 9.0)), RUN)
    command = robot.answer(observation(tick=1, inbox=(packet, good, packet)))[1]
    assert command.refused == {cause: 2}
    assert command.team == ("r1", "r2")
    assert command.estimate == pytest.approx((8.0, 9.0))


SAID = pose("r2", 4, position=(5.0, 5.0), detection=(8.0, 9.0))


def after_hearing(relayed, **parameters):
    """A robot's core and its command at tick 5, at which a packet comes that relays this."""
    robot = Robot(replace(SETUP, parameters=BODIES | parameters))
    for tick in range(5):
        robot.answer(observation(tick=tick))
    packet = encode(replace(SAID, relayed=tuple(relayed)), RUN)
    return robot, robot.answer(observation(tick=5, inbox=(packet,)))[1]


@pytest.mark.parametrize(
    ("wrong", "cause", "named"),
    [
        (("r9", 3, 1.0, 1.0), "wrong-sender", "'r9'"),
        (("", 3, 1.0, 1.0), "wrong-sender", "''"),
        (("r3", 4, 1.0, 1.0), "out-of-turn", "of tick 4 at tick 4"),
        (("r3", 5, 1.0, 1.0), "out-of-turn", "of tick 5 at tick 4"),
        (("r3", 2**40, 1.0, 1.0), "out-of-turn", str(2**40)),
        (("r1", 4, 1.0, 1.0), "out-of-turn", "'r1'"),
    ],
)
def test_a_relayed_detection_that_cannot_be_is_refused_and_the_rest_of_the_packet_used(
    wrong, cause, named
):
    sound = ("r4", 4 - 1, 8.0, 9.0)
    robot, command = after_hearing([wrong, sound, wrong])
    assert command.refused == {cause: 2}
    assert len(robot.logged) == 2
    for text in ("r2", named):
        assert text in robot.logged[0]
    assert command.team == ("r1", "r2")
    clean, expected = after_hearing([sound])
    assert replace(command, refused={}) == expected
    # The packets themselves are kept as they came, for the policy.
    assert robot.core.state._replace(packets=()) == clean.core.state._replace(packets=())


def test_the_own_detections_come_back_and_are_neither_refused_nor_believed():
    robot, command = after_hearing([("r1", 3, 1.0, 1.0), ("r1", 2, 1.0, 1.0)])
    clean, expected = after_hearing([])
    assert command == expected
    assert robot.core.state._replace(packets=()) == clean.core.state._replace(packets=())


def test_a_packet_is_sifted_anew_by_each_robot_that_gets_it():
    # Decoded packets are remembered and shared by the robots of one process.
    for _ in range(2):
        assert after_hearing([("r9", 3, 1.0, 1.0)])[1].refused == {"wrong-sender": 1}


def test_late_detections_that_were_ignored_are_reported_with_those_too_late_for_the_window():
    late = [("r3", 2, 8.0, 8.0), ("r4", 1, 8.0, 8.0)]
    _, command = after_hearing(late, late_detections="ignore")
    assert command.refused == {"late-detection": 2}
    assert command.estimate == pytest.approx((8.0, 9.0))
    assert after_hearing(late)[1].refused == {}


@pytest.mark.parametrize("every", [1, 2, 5])
def test_a_robot_that_publishes_nothing_answers_with_its_command_alone(every):
    robot = Robot(replace(SETUP, parameters=BODIES | {"publish_every_ticks": every}))
    for tick in range(11):
        sent = robot.tell("observation", observation(tick=tick))
        channels = ["pose", "command"] if tick % every == 0 else ["command"]
        assert [where for where, _ in sent] == [key(channel) for channel in channels]
        command = decode(Command, sent[-1][1], RUN)
        assert (command.tick, command.published) == (tick, len(sent) == 2)


@pytest.mark.parametrize(
    "strange",
    [
        pose("r2", 0, relayed=(("r3", 0, 1e308, 0.0),)),
        pose("r2", 0, position=(1e308, -1e308)),
        pose("r2", 0, position=(1e300, 0.0)),
        pose("r2", 0, velocity=(1e308, 1e308)),
        pose("r2", 0, detection=(1e308, -1e308)),
        pose("r2", 0, detection=(1e160, 0.0)),
        pose("r2", 0, position=(9e8, -9e8), velocity=(9e8, 9e8)),
        pose("r2", 0, detection=(9e8, -9e8)),
    ],
)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_a_peer_that_sends_absurd_but_finite_numbers_does_not_stop_a_robot(strange):
    robot = Robot()
    for tick in range(3):
        inbox = (encode(strange, RUN),) if tick == 1 else ()
        seen = observation(tick=tick, target=(4.0, 0.0), inbox=inbox)
        assert len(robot.tell("observation", seen)) == 2


@pytest.mark.parametrize("reason", ["captured", "ticks", "failed: r2 is gone"])
def test_the_end_message_ends_with_its_reason(reason):
    robot = Robot()
    assert robot.core.ended is None
    assert robot.tell("end", End("r1", 3, reason)) == []
    assert robot.core.ended == reason
    assert robot.core.refused == {}


def test_the_end_may_come_before_setup():
    robot = Robot(setup=None)
    robot.tell("end", End("r1", 0, "failed: r2 did not join"))
    assert robot.core.ended == "failed: r2 did not join"


def test_decide_raises_for_our_own_callers_where_receive_counts():
    robot = Robot(setup=None)
    with pytest.raises(OutOfTurn, match="before setup"):
        robot.core.decide(observation())
    assert robot.core.refused == {}


def test_decide_answers_as_receive_does():
    first, second = Robot(), Robot()
    action = first.core.decide(observation(target=(4.0, 0.0)))
    assert second.answer(observation(target=(4.0, 0.0))) == (action.pose, action.command)


@CHEAP
@given(
    st.sampled_from(["setup", "observation", "end", "pose", "", "x"]),
    st.binary(max_size=200),
    st.booleans(),
)
def test_no_bytes_on_any_key_make_it_raise(channel, payload, set_up):
    robot = Robot(SETUP if set_up else None)
    assert robot.core.receive(key(channel), payload) == []
    assert sum(robot.core.refused.values()) == 1


finite = st.floats(-1e5, 1e5)
observations = st.builds(
    Observation,
    st.just("r1"),
    st.just(0),
    st.tuples(finite, finite),
    st.floats(-pi, pi),
    st.none() | st.tuples(finite, finite),
    st.lists(st.floats(0.0, 6.0), min_size=8, max_size=30).map(tuple),
    st.sets(st.sampled_from(TEAM[1:])).flatmap(
        lambda peers: st.tuples(*[st.tuples(st.just(r), finite, finite) for r in sorted(peers)])
    ),
    st.lists(st.binary(max_size=60), max_size=3).map(tuple),
)


@CHEAP
@given(observations)
def test_any_observation_of_a_sane_size_is_answered(sensed):
    robot = Robot()
    _, command = robot.answer(sensed)
    assert sum(command.refused.values()) == len(sensed.inbox)
