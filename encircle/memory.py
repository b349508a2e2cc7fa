"""A hunt inside one process: the same cores as in the real thing, joined by hand.

Every message is encoded and decoded as over Zenoh, so that the digest is the same and the recording
too; only processes, threads and sockets are left out.
"""

from collections.abc import Callable

from agents.core import RobotCore
from world.core import Record, Result, WorldCore
from world.engine import Arena


def run_in_memory(
    arena: Arena,
    run: str,
    log: Callable[[str], None],
    record: Record | None = None,
    progress: Callable[[WorldCore], None] | None = None,
) -> Result:
    """Run a hunt to its end; ``progress`` is called after every tick."""
    world = WorldCore(arena, run, log, record)
    robots = {robot: RobotCore(robot, run, log) for robot in arena.ids}
    for robot, core in robots.items():
        for key, payload in world.join(robot):
            core.receive(key, payload)
    outgoing = world.begin()
    while world.ended is None:
        asked, outgoing = outgoing, []
        # The world sends to robots in robot order, one message each.
        for core, (key, payload) in zip(robots.values(), asked, strict=True):
            for answer_key, answer in core.receive(key, payload):
                outgoing += world.receive(answer_key, answer)
        world.settle()
        if progress is not None:
            progress(world)
    return world.result()
