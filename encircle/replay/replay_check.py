"""The result of a replay, in lock-step and by the clock."""

from dataclasses import dataclass

from encircle.agents.brain.robot_core import RobotCore


@dataclass(frozen=True, slots=True)
class ReplayCheck:
    """The result of a replay. ``differences``: (tick, robot, channel) decided differently.

    ``unchecked``: what could not be checked, and why; in lock-step only what was decided outside.
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


def steered_text(robot: str, ticks: int) -> str:
    """That a robot was steered from outside at some ticks, as a reason not to check these."""
    return (
        f"{robot}: ROS 2 has decided at {ticks} tick{'s' if ticks > 1 else ''}; not checked there"
    )


def raise_failure(core: RobotCore) -> None:
    """Raise the failure of a robot's policy, if it has failed."""
    if core.failed is not None:
        raise core.failed
