"""How the target behaves. A behaviour is any callable of the form of ``Behaviour``.

Those of other packages are found by entry point, group ``encircle.targets``. A behaviour is pure:
what it wants to remember it returns and is given back at the next tick. Keyword-only arguments are
its parameters, set in the scenario under ``target.parameters``.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from math import atan2, cos, hypot, pi, sin
from typing import Annotated, Any, NamedTuple, TypeAlias

from pydantic import Field

from encircle.protocol.messages import Point
from encircle.protocol.plugins import (
    TARGET,
    TARGETS,
    InvalidPluginResult,
    PluginFailed,
    Registry,
    pair_of_m,
    shown,
)
from encircle.world.scenario.fields import Deviation, Position

EQUAL_RAD = 1e-9
"""Gaps are as wide if they are so in whole multiples of this."""
ObstacleRange = Annotated[
    Deviation, Field(description="Obstacles that are nearer are steered around.")
]
Waypoints = Annotated[
    Sequence[Position], Field(min_length=1, description="Where it goes, one after the other.")
]


class TargetView(NamedTuple):
    """What the target goes by: its own sensors, nothing else.

    ``robots``: absolute positions in m of the robots it detects, in robot order; ``scan``: distance
    in m to the nearest surface along equally spaced rays, the first along +x; ``heading_rad``: the
    direction of its last step, at first the scenario's.
    """

    tick: int
    position: Point
    heading_rad: float
    robots: Sequence[Point]
    scan: Sequence[float]
    step_m_max: float
    radius_m: float


Behaviour: TypeAlias = Callable[..., tuple[Any, Point]]
"""``(memory, view, **parameters) -> (memory, step)``: what it remembers and sees to what it will
remember and the step it wants, in m."""


def flee(
    memory: Any, view: TargetView, *, obstacle_range_m: ObstacleRange = 1.5
) -> tuple[Any, Point]:
    """Away from every robot it detects, from near ones more (inverse square); also off obstacles.

    With none in sight it goes on as it was going; before it has ever seen one it stands still.
    """
    x, y = view.position
    pull_x = pull_y = 0.0
    for rx, ry in view.robots:
        dx, dy = x - rx, y - ry
        distance = hypot(dx, dy)
        pull_x += dx / distance**3
        pull_y += dy / distance**3
    if view.robots:
        memory = atan2(pull_y, pull_x) if hypot(pull_x, pull_y) > 1e-9 else view.heading_rad
    if memory is None:
        return None, (0.0, 0.0)
    return memory, _step(_clear_heading(memory, view, obstacle_range_m), view.step_m_max)


def gap(
    memory: Any, view: TargetView, *, obstacle_range_m: ObstacleRange = 1.5
) -> tuple[Any, Point]:
    """Through the middle of the widest angular gap between the robots it detects.

    Of gaps that differ by rounding noise alone it takes the first by bearing, from -pi on. With no
    robot in sight it goes on as it was going; before it has ever seen one it stands still.
    """
    x, y = view.position
    if view.robots:
        bearings = sorted(atan2(ry - y, rx - x) for rx, ry in view.robots)
        widths = [
            (after - before, before)
            for before, after in zip(bearings, [*bearings[1:], bearings[0] + 2 * pi], strict=True)
        ]
        width, before = max(widths, key=lambda item: round(item[0] / EQUAL_RAD))
        memory = before + width / 2
    if memory is None:
        return None, (0.0, 0.0)
    return memory, _step(_clear_heading(memory, view, obstacle_range_m), view.step_m_max)


def straight(memory: Any, view: TargetView) -> tuple[Any, Point]:
    """Always on along its first heading."""
    heading = view.heading_rad if memory is None else memory
    return heading, _step(heading, view.step_m_max)


def patrol(memory: Any, view: TargetView, *, waypoints: Waypoints) -> tuple[Any, Point]:
    """From waypoint to waypoint, and from the last one to the first."""
    waypoint_index = memory or 0
    gx, gy = waypoints[waypoint_index % len(waypoints)]
    dx, dy = gx - view.position[0], gy - view.position[1]
    distance = hypot(dx, dy)
    if distance <= view.step_m_max:
        return (waypoint_index + 1) % len(waypoints), (dx, dy)
    return waypoint_index, _step(atan2(dy, dx), view.step_m_max)


def still(_memory: Any, _view: TargetView) -> tuple[Any, Point]:
    """Stays where it is."""
    return None, (0.0, 0.0)


BUILT_IN: dict[str, Behaviour] = {
    "flee": flee,
    "gap": gap,
    "straight": straight,
    "patrol": patrol,
    "still": still,
}
REGISTRY = Registry(TARGETS, BUILT_IN)


@lru_cache(maxsize=64)
def behaviour_named(name: str) -> Behaviour:
    """The behaviour of that name; errors as of ``Registry.named``."""
    behaviour: Behaviour = REGISTRY.named(name)
    return behaviour


def act(
    name: str, memory: Any, view: TargetView, parameters: Mapping[str, Any]
) -> tuple[Any, Point]:
    """What the behaviour of that name remembers and wants; ``PluginFailed`` if it fails."""
    try:
        answer = behaviour_named(name)(memory, view, **parameters)
        if not isinstance(answer, tuple) or len(answer) != 2:
            raise InvalidPluginResult(f"{shown(answer)}: must be what it remembers, and a step")
        return answer[0], pair_of_m("step", answer[1])
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        raise PluginFailed(TARGETS, name, TARGET, view.tick, error) from error


def _step(heading_rad: float, length_m: float) -> Point:
    return length_m * cos(heading_rad), length_m * sin(heading_rad)


def _clear_heading(heading_rad: float, view: TargetView, range_m: float) -> float:
    """The heading nearest to the wanted one whose ray, and its neighbours', are free for a way."""
    rays = len(view.scan)
    if rays < 8 or min(view.scan) >= range_m + view.radius_m:
        return heading_rad
    spacing = 2 * pi / rays
    wanted = round(heading_rad / spacing)
    for offset in sorted(range(-(rays // 3), rays // 3 + 1), key=lambda k: (abs(k), -k)):
        ray = wanted + offset
        if all(view.scan[(ray + side) % rays] >= range_m for side in (-1, 0, 1)):
            return heading_rad if offset == 0 else ray * spacing
    return heading_rad
