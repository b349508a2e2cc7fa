"""Plug-ins: policies, target behaviours and measures of other people.

They are found by entry point, or by the file that they are in (``my_robots.py:auction``). A plug-in
is named in a scenario or a study and is other people's code: it may be missing, broken, or fail at
any tick of a run. Then it is named in full, with where it comes from, and so is the error. There is
one ``Registry`` for each group of entry points; what is shipped with this program comes before
plug-ins of the same name.
"""

import reprlib
import sys
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache, partial
from importlib.metadata import EntryPoint, entry_points
from math import nan
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

from encircle.protocol.errors import did_you_mean
from encircle.protocol.messages import Point
from encircle.protocol.plugin_files import (
    FileProblem,
    file_digest,
    function_in_file,
    is_in_file,
    source_digest,
)
from encircle.protocol.wire.limits import NUMBER_MAX

STRATEGIES, TARGETS, MEASURES_GROUP = "encircle.strategies", "encircle.targets", "encircle.measures"
GROUPS = (STRATEGIES, TARGETS, MEASURES_GROUP)
KINDS = {STRATEGIES: "policy", TARGETS: "target behaviour", MEASURES_GROUP: "measure"}
TARGET = "target"
_POLICIES = "encircle.agents.policies"
SHIPPED_POLICIES = {
    "xi-star": f"{_POLICIES}.paper:xi_star",
    "xi-0": f"{_POLICIES}.paper:xi_0",
    "xi-1": f"{_POLICIES}.paper:xi_1",
    "xi-3": f"{_POLICIES}.paper:xi_3",
    "pursuit": f"{_POLICIES}.paper:pursue",
    "auction": f"{_POLICIES}.auction:auction",
    "hungarian-consensus": f"{_POLICIES}.hungarian_consensus:hungarian_consensus",
    "intents": f"{_POLICIES}.intents:intents",
    "closed-ring": f"{_POLICIES}.closed_ring:closed_ring",
    "voronoi": f"{_POLICIES}.voronoi:voronoi",
    "group-chase": f"{_POLICIES}.group_chase:group_chase",
}
"""Policies that every robot has, by name; a world knows them without looking for plug-ins."""
OWN = "encircle"
"""The distribution whose entry points are the shipped ones, not plug-ins."""
TEXT_MAX = 300


class UnknownPlugin(ValueError):
    """A name that nothing has; the message lists the known ones, the nearest first."""


class PluginLoadError(Exception):
    """A plug-in that is installed but cannot be loaded; the message says which and why."""


class InvalidPluginResult(ValueError):
    """What a plug-in has answered cannot be; the message says what, and what must be."""


class PluginFailed(Exception):
    """A plug-in that failed in mid-run; the message names it, and who, when, and the error.

    ``who``: the robot's id, ``target``, or empty for a measure; ``tick``: None for a measure, which
    is of a whole run; ``error``: what was raised.
    """

    def __init__(
        self, group: str, name: str, who: str, tick: int | None, error: BaseException
    ) -> None:
        plugin = installed(group).get(name)
        source = f" ({plugin.source})" if plugin is not None else ""
        where = "" if who in (TARGET, "") else f" in robot {who}"
        when = "" if tick is None else f" at tick {tick}"
        reason = (
            f"answered {error}" if isinstance(error, InvalidPluginResult) else error_line(error)
        )
        super().__init__(f"{KINDS[group]} {name!r}{source} failed{where}{when}: {reason}")
        self.who = who
        self.error = error

    @property
    def trace(self) -> str:
        """The traceback of the error, to be read by whoever wrote the plug-in."""
        return "".join(traceback.format_exception(self.error))


@dataclass(frozen=True, slots=True)
class Plugin:
    """An entry point."""

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
        return _loaded(self.entry.load, self.source)


