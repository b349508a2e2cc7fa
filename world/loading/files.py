"""Scenarios before they are checked: where they lie, how they are read, what is overridden."""

import json
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from encircle.protocol.errors import did_you_mean
from encircle.world.loading import robots
from encircle.world.loading.toml_folder import toml_files
from encircle.world.loading.trace_files import anchored
from encircle.world.scenario.errors import ScenarioError
from encircle.world.scenario.fields import shown

SHIPPED = Path(__file__).parent / "shipped"
STUDY_KEYS = {"scenario", "axes", "strategies"}
"""Keys that a study has and no scenario has."""


def shipped() -> dict[str, Path]:
    """The scenarios that come with the package, by name."""
    return toml_files(SHIPPED)


def read(source: str | Path | Mapping[str, Any]) -> tuple[str, dict[str, Any]]:
    """A scenario's name and its tree of tables, which is the caller's own to change."""
    if isinstance(source, Mapping):
        return "scenario", copied(source)
    known = shipped()
    path = known.get(str(source), Path(source))
    try:
        with open(path, "rb") as file:
            tree = json.load(file) if path.suffix == ".json" else tomllib.load(file)
            if not isinstance(tree, dict):
                raise ScenarioError(f"scenario {str(source)!r} = {shown(tree)}: must be a table")
            if of_study := sorted(STUDY_KEYS & tree.keys()):
                raise ScenarioError(
                    f"scenario {str(source)!r} has {' and '.join(of_study)}, so it is a study:"
                    f" encircle study {source}"
                )
            return str(source), anchored(tree, path.parent)
    except (FileNotFoundError, IsADirectoryError):
        raise ScenarioError(
            f"scenario {str(source)!r} is neither a file nor one of: {', '.join(known)}"
            f"{did_you_mean(source, known)}"
        ) from None
    except ScenarioError:
        raise
    except ValueError as error:  # tomllib's and json's decode errors, and wrong UTF-8
        raise ScenarioError(f"scenario {str(source)!r} cannot be parsed: {error}") from None
    except OSError as error:
        raise ScenarioError(f"scenario {str(source)!r} cannot be read: {error.strerror}") from None


def override(tree: dict[str, Any], change: str) -> None:
    """Change a tree by one ``key=value``; ``ScenarioError`` if it can have no such key."""
    key, separator, text = change.partition("=")
    if not separator or not key:
        raise ScenarioError(f"override {change!r}: must be key=value, as in target.step_m_max=0.39")
    try:
        parsed = tomllib.loads(f"value = {text}")
        value = parsed["value"] if len(parsed) == 1 else text
    except tomllib.TOMLDecodeError:
        value = text
    *path, last = key.split(".")
    branch: Any = tree
    for depth, part in enumerate(path):
        # A scenario that was written out in full has null for a table that it has not.
        if isinstance(branch, dict) and branch.get(part) is None:
            branch[part] = {}
        if isinstance(branch, dict) and (*path[:depth], part) == robots.KEY:
            branch[part] = robots.as_table(branch[part])
        branch = branch[_key_in(branch, part, path[:depth], change)]
    if isinstance(branch, dict) and (*path, last) == robots.KEY:
        value = robots.set_robots(branch.get(last), value)
    branch[_key_in(branch, last, path, change)] = value


def _key_in(branch: Any, part: str, path: list[str], change: str) -> str | int:
    """The key of a part of a table or list; ``ScenarioError`` if it can have none."""
    if isinstance(branch, dict):
        return part
    where = ".".join(path)
    if not isinstance(branch, list):
        raise ScenarioError(
            f"override {change!r}: there is no such key, for {where} = {shown(branch)} is no table"
        )
    if not (part.isascii() and part.isdigit() and int(part) < len(branch)):
        numbers = f"they are numbered from 0 to {len(branch) - 1}" if branch else "it has none"
        raise ScenarioError(
            f"override {change!r}: there is no such key, for {where} is a list, and {part!r} not"
            f" the number of one of its items: {numbers}"
        )
    return int(part)


def copied(tree: Any) -> Any:
    """A copy of a tree in which nothing is shared, with dicts for mappings and lists for tuples."""
    if isinstance(tree, Mapping):
        return {key: copied(value) for key, value in tree.items()}
    if isinstance(tree, list | tuple):
        return [copied(value) for value in tree]
    return tree
