"""The model of a study: a base scenario, axes, seeds and measures, as read from TOML.

A study is a grid: every combination of levels of its axes is a cell, and every cell is run with the
same seeds. All cells of one seed get the same random draws (``encircle.world.random_streams``), so
the runs of a study can be compared in pairs. Everything is checked before anything runs: the file
here, and every cell's scenario in ``encircle.studies.plan_problems``.

The fingerprint is a digest of what the numbers of a run depend on: base scenario, axes and
measures. It leaves out titles and seeds, so that seeds can be added to an existing table.
"""

import hashlib
import itertools
import json
import re
from collections.abc import Mapping, Sequence
from functools import cached_property
from math import isfinite, prod
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    FiniteFloat,
    PrivateAttr,
    model_validator,
)

from encircle.measures.registry import MEASURES, is_shipped, split_name
from encircle.protocol.plugin_files import is_in_file
from encircle.protocol.plugins import (
    GROUPS,
    MEASURES_GROUP,
    SHIPPED_POLICIES,
    STRATEGIES,
    TARGETS,
    Plugin,
    installed,
)
from encircle.protocol.process.log import printable
from encircle.world.loading.load import load
from encircle.world.loading.remarks import remarks_on
from encircle.world.scenario.errors import ScenarioError
from encircle.world.scenario.fields import SEED_END, shown
from encircle.world.scenario.model import Scenario

CELLS_MAX = 100_000
CELLS_NAMED_MAX = 4
SEEDS_MAX = 1_000_000
BoundedFloat = Annotated[float, Field(ge=-1e12, le=1e12, allow_inf_nan=False)]
PrintableText = Annotated[str, AfterValidator(printable)]
"""Text for figures, tables and the terminal, without control characters."""
NAME_PATTERN = re.compile(r"[a-z][a-z0-9_]{0,30}")
RESERVED_COLUMNS = (
    "cell",
    "seed",
    "digest",
    "captured",
    "ticks",
    "failed",
    "wall_s",
    "code",
    "versions",
)
STRATEGY_AXIS = "strategy"
DELIVERED_DELAY = "delay_s_mean"
"""The measure of the mean delay with which the channel delivered packets."""
DELAY_KEYS = ("channel.delay.mean_s", "channel.delay.low_s", "channel.delay.high_s")
"""Keys of a scenario that request a delay, in s."""


_RANGE = re.compile(r"([0-9]{1,19})-([0-9]{1,19})")
SEEDS_RULE = (
    f"must be a number from 1 to {SEEDS_MAX}, a list of different seeds from 0 to 2^63 - 1, or the"
    ' first and the last as in "1001-1200"'
)


def _validated_seeds(value: Any) -> Any:
    """Seeds, if they are a number, a list of numbers, or the first and last of a range as text."""
    if isinstance(value, str) and (ends := _RANGE.fullmatch(value)):
        first, last = int(ends[1]), int(ends[2])
        value = tuple(range(first, min(last, first + SEEDS_MAX) + 1))
    if isinstance(value, list | tuple):
        good = (
            0 < len(value) <= SEEDS_MAX
            and all(type(seed) is int and 0 <= seed < SEED_END for seed in value)
            and len(set(value)) == len(value)
        )
    else:
        good = type(value) is int and 0 < value <= SEEDS_MAX
    if not good:
        raise ValueError(SEEDS_RULE)
    return value


def _validated_scenario(value: Any) -> Any:
    if not isinstance(value, str | dict):
        raise ValueError("must be a shipped scenario's name, a file's, or a table")
    return value


def _validated_name(value: str) -> str:
    if NAME_PATTERN.fullmatch(value) is None:
        raise ValueError(
            "must begin with a small letter and have small letters, digits and _ only, at most 31"
        )
    return value


class StudyError(ValueError):
    """A study that cannot be run; the message lists every problem, one per line."""


