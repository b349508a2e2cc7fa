"""What robots believe, worked out from messages: new robot cores receive what the real ones did.

What a robot believes is in no message. Its setup and its observations are, and the same program
decides the same on them; so do its beliefs follow. Where a robot cannot be followed, because its
setup or an observation was not seen, or because it decided otherwise than this program does, it is
named as unsure until it gets a new setup.

This is for runs in lock-step; ``encircle.scene.beliefs_by_clock`` is for the others.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

from encircle.agents.brain.robot_core import RobotCore
from encircle.agents.estimation.spline import extrapolate
from encircle.agents.teamwork.peers import believed_positions, planning_team
from encircle.protocol.codec import decode
from encircle.protocol.keys import robot_key
from encircle.protocol.messages import Command, CommandMode, Observation
from encircle.protocol.plugins import PluginFailed
from encircle.runlog.runlog import belief_of
from encircle.scene.frame import PREDICTED_TICKS, Belief, PeerBelief
from encircle.world.scenario.model import Scenario


def shown_belief(core: RobotCore) -> Belief:
    """What a robot that has decided believes now."""
    config, state, tick = core.config, core.state, core.tick
    assert config is not None, "no setup yet"
    assert state is not None, "no setup yet"
    position, table, estimate = belief_of(core)
    own, parameters = config.own, config.parameters
    members = set(planning_team(table, own, position, tick, parameters).members)
    known = [(robot, peer) for robot, peer in enumerate(table) if peer is not None and robot != own]
    places = believed_positions([peer for _, peer in known], tick, parameters)
    peers = tuple(
        [
            PeerBelief(robot, x, y, tick - peer[0], robot in members)
            for (robot, peer), (x, y) in zip(known, places, strict=True)
        ]
    )
    if estimate is None:
        return Belief(position, peers, None, None, ())
    ahead, _ = extrapolate(state.track, config.tick_s, parameters, PREDICTED_TICKS)
    prediction = tuple([(x, y) for x, y in ahead.tolist()])
    return Belief(position, peers, estimate[:4], estimate.covariance, prediction)


RESULTS_MAX = 200
"""Ticks of which results are kept until they are taken back."""
NO_SETUP = "its setup was not seen"
OTHERWISE = "it decided otherwise than this program does"
Believed = tuple[tuple[Belief | None, ...], dict[str, str]]
"""What each robot believes at a tick, and of which robots that is not known, and why."""


class Followed(NamedTuple):
    """What has come of following one robot to a tick.

    ``belief`` and ``command``: what the new core believes and decided; or ``problem``: why that
    cannot be known. ``since``: how many setups the robot had had.
    """

    belief: Belief | None
    command: Command | None
    problem: str | None
    since: int


class LockStepBeliefs:
    """New cores for the robots of a run in lock-step, fed with what the real ones receive."""

    def __init__(self, scenario: Scenario, run: str) -> None:
        self._run = run
        self._refusals: list[str] = []
        self._cores = {
            robot: RobotCore(robot, run, self._refusals.append) for robot in scenario.ids
        }
        self._setups = dict.fromkeys(scenario.ids, 0)
        self._problems: dict[str, str] = dict.fromkeys(scenario.ids, NO_SETUP)
        self._results: dict[int, dict[str, Followed]] = {}
        self._wrong_since = dict.fromkeys(scenario.ids, -1)

    def take_setup(self, robot: str, payload: bytes) -> None:
        """A robot begins, or begins anew."""
        core, before = self._cores[robot], len(self._refusals)
        self._setups[robot] += 1
        core.receive(robot_key(self._run, robot, "setup"), payload)
        self._problems.pop(robot, None)
        if len(self._refusals) > before:
            self._problems[robot] = self._refusals[-1]
        self._refusals.clear()

    def take_observation(self, robot: str, tick: int, payload: bytes) -> None:
        """A robot is asked; it decides.

        As of a robot, ``ProtocolError`` for an observation that is none, and nothing if it comes
        once more, as it does when an answer is lost.
        """
        observation = decode(Observation, payload, self._run)
        core, problem = self._cores[robot], self._problems.get(robot)
        belief = command = None
        if problem is None:
            if tick <= core.tick:
                return
            if tick > core.tick + 1:
                problem = f"its observation of tick {core.tick + 1} was not seen"
            else:
                core.check(observation)
                try:
                    command = core.decide(observation).command
                    belief = shown_belief(core)
                except PluginFailed as error:
                    problem = str(error).partition("\n")[0]
            if problem is not None:
                self._problems[robot] = problem
        followed = Followed(belief, command, problem, self._setups[robot])
        self._results.setdefault(tick, {})[robot] = followed
        if len(self._results) > RESULTS_MAX:
            del self._results[min(self._results)]

    def take_back(self, tick: int, commands: Mapping[str, Command]) -> Believed:
        """What each robot believed at a tick, and of which that is not known.

        ``commands``: those that the robots themselves gave, as far as they are there. Ticks are
        asked for in order; what was before is forgotten.
        """
        for passed in [known for known in self._results if known < tick]:
            del self._results[passed]
        results = self._results.pop(tick, {})
        beliefs, doubts = [], {}
        for robot in self._cores:
            belief, doubt = self._judged(robot, results.get(robot), commands.get(robot))
            beliefs.append(belief)
            if doubt is not None:
                doubts[robot] = doubt
        return tuple(beliefs), doubts

    def _judged(
        self, robot: str, followed: Followed | None, command: Command | None
    ) -> tuple[Belief | None, str | None]:
        """A robot's belief, or why it is not known; neither of one that was lost."""
        if followed is None:
            return None, None
        if followed.problem is not None:
            return None, followed.problem
        if self._wrong_since[robot] == followed.since:
            return None, OTHERWISE
        if command is None or followed.command is None:
            return None, None
        if not same_decision(command, followed.command):
            self._wrong_since[robot] = followed.since
            return None, OTHERWISE
        return followed.belief, None


def same_decision(one: Command, other: Command) -> bool:
    """Whether two commands are one decision; what was refused, and when, is none.

    What somebody outside has decided says nothing of what the robot believed: it is always right.
    """
    if CommandMode.STEERED in (one.mode, other.mode):
        return True
    return _without_counts(one) == _without_counts(other)


def _without_counts(command: Command) -> Command:
    return replace(command, refused={}, timing=None)
