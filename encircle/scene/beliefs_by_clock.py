"""As ``encircle.scene.beliefs``, for runs by the clock: what robots received is in their receipts.

A robot may answer an observation late, pass it over or never get it, and at such a tick it decides
nothing and has no belief to show. What it received before it decided is known from the receipts in
its commands (``encircle.replay.receipts``). As long as one of the messages that they name has not
come, the robot is unsure; it is sure again when that message comes, or with a new setup.
"""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field

from encircle.agents.brain.robot_core import RobotCore
from encircle.protocol.codec import decode
from encircle.protocol.messages import Command, Pose
from encircle.protocol.real_time import Receipt
from encircle.replay.receipts import NotRecorded, RobotByReceipts
from encircle.scene.beliefs import NO_SETUP, OTHERWISE, Believed, same_decision, shown_belief
from encircle.scene.frame import Belief
from encircle.scene.radio_watch import NEVER
from encircle.world.scenario.model import Scenario

KEPT_TICKS = 600
"""For so many ticks messages are kept for receipts that name them."""
RECEIPTS_MAX = 16_384
"""Receipts of one robot that wait for what they name; with more it is unsure for good."""


@dataclass(slots=True)
class _Robot:
    """One robot's part. ``problem``: why it cannot be followed until it gets a new setup.

    ``waiting``: receipts in their order; ``seen``: the numbers of those that were taken in, by
    source; ``decided``: what it believed and decided, by tick.
    """

    again: RobotByReceipts | None = None
    problem: str | None = NO_SETUP
    observations: dict[int, bytes] = field(default_factory=dict)
    waiting: deque[Receipt] = field(default_factory=deque)
    seen: dict[str, dict[int, None]] = field(default_factory=dict)
    decided: dict[int, tuple[Belief, Command, tuple[int, ...]]] = field(default_factory=dict)


class BeliefsByClock:
    """New robots for a run by the clock, fed with what the real ones have receipts for.

    ``newest``: by robot, the tick of the newest packet that it has of each robot, in robot order,
    as of the tick taken back last; robots that are unsure are left out.
    """

    def __init__(self, scenario: Scenario, run: str) -> None:
        self.newest: dict[str, tuple[int, ...]] = {}
        self._run = run
        self._is_direct = scenario.is_direct
        self._robots = {robot: _Robot() for robot in scenario.ids}
        self._packets: dict[tuple[str, int], bytes] = {}
        self._packet_ticks: deque[tuple[int, str, int]] = deque()

    def take_setup(self, robot: str, payload: bytes) -> None:
        """A robot begins, or begins anew."""
        again = RobotByReceipts(robot, self._run, payload)
        refused = again.core.setup is None
        problem = "its setup is refused by this program" if refused else None
        # Observations stay: they are known by their ticks.
        self._robots[robot] = _Robot(again, problem, self._robots[robot].observations)

    def take_observation(self, robot: str, tick: int, payload: bytes) -> None:
        """A robot is asked."""
        self._robots[robot].observations[tick] = payload

    def take_packet(self, robot: str, payload: bytes) -> None:
        """A robot has sent a packet; its peers may have received it directly."""
        if self._is_direct:
            pose = decode(Pose, payload, self._run)
            self._packets[robot, pose.sequence] = payload
            self._packet_ticks.append((pose.tick, robot, pose.sequence))

    def take_command(self, robot: str, command: Command) -> None:
        """A robot's command has come, with receipts of what it had received by then."""
        part = self._robots[robot]
        for receipt in command.timing.receipts if command.timing else ():
            seen = part.seen.setdefault(receipt.source, {})
            if receipt.number not in seen:
                seen[receipt.number] = None
                part.waiting.append(receipt)
                if len(seen) > RECEIPTS_MAX:
                    del seen[next(iter(seen))]
        if len(part.waiting) > RECEIPTS_MAX:
            part.problem = "too much of what it received is missing"
            part.waiting.clear()

    def take_back(self, tick: int, commands: Mapping[str, Command]) -> Believed:
        """As ``LockStepBeliefs.take_back``, of every robot that decided at the tick."""
        beliefs, doubts = [], {}
        for robot, part in self._robots.items():
            belief, doubt = self._follow(robot, part, tick, commands.get(robot))
            beliefs.append(belief)
            if doubt is not None:
                doubts[robot] = doubt
                self.newest.pop(robot, None)
            self._forget(part, tick)
        while self._packet_ticks and self._packet_ticks[0][0] < tick - KEPT_TICKS:
            _, sender, sequence = self._packet_ticks.popleft()
            self._packets.pop((sender, sequence), None)
        return tuple(beliefs), doubts

    def _follow(
        self, robot: str, part: _Robot, tick: int, command: Command | None
    ) -> tuple[Belief | None, str | None]:
        """A robot's belief at a tick, if it decided then, or why it is not known."""
        missing = None if part.problem is not None else self._let_receive(part)
        decided = part.decided.get(tick)
        if decided is not None and (command is None or same_decision(decided[1], command)):
            self.newest[robot] = decided[2]
            return decided[0], None
        if decided is not None:
            part.problem = OTHERWISE
        return None, part.problem or missing

    def _let_receive(self, part: _Robot) -> str | None:
        """Let a robot receive what there is; returns what the next receipt is in want of."""
        again = part.again
        assert again is not None, "it has no problem"
        while part.waiting:
            try:
                is_asked = again.receive(part.waiting[0], part.observations, self._packets)
            except NotRecorded as reason:
                return str(reason)
            receipt = part.waiting.popleft()
            if not is_asked:
                continue
            answer = again.decide()
            if again.core.failed is not None:
                part.problem = str(again.core.failed).partition("\n")[0]
            elif answer is None:
                part.problem = OTHERWISE
            else:
                newest = _newest_ticks(again.core)
                part.decided[receipt.number] = shown_belief(again.core), answer[0].command, newest
            if part.problem is not None:
                return None
        return None

    def _forget(self, part: _Robot, tick: int) -> None:
        for decided in [known for known in part.decided if known <= tick]:
            del part.decided[decided]
        # They are there in the order of their ticks.
        while part.observations and (oldest := next(iter(part.observations))) < tick - KEPT_TICKS:
            del part.observations[oldest]


def _newest_ticks(core: RobotCore) -> tuple[int, ...]:
    assert core.state is not None, "it has decided"
    return tuple([NEVER if packet is None else packet.tick for packet in core.state.packets])
