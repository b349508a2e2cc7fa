"""A hunt inside one process: the same cores as over Zenoh, without connections between them.

Poses and commands are encoded as over Zenoh, and poses are decoded by the robots to which the
channel delivers them, so digest and recording are the same. Left out are processes, threads and
sockets, and the decoding of what this process has itself just encoded.
"""

import gc
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import NamedTuple, Protocol

from encircle.agents.brain.co_hosted import decide_together
from encircle.agents.brain.robot_core import RobotCore
from encircle.protocol.codec import decode, encode, remember_pose
from encircle.protocol.keys import channel_of, parse_key
from encircle.protocol.messages import Command, Observation, Pose
from encircle.protocol.plugins import PluginFailed
from encircle.world.arena.engine import Arena
from encircle.world.coordinator.journal import Record
from encircle.world.coordinator.result import Result
from encircle.world.coordinator.world_core import WorldCore
from encircle.world.recording.resuming import Resumed

GARBAGE_THRESHOLD = 100_000


class RobotAnswer(NamedTuple):
    """One robot's answer at a tick. ``packet``: its encoded pose, empty if it publishes none."""

    packet: bytes
    command: Command


class RunEndedByPlugin(Exception):
    """A run that a plug-in has ended: how it failed, and what had come of the run so far."""

    def __init__(self, failed: PluginFailed, result: Result) -> None:
        super().__init__(str(failed))
        self.failed = failed
        self.result = result


class RunObserver(Protocol):
    """Code that looks on at a hunt in memory, and must change nothing."""

    def decided(
        self, world: WorldCore, robots: Sequence[RobotCore], answers: Sequence[RobotAnswer | None]
    ) -> None:
        """All robots have answered, in robot order, at the tick that ``world.state`` shows.

        None in place of its answer for a robot that is lost. ``world.rounds.fates`` are those of
        the packets of the tick before, None at the first.
        """

    def ended(self, world: WorldCore) -> None:
        """The run is over; state and fates are the last."""


def run_in_memory(
    arena: Arena,
    run: str,
    log: Callable[[str], None],
    record: Record | None = None,
    progress: Callable[[WorldCore], None] | None = None,
    observer: RunObserver | None = None,
    resumed: Resumed | None = None,
) -> Result:
    """Run a hunt to its end; ``progress`` is called at every tick but the last.

    ``resumed``: a hunt to go on with instead of beginning one. ``RunEndedByPlugin`` if a
    policy or the target's behaviour fails.
    """
    with rare_garbage_collection():
        if resumed is None:
            world, cores = joined(arena, run, log, record)
            observations = next_observations(world, cores, observer, progress)
        else:
            world, cores = resumed.core, {robot: RobotCore(robot, run, log) for robot in arena.ids}
            world.record_with(record)
            observations = _resumed_observations(resumed, cores)
        try:
            _run(world, cores, observations, progress, observer)
        except PluginFailed as error:
            world.rounds.fail(str(error), error)
        failure = world.rounds.plugin_failure
        if failure is not None:
            raise RunEndedByPlugin(failure, world.rounds.result()) from failure
        return world.rounds.result()


def joined(
    arena: Arena, run: str, log: Callable[[str], None], record: Record | None = None
) -> tuple[WorldCore, dict[str, RobotCore]]:
    """A world, and its robots by id, each of which has joined and been set up."""
    world = WorldCore(arena, run, log, record)
    cores = {robot: RobotCore(robot, run, log) for robot in arena.ids}
    for robot, core in cores.items():
        for key, payload in world.join(robot):
            core.receive(key, payload)
    return world, cores


def give_answer(world: WorldCore, pose: Pose | None, command: Command) -> RobotAnswer:
    """Give the world a robot's answer, encoded as over Zenoh; returns it."""
    packet = b"" if pose is None else encode(pose, world.run)
    if pose is not None:
        remember_pose(pose, packet, world.run)
    world.answer(pose, packet, command, encode(command, world.run))
    return RobotAnswer(packet, command)


@contextmanager
def rare_garbage_collection() -> Iterator[None]:
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
    cores: Mapping[str, RobotCore],
    observations: list[Observation],
    progress: Callable[[WorldCore], None] | None,
    observer: RunObserver | None,
) -> None:
    robots = tuple(cores.values())
    while observations:
        answers: dict[str, RobotAnswer] = {}
        asked = [cores[observation.robot] for observation in observations]
        for core, action in zip(asked, decide_together(asked, observations), strict=True):
            answers[core.robot] = give_answer(world, *action)
        world.rounds.commit()
        if observer is not None:
            observer.decided(world, robots, [answers.get(robot) for robot in cores])
        if progress is not None:
            progress(world)
        observations = next_observations(world, cores, observer, progress)
    if observer is not None and world.rounds.plugin_failure is None:
        observer.ended(world)


def next_observations(
    world: WorldCore,
    cores: Mapping[str, RobotCore],
    observer: RunObserver | None = None,
    progress: Callable[[WorldCore], None] | None = None,
) -> list[Observation]:
    """The observations of the next round that anyone is there for; none when the run is over."""
    while not (observations := world.ask()) and world.ended is None:
        world.rounds.commit()
        if observer is not None:
            observer.decided(world, tuple(cores.values()), [None] * len(cores))
        if progress is not None:
            progress(world)
    for key, payload in world.rounds.open_round.setups:
        cores[parse_key(key).robot or ""].receive(key, payload)
    return observations


def _resumed_observations(resumed: Resumed, cores: Mapping[str, RobotCore]) -> list[Observation]:
    """The observations of the round that was under way; each robot first gets its history."""
    world, observations = resumed.core, []
    for robot in world.rounds.lost:
        # It is present now, and takes part again from the next round on.
        world.join(robot)
    for robot, history in resumed.histories.items():
        for key, payload in history:
            cores[robot].receive(key, payload)
    for key, payload in world.rounds.unanswered():
        if channel_of(key) == "observation":
            observations.append(decode(Observation, payload, world.run))
        else:
            cores[parse_key(key).robot or ""].receive(key, payload)
    return observations
