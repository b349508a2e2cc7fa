"""What several test modules of the world share: small scenarios and robots that follow a script."""

from collections.abc import Callable, Iterator, Mapping
from fractions import Fraction
from typing import Any

import numpy as np

from encircle.protocol.codec import encode
from encircle.protocol.keys import robot_key
from encircle.protocol.messages import Command, Point, Pose
from encircle.world.arena import engine
from encircle.world.arena.engine import Arena, build
from encircle.world.coordinator.world_core import WorldCore
from encircle.world.loading.load import load
from encircle.world.scenario.model import Scenario

RUN = "tested"
SQUARE = ((4.0, 0.0), (0.0, 4.0), (-4.0, 0.0), (0.0, -4.0))
QUANTA_PER_M = 2**20


def small(*overrides: str, **sections: Any) -> Scenario:
    """Four robots around a target that stays still, for ten ticks; changed as asked."""
    tree: dict[str, Any] = {
        "ticks_max": 10,
        "team": {"positions": SQUARE},
        "target": {"behaviour": "still"},
    }
    return load({**tree, **sections}, overrides)


def arena(*overrides: str, **sections: Any) -> Arena:
    scenario = small(*overrides, **sections)
    return build(scenario, scenario.seed)


def pose(robot: str, tick: int, **changes: Any) -> Pose:
    values: dict[str, Any] = {
        "robot": robot,
        "tick": tick,
        "sequence": tick,
        "position": (1.0, 2.0),
        "velocity": (0.0, 0.0),
        "detection": None,
        "mode": "script",
        "xi": None,
        "point": None,
    }
    return Pose(**(values | changes))


def command(robot: str, tick: int, step: Point = (0.0, 0.0), **changes: Any) -> Command:
    values: dict[str, Any] = {
        "robot": robot,
        "tick": tick,
        "step": step,
        "mode": "script",
        "xi": None,
        "point": None,
        "goal": None,
        "estimate": None,
        "predictor": None,
        "team": (),
    }
    return Command(**(values | changes))


def step_of(robot: str, tick: int) -> Point:
    """Some step, another one for every robot and tick."""
    turn = 2.4 * tick + int(robot.removeprefix("r"))
    return 0.25 * float(np.cos(turn)), 0.25 * float(np.sin(turn))


def answers(core: WorldCore, **changes: Any) -> list[tuple[str, bytes]]:
    """Every robot's pose and command for the tick that is asked for, by the script."""
    found = []
    for robot in core.arena.ids:
        said = pose(robot, core.rounds.table.tick)
        asked = command(
            robot, core.rounds.table.tick, step_of(robot, core.rounds.table.tick), **changes
        )
        found.append((robot_key(core.run, robot, "pose"), encode(said, core.run)))
        found.append((robot_key(core.run, robot, "command"), encode(asked, core.run)))
    return found


def departures_of(core: WorldCore) -> list[tuple[int, str, str]]:
    """Who was lost and came back so far, as results show it."""
    return [departure.row for departure in core.rounds.departures]


def begun(core: WorldCore) -> WorldCore:
    for robot in core.arena.ids:
        core.join(robot)
    core.begin()
    return core


def rounds(core: WorldCore) -> Iterator[int]:
    """Yields each tick of a begun run before its answers go in, until the run has ended."""
    while core.ended is None:
        yield core.state.tick
        for key, payload in answers(core):
            core.receive(key, payload)


def played(
    arena: Arena, run: str = RUN, record: Callable[[int, str, bytes], None] | None = None
) -> WorldCore:
    """A run by the script, from its start to its end."""
    core = begun(WorldCore(arena, run, record=record))
    for _ in rounds(core):
        pass
    core.rounds.commit()
    return core


def packets(tick: int, count: int = 4) -> list[bytes]:
    return [f"packet of r{k + 1} at {tick}".encode() for k in range(count)]


def walked(
    hunted: Arena, ticks: int, steps: Callable[[int], np.ndarray] | None = None
) -> list[engine.ArenaState]:
    """The states of an arena in which ``steps(tick)`` are commanded, or none."""
    count = len(hunted.ids)
    states = [engine.initial(hunted)]
    for tick in range(ticks):
        wanted = steps(tick) if steps else np.zeros((count, 2))
        states.append(engine.advance(hunted, states[-1], wanted, packets(tick, count))[0])
    return states


def overlapping(positions: np.ndarray, radii: np.ndarray, moving: int) -> list[tuple[int, int]]:
    """The pairs of discs that overlap, in exact arithmetic; ``positions`` whole in quanta."""
    quanta = [(int(x), int(y)) for x, y in (positions * QUANTA_PER_M).tolist()]
    exact = [Fraction(r) * QUANTA_PER_M for r in radii.tolist()]
    found = []
    for i in range(moving):
        for k in range(i + 1, len(quanta)):
            squared = (quanta[i][0] - quanta[k][0]) ** 2 + (quanta[i][1] - quanta[k][1]) ** 2
            if squared < (exact[i] + exact[k]) ** 2:
                found.append((i, k))
    return found


def frozen(value: Any) -> Any:
    """A deep copy that can be compared, arrays as bytes."""
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    if isinstance(value, Mapping):
        return {key: frozen(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [frozen(item) for item in value]
    return value
