"""Plug-ins: strategies and target behaviours of other packages, found by entry point.

A plug-in is named in a scenario and is other people's code: it may be missing, broken, or fail at
any tick of a run. Then it is named in full, with where it comes from, and so is the error.
"""

import reprlib
import traceback
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from math import nan
from typing import Any

from encircle.protocol.messages import Point
from encircle.protocol.wire.limits import NUMBER_MAX

STRATEGIES, TARGETS = "encircle.strategies", "encircle.targets"
GROUPS = (STRATEGIES, TARGETS)
KINDS = {STRATEGIES: "strategy", TARGETS: "target behaviour"}
TARGET = "target"
OWN = "encircle"
"""The distribution whose entry points are the shipped ones, not plug-ins."""


TEXT_MAX = 300


class PluginLoadError(Exception):
    """A plug-in that is installed but cannot be loaded; the message says which and why."""


class InvalidPluginResult(ValueError):
    """What a plug-in has answered cannot be; the message says what, and what must be."""


class PluginFailed(Exception):
    """A plug-in that failed in mid-run; the message names it, and who, when, and the error.

    ``who``: the robot's id, or ``target``; ``error``: what was raised.
    """

    def __init__(self, group: str, name: str, who: str, tick: int, error: BaseException) -> None:
        plugin = installed(group).get(name)
        source = f" ({plugin.source})" if plugin is not None else ""
        where = "" if who == TARGET else f" in robot {who}"
        reason = (
            f"answered {error}" if isinstance(error, InvalidPluginResult) else error_line(error)
        )
        super().__init__(f"{KINDS[group]} {name!r}{source} failed{where} at tick {tick}: {reason}")
        self.who = who
        self.error = error

    @property
    def trace(self) -> str:
        """The traceback of the error, to be read by whoever wrote the plug-in."""
        return "".join(traceback.format_exception(self.error))


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
        """What the entry point names; ``PluginLoadError`` if that cannot be had or called."""
        try:
            loaded = self.entry.load()
        except (Exception, SystemExit) as error:
            raise PluginLoadError(f"{self.source} cannot be loaded: {error_line(error)}") from error
        if not callable(loaded):
            raise PluginLoadError(f"{self.source} is {type(loaded).__name__}, must be a function")
        return loaded


def installed(group: str) -> dict[str, Plugin]:
    """All plug-ins of a group, those of this program included, by name."""
    return {entry.name: Plugin(group, entry.name, entry) for entry in entry_points(group=group)}


def error_line(error: BaseException) -> str:
    """An error in one line: its type and its text."""
    try:
        text = " ".join(str(error).split())
    except Exception:
        # It is other people's code that says so.
        text = "its text cannot be had"
    text = text if len(text) <= TEXT_MAX else text[:TEXT_MAX] + "..."
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def pair_of_m(name: str, value: Any) -> Point:
    """A pair of numbers that a message can hold, as floats; else ``InvalidPluginResult``."""
    try:
        x, y = value
        if not (type(x) is type(y) is float):
            if {str, bool} & {type(x), type(y)}:
                raise TypeError
            x, y = float(x), float(y)
    except (TypeError, ValueError, OverflowError):
        x = y = nan
    # NaN is not between anything.
    if -NUMBER_MAX < x < NUMBER_MAX > y > -NUMBER_MAX:
        return x, y
    raise InvalidPluginResult(
        f"{name} = {shown(value)}: must be two numbers between -{NUMBER_MAX:g} and {NUMBER_MAX:g},"
        " in m"
    )


def shown(value: Any) -> str:
    """A value as error lines show it, whatever it is."""
    try:
        text = " ".join(reprlib.repr(value).split())
    except Exception:
        return f"a {type(value).__name__}"
    return text
