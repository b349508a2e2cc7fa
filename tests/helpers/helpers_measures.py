"""Logs made by hand, for the tests of measures: four robots stand in a square about the target.

Everybody knows everything: every packet comes at the next tick, every belief is the truth.
"""

from typing import Any

import numpy as np

from encircle.runlog.runlog import RunLog
from encircle.world.loading.load import load
from encircle.world.scenario.model import Scenario

RING_M = 4.0
SQUARE = ((RING_M, 0.0), (0.0, RING_M), (-RING_M, 0.0), (0.0, -RING_M))


def scenario(robots: int = 4, **sections: Any) -> Scenario:
    tree: dict[str, Any] = {"ticks_max": 10_000, "team": {"robots": robots}}
    return load({**tree, **sections})


def polygon(robots: int) -> np.ndarray:
    """(N, 2) robots at equal angles on the ring, the first due east."""
    angles = 2.0 * np.pi * np.arange(robots) / robots
    return RING_M * np.stack([np.cos(angles), np.sin(angles)], axis=1)


def standing(ticks: int, robots: int = 4, **changes: Any) -> RunLog:
    """A log of so many rounds, with some of its arrays replaced by what broadcasts to them."""
    places = np.array(SQUARE) if robots == 4 else polygon(robots)
    by_robot, by_link = (ticks, robots), (ticks, robots, robots)
    sent = np.arange(ticks)[:, None, None] + 1
    made: dict[str, Any] = {
        "positions": np.tile(np.vstack([places, [0.0, 0.0]]), (ticks + 1, 1, 1)),
        "contacts": np.empty((0, 3), np.int64),
        "steps": np.zeros((*by_robot, 2)),
        "modes": np.full(by_robot, "encircle"),
        "xi": np.zeros(by_robot),
        "points": np.tile(np.arange(robots), (ticks, 1)),
        "goals": np.tile(places, (ticks, 1, 1)),
        "estimates": np.zeros((*by_robot, 4)),
        "covariances": np.tile([1.0, 0.0, 1.0], (*by_robot, 1)),
        "believed": np.tile(places, (*by_robot, 1, 1)),
        "due": np.where(np.eye(robots, dtype=bool), 0, sent),
        "copies": np.zeros(by_link, np.int64),
        "sizes_bytes": np.full(by_robot, 100),
        "parts_bytes": np.zeros((*by_robot, 3), np.int64),
        "there": np.full(by_robot, True),
    }
    for name in made.keys() & changes.keys():
        given = np.asarray(changes.pop(name))
        fixed = name in ("contacts", "modes")
        made[name] = given if fixed else np.broadcast_to(given, made[name].shape).copy()
    rest = {"scenario": scenario(robots), "seed": 1, "captured": False, "ended": "ticks"}
    return RunLog(**made, **{**rest, **changes})


def random_log(ticks: int, robots: int, seed: int) -> RunLog:
    """A log of nonsense, NaN where they may be, of the right shapes."""
    rng = np.random.default_rng(seed)
    positions = rng.uniform(-9.0, 9.0, (ticks + 1, robots + 1, 2))
    kept = rng.random((ticks, robots))
    none = rng.random((ticks, robots)) < 0.2
    sent = np.arange(ticks)[:, None, None]
    shape = (ticks, robots, robots)
    due = np.where(rng.random(shape) < kept[..., None], sent + rng.integers(1, 9, shape), -1)
    copies = np.where(rng.random(shape) < 0.1, sent + rng.integers(1, 9, shape), 0)
    due[:, np.arange(robots), np.arange(robots)] = copies[:, np.arange(robots), range(robots)] = 0
    due[none] = copies[none] = 0
    believed = positions[:-1, None, :-1] + rng.normal(0.0, 1.0, (*shape, 2))
    believed[(rng.random(shape) < 0.3) & ~np.eye(robots, dtype=bool)] = np.nan
    estimates = rng.normal(0.0, 3.0, (ticks, robots, 4))
    estimates[none] = np.nan
    bodies = rng.integers(0, robots + 2, (rng.integers(0, 9), 2))
    return standing(
        ticks,
        robots,
        positions=positions,
        contacts=np.insert(np.sort(bodies, axis=1), 0, 1, axis=1),
        steps=rng.normal(0.0, 0.2, (ticks, robots, 2)),
        xi=np.where(none, np.nan, rng.integers(0, 7, (ticks, robots))),
        points=np.where(rng.random((ticks, robots)) < 0.2, -1, 0),
        goals=rng.uniform(-6.0, 6.0, (ticks, robots, 2)),
        estimates=estimates,
        believed=believed,
        due=due,
        copies=copies,
        sizes_bytes=np.where(none, 0, rng.integers(50, 200, (ticks, robots))),
        parts_bytes=np.where(none[..., None], 0, rng.integers(0, 15, (ticks, robots, 3))),
        captured=bool(rng.random() < 0.5),
    )
