"""A hunt inside one process: the same cores as in the real thing, joined by hand.

Poses and commands are encoded as over Zenoh, and poses decoded by whoever the radio delivers them
to, so digest and recording are the same. Left out are processes, threads and sockets, and the
decoding of what this process has itself just encoded.
"""

from collections.abc import Callable

from agents.core import RobotCore
from protocol.codec import encode
from world.core import Record, WorldCore
from world.engine import Arena
from world.result import Result


def run_in_memory(
    arena: Arena,
    run: str,
    log: Callable[[str], None],
    record: Record | None = None,
    progress: Callable[[WorldCore], None] | None = None,
) -> Result:
    """Run a hunt to its end; ``progress`` is called at every tick but the last."""
    world = WorldCore(arena, run, log, record)
    robots = {robot: RobotCore(robot, run, log) for robot in arena.ids}
    for robot, core in robots.items():
        for key, payload in world.join(robot):
            core.receive(key, payload)
    while asked := world.ask():
        for core, observation in zip(robots.values(), asked, strict=True):
            pose, command = core.decide(observation)
            world.answer(pose, encode(pose, run), command, encode(command, run))
        world.settle()
        if progress is not None:
            progress(world)
    return world.result()
