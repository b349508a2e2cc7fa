"""What a study is: a base scenario, axes to vary it along, seeds, measures. Read from TOML.

A study is the grid of all combinations of its axes' levels, its cells, each run with the same
seeds. Everything is checked before anything runs: the file itself, and every cell's scenario. All
cells of one seed meet the same draws (``encircle.world.random_streams``), so arms of a study are
compared in pairs.

The fingerprint covers what the numbers depend on, the base scenario and the axes, and neither
titles nor seeds: more seeds can be added to a table later.
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

from encircle.measures.registry import MEASURES
from encircle.protocol.plugins import GROUPS, MEASURES_GROUP, STRATEGIES, TARGETS, installed
from encircle.protocol.process.log import printable
from encircle.world.loading.load import load
from encircle.world.loading.remarks import remarks_on
from encircle.world.scenario.errors import ScenarioError
from encircle.world.scenario.fields import shown
from encircle.world.scenario.model import Scenario

CELLS_MAX = 100_000
CELLS_NAMED_MAX = 4
SEEDS_MAX = 1_000_000
Bound = Annotated[float, Field(ge=-1e12, le=1e12, allow_inf_nan=False)]
Visible = Annotated[str, AfterValidator(printable)]
"""Text that figures, tables and lines show."""
NAME = re.compile(r"[a-z][a-z0-9_]{0,30}")
RESERVED = ("cell", "seed", "digest", "captured", "ticks", "failed", "wall_s", "code", "versions")
STRATEGY = "strategy"
DELIVERED = "delay_s_mean"
"""The measure of the delay that came of the radio."""
DELAYS = ("channel.delay.mean_s", "channel.delay.low_s", "channel.delay.high_s")
"""Keys that ask for a delay, in s."""


SEEDS = f"must be a number from 1 to {SEEDS_MAX}, or a list of different seeds from 0 to 2^63 - 1"


def _seeds(value: Any) -> Any:
    """Seeds as they are, so that nothing but a number or a list of numbers goes further."""
    if isinstance(value, list | tuple):
        good = (
            0 < len(value) <= SEEDS_MAX
            and all(type(seed) is int and 0 <= seed < 2**63 for seed in value)
            and len(set(value)) == len(value)
        )
    else:
        good = type(value) is int and 0 < value <= SEEDS_MAX
    if not good:
        raise ValueError(SEEDS)
    return value


def _scenario(value: Any) -> Any:
    if not isinstance(value, str | dict):
        raise ValueError("must be a shipped scenario's name, a file's, or a table")
    return value


def _name(value: str) -> str:
    if NAME.fullmatch(value) is None:
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

    first: Bound
    last: Bound
    count: Annotated[int, Field(ge=2, le=1000)]


class Arm(_Model):
    """One level of an axis that changes several keys at once."""

    name: Visible
    set: dict[str, Any]


class Axis(_Model):
    """One axis: a key with ``values`` or a ``range`` of them, or named ``arms``.

    ``scale`` is what values are multiplied with to be shown in ``unit``: 100 for a share in %.
    ``show``: levels of a delay are shown as they are asked for or, once there are runs, by the mean
    delay in s that was delivered at each, ``delivered_s``.
    """

    name: Annotated[str, AfterValidator(_name)]
    key: str | None = None
    values: tuple[Any, ...] | None = None
    range: Range | None = None
    arms: tuple[Arm, ...] | None = None
    label: Visible = ""
    unit: Visible = ""
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
            texts = {_text(level) for level in self.levels}
            if self.numeric and not all(isfinite(float(level)) for level in self.levels):
                raise OverflowError
        except (TypeError, OverflowError):
            raise ValueError(
                "levels must be finite numbers, texts, truth values, or lists and tables of those"
            ) from None
        if len(texts) < len(self.levels):
            raise ValueError(f"every level once, not {list(self.levels)}")
        if self.show == "delivered" and not (self.key in DELAYS and self.numeric):
            raise ValueError(
                f"show = 'delivered' needs an axis of a delay: a key of {', '.join(DELAYS)} with"
                f" numbers, not {self.key or 'arms'}"
            )
        return self

    @cached_property
    def levels(self) -> tuple[Any, ...]:
        """The levels as they stand in the table: values, or names of arms."""
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
        """Whether the levels are numbers, to be drawn on a scale."""
        return all(isinstance(v, int | float) and not isinstance(v, bool) for v in self.levels)

    def changes(self, index: int) -> dict[str, Any]:
        """Keys and values of the level at a place."""
        if self.arms is not None:
            return self.arms[index].set
        assert self.key is not None
        return {self.key: self.levels[index]}

    def column(self, index: int) -> Any:
        """The level at a place as it stands in the table: of one type for the whole axis."""
        level = self.levels[index]
        if self.numeric:
            return float(level)
        return level if isinstance(level, str) else _text(level)

    def as_delivered(self, delivered_s: Sequence[float]) -> "Axis":
        """The axis with its levels shown by these mean delays, one for each."""
        label = f"delivered {self.label or self.name.replace('_', ' ')}"
        axis = self.model_copy(update={"label": label})
        axis._delivered_s = tuple(delivered_s)
        return axis

    @property
    def shown_values(self) -> tuple[float, ...]:
        """What the levels of a numeric axis are shown by, before ``scale``: places on a line."""
        return self._delivered_s or tuple(float(level) for level in self.levels)

    def shown_value(self, value: float) -> str:
        """A place between levels as a person reads it, without unit."""
        shown = value * self.scale
        return f"{shown:.0f}" if abs(shown) >= 1000.0 else f"{shown:.3g}"

    def shown(self, level: Any) -> str:
        """A level as a person reads it, without unit."""
        if self._delivered_s is not None:
            return self.shown_value(self._delivered_s[self.levels.index(level)])
        if isinstance(level, float | int) and not isinstance(level, bool):
            return f"{level * self.scale:.6g}"
        return _text(level) if isinstance(level, list | tuple | dict) else str(level)


class Plan(_Model):
    """A study, complete and checked. ``compare``: the axis whose levels are compared in pairs."""

    name: str = "study"
    title: Visible = ""
    question: str = ""
    scenario: Annotated[str | dict[str, Any], BeforeValidator(_scenario)]
    set: dict[str, Any] = {}
    changes: tuple[str, ...] = ()
    axes: tuple[Axis, ...] = ()
    strategies: tuple[str, ...] = ()
    seeds: Annotated[int | tuple[int, ...], BeforeValidator(_seeds)] = 40
    measures: tuple[str, ...] = ()
    compare: str | None = None
    baseline: str | None = None
    tolerated_rate: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.9

    @cached_property
    def all_axes(self) -> tuple[Axis, ...]:
        """The axes, that of the strategies last."""
        if not self.strategies:
            return self.axes
        chosen = Axis(name=STRATEGY, key="team.strategy", values=self.strategies)
        return (*self.axes, chosen)

    @cached_property
    def seed_list(self) -> tuple[int, ...]:
        """The seeds of every cell."""
        return tuple(range(1, self.seeds + 1)) if isinstance(self.seeds, int) else self.seeds

    @cached_property
    def cells(self) -> tuple[tuple[int, ...], ...]:
        """Places of each cell's levels on the axes; the last axis varies fastest."""
        return tuple(itertools.product(*(range(len(axis.levels)) for axis in self.all_axes)))

    @property
    def runs(self) -> int:
        """How many runs the study has."""
        return len(self.cells) * len(self.seed_list)

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the measures in the table; the delay that was delivered is always one."""
        return (
            tuple(dict.fromkeys((*self.measures, DELIVERED))) if self.measures else tuple(MEASURES)
        )

    @cached_property
    def compared(self) -> Axis | None:
        """The axis whose levels are compared, if any."""
        wanted = self.compare or (STRATEGY if len(self.strategies) > 1 else None)
        return next((axis for axis in self.all_axes if axis.name == wanted), None)

    @cached_property
    def fingerprint(self) -> str:
        """Digest of everything that the numbers of a cell and seed depend on, but the code."""
        cells = [_numbers(self.scenario_of(cell)) for cell in range(len(self.cells))]
        axes = [[axis.name, axis.levels] for axis in self.all_axes]
        tree = {"cells": cells, "axes": axes, "measures": self.columns}
        return hashlib.blake2b(_text(tree).encode(), digest_size=8).hexdigest()

    @cached_property
    def plugins(self) -> tuple[tuple[str, str], ...]:
        """Policies, targets and measures of other packages that are used: group and name."""
        used = {(MEASURES_GROUP, name) for name in self.columns if name not in MEASURES}
        for cell in range(len(self.cells)):
            scenario = self.scenario_of(cell)
            used |= {(STRATEGIES, scenario.team.strategy), (TARGETS, scenario.target.behaviour)}
        known = {group: installed(group) for group in GROUPS}
        return tuple(
            sorted((group, name) for group, name in used if not known[group][name].shipped)
        )

    def as_delivered(self, delivered_s: Mapping[str, Sequence[float]]) -> "Plan":
        """The plan with the levels of some axes, by name, shown by the mean delays delivered."""
        axes = [
            axis.as_delivered(delivered_s[axis.name]) if axis.name in delivered_s else axis
            for axis in self.axes
        ]
        # A copy would keep what was computed from the other axes.
        fields = {name: getattr(self, name) for name in type(self).model_fields}
        return type(self).model_construct(**{**fields, "axes": tuple(axes)})

    def levels(self, cell: int) -> dict[str, Any]:
        """Axis names and levels of a cell."""
        pairs = zip(self.all_axes, self.cells[cell], strict=True)
        return {axis.name: axis.column(index) for axis, index in pairs}

    def scenario_of(self, cell: int) -> Scenario:
        """The scenario of a cell, but for its seed; ``ScenarioError`` if it cannot be run."""
        levels = zip(self.all_axes, self.cells[cell], strict=True)
        lines = [line for axis, index in levels for line in _lines(axis.changes(index))]
        return load(self.scenario, [*_lines(self.set), *self.changes, *lines])

    def remarks(self) -> list[str]:
        """What is worth knowing of the cells before they are run, each sentence once."""
        cells: dict[str, list[int]] = {}
        for cell in range(len(self.cells)):
            for line in remarks_on(self.scenario_of(cell)):
                cells.setdefault(line, []).append(cell)
        return [f"{line} ({_where(self, found)})" for line, found in cells.items()]


def _where(plan: Plan, cells: Sequence[int]) -> str:
    """Which cells these are, by the levels that tell them from the others."""
    if len(cells) == len(plan.cells):
        return "in every cell"
    places = [sorted({plan.cells[cell][k] for cell in cells}) for k in range(len(plan.all_axes))]
    if prod(map(len, places)) == len(cells):
        words = [
            f"{axis.name} = {', '.join(axis.shown(axis.levels[k]) for k in chosen)}"
            for axis, chosen in zip(plan.all_axes, places, strict=True)
            if len(chosen) < len(axis.levels)
        ]
        return f"at {' and '.join(words)}"
    named = [", ".join(f"{k} = {v}" for k, v in plan.levels(c).items()) for c in cells]
    more = len(cells) - CELLS_NAMED_MAX
    rest = f"; and {more} more cells" if more > 0 else ""
    return f"at {'; '.join(named[:CELLS_NAMED_MAX])}{rest}"


def _numbers(scenario: Scenario) -> dict[str, Any]:
    """What of a scenario its numbers depend on, but for the seed."""
    words = {"title", "description", "seed"}
    return scenario.model_dump(mode="json", exclude=words, exclude_defaults=True)


def _lines(changes: Mapping[str, Any]) -> list[str]:
    try:
        return [f"{key}={toml(value)}" for key, value in changes.items()]
    except TypeError:
        # Such as a date.
        raise ScenarioError(
            f"set = {shown(changes)}: must have numbers, texts, truth values, lists and tables only"
        ) from None


def toml(value: Any) -> str:
    """A value in TOML, on one line."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{json.dumps(k)} = {toml(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(toml, value)) + "]"
    return json.dumps(value)


def _text(tree: Any) -> str:
    return json.dumps(tree, sort_keys=True)
