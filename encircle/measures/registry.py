"""Every measure of a run by name: what a study tabulates.

A measure is a function from a log to one number. Averages are over the ticks of the run (and over
robots, links or packets, where there are several), so that a run counts once however long it took;
NaN stands where there is nothing to average. ``docs/measures.md`` defines each one.

Those of other packages are found by entry point, group ``encircle.measures``. The modules of
measures and the log import scipy. They are imported when a measure is first taken, not for names.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib import import_module
from math import isinf
from typing import TYPE_CHECKING, Any, TypeAlias

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
        "switches",
        "switch_share",
        "xi_disagreement_share",
        "xi_spread_ticks_mean",
        "regret_m_mean",
        "regret_defined_share",
    ),
}
"""The measures of each module, in the order of a study's columns."""


MeasureFunction: TypeAlias = Callable[["RunLog"], float]


@dataclass(frozen=True, slots=True)
class Measure:
    """One measure: the name of its column, its unit (1 for none), what it is, how it is had."""

    name: str
    unit: str
    description: str
    function: MeasureFunction


class _ShippedFunctions(Mapping[str, MeasureFunction]):
    """The shipped measures' functions by name; a module is imported when one of it is taken."""

    def __init__(self) -> None:
        self._modules = {name: module for module, names in SHIPPED.items() for name in names}

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


MEASURES: Mapping[str, MeasureFunction] = _ShippedFunctions()
"""The shipped measures: what is measured where no names are given."""
REGISTRY = Registry(MEASURES_GROUP, MEASURES)


@lru_cache(maxsize=256)
def measure_named(name: str) -> Measure:
    """The measure of that name; errors as of ``Registry.named``.

    A function without ``unit`` (``encircle.measures.common.in_unit``) is one without a unit.
    """
    function = REGISTRY.named(name)
    description = " ".join((function.__doc__ or "").split("\n\n")[0].split())
    return Measure(name, str(getattr(function, "unit", "1")), description, function)


def measure(log: "RunLog", names: Iterable[str] | None = None) -> dict[str, float]:
    """The measures of that name, all that are shipped by default.

    ``ValueError`` for a name that is not known, ``PluginFailed`` for a measure that fails.
    """
    wanted = list(MEASURES) if names is None else list(names)
    problems = [
        f"measure {name!r}: {problem}"
        for name in wanted
        if (problem := REGISTRY.problem_with(name))
    ]
    if problems:
        raise ValueError("; ".join(problems))
    return {name: _measured(log, name) for name in wanted}


def _measured(log: "RunLog", name: str) -> float:
    function = measure_named(name).function
    if name in MEASURES:
        return function(log)
    try:
        return _number(function(log))
    except (Exception, SystemExit) as error:
        raise PluginFailed(MEASURES_GROUP, name, "", None, error) from error


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
