"""What is shipped, for lists: read from the files alone, without the models that check them.

The models need pydantic, numpy and scipy, and a list need not wait for those. Shipped files are
right: tests load them, and hold these lists to what the models say.
"""

from collections.abc import Mapping
from math import prod
from pathlib import Path
from typing import Any, NamedTuple

from encircle import studies
from encircle.world import loading
from encircle.world.loading.toml_folder import toml_trees

SCENARIOS = Path(loading.__path__[0]) / "shipped"
PROFILES = Path(loading.__path__[0]) / "shipped_profiles"
STUDIES = Path(studies.__path__[0]) / "shipped"


class Listed(NamedTuple):
    """A line of a list. ``number``: a scenario's robots, a study's runs."""

    name: str
    number: int
    title: str


def listed_scenarios() -> list[Listed]:
    """The shipped scenarios."""
    return [
        Listed(name, tree["team"].get("robots") or len(tree["team"]["positions"]), tree["title"])
        for name, tree in toml_trees(SCENARIOS).items()
    ]


def listed_profiles() -> dict[str, str]:
    """The shipped profiles of channels, title by name."""
    return {name: tree["title"] for name, tree in toml_trees(PROFILES).items()}


def listed_studies() -> list[Listed]:
    """The shipped studies."""
    return [Listed(name, _runs(tree), tree["title"]) for name, tree in toml_trees(STUDIES).items()]


def _runs(tree: Mapping[str, Any]) -> int:
    """How many runs a study has: every combination of its levels, with every seed."""
    seeds = tree["seeds"]
    if isinstance(seeds, str):
        first, last = map(int, seeds.split("-"))
        seeds = last - first + 1
    seeds = seeds if isinstance(seeds, int) else len(seeds)
    cells = prod(map(_levels, tree.get("axes", ())))
    return cells * max(1, len(tree.get("strategies", ()))) * seeds


def _levels(axis: Mapping[str, Any]) -> int:
    if "range" in axis:
        return int(axis["range"]["count"])
    return len(axis["values"] if "values" in axis else axis["arms"])
