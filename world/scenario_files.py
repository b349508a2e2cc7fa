"""Scenarios before they are checked: where they lie, how they are read, what is overridden."""

import json
import tomllib
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from world.fields import shown
from world.trace_files import anchored


class ScenarioError(ValueError):
    """A scenario that cannot be run; the message lists every problem, one per line."""


def shipped() -> dict[str, Path]:
    """The scenarios that come with the package, by name."""
    folder = resources.files("world") / "scenarios"
    files = [Path(str(f)) for f in folder.iterdir() if f.name.endswith(".toml")]
    return {path.stem: path for path in sorted(files)}


def read(source: str | Path | Mapping[str, Any]) -> tuple[str, dict[str, Any]]:
    """A scenario's name and its tree of tables, which is the caller's own to change."""
    if isinstance(source, Mapping):
        return "scenario", _copied(source)
    known = shipped()
    path = known.get(str(source), Path(source))
    try:
        with open(path, "rb") as file:
            tree = json.load(file) if path.suffix == ".json" else tomllib.load(file)
            if not isinstance(tree, dict):
                raise ScenarioError(f"scenario {str(source)!r} = {shown(tree)}: must be a table")
            if "axes" in tree:
                raise ScenarioError(
                    f"scenario {str(source)!r} has axes, so it is a study: encircle study {source}"
                )
            return str(source), anchored(tree, path.parent)
    except (FileNotFoundError, IsADirectoryError):
        raise ScenarioError(
            f"scenario {str(source)!r} is neither a file nor one of: {', '.join(known)}"
        ) from None
    except ScenarioError:
        raise
    except ValueError as error:  # tomllib's and json's decode errors, and wrong UTF-8
        raise ScenarioError(f"scenario {str(source)!r} cannot be parsed: {error}") from None
    except OSError as error:
        raise ScenarioError(f"scenario {str(source)!r} cannot be read: {error.strerror}") from None


def override(tree: dict[str, Any], change: str) -> None:
    """Change a tree by one ``key=value``; ``ScenarioError`` if there is no such place."""
    key, separator, text = change.partition("=")
    if not separator or not key:
        raise ScenarioError(f"override {change!r}: must be key=value, as in target.step_m_max=0.39")
    try:
        parsed = tomllib.loads(f"value = {text}")
        value = parsed["value"] if len(parsed) == 1 else text
    except tomllib.TOMLDecodeError:
        value = text
    *path, last = key.split(".")
    place: Any = tree
    try:
        for part in path:
            if isinstance(place, list):
                place = place[int(part)]
            else:
                # A scenario that was written out in full has null for a table that it has not.
                place[part] = {} if place.get(part) is None else place[part]
                place = place[part]
        if isinstance(place, list):
            place[int(last)] = value
        else:
            place[last] = value
    except (ValueError, IndexError, TypeError, AttributeError):
        raise ScenarioError(f"override {change!r}: there is no such key") from None


def _copied(tree: Any) -> Any:
    if isinstance(tree, Mapping):
        return {key: _copied(value) for key, value in tree.items()}
    if isinstance(tree, list | tuple):
        return [_copied(value) for value in tree]
    return tree
