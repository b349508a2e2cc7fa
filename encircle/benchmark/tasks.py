"""The benchmark's tasks: which there are, and whether a study's runs are of exactly these.

The tasks stand in the shipped study ``benchmark``, as the levels of its axis ``task``. A task's
name has three parts: scene, number of robots, channel. Their digest is taken of what the file says,
with nothing filled in, so that it stays the same when scenarios get new keys. The version goes up
whenever the digest changes, and scores of two versions are never compared.
"""

import hashlib
import json
import tomllib
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from encircle.benchmark.seeds import held_out_seeds, public_seeds
from encircle.protocol.plugins import SHIPPED_POLICIES
from encircle.studies.plan import Plan
from encircle.studies.plan_files import load_plan, shipped_studies

VERSION = 1
STUDY = "benchmark"
TASK_AXIS = "task"
POLICIES = tuple(SHIPPED_POLICIES)
"""The shipped policies, which all have a row in the published table."""
_PARTS = ("scenario", "set", "axes")


class Task(NamedTuple):
    """One task: a scene, so many robots, a channel."""

    name: str
    scene: str
    robots: int
    channel: str


def task_named(name: str) -> Task:
    """The task with a name such as ``sim1-4-perfect``."""
    scene, robots, channel = name.split("-")
    return Task(name, scene, int(robots), channel)


def benchmark_tree() -> dict[str, Any]:
    """The shipped study as its file has it."""
    return tomllib.loads(shipped_studies()[STUDY].read_text(encoding="utf-8"))


def tasks() -> tuple[Task, ...]:
    """All tasks, in the order of the file."""
    (axis,) = benchmark_tree()["axes"]
    return tuple(task_named(arm["name"]) for arm in axis["arms"])


def tasks_digest(tree: Mapping[str, Any] | None = None) -> str:
    """Digest of scenario and tasks of a study's tree, by default of the benchmark's own."""
    tree = benchmark_tree() if tree is None else tree
    axes = [{"name": axis.get("name"), "arms": axis.get("arms")} for axis in tree["axes"]]
    parts = [tree["scenario"], tree.get("set", {}), axes]
    text = json.dumps(parts, sort_keys=True)
    return hashlib.blake2b(text.encode(), digest_size=8).hexdigest()


def submission_plan(
    policy: str, name: str, seeds: int, policy_parameters: Sequence[str] = ()
) -> Plan:
    """The plan of a submission: one policy, all tasks, public and held-out seeds.

    ``seeds``: how many of each. ``policy_parameters``: ``NAME=VALUE``. Raises ``StudyError`` if
    there is no such policy or parameter.
    """
    both = (*public_seeds(seeds), *held_out_seeds(VERSION, name, seeds))
    tree = {
        **benchmark_tree(),
        "name": f"{STUDY}-{VERSION}",
        "title": name,
        "strategies": [policy],
        "seeds": list(both),
        "compare": None,
        "baseline": None,
    }
    return load_plan(tree, [f"team.policy_parameters.{given}" for given in policy_parameters])
