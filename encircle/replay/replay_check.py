"""The result of a replay, in lock-step and by the clock."""

from dataclasses import dataclass

from encircle.agents.brain.robot_core import RobotCore


@dataclass(frozen=True, slots=True)
class ReplayCheck:
    """The result of a replay. ``differences``: (tick, robot, channel) decided differently.

    ``unchecked``: what could not be checked, and why; nothing in lock-step.
    """

    ticks: int
    robots: int
    compared: int
    differences: tuple[tuple[int, str, str], ...]
    complete: bool
    unchecked: tuple[str, ...] = ()

    @property
    def same(self) -> bool:
        """Whether every decision was compared equal, and there was at least one."""
        return self.compared > 0 and not self.differences


def raise_failure(core: RobotCore) -> None:
    """Raise the failure of a robot's policy, if it has failed."""
    if core.failed is not None:
        raise core.failed
