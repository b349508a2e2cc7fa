"""One robot's side of the protocol, sans I/O: messages in, messages out.

The shell passes in what arrives on its connection and sends what is returned. What is refused is
counted by cause, and ``log`` gets a line on each message; the counts travel to the world with each
command, so that nothing is lost silently.
"""

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from encircle.agents.brain import brain
from encircle.agents.brain.observation_check import problem_of
from encircle.agents.policies.interface import Decision, Policy, View
from encircle.agents.policies.registry import policy_named
from encircle.protocol.codec import decode, decode_pose, encode
from encircle.protocol.errors import (
    MalformedMessage,
    OutOfTurn,
    ProtocolError,
    WrongRun,
    WrongSender,
    WrongVersion,
)
from encircle.protocol.keys import parse_key, robot_key
from encircle.protocol.messages import Command, CommandMode, End, Observation, Pose, Setup
from encircle.protocol.parameters import BODIES, Parameters
from encircle.protocol.plugins import STRATEGIES, PluginFailed, PluginLoadError, UnknownPlugin


class RobotCore:
    """The protocol around one brain. ``ended`` holds the reason once the run is over.

    ``accepted`` counts messages that were not refused: as long as it grows, there is a world.
    ``version_mismatch``: the line on the newest message that was refused because it is of another
    version, if there was one.

    ``failed``: how the robot's own code has failed, if it has. From then on the robot's commands
    say only that, whatever it observes; ``decide`` raises it, and ``report_failure`` gets it.

    ``receive`` takes bytes and never raises for them; ``decide`` is the same for an observation
    that is already decoded, for hunts inside one process. A setup starts a new brain at any time: a
    robot that was lost is readmitted with one. ``tick``: that of the last observation; ``mode``:
    what the robot then did; ``setups``: how many it has had.
    """

    def __init__(
        self,
        robot: str,
        run: str,
        log: Callable[[str], None] = lambda _line: None,
        report_failure: Callable[[PluginFailed], None] = lambda _failure: None,
    ) -> None:
        self.robot = robot
        self.run = run
        self.ended: str | None = None
        self.failed: PluginFailed | None = None
        self._last_failure: PluginFailed | None = None
        self.refused: Counter[str] = Counter()
        self.accepted = 0
        self.version_mismatch: str | None = None
        self.setup: Setup | None = None
        self.config: brain.RobotConfig | None = None
        self.state: brain.BrainState | None = None
        self.tick = -1
        self.mode = ""
        self.setups = 0
        self._answer_tick = 0
        self._timed: bool | None = None
        self._answered: bytes | None = None
        self._answer: list[tuple[str, bytes]] = []
        self._log = log
        self._report_failure = report_failure
        self._pose_key = robot_key(run, robot, "pose")
        self._command_key = robot_key(run, robot, "command")

    def receive(self, key: str, payload: bytes) -> list[tuple[str, bytes]]:
        """Take one message in; returns the messages to send. Never raises for remote input."""
        try:
            answer = self._receive(key, payload)
        except ProtocolError as error:
            self.refuse(key, error)
            return []
        self.accepted += 1
        return answer

    def _receive(self, key: str, payload: bytes) -> list[tuple[str, bytes]]:
        run, robot, channel = parse_key(key)
        if run != self.run:
            raise WrongRun(f"key of run {run!r}, this is {self.run!r}")
        if robot != self.robot:
            raise WrongSender(f"meant for {robot}")
        if channel == "observation":
            # The same once more means that the answer was lost: nothing is decided anew.
            if payload != self._answered:
                action = self.answer(decode(Observation, payload, self.run))
                self._answered, self._answer = payload, []
                if action.command.tick < self._answer_tick:
                    return []
                self._answer = [(self._command_key, encode(action.command, self.run))]
                if action.pose is not None:
                    self._answer.insert(0, (self._pose_key, encode(action.pose, self.run)))
            return self._answer
        if channel == "setup":
            self._set_up(decode(Setup, payload, self.run))
        elif channel == "end":
            end = decode(End, payload, self.run)
            if end.robot != self.robot:
                raise WrongSender(f"end is for {end.robot}")
            self.ended = end.reason
        else:
            raise OutOfTurn(f"a robot does not listen to {channel!r}")
        return []

    def _set_up(self, setup: Setup) -> None:
        if setup.robot != self.robot or self.robot not in setup.team:
            raise WrongSender(f"setup is for {setup.robot} in team {', '.join(setup.team)}")
        missing = [name for name in BODIES if name not in setup.parameters]
        if missing:
            raise MalformedMessage(f"Setup: parameters lack {', '.join(missing)}")
        try:
            policy, failed = self._policy_of(setup)
            parameters = Parameters.from_mapping(setup.parameters)
        except ValueError as error:
            raise MalformedMessage(f"Setup: {error}") from None
        config = brain.RobotConfig(
            self.robot, setup.team, setup.tick_s, policy, parameters, setup.strategy
        )
        # Nothing is kept of an earlier participation: the track may have a gap too long to bridge.
        self.setup, self.config, self.failed = setup, config, failed
        self.state = brain.initial(config, setup.first_tick)
        self.tick, self._answer_tick = setup.first_tick - 1, setup.answer_tick
        self.setups += 1
        self._answered = None

    def _policy_of(self, setup: Setup) -> tuple[Policy, PluginFailed | None]:
        """The policy of a setup, or why it cannot be loaded; ``ValueError`` if it is unknown."""
        try:
            parameters = setup.policy_parameters
            return policy_named(setup.strategy, parameters, setup.policy_source), None
        except UnknownPlugin as error:
            raise ValueError(f"strategy = {setup.strategy!r}: {error}") from None
        except PluginLoadError as error:
            failed = PluginFailed(STRATEGIES, setup.strategy, self.robot, setup.first_tick, error)
            return _no_policy, failed

    def answer(self, observation: Observation) -> brain.Action:
        """As ``decide``; a robot whose own code fails answers with that failure instead."""
        try:
            return self.decide(observation)
        except PluginFailed as error:
            if error is not self._last_failure:
                self.failed = self._last_failure = error
                self._report_failure(error)
            return brain.Action(None, _failure_command(observation))

    def check(self, observation: Observation) -> None:
        """Raise for an observation that cannot be answered; nothing changes.

        ``OutOfTurn`` before setup or if its tick is not the next one, ``WrongSender`` if it is for
        another robot, ``MalformedMessage`` for values that are impossible for this robot.
        """
        setup, config = self._check_turn(observation)
        problem = problem_of(observation, setup, config)
        if problem is not None:
            raise MalformedMessage(f"Observation: {problem}")

    def _check_turn(self, observation: Observation) -> tuple[Setup, brain.RobotConfig]:
        """The first part of ``check``: whether an observation is for this robot, and its turn."""
        if self.setup is None or self.config is None:
            raise OutOfTurn(f"observation of tick {observation.tick} before setup")
        if observation.robot != self.robot:
            raise WrongSender(f"observation is for {observation.robot}")
        # By the clock a robot leaves out observations that came late or never.
        by_clock = observation.sent_us is not None and observation.tick > self.tick
        if observation.tick != self.tick + 1 and not by_clock:
            raise OutOfTurn(f"observation of tick {observation.tick} after tick {self.tick}")
        if self._timed not in (None, observation.sent_us is not None):
            raise MalformedMessage("Observation: sent_us is null in lock-step, and only there")
        return self.setup, self.config

    def decide(self, observation: Observation) -> brain.Action:
        """Answer an observation; raises as ``check``, or ``PluginFailed`` if the policy fails."""
        self.check(observation)
        state, packets, config = self._begin(observation)
        refused = self._refused_so_far()
        self.state, action = brain.step(state, observation, packets, config, refused)
        return self._acted(action)

    def perceive(self, observation: Observation) -> brain.Perception:
        """The first half of ``decide``, for a caller who decides himself; raises as that."""
        self.check(observation)
        return self._perceived(observation)

    def perceive_own(self, observation: Observation) -> brain.Perception:
        """As ``perceive``, of an observation that a world in this process has just made.

        Its values need no check; whether it is its turn is checked as ever.
        """
        self._check_turn(observation)
        return self._perceived(observation)

    def _perceived(self, observation: Observation) -> brain.Perception:
        state, packets, config = self._begin(observation)
        return brain.perceive(state, observation, packets, config)

    def decide_on(self, perception: brain.Perception) -> tuple[Any, Decision]:
        """What its policy remembers and decides; ``PluginFailed`` if the policy fails."""
        assert self.config is not None, "it has perceived"
        return brain.decide(perception.state.memory, perception.view, self.config)

    def act(
        self, perception: brain.Perception, decision: Decision, memory: Any = None
    ) -> brain.Action:
        """The second half: what a valid decision comes to; the policy will remember ``memory``."""
        assert self.config is not None, "it has perceived"
        refused = self._refused_so_far()
        self.state, action = brain.act(perception, memory, decision, self.config, refused)
        return self._acted(action)

    def _begin(
        self, observation: Observation
    ) -> tuple[brain.BrainState, list[Pose], brain.RobotConfig]:
        assert self.config is not None, "checked"
        assert self.state is not None, "checked"
        self.tick, self._timed = observation.tick, observation.sent_us is not None
        if self.failed is not None:
            raise self.failed
        packets = self._packets_of(observation, brain.indices_of(self.config.team))
        return self.state, packets, self.config

    def _acted(self, action: brain.Action) -> brain.Action:
        self.mode = action.command.mode
        return action

    def _refused_so_far(self) -> Mapping[str, int]:
        """How many messages were refused so far, by cause; a copy, in the order of the causes."""
        return dict(sorted(self.refused.items())) if self.refused else brain.NOTHING_REFUSED

    def _packets_of(self, observation: Observation, indices: Mapping[str, int]) -> list[Pose]:
        """The packets in an observation's inbox that can be from peers; others are refused."""
        packets = []
        for packet in observation.inbox:
            try:
                pose = decode_pose(packet, self.run)
                if pose.robot not in indices or pose.robot == self.robot:
                    raise WrongSender(f"pose from {pose.robot}")
                if pose.tick >= observation.tick:
                    raise OutOfTurn(f"pose of tick {pose.tick} at tick {observation.tick}")
            except ProtocolError as error:
                self.refuse("inbox", error)
                continue
            packets.append(self._without_invalid_relays(pose, indices) if pose.relayed else pose)
        return packets

    def _without_invalid_relays(self, pose: Pose, indices: Mapping[str, int]) -> Pose:
        """The pose without those relayed detections that are impossible, which are refused."""
        valid = []
        for detection in pose.relayed:
            origin, tick = detection[:2]
            if origin in indices and tick < pose.tick:
                valid.append(detection)
                continue
            complaint = f"{pose.robot} relays a detection by {origin!r} of tick {tick}"
            if origin not in indices:
                self.refuse("inbox", WrongSender(f"{complaint}, not of this team"))
            else:
                self.refuse("inbox", OutOfTurn(f"{complaint} at tick {pose.tick}"))
        return pose if len(valid) == len(pose.relayed) else replace(pose, relayed=tuple(valid))

    def refuse(self, key: str, error: ProtocolError) -> None:
        """Count and log something that was refused."""
        self.refused[error.cause] += 1
        line = f"{self.robot} refused a message on {key}: {error}"
        if isinstance(error, WrongVersion):
            self.version_mismatch = line
        self._log(line)


def _no_policy(_memory: None, view: View) -> tuple[None, Decision]:
    raise AssertionError(f"a robot without a policy is not to decide: {view}")


def _failure_command(observation: Observation) -> Command:
    """The command of a robot whose own code has failed: it stands still."""
    robot, tick = observation.robot, observation.tick
    return Command(
        robot, tick, (0.0, 0.0), CommandMode.FAILED, None, None, None, None, None, (), False
    )
