"""Robots of one process answer together as each answers alone, also where a policy fails."""

from dataclasses import replace

import pytest
from helpers_agents import BODIES, TEAM, observation
from helpers_scenarios import scenario_of

from encircle.agents.brain.co_hosted import decide_together
from encircle.agents.brain.robot_core import RobotCore
from encircle.protocol.codec import encode
from encircle.protocol.errors import OutOfTurn, WrongSender
from encircle.protocol.keys import robot_key
from encircle.protocol.messages import Setup
from encircle.protocol.plugins import STRATEGIES, PluginFailed
from encircle.runner.memory import give_answer, joined, next_observations
from encircle.world.arena.engine import build

RUN = "g1"


def one_by_one(cores, observations):
    return [core.decide(seen) for core, seen in zip(cores, observations, strict=True)]


def answers_of(scenario, decide):
    """All answers of a hunt, and its digest."""
    world, cores = joined(build(scenario, 3), RUN, print)
    answers, observations = [], next_observations(world, cores)
    while observations:
        asked = [cores[sensed.robot] for sensed in observations]
        answers += [give_answer(world, *action) for action in decide(asked, observations)]
        observations = next_observations(world, cores)
    return answers, world.rounds.result().digest


@pytest.mark.parametrize("strategy", ["xi-star", "pursuit", "intents"])
@pytest.mark.parametrize("seed", range(4))
def test_a_hunt_is_the_same_whether_robots_decide_together_or_one_by_one(strategy, seed):
    drawn = scenario_of(seed)
    team = drawn.team.model_copy(update={"strategy": strategy, "policy_parameters": {}})
    scenario = drawn.model_copy(update={"team": team})
    assert answers_of(scenario, decide_together) == answers_of(scenario, one_by_one)


def test_whose_turn_it_is_is_checked_also_for_what_this_process_has_made():
    cores = cores_with(failing=())
    asked = [observation(robot) for robot in TEAM]
    decide_together(cores, asked)
    for wrong in (asked[0], observation("r1", tick=2), observation("r2", tick=1)):
        with pytest.raises((OutOfTurn, WrongSender)):
            decide_together(cores[:1], [wrong])


def cores_with(failing, failed_before=()):
    """The team's cores: the policies of some fail when asked, those of others cannot be had."""
    cores = [RobotCore(robot, RUN) for robot in TEAM]
    for core in cores:
        setup = Setup(core.robot, TEAM, 0.1, "xi-star", BODIES)
        core.receive(robot_key(RUN, core.robot, "setup"), encode(setup, RUN))
        core.config = replace(core.config, policy=failing_in(failing, core.config.policy))
        if core.robot in failed_before:
            core.failed = PluginFailed(STRATEGIES, "gone", core.robot, 0, ImportError())
    return cores


def failing_in(robots, policy):
    def fails(memory, view):
        if view.robot in robots:
            raise ZeroDivisionError
        return policy(memory, view)

    return fails


@pytest.mark.parametrize(
    ("failing", "failed_before", "raised"),
    [({"r3", "r4"}, (), "r3"), ({"r2"}, {"r3"}, "r2"), ({"r4"}, {"r2"}, "r2")],
)
def test_the_first_failure_in_robot_order_is_raised(failing, failed_before, raised):
    observations = [observation(robot, target=(1.0, 2.0)) for robot in TEAM]
    for decide in (decide_together, one_by_one):
        with pytest.raises(PluginFailed, match=f"in robot {raised} "):
            decide(cores_with(failing, failed_before), observations)
