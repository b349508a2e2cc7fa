"""The answers of several robots in one process, phase by phase.

First all perceive, then all decide, then all act. Each robot keeps its own core and decides on its
own view alone, so what comes out is what ``decide`` of each core gives, one after the other. It
comes sooner, since the code of a phase stays in the processor's caches. Sans I/O.
"""

from collections.abc import Sequence

from encircle.agents.brain.brain import Action
from encircle.agents.brain.robot_core import RobotCore
from encircle.protocol.messages import Observation


def decide_together(
    cores: Sequence[RobotCore], observations: Sequence[Observation]
) -> list[Action]:
    """The answer of each core to its observation; raises as ``RobotCore.decide``.

    A world in this process has made the observations, so that their values are not checked.

    If a policy fails it is the first one, in this order, that is raised; the others may have taken
    their observations in or not.
    """
    if any(core.failed is not None for core in cores):
        # One that has failed raises before it perceives, and others before it may fail first.
        return [core.decide(seen) for core, seen in zip(cores, observations, strict=True)]
    perceptions = [core.perceive_own(seen) for core, seen in zip(cores, observations, strict=True)]
    decided = [
        core.decide_on(perception) for core, perception in zip(cores, perceptions, strict=True)
    ]
    return [
        core.act(perception, decision, memory)
        for core, perception, (memory, decision) in zip(cores, perceptions, decided, strict=True)
    ]
