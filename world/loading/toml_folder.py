"""Folders of TOML files that come with the package."""

import tomllib
from pathlib import Path
from typing import Any


def toml_files(folder: Path) -> dict[str, Path]:
    """The TOML files of a folder, by their names without the ending."""
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def toml_trees(folder: Path) -> dict[str, dict[str, Any]]:
    """Their contents, unchecked: for lists, which need not wait for the models."""
    return {
        name: tomllib.loads(path.read_text(encoding="utf-8"))
        for name, path in toml_files(folder).items()
    }
