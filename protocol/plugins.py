"""Plug-ins: strategies and target behaviours of other packages, found by entry point.

A plug-in is named in a scenario and is other people's code: it may be missing, broken, or fail at
any tick of a run. Then it is named in full, with where it comes from, and so is the error.
"""

import traceback
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

STRATEGIES, TARGETS = "encircle.strategies", "encircle.targets"
GROUPS = (STRATEGIES, TARGETS)
KINDS = {STRATEGIES: "strategy", TARGETS: "target behaviour"}
OWN = "encircle"
"""The distribution whose entry points are the shipped ones, not plug-ins."""


class PluginBroken(Exception):
    """A plug-in that is installed but cannot be loaded; the message says which and why."""


@dataclass(frozen=True, slots=True)
class Plugin:
    """An entry point. ``value``: ``module:attribute``; ``source``: that, and whose it is."""

    group: str
    name: str
    entry: EntryPoint

    @property
    def source(self) -> str:
        """Where it comes from: ``my_robots:halfway of my-robots 0.1``."""
        dist = self.entry.dist
        return self.entry.value + (f" of {dist.name} {dist.version}" if dist is not None else "")

    @property
    def shipped(self) -> bool:
        """Whether it is one of this program's own."""
        return self.entry.dist is not None and self.entry.dist.name == OWN

    def load(self) -> Any:
        """What the entry point names; ``PluginBroken`` if that cannot be had or called."""
        try:
            found = self.entry.load()
        except (Exception, SystemExit) as error:
            raise PluginBroken(f"{self.source} cannot be loaded: {_told(error)}") from error
        if not callable(found):
            raise PluginBroken(f"{self.source} is {type(found).__name__}, must be a function")
        return found


def installed(group: str) -> dict[str, Plugin]:
    """All plug-ins of a group, those of this program included, by name."""
    return {entry.name: Plugin(group, entry.name, entry) for entry in entry_points(group=group)}


def _told(error: BaseException) -> str:
    """An error in one line: its type, its text, and where it was raised, if in a file."""
    text = " ".join(str(error).split())
    told = f"{type(error).__name__}: {text}" if text else type(error).__name__
    frames = traceback.extract_tb(error.__traceback__)
    inner = frames[-1] if frames else None
    if inner is None or "importlib" in inner.filename:
        return told
    return f"{told} ({Path(inner.filename).name}, line {inner.lineno})"
