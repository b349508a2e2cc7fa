"""A hunt inside one process: the same cores as in the real thing, joined by hand.

Poses and commands are encoded as over Zenoh, and poses decoded by whoever the radio delivers them
to, so digest and recording are the same. Left out are processes, threads and sockets, and the
decoding of what this process has itself just encoded.
"""

import gc
from collections.abc import Callable

from agents.core import RobotCore
from protocol.codec import encode, remember_pose
from world.core import Record, WorldCore
from world.engine import Arena
from world.result import Result

GARBAGE_THRESHOLD = 100_000


def run_in_memory(
    arena: Arena,
    run: str,
    log: Callable[[str], None],
    record: Record | None = None,
    progress: Callable[[WorldCore], None] | None = None,
) -> Result:
    """Run a hunt to its end; ``progress`` is called at every tick but the last."""
    thresholds = gc.get_threshold()
    # A hunt makes many short-lived tuples and no cycles; looking for cycles costs a twentieth.
    gc.set_threshold(GARBAGE_THRESHOLD, *thresholds[1:])
    try:
        return _run(WorldCore(arena, run, log, record), run, log, progress)
    finally:
        gc.set_threshold(*thresholds)


def _run(
    world: WorldCore,
    run: str,
    log: Callable[[str], None],
    progress: Callable[[WorldCore], None] | None,
) -> Result:
    robots = {robot: RobotCore(robot, run, log) for robot in world.arena.ids}
    for robot, core in robots.items():
        for key, payload in world.join(robot):
            core.receive(key, payload)
    while asked := world.ask():
        for core, observation in zip(robots.values(), asked, strict=True):
            pose, command = core.decide(observation)
            packet = b"" if pose is None else encode(pose, run)
            if pose is not None:
                remember_pose(pose, packet, run)
            world.answer(pose, packet, command, encode(command, run))
        world.settle()
        if progress is not None:
            progress(world)
    return world.result()