class _Model(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Range(_Model):
    """``count`` evenly spaced levels from ``first`` to ``last``, both included."""

    first: BoundedFloat
    last: BoundedFloat
    count: Annotated[int, Field(ge=2, le=1000)]


class Arm(_Model):
    """One level of an axis that changes several keys at once."""

    name: PrintableText
    set: dict[str, Any]


class Axis(_Model):
    """One axis of a study: a key with ``values`` or a ``range`` of them, or named ``arms``.

    ``scale``: factor by which values are multiplied to be shown in ``unit``, such as 100 for a
    share in %. ``show``: whether the levels of a delay are shown as requested or, once there
    are runs, as the mean delay in s that was delivered at each level.
    """

    name: Annotated[str, AfterValidator(_validated_name)]
    key: str | None = None
    values: tuple[Any, ...] | None = None
    range: Range | None = None
    arms: tuple[Arm, ...] | None = None
    label: PrintableText = ""
    unit: PrintableText = ""
    scale: FiniteFloat = 1.0
    show: Literal["asked", "delivered"] = "asked"
    _delivered_s: tuple[float, ...] | None = PrivateAttr(None)

    @model_validator(mode="after")
    def _one_kind(self) -> "Axis":
        given = [name for name in ("values", "range", "arms") if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(f"give one of values, range and arms, not {given or 'none'}")
        if (self.arms is None) == (self.key is None):
            raise ValueError("values and range need a key, arms have their own under set")
        if not self.levels:
            raise ValueError("an axis needs at least one level")
        try:
            texts = {_json_text(level) for level in self.levels}
            if self.numeric and not all(isfinite(float(level)) for level in self.levels):
                raise OverflowError
        except (TypeError, OverflowError):
            raise ValueError(
                "levels must be finite numbers, texts, truth values, or lists and tables of those"
            ) from None
        if len(texts) < len(self.levels):
            raise ValueError(f"every level once, not {list(self.levels)}")
        if self.show == "delivered" and not (self.key in DELAY_KEYS and self.numeric):
            raise ValueError(
                f"show = 'delivered' needs an axis of a delay: a key of {', '.join(DELAY_KEYS)}"
                f" with numbers, not {self.key or 'arms'}"
            )
        return self

    @cached_property
    def levels(self) -> tuple[Any, ...]:
        """The levels: values, or names of arms."""
        if self.arms is not None:
            return tuple(arm.name for arm in self.arms)
        if self.range is not None:
            steps = np.linspace(self.range.first, self.range.last, self.range.count)
            return tuple(steps.round(12).tolist())
        return self.values or ()

    @property
    def title(self) -> str:
        """Label and unit, for axes of figures and heads of tables."""
        label = self.label or self.name.replace("_", " ")
        return f"{label} ({self.unit})" if self.unit else label

    @property
    def numeric(self) -> bool:
        """Whether the levels are numbers, which are drawn on a scale."""
        return all(isinstance(v, int | float) and not isinstance(v, bool) for v in self.levels)

    def changes(self, index: int) -> dict[str, Any]:
        """Keys and values of the level with an index."""
        if self.arms is not None:
            return self.arms[index].set
        assert self.key is not None
        return {self.key: self.levels[index]}

    def table_value(self, index: int) -> Any:
        """The level with an index as it stands in the table: of one type for the whole axis."""
        level = self.levels[index]
        if self.numeric:
            return float(level)
        return level if isinstance(level, str) else _json_text(level)

    def as_delivered(self, delivered_s: Sequence[float]) -> "Axis":
        """The axis with its levels shown as mean delivered delays in s, one for each level."""
        label = f"delivered {self.label or self.name.replace('_', ' ')}"
        axis = self.model_copy(update={"label": label})
        axis._delivered_s = tuple(delivered_s)
        return axis

    @property
    def display_values(self) -> tuple[float, ...]:
        """The numbers as which the levels of a numeric axis are shown, before ``scale``."""
        return self._delivered_s or tuple(float(level) for level in self.levels)

    def display_value(self, value: float) -> str:
        """A value between levels as a person reads it, without unit."""
        shown = value * self.scale
        return f"{shown:.0f}" if abs(shown) >= 1000.0 else f"{shown:.3g}"

    def display_level(self, level: Any) -> str:
        """A level as a person reads it, without unit."""
        if self._delivered_s is not None:
            return self.display_value(self._delivered_s[self.levels.index(level)])
        if isinstance(level, float | int) and not isinstance(level, bool):
            return f"{level * self.scale:.6g}"
        return _json_text(level) if isinstance(level, list | tuple | dict) else str(level)


class Plan(_Model):
    """A study that is complete and checked.

    ``compare``: name of the axis whose levels are compared in pairs. ``baseline``: its level
    with which the others are compared. ``tolerated_rate``: capture rate of which the report
    says up to which level it is reached.
    """

    name: str = "study"
    title: PrintableText = ""
    question: str = ""
    scenario: Annotated[str | dict[str, Any], BeforeValidator(_validated_scenario)]
    set: dict[str, Any] = {}
    changes: tuple[str, ...] = ()
    axes: tuple[Axis, ...] = ()
    strategies: tuple[str, ...] = ()
    seeds: Annotated[int | tuple[int, ...], BeforeValidator(_validated_seeds)] = 40
    measures: tuple[str, ...] = ()
    compare: str | None = None
    baseline: str | None = None
    tolerated_rate: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.9

    @cached_property
    def all_axes(self) -> tuple[Axis, ...]:
        """The axes; that of the strategies, if there is one, is the last."""
        if not self.strategies:
            return self.axes
        chosen = Axis(name=STRATEGY_AXIS, key="team.strategy", values=self.strategies)
        return (*self.axes, chosen)

    @cached_property
    def seed_list(self) -> tuple[int, ...]:
        """The seeds of every cell."""
        return tuple(range(1, self.seeds + 1)) if isinstance(self.seeds, int) else self.seeds

    @cached_property
    def cells(self) -> tuple[tuple[int, ...], ...]:
        """Indices of each cell's levels, one per axis; the last axis varies fastest."""
        return tuple(itertools.product(*(range(len(axis.levels)) for axis in self.all_axes)))

    @property
    def runs(self) -> int:
        """The number of runs of the study."""
        return len(self.cells) * len(self.seed_list)

    @property
    def measure_names(self) -> tuple[str, ...]:
        """Names of the measures in the table; the mean delivered delay is always one of them."""
        return (
            tuple(dict.fromkeys((*self.measures, DELIVERED_DELAY)))
            if self.measures
            else tuple(MEASURES)
        )

    @cached_property
    def compared_axis(self) -> Axis | None:
        """The axis whose levels are compared, or None."""
        axis_name = self.compare or (STRATEGY_AXIS if len(self.strategies) > 1 else None)
        return next((axis for axis in self.all_axes if axis.name == axis_name), None)

    @cached_property
    def fingerprint(self) -> str:
        """Digest of everything that the numbers of a cell and seed depend on, except the code."""
        cells = [_scenario_without_texts(self.scenario_of(cell)) for cell in range(len(self.cells))]
        axes = [[axis.name, axis.levels] for axis in self.all_axes]
        tree = {"cells": cells, "axes": axes, "measures": self.measure_names}
        return hashlib.blake2b(_json_text(tree).encode(), digest_size=8).hexdigest()

    @cached_property
    def plugins(self) -> tuple[tuple[str, str], ...]:
        """Group and name of each plug-in of another package that the study uses."""
        used = {
            (MEASURES_GROUP, split_name(name)[0])
            for name in self.measure_names
            if not is_shipped(name)
        }
        for cell in range(len(self.cells)):
            scenario = self.scenario_of(cell)
            used.add((TARGETS, scenario.target.behaviour))
            used |= {(STRATEGIES, scenario.strategy_of(robot)) for robot in scenario.ids}
        known = {group: installed(group) for group in GROUPS}
        return tuple(
            sorted(
                (group, name)
                for group, name in used
                if is_in_file(name)
                # An install from before a policy was shipped has no entry point of it.
                or (name not in SHIPPED_POLICIES and not _is_shipped(known[group].get(name)))
            )
        )

    def as_delivered(self, delivered_s: Mapping[str, Sequence[float]]) -> "Plan":
        """The plan with the levels of some axes, by name, shown as mean delivered delays in s."""
        axes = [
            axis.as_delivered(delivered_s[axis.name]) if axis.name in delivered_s else axis
            for axis in self.axes
        ]
        # A copy would keep cached properties that were computed from the old axes.
        fields = {name: getattr(self, name) for name in type(self).model_fields}
        return type(self).model_construct(**{**fields, "axes": tuple(axes)})

    def levels(self, cell: int) -> dict[str, Any]:
        """Axis names and levels of a cell."""
        pairs = zip(self.all_axes, self.cells[cell], strict=True)
        return {axis.name: axis.table_value(index) for axis, index in pairs}

    def scenario_of(self, cell: int) -> Scenario:
        """The scenario of a cell, without its seed; raises ``ScenarioError`` if it is not valid."""
        return load(self.scenario, self.changes_of(cell))

    def changes_of(self, cell: int) -> list[str]:
        """What makes the scenario of a cell from the base scenario: ``key=value``, in order."""
        levels = zip(self.all_axes, self.cells[cell], strict=True)
        lines = [line for axis, index in levels for line in _assignments(axis.changes(index))]
        return [*_assignments(self.set), *self.changes, *lines]

    def remarks(self) -> list[str]:
        """Remarks on the cells' scenarios that a user should know before the runs, each once."""
        cells: dict[str, list[int]] = {}
        for cell in range(len(self.cells)):
            for line in remarks_on(self.scenario_of(cell)):
                cells.setdefault(line, []).append(cell)
        return [
            f"{line} ({_cells_text(self, cell_numbers)})" for line, cell_numbers in cells.items()
        ]


def _is_shipped(plugin: Plugin | None) -> bool:
    """Whether a plug-in, None if it is not installed, is one of this program's own."""
    return plugin is not None and plugin.shipped


def _cells_text(plan: Plan, cells: Sequence[int]) -> str:
    """Which cells these are, by the levels that distinguish them from the others."""
    if len(cells) == len(plan.cells):
        return "in every cell"
    level_indices = [
        sorted({plan.cells[cell][k] for cell in cells}) for k in range(len(plan.all_axes))
    ]
    if prod(map(len, level_indices)) == len(cells):
        clauses = [
            f"{axis.name} = {', '.join(axis.display_level(axis.levels[k]) for k in chosen)}"
            for axis, chosen in zip(plan.all_axes, level_indices, strict=True)
            if len(chosen) < len(axis.levels)
        ]
        return f"at {' and '.join(clauses)}"
    named = [", ".join(f"{k} = {v}" for k, v in plan.levels(c).items()) for c in cells]
    more = len(cells) - CELLS_NAMED_MAX
    rest = f"; and {more} more cells" if more > 0 else ""
    return f"at {'; '.join(named[:CELLS_NAMED_MAX])}{rest}"


def _scenario_without_texts(scenario: Scenario) -> dict[str, Any]:
    """A scenario's keys that its numbers depend on, without the seed."""
    excluded = {"title", "description", "seed"}
    return scenario.model_dump(mode="json", exclude=excluded, exclude_defaults=True)


def _assignments(changes: Mapping[str, Any]) -> list[str]:
    try:
        return [f"{key}={toml_text(value)}" for key, value in changes.items()]
    except TypeError:
        # TOML has values that a scenario cannot hold, such as dates.
        raise ScenarioError(
            f"set = {shown(changes)}: must have numbers, texts, truth values, lists and tables only"
        ) from None


def toml_text(value: Any) -> str:
    """A value in TOML, on one line."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{json.dumps(k)} = {toml_text(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(toml_text, value)) + "]"
    return json.dumps(value)


def _json_text(tree: Any) -> str:
    return json.dumps(tree, sort_keys=True)
