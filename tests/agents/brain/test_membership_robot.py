"""The robot's side of being lost and back: setups that begin anew, and planning for those left."""

from dataclasses import replace

import pytest
from helpers_agents import BODIES, config, observation, pose, run_actions

from encircle.agents.brain.robot_core import RobotCore
from encircle.protocol.codec import decode, encode
from encircle.protocol.keys import robot_key
from encircle.protocol.messages import Command, Setup

RUN = "g1"
PEERS = [pose(f"r{k}", tick=0, position=(3.0 * k, 0.0)) for k in (2, 3, 4)]


def teams(lost, packets=lambda _tick: []):
    """The team that r1 plans with at ticks 0, 1, ...; ``lost`` is said at each."""
    seen = [
        replace(observation(tick=t, target=(4.0, 4.0)), lost=names) for t, names in enumerate(lost)
    ]
    inbox = {1: PEERS}
    _, actions = run_actions(config(), seen, lambda t: [*inbox.get(t, []), *packets(t)])
    return [action.command.team for action in actions]


def test_a_robot_plans_without_the_lost_and_with_them_once_they_are_back():
    all_of_them = ("r1", "r2", "r3", "r4")
    found = teams([(), (), ("r3",), ("r2", "r3"), ("r2",), ()])
    assert found[1:] == [
        all_of_them,
        ("r1", "r2", "r4"),
        ("r1", "r4"),
        ("r1", "r3", "r4"),
        all_of_them,
    ]


def test_a_packet_younger_than_the_loss_brings_a_peer_back_and_an_older_one_does_not():
    def late(tick):
        return [pose("r3", tick={3: 1, 4: 2}[tick], position=(9.0, 1.0))] if tick in (3, 4) else []

    found = teams([(), (), ("r3",), ("r3",), ("r3",), ("r3",)], late)
    assert ["r3" in team for team in found] == [False, True, False, False, True, True]


def test_a_lost_peer_that_is_seen_is_still_kept_clear_of_but_not_planned_with():
    seen = replace(observation(tick=0, target=(4.0, 0.0), seen=(("r2", 1.2, 0.0),)), lost=("r2",))
    _, [action] = run_actions(config(clearance_m=0.08), [seen])
    assert action.command.team == ("r1",)
    assert action.command.step[0] <= 1.2 - 2 * 0.5


class Back:
    """A robot that knows something and is set up again."""

    def __init__(self, first_tick, answer_tick):
        self.core = RobotCore("r1", RUN)
        setup = Setup("r1", ("r1", "r2"), 0.1, "xi-star", BODIES)
        self.tell("setup", setup)
        for tick in range(3):
            self.tell("observation", observation(tick=tick, target=(5.0, 5.0)))
        self.tell("setup", replace(setup, first_tick=first_tick, answer_tick=answer_tick))

    def tell(self, channel, message):
        return self.core.receive(robot_key(RUN, "r1", channel), encode(message, RUN))


def test_a_second_setup_starts_a_fresh_brain_at_its_first_tick():
    back, fresh = Back(20, 20), RobotCore("r1", RUN)
    assert back.tell("observation", observation(tick=3)) == []
    assert back.core.refused == {"out-of-turn": 1}
    fresh.receive(
        robot_key(RUN, "r1", "setup"),
        encode(
            Setup("r1", ("r1", "r2"), 0.1, "xi-star", BODIES, first_tick=20, answer_tick=20), RUN
        ),
    )
    for tick in (20, 21, 22):
        seen = observation(tick=tick, position=(0.1 * tick, 0.0))
        (_, packet), (_, told) = back.tell("observation", seen)
        key = robot_key(RUN, "r1", "observation")
        (_, expected), (_, commanded) = fresh.receive(key, encode(seen, RUN))
        assert packet == expected
        assert replace(decode(Command, told, RUN), refused={}) == decode(Command, commanded, RUN)
        assert decode(Command, told, RUN).estimate is None


def test_observations_before_the_answer_tick_are_folded_in_and_not_answered():
    back = Back(0, 3)
    for tick in range(3):
        seen = observation(tick=tick, target=(4.0 + tick, 4.0))
        assert back.tell("observation", seen) == []
        assert back.tell("observation", seen) == [], "nor when they come again"
    _, (_, told) = back.tell("observation", observation(tick=3))
    x, y = decode(Command, told, RUN).estimate
    assert x == pytest.approx(7.0, abs=0.3)
    assert y == pytest.approx(4.0, abs=0.1)
    assert not back.core.refused


def test_a_bad_second_setup_leaves_the_brain_that_there_was():
    back = Back(0, 0)
    state = back.core.state
    back.tell("setup", Setup("r1", ("r1", "r2"), 0.1, "dance", BODIES))
    back.tell("setup", Setup("r1", ("r1", "r2"), 0.1, "xi-star", BODIES, "world", 5, 4))
    assert back.core.state is state
    assert back.core.refused == {"malformed": 2}


@pytest.mark.parametrize("lost", [("r1",), ("r9",), ("r2", "r9")])
def test_an_observation_that_says_nonsense_of_who_is_lost_is_malformed(lost):
    back = Back(0, 0)
    assert back.tell("observation", replace(observation(), lost=lost)) == []
    assert back.core.refused == {"malformed": 1}
