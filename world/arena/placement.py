"""Where bodies are put: the robots' starts, and the target when it is moved by hand.

Starts are the given ones, each moved by up to ``team.jitter_m`` along each axis, uniformly, or
random ones, uniform by area in an annulus around the target. A robot's draws are its own: the
starts of the first N robots are the same in any larger team.
"""

from collections.abc import Iterator
from math import ceil, cos, pi, sin

import numpy as np
from numpy.typing import NDArray

from encircle.protocol.messages import Point
from encircle.world.arena.collisions import SKIN_M
from encircle.world.arena.dynamics import quantised
from encircle.world.random_streams import Purpose, uniforms
from encircle.world.scenario.errors import ScenarioError
from encircle.world.scenario.model import Scenario

Floats = NDArray[np.float64]
TRIES_MAX = 10_000
FREE_SPACING_M = 0.08
FREE_RINGS_MAX = 2_000


def starts(scenario: Scenario, seed: int) -> list[Point]:
    """The robots' starts, robot order; ``ScenarioError`` if there is no room for one."""
    given, jitter_m = scenario.team.positions, scenario.team.jitter_m
    if given is None:
        return _random(scenario, seed)
    if jitter_m == 0.0:
        return list(given)
    moved = []
    for robot, (x, y) in enumerate(given):
        u, v = (2.0 * uniforms(seed, Purpose.JITTER, robot, 2) - 1.0).tolist()
        moved.append((x + u * jitter_m, y + v * jitter_m))
    return moved


def nearest_free(positions: Floats, radii: Floats, body: int, wanted: Point) -> Floats:
    """The wanted position (2,) of a body, or the nearest position around it where it fits.

    ``positions`` (B, 2) and ``radii`` (B,) of all bodies, in m. The body's own position if there
    is no other.
    """
    others = np.delete(positions, body, axis=0)
    apart = np.delete(radii, body) + radii[body] + 2 * SKIN_M
    for ring in range(FREE_RINGS_MAX):
        radius = ring * FREE_SPACING_M
        count = max(1, ceil(2 * pi * ring))
        angles = np.arange(count) * (2 * pi / count)
        tried = quantised(
            np.array(wanted) + radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        )
        away = others - tried[:, None]
        free = ((away * away).sum(axis=2) > apart**2).all(axis=1)
        if free.any():
            chosen: Floats = tried[free.argmax()]
            return chosen
    staying: Floats = positions[body]
    return staying


def _random(scenario: Scenario, seed: int) -> list[Point]:
    """Random starts in the annulus around the target, apart from each other and from obstacles."""
    ring = scenario.team.placement
    low, high = ring.distance_m_min**2, ring.distance_m_max**2
    tx, ty = scenario.target.position
    free = [(o.position, o.radius_m + scenario.team.radius_m) for o in scenario.obstacles]
    free.append(((tx, ty), scenario.target.radius_m + scenario.team.radius_m))
    placed: list[Point] = []
    for robot, name in enumerate(scenario.ids):
        for u, v in _tries(seed, robot):
            distance = (low + u * (high - low)) ** 0.5
            x, y = tx + distance * cos(2 * pi * v), ty + distance * sin(2 * pi * v)
            if all((x - ox) ** 2 + (y - oy) ** 2 > (1.05 * apart) ** 2 for (ox, oy), apart in free):
                placed.append((x, y))
                free.append(((x, y), 2 * scenario.team.radius_m))
                break
        else:
            raise ScenarioError(
                f"team.placement: no room for {name} between"
                f" {ring.distance_m_min} and {ring.distance_m_max} m from the target"
            )
    return placed


def _tries(seed: int, robot: int) -> Iterator[tuple[float, float]]:
    """Pairs of draws from a robot's own stream."""
    for count in (16, TRIES_MAX):
        # A stream's first draws are the same however many are taken.
        pairs = uniforms(seed, Purpose.PLACEMENT, robot, 2 * count).reshape(count, 2)
        yield from (tuple(pair) for pair in pairs[0 if count == 16 else 16 :].tolist())
