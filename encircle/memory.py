"""A hunt inside one process: the same cores as in the real thing, joined by hand.

Poses and commands are encoded as over Zenoh, and poses decoded by whoever the radio delivers them
to, so digest and recording are the same. Left out are processes, threads and sockets, and the
decoding of what this process has itself just encoded.
"""

import gc
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import NamedTuple, Protocol

from agents.core import RobotCore
from protocol.codec import encode, remember_pose
from protocol.messages import Command
from world.core import Record, WorldCore
from world.engine import Arena
from world.result import Result

GARBAGE_THRESHOLD = 100_000


class Answer(NamedTuple):
    """One robot's answer at a tick. ``packet``: its encoded pose, empty if it publishes none."""

    packet: bytes
    command: Command


class Watch(Protocol):
    """Someone who looks on at a hunt in memory, and must change nothing."""

    def decided(
        self, world: WorldCore, robots: Sequence[RobotCore], answers: Sequence[Answer]
    ) -> None:
        """All robots have answered, in robot order, at the tick that ``world.state`` shows.

        ``world.fates`` are those of the packets of the tick before, None at the first.
        """

    def ended(self, world: WorldCore) -> None:
        """The run is over; state and fates are the last."""


def run_in_memory(
    arena: Arena,
    run: str,
    log: Callable[[str], None],
    record: Record | None = None,
    progress: Callable[[WorldCore], None] | None = None,
    watch: Watch | None = None,
) -> Result:
    """Run a hunt to its end; ``progress`` is called at every tick but the last."""
    with little_garbage():
        return _run(WorldCore(arena, run, log, record), run, log, progress, watch)


@contextmanager
def little_garbage() -> Iterator[None]:
    """Look for cycles rarely, where many tuples are made and no cycles."""
    thresholds = gc.get_threshold()
    # In a hunt, looking for cycles costs a twentieth.
    gc.set_threshold(GARBAGE_THRESHOLD, *thresholds[1:])
    try:
        yield
    finally:
        gc.set_threshold(*thresholds)


def _run(
    world: WorldCore,
    run: str,
    log: Callable[[str], None],
    progress: Callable[[WorldCore], None] | None,
    watch: Watch | None,
) -> Result:
    robots = [RobotCore(robot, run, log) for robot in world.arena.ids]
    for core in robots:
        for key, payload in world.join(core.robot):
            core.receive(key, payload)
    while asked := world.ask():
        answers = []
        for core, observation in zip(robots, asked, strict=True):
            pose, command = core.decide(observation)
            packet = b"" if pose is None else encode(pose, run)
            if pose is not None:
                remember_pose(pose, packet, run)
            world.answer(pose, packet, command, encode(command, run))
            answers.append(Answer(packet, command))
        world.settle()
        if watch is not None:
            watch.decided(world, robots, answers)
        if progress is not None:
            progress(world)
    if watch is not None:
        watch.ended(world)
    return world.result()
