"""Prediction error against xi: what the spline's ends, K, spacing and the filter's noise do to it.

    python bench/prediction.py

Targets of 40 hunts (random starts, the fleeing target of simulation 1) are detected by one robot at
every tick with noise; the filter's positions feed the predictor; the error is the distance between
where the target was predicted and where it went, root mean square over all ticks. Two predictors
that need no spline stand beside it: the filter's own velocity, and holding the position.
"""

import argparse
from dataclasses import replace
from itertools import product

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from scenarios import ordinary_hunt

from encircle.agents.estimation import kalman
from encircle.agents.estimation.spline import extrapolate
from encircle.protocol.parameters import Parameters
from encircle.runner.memory import run_in_memory
from encircle.world.arena import engine
from encircle.world.coordinator.world_core import WorldCore
from encircle.world.loading.load import load

HUNTS = 40
XI = tuple(float(xi) for xi in range(7))
SKIPPED_TICKS = 15


def target_paths(hunts: int) -> list[NDArray[np.float64]]:
    """True target positions (ticks, 2) in m of some hunts."""
    paths = []
    for seed in range(hunts):
        path: list[list[float]] = []

        def note(world: WorldCore, path: list[list[float]] = path) -> None:
            path.append(world.state.positions[len(world.arena.ids)].tolist())

        scenario = load(ordinary_hunt(4), ["ticks_max=120"])
        run_in_memory(engine.build(scenario, seed), "bench", print, None, note)
        if len(path) > SKIPPED_TICKS + 2 * len(XI):
            paths.append(np.array(path))
    return paths


def errors(
    paths: list[NDArray[np.float64]], noise_m_std: float, parameters: Parameters, predictor: str
) -> NDArray[np.float64]:
    """Root mean square prediction error in m at each xi."""
    squares: list[NDArray[np.float64]] = []
    tick_s = 0.1
    for number, path in enumerate(paths):
        noise = np.random.default_rng(number).normal(0.0, noise_m_std, path.shape)
        track = kalman.EMPTY_TRACK
        for tick, (x, y) in enumerate((path + noise).tolist()):
            track = kalman.incorporate(track, [(tick, 0, x, y)], tick, tick_s, parameters)
            if SKIPPED_TICKS <= tick < len(path) - len(XI):
                predicted = predict(track, tick_s, parameters, predictor)
                missed = predicted - path[tick : tick + len(XI)]
                squares.append((missed * missed).sum(axis=1))
    result: NDArray[np.float64] = np.sqrt(np.mean(squares, axis=0))
    return result


def predict(
    track: kalman.Track, tick_s: float, parameters: Parameters, predictor: str
) -> NDArray[np.float64]:
    """Predicted positions (len(XI), 2) in m by one of three predictors."""
    if predictor == "spline":
        return extrapolate(track, tick_s, parameters, XI)[0]
    estimate = track.estimate
    assert estimate is not None
    velocity = np.array((estimate.vx, estimate.vy)) * (tick_s if predictor == "velocity" else 0.0)
    return np.array((estimate.x, estimate.y)) + np.array(XI)[:, None] * velocity


def main() -> None:
    """Print the table, best at xi = 3 first within each noise."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--all", action="store_true", help="every combination, not only some")
    options = parser.parse_args()
    paths = target_paths(HUNTS)
    accelerations = (3.0, 10.0, 30.0)
    shapes = list(product(("natural", "not-a-knot"), (4, 6, 8), (1, 2, 3, 4)))
    if not options.all:
        shapes = [s for s in shapes if s[1] in (4, 6) and s[2] in (1, 3)]
    for noise in (0.0, 0.02, 0.1):
        rows = []
        for acceleration in accelerations:
            base = Parameters(
                acceleration_mps2_std=acceleration, measurement_m_std=max(noise, 0.01)
            )
            rows += [
                (predictor, acceleration, errors(paths, noise, base, predictor))
                for predictor in ("velocity", "hold")
            ]
            for ends, samples, spacing in shapes:
                chosen = replace(
                    base, spline_ends=ends, spline_samples=samples, spline_spacing_ticks=spacing
                )
                name = f"{ends}, K {samples}, every {spacing}"
                rows.append((name, acceleration, errors(paths, noise, chosen, "spline")))
        rows.sort(key=lambda row: row[2][3])
        table = Table(
            title=f"detection noise {noise} m: error in m at each xi", title_justify="left"
        )
        table.add_column("predictor")
        table.add_column("filter m/s^2", justify="right")
        for xi in XI:
            table.add_column(f"{xi:g}", justify="right")
        for name, acceleration, error in rows:
            table.add_row(name, f"{acceleration:g}", *(f"{e:.3f}" for e in error))
        Console(width=110).print(table)


if __name__ == "__main__":
    main()
