"""Every measure of a run by name: what a study tabulates.

A measure is a function from a log to one number. Averages are over the ticks of the run (and over
robots, links or packets, where there are several), so that a run counts once however long it took;
NaN stands where there is nothing to average. ``docs/measures.md`` defines each one.

Some measures are of each robot, and a study names whose: ``path_m/r3``.

Those of other packages are found by entry point, group ``encircle.measures``. The modules of
measures and the log import scipy. They are imported when a measure is first taken, not for names.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache, partial
from importlib import import_module
from math import isinf, nan
from typing import TYPE_CHECKING, Any, TypeAlias

from encircle.protocol.errors import did_you_mean
from encircle.protocol.plugins import (
    MEASURES_GROUP,
    InvalidPluginResult,
    PluginFailed,
    Registry,
    shown,
)

if TYPE_CHECKING:
    from encircle.runlog.runlog import RunLog

SHIPPED: Mapping[str, tuple[str, ...]] = {
    "motion": (
        "captured",
        "capture_tick",
        "capture_s",
        "ring_tick",
        "ring_s",
        "path_m_mean",
        "path_m_total",
        "effort_m2ps_mean",
        "separation_robots_m_min",
        "separation_m_min",
        "contacts",
        "collisions",
        "gap_rad_mean",
        "gap_rad_final",
        "enclosed_share",
    ),
    "ring_closure": (
        "closed_share",
        "slack_rad_mean",
        "slack_rad_final",
    ),
    "radio": (
        "age_ticks_mean",
        "age_ticks_p95",
        "age_ticks_max",
        "age_ticks_mean_worst",
        "unheard_share",
        "delivery_ratio",
        "delay_ticks_mean",
        "delay_s_mean",
        "messages_sent",
        "messages_hz_mean",
        "sent_bytes",
        "sent_bytes_per_s",
        "sent_bytes_pose",
        "sent_bytes_payload",
        "sent_bytes_relayed",
        "sent_bytes_estimate",
    ),
    "belief": (
        "peer_error_m_mean",
        "peer_error_m_p95",
        "peer_error_m_rms",
        "peer_missing_share",
        "target_error_m_rms",
        "estimate_missing_share",
        "nees_mean",
        "nees_in_band_share",
    ),
    "choice": (
        "conflict_share",
        "conflict_pairs_mean",
        "conflict_ticks",
        "switches",
        "switch_share",
        "xi_disagreement_share",
        "xi_spread_ticks_mean",
        "regret_m_mean",
        "regret_defined_share",
    ),
    "agreement": (
        "agreed",
        "agreement_tick",
        "agreement_s",
        "negotiation_ticks",
        "negotiation_messages",
        "negotiation_bytes",
        "negotiation_payload_bytes",
    ),
}
"""The measures of each module, in the order of a study's columns."""
SHIPPED_OF_EACH_ROBOT: Mapping[str, tuple[str, ...]] = {
    "per_robot": (
        "path_m",
        "effort_m2ps",
        "search_share",
        "encircle_share",
        "shrink_share",
        "pursue_share",
        "lost_share",
        "messages_sent",
        "sent_bytes",
        "sent_bytes_payload",
        "sent_bytes_relayed",
        "sent_bytes_estimate",
        "delivery_ratio",
        "received_share",
        "age_ticks_mean",
        "peer_error_m_mean",
        "target_error_m_rms",
        "estimate_missing_share",
        "conflict_share",
        "switches",
    ),
}
"""The measures of each robot, which a study has if it names them with a robot: ``path_m/r3``."""

ROBOT_SUFFIX = re.compile(r"(.+)/(r[1-9][0-9]*)")
MeasureFunction: TypeAlias = Callable[["RunLog"], Any]


@dataclass(frozen=True, slots=True)
class Measure:
    """One measure: the name of its column, its unit (1 for none), what it is, how it is had."""

    name: str
    unit: str
    description: str
    function: MeasureFunction


class _ShippedFunctions(Mapping[str, MeasureFunction]):
    """Shipped measures' functions by name; a module is imported when one of it is taken."""

    def __init__(self, shipped: Mapping[str, tuple[str, ...]]) -> None:
        self._modules = {name: module for module, names in shipped.items() for name in names}

    def __getitem__(self, name: str) -> MeasureFunction:
        module = import_module(f"encircle.measures.{self._modules[name]}")
        function: MeasureFunction = getattr(module, name)
        return function

    def __contains__(self, name: object) -> bool:
        return name in self._modules

    def __iter__(self) -> Iterator[str]:
        return iter(self._modules)

    def __len__(self) -> int:
        return len(self._modules)


