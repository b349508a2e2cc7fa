"""The work of a study: from a task to rows of its table.

What is done in a worker process, on this machine or another. A task is complete in itself, scenario
included, and nothing is remembered from one to the next.
"""

import hashlib
import json
import platform
import time
from collections.abc import Mapping
from functools import lru_cache
from importlib import resources
from importlib.metadata import entry_points, version
from typing import Any, NamedTuple

from encircle.measures import measure
from encircle.memory import run_in_memory
from encircle.runlog import Collector, RunLog
from protocol.log import bounded_log
from world.engine import build
from world.scenario import load

RUN = "study"
Row = dict[str, Any]
SOURCES: dict[str, tuple[str, ...]] = {
    "agents": ("",),
    "encircle": ("measur", "memory", "recorded_log", "runlog"),
    "protocol": ("",),
    "world": ("",),
}
"""Packages, and the beginnings of their modules' names, on which numbers depend."""
PACKAGES = ("encircle", "numpy", "scipy", "filterpy", "msgpack")


class Task(NamedTuple):
    """Some seeds of one cell. ``scenario``: the cell's, as JSON; ``columns``: measures to take."""

    cell: int
    levels: Mapping[str, Any]
    scenario: str
    seeds: tuple[int, ...]
    columns: tuple[str, ...]


@lru_cache(maxsize=1)
def code() -> str:
    """Digest of everything that has a part in a run's numbers: our sources and versions."""
    digest = hashlib.blake2b(json.dumps(versions()).encode(), digest_size=8)
    for package, beginnings in SOURCES.items():
        for file in sorted(resources.files(package).iterdir(), key=lambda f: f.name):
            if file.name.endswith(".py") and file.name.startswith(beginnings):
                digest.update(file.read_bytes())
    return digest.hexdigest()


@lru_cache(maxsize=1)
def versions() -> dict[str, str]:
    """Versions of what computes a run's numbers, other people's strategies and targets included."""
    found = {name: version(name) for name in PACKAGES}
    for group in ("encircle.strategies", "encircle.targets"):
        for entry in sorted(entry_points(group=group), key=lambda e: e.value):
            if entry.dist is not None:
                found[entry.dist.name] = entry.dist.version
    return {"python": platform.python_version(), **found}


def run_task(task: Task) -> tuple[str, list[Row]]:
    """Run a task in memory; returns ``code()`` of this process and a row per seed."""
    scenario = load(json.loads(task.scenario))
    rows = []
    for seed in task.seeds:
        begun = time.perf_counter()
        collector = Collector()
        result = run_in_memory(build(scenario, seed), RUN, bounded_log(), watch=collector)
        rows.append(row(task, collector.log(), result.digest, begun))
    return code(), rows


def row(task: Task, log: RunLog, digest: str, begun_s: float) -> Row:
    """A run's row: axes, seed, digest, outcome, measures, versions.

    ``begun_s``: ``perf_counter`` when the run began.
    """
    return {
        "cell": task.cell,
        **task.levels,
        "seed": log.seed,
        "digest": digest,
        "captured": float(log.captured),
        "ticks": log.ticks,
        **{name: float(value) for name, value in measure(log, task.columns).items()},
        "wall_s": time.perf_counter() - begun_s,
        "code": code(),
        "versions": json.dumps(versions()),
    }
