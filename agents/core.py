"""One robot's side of the protocol, sans I/O: messages in, messages out.

The shell that owns a link feeds in what arrives and sends what comes back. What is refused is
counted by cause, and told to ``log`` once per message; the counts travel to the world with each
command, so that nothing is lost silently.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import replace

from agents import brain
from agents.strategies import strategy_named
from protocol.codec import decode, decode_pose, encode
from protocol.errors import MalformedMessage, OutOfTurn, ProtocolError, WrongSender
from protocol.keys import parse_key, robot_key
from protocol.messages import End, Observation, Pose, Setup
from protocol.parameters import Parameters


class RobotCore:
    """The protocol around one brain. ``ended`` holds the reason once the run is over."""

    def __init__(
        self, robot: str, run: str, log: Callable[[str], None] = lambda _line: None
    ) -> None:
        self.robot = robot
        self.run = run
        self.ended: str | None = None
        self.refused: Counter[str] = Counter()
        self.role: brain.Role | None = None
        self._state: brain.BrainState | None = None
        self._tick = -1
        self._log = log
        self._pose_key = robot_key(run, robot, "pose")
        self._command_key = robot_key(run, robot, "command")

    def receive(self, key: str, payload: bytes) -> list[tuple[str, bytes]]:
        """Take one message in; returns the messages to send. Never raises for remote input."""
        try:
            return self._receive(key, payload)
        except ProtocolError as error:
            self._refuse(key, error)
            return []

    def _receive(self, key: str, payload: bytes) -> list[tuple[str, bytes]]:
        _, robot, channel = parse_key(key)
        if robot != self.robot:
            raise WrongSender(f"meant for {robot}")
        if channel == "observation":
            return self._observe(decode(Observation, payload, self.run))
        if channel == "setup":
            self._set_up(decode(Setup, payload, self.run))
        elif channel == "end":
            self.ended = decode(End, payload, self.run).reason
        else:
            raise OutOfTurn(f"a robot does not listen to {channel!r}")
        return []

    def _set_up(self, setup: Setup) -> None:
        if self.role is not None:
            raise OutOfTurn("setup came twice")
        if setup.robot != self.robot or self.robot not in setup.team:
            raise WrongSender(f"setup is for {setup.robot} in team {', '.join(setup.team)}")
        try:
            self.role = brain.Role(
                self.robot,
                setup.team,
                setup.tick_s,
                strategy_named(setup.strategy),
                Parameters.from_mapping(setup.parameters),
            )
        except ValueError as error:
            raise MalformedMessage(f"Setup: {error}") from None
        self._state = brain.initial(self.role)

    def _observe(self, observation: Observation) -> list[tuple[str, bytes]]:
        if self.role is None or self._state is None:
            raise OutOfTurn(f"observation of tick {observation.tick} before setup")
        if observation.robot != self.robot:
            raise WrongSender(f"observation is for {observation.robot}")
        strangers = {robot for robot, _ in observation.seen} - set(self.role.team)
        if strangers:
            raise MalformedMessage(f"Observation: seen {sorted(strangers)[:5]}, not of this team")
        if observation.tick != self._tick + 1:
            raise OutOfTurn(f"observation of tick {observation.tick} after tick {self._tick}")
        self._tick = observation.tick
        packets = [p for p in map(self._opened, observation.inbox) if p is not None]
        self._state, action = brain.step(self._state, observation, packets, self.role)
        command = action.command
        if self.refused:
            command = replace(command, refused=dict(sorted(self.refused.items())))
        return [
            (self._pose_key, encode(action.pose, self.run)),
            (self._command_key, encode(command, self.run)),
        ]

    def _opened(self, packet: bytes) -> Pose | None:
        """A pose packet of the inbox, or None if it is refused."""
        assert self.role is not None
        try:
            pose = decode_pose(packet, self.run)
            if pose.robot == self.robot or pose.robot not in brain.places_in(self.role.team):
                raise WrongSender(f"pose from {pose.robot}")
            return pose
        except ProtocolError as error:
            self._refuse("inbox", error)
            return None

    def _refuse(self, key: str, error: ProtocolError) -> None:
        self.refused[error.cause] += 1
        self._log(f"{self.robot} refused a message on {key}: {error}")