MEASURES: Mapping[str, MeasureFunction] = _ShippedFunctions(SHIPPED)
"""The shipped measures of the team: what is measured where no names are given."""
ROBOT_MEASURES: Mapping[str, MeasureFunction] = _ShippedFunctions(SHIPPED_OF_EACH_ROBOT)
"""The shipped measures of each robot: functions of a log that answer (N,) numbers."""
REGISTRY = Registry(MEASURES_GROUP, MEASURES)


def split_name(name: str) -> tuple[str, str]:
    """A measure's name and the robot whose it is: ``path_m/r3`` is path_m of r3, else of none."""
    of_robot = ROBOT_SUFFIX.fullmatch(name)
    return (of_robot[1], of_robot[2]) if of_robot else (name, "")


def is_shipped(name: str) -> bool:
    """Whether a measure, of the team or of a robot, is one of this program's own."""
    base, robot = split_name(name)
    return base in (ROBOT_MEASURES if robot else MEASURES)


def problem_with(name: str) -> str:
    """Why nothing can be measured under that name; empty if it can. Loads that plug-in alone."""
    if is_shipped(name):
        return ""
    base, robot = split_name(name)
    if not robot and base in ROBOT_MEASURES:
        return f"is of each robot: name one, such as {base}/r1"
    if robot and (base in MEASURES or base not in REGISTRY.names()):
        near = did_you_mean(base, ROBOT_MEASURES)
        return f"unknown measure of each robot{near}; known are: {', '.join(ROBOT_MEASURES)}"
    if problem := REGISTRY.problem_with(base):
        return problem
    if _of_each_robot(REGISTRY.named(base)) == bool(robot):
        return ""
    if robot:
        return f"is of the team: name it without /{robot}"
    return f"is of each robot: name one, such as {base}/r1"


def _of_each_robot(function: MeasureFunction) -> bool:
    return bool(getattr(function, "of_each_robot", False))


@lru_cache(maxsize=256)
def measure_named(name: str) -> Measure:
    """The measure of that name; errors as of ``Registry.named``.

    A function without ``unit`` (``encircle.measures.common.in_unit``) is one without a unit.
    """
    base, robot = split_name(name)
    of_robot = robot and base in ROBOT_MEASURES
    function = ROBOT_MEASURES[base] if of_robot else REGISTRY.named(base)
    description = " ".join((function.__doc__ or "").split("\n\n")[0].split())
    unit = str(getattr(function, "unit", "1"))
    return Measure(
        name, unit, description, partial(_of_robot, function, robot) if robot else function
    )


def _of_robot(function: MeasureFunction, robot: str, log: "RunLog") -> Any:
    """A robot's own of a measure of each, NaN if the team has no such robot."""
    numbers = list(function(log))
    if len(numbers) != log.count:
        raise InvalidPluginResult(
            f"{shown(numbers)}: must be {log.count} numbers, one of each robot"
        )
    ids = log.scenario.ids
    return float(numbers[ids.index(robot)]) if robot in ids else nan


def measure(log: "RunLog", names: Iterable[str] | None = None) -> dict[str, float]:
    """The measures of that name, all that are shipped of the team by default.

    ``ValueError`` for a name that is not known, ``PluginFailed`` for a measure that fails.
    """
    wanted = list(MEASURES) if names is None else list(names)
    problems = [
        f"measure {name!r}: {problem}" for name in wanted if (problem := problem_with(name))
    ]
    if problems:
        raise ValueError("; ".join(problems))
    return {name: _measured(log, name) for name in wanted}


def _measured(log: "RunLog", name: str) -> float:
    function = measure_named(name).function
    if is_shipped(name):
        number: float = function(log)
        return number
    try:
        return _number(function(log))
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        base = split_name(name)[0]
        raise PluginFailed(MEASURES_GROUP, base, "", None, error) from error


def _number(value: Any) -> float:
    """A measure's number, NaN included; ``InvalidPluginResult`` if it is none."""
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        number = float("inf")
    if isinstance(value, str | bytes) or isinf(number):
        raise InvalidPluginResult(
            f"{shown(value)}: must be a finite number, or NaN where there is nothing to measure"
        )
    return number
