"""A robot of a run by the clock, which receives again what its receipts say that it received.

In lock-step the observations suffice. Here a robot answers the newest observation that it has, and
may receive packets from its peers directly. The receipts in its commands show in which order it has
received packets, passed over observations and answered them (``encircle.protocol.real_time``), and
the world has recorded observations and packets.
"""

from collections.abc import Mapping

from encircle.agents.brain.brain import Action
from encircle.agents.brain.real_time_core import Outgoing, RealTimeRobotCore
from encircle.agents.brain.robot_core import RobotCore
from encircle.protocol.keys import robot_key
from encircle.protocol.real_time import Receipt, ReceiptKind

Packets = Mapping[tuple[str, int], bytes]
"""Packets by sender and sequence."""


class NotRecorded(Exception):
    """What a robot had received cannot be reconstructed; the message says why."""


class RobotByReceipts:
    """A new robot in one participation. ``core.setup`` is None if its setup was refused."""

    def __init__(self, robot: str, run: str, setup: bytes) -> None:
        self.core = RobotCore(robot, run)
        self.core.receive(robot_key(run, robot, "setup"), setup)
        self._robot = robot
        self._run = run
        self._by_clock = RealTimeRobotCore(self.core) if self.core.setup is not None else None

    def receive(
        self, receipt: Receipt, observations: Mapping[int, bytes], packets: Packets
    ) -> bool:
        """Receive what a receipt is for; whether the robot then has an observation to answer.

        ``observations``: by tick. ``NotRecorded`` if it is not among these; nothing has changed
        then.
        """
        assert self._by_clock is not None, "without a setup there is nothing to receive"
        if receipt.kind is ReceiptKind.PACKET:
            packet = packets.get((receipt.source, receipt.number))
            if packet is None:
                raise NotRecorded(
                    f"packet {receipt.number} of {receipt.source}, which it received, did not"
                    " reach the world"
                )
            key = robot_key(self._run, receipt.source, "pose")
            self._by_clock.take(receipt.arrival_us, key, packet)
            return False
        observation = observations.get(receipt.number)
        if observation is None:
            raise NotRecorded(f"the observation of tick {receipt.number} is not recorded")
        self._by_clock.take(0, robot_key(self._run, self._robot, "observation"), observation)
        return receipt.kind is ReceiptKind.ANSWERED

    def decide(self) -> tuple[Action, Outgoing] | None:
        """Answer the observation: what is decided and sent; None if the robot would not."""
        assert self._by_clock is not None, "without a setup there is nothing to decide"
        action = self._by_clock.decide()
        return None if action is None else (action, self._by_clock.messages(action, 0))