def _loaded(load: Callable[[], Any], source: str) -> Any:
    try:
        loaded = load()
    except FileProblem as error:
        raise PluginLoadError(str(error)) from None
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        raise PluginLoadError(f"{source} cannot be loaded: {error_line(error)}") from error
    if not callable(loaded):
        raise PluginLoadError(f"{source} is {type(loaded).__name__}, must be a function")
    return loaded


def installed(group: str) -> dict[str, Plugin]:
    """All entry points of a group by name; of several of one name this program's own."""
    return dict(_installed(group, _search_path_state()))


@lru_cache(maxsize=16)
def _installed(group: str, _: tuple[tuple[int, ...], ...]) -> dict[str, Plugin]:
    # Each search reads files of every distribution, which takes 10 ms; a study loads a scenario for
    # each of its cells.
    plugins: dict[str, Plugin] = {}
    for entry in entry_points(group=group):
        plugin = Plugin(group, entry.name, entry)
        # Whose it is stands in a file that takes long to read.
        if entry.name not in plugins or plugin.shipped:
            plugins[entry.name] = plugin
    return plugins


def _search_path_state() -> tuple[tuple[int, ...], ...]:
    """Which directories are searched, and when a distribution last came into or left each."""
    states = []
    for directory in sys.path:
        try:
            status = Path(directory).stat()
        except OSError:
            continue
        states.append((status.st_dev, status.st_ino, status.st_mtime_ns))
    return tuple(states)


@dataclass(frozen=True, slots=True)
class Registry:
    """Everything of one group that can be named: what is shipped, plug-ins, functions in files.

    ``shipped``: functions by name, or where they are (``module:function``), imported when they are
    named. They are declared as entry points too; to look those up costs 20 ms, which a robot's
    start need not pay.
    """

    group: str
    shipped: Mapping[str, Any] = field(default_factory=dict)

    def names(self) -> list[str]:
        """All names, the shipped ones first. Nothing is loaded."""
        return list(dict.fromkeys([*self.shipped, *sorted(installed(self.group))]))

    def named(self, name: str, digest: str = "") -> Any:
        """The function of that name; ``UnknownPlugin`` if there is none.

        ``digest``: the SHA-256 of the file that it must be in, if its name says its file.
        ``PluginLoadError`` if it is installed, or in a file, but cannot be loaded.
        """
        if name in self.shipped:
            shipped = self.shipped[name]
            return resolve_name(shipped) if isinstance(shipped, str) else shipped
        if is_in_file(name):
            return _loaded(partial(function_in_file, name, digest), name)
        plugin = installed(self.group).get(name)
        if plugin is None:
            raise UnknownPlugin(self._unknown(name))
        return plugin.load()

    def problem_with(self, name: str) -> str:
        """Why that name cannot be used; empty if it can. Of plug-ins only this one is loaded."""
        if name in self.shipped:
            return ""
        if is_in_file(name):
            try:
                self.named(name)
            except PluginLoadError as error:
                return str(error)
            return ""
        plugin = installed(self.group).get(name)
        if plugin is None:
            return self._unknown(name)
        try:
            # The shipped ones are in order, and may take long to import.
            _ = plugin.shipped or plugin.load()
        except PluginLoadError as error:
            return str(error)
        return ""

    def _unknown(self, name: str) -> str:
        kind = KINDS[self.group]
        if name.endswith(".py"):
            return f"is a file: name its function too, as {name}:my_{kind.split()[-1]}"
        known = self.names()
        return f"unknown {kind}{did_you_mean(name, known)}; known are: {', '.join(known)}"


def policy_source(name: str) -> str:
    """SHA-256 of the file that a policy is in; empty for a shipped one, or one that is in none.

    ``PluginLoadError`` or ``UnknownPlugin`` if the policy cannot be had.
    """
    if name in SHIPPED_POLICIES:
        return ""
    policy = Registry(STRATEGIES).named(name)
    if not is_in_file(name):
        return source_digest(policy)
    try:
        return file_digest(name)
    except FileProblem as error:
        raise PluginLoadError(str(error)) from None


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
