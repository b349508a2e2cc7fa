"""What a study is: a base scenario, axes to vary it along, seeds, measures. Read from TOML.

A study is the grid of all combinations of its axes' levels, its cells, each run with the same
seeds. Everything is checked before anything runs: the file itself, and every cell's scenario. All
cells of one seed meet the same draws (``world.draws``), so arms of a study are compared in pairs.

The fingerprint covers what the numbers depend on, the base scenario and the axes, and neither
titles nor seeds: more seeds can be added to a table later.
"""

import hashlib
import itertools
import json
import tomllib
from collections.abc import Mapping, Sequence
from functools import cached_property
from importlib import resources
from math import prod
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    PrivateAttr,
    ValidationError,
    model_validator,
)

from encircle.measures import MEASURES
from protocol.plugins import GROUPS, STRATEGIES, TARGETS, installed
from world.scenario import Scenario, ScenarioError, load

CELLS_MAX = 100_000
CELLS_NAMED_MAX = 4
SEEDS_MAX = 1_000_000
Name = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,30}$")]
RESERVED = ("cell", "seed", "digest", "captured", "ticks", "failed", "wall_s", "code", "versions")
STRATEGY = "strategy"
DELIVERED = "delay_s_mean"
"""The measure of the delay that came of the radio."""
DELAYS = ("channel.delay.mean_s", "channel.delay.low_s", "channel.delay.high_s")
"""Keys that ask for a delay, in s."""


class StudyError(ValueError):
    """A study that cannot be run; the message lists every problem, one per line."""


class _Model(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Range(_Model):
    """``count`` evenly spaced levels from ``first`` to ``last``, both included."""

    first: float
    last: float
    count: Annotated[int, Field(ge=2, le=1000)]


class Arm(_Model):
    """One level of an axis that changes several keys at once."""

    name: str
    set: dict[str, Any]


class Axis(_Model):
    """One axis: a key with ``values`` or a ``range`` of them, or named ``arms``.

    ``scale`` is what values are multiplied with to be shown in ``unit``: 100 for a share in %.
    ``show``: levels of a delay are shown as they are asked for or, once there are runs, by the mean
    delay in s that was delivered at each, ``delivered_s``.
    """

    name: Name
    key: str | None = None
    values: tuple[Any, ...] | None = None
    range: Range | None = None
    arms: tuple[Arm, ...] | None = None
    label: str = ""
    unit: str = ""
    scale: float = 1.0
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
        if len({_text(level) for level in self.levels}) < len(self.levels):
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

    def changes(self, place: int) -> dict[str, Any]:
        """Keys and values of the level at a place."""
        if self.arms is not None:
            return self.arms[place].set
        assert self.key is not None
        return {self.key: self.levels[place]}

    def column(self, place: int) -> Any:
        """The level at a place as it stands in the table: of one type for the whole axis."""
        level = self.levels[place]
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
    title: str = ""
    question: str = ""
    scenario: str | dict[str, Any]
    set: dict[str, Any] = {}
    changes: tuple[str, ...] = ()
    axes: tuple[Axis, ...] = ()
    strategies: tuple[str, ...] = ()
    seeds: int | tuple[int, ...] = 40
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
        """Strategies and targets of other packages that some cell uses: group and name."""
        used = set()
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
        return {axis.name: axis.column(place) for axis, place in pairs}

    def scenario_of(self, cell: int) -> Scenario:
        """The scenario of a cell, but for its seed; ``ScenarioError`` if it cannot be run."""
        levels = zip(self.all_axes, self.cells[cell], strict=True)
        lines = [line for axis, place in levels for line in _lines(axis.changes(place))]
        return load(self.scenario, [*_lines(self.set), *self.changes, *lines])

    def problems(self) -> list[str]:
        """What is wrong with the study, cells included; empty if nothing is."""
        found = [*_problems_of_names(self), *_problems_of_size(self)]
        if found:
            return found
        seen: dict[str, str] = {}
        for cell in range(len(self.cells)):
            try:
                if self.scenario_of(cell).clock == "wall":
                    raise ScenarioError(
                        "clock = 'wall': a study pairs runs that can be repeated; use 'lockstep'"
                    )
            except ScenarioError as error:
                for line in str(error).splitlines()[1:] or [str(error)]:
                    where = ", ".join(f"{k} = {v}" for k, v in self.levels(cell).items())
                    seen.setdefault(line.strip(), where)
        return [f"{line} (at {where or 'the base'})" for line, where in seen.items()]

    def remarks(self) -> list[str]:
        """What is worth knowing of the cells before they are run, each sentence once."""
        cells: dict[str, list[int]] = {}
        for cell in range(len(self.cells)):
            for line in self.scenario_of(cell).remarks():
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


def _problems_of_names(plan: Plan) -> list[str]:
    found = []
    names = [axis.name for axis in plan.all_axes]
    taken = {*RESERVED, *MEASURES}
    found += [f"axes: {n!r} stands twice" for n in sorted(set(names)) if names.count(n) > 1]
    found += [
        f"axes.{k}.name = {n!r}: is a column of the table"
        for k, n in enumerate(names)
        if n in taken
    ]
    found += [
        f"measures: {name!r} is not known; known are: {', '.join(MEASURES)}"
        for name in plan.measures
        if name not in MEASURES
    ]
    if plan.compare is not None and plan.compare not in names:
        found.append(f"compare = {plan.compare!r}: must be one of the axes {', '.join(names)}")
    if plan.baseline is not None:
        axis = plan.compared
        if axis is None or plan.baseline not in map(str, axis.levels):
            known = ", ".join(map(str, axis.levels)) if axis else "none, as nothing is compared"
            found.append(f"baseline = {plan.baseline!r}: must be one of the levels ({known})")
    return found


def _problems_of_size(plan: Plan) -> list[str]:
    found = []
    seeds = plan.seed_list
    if any(axis.key == "seed" for axis in plan.axes) or "seed" in plan.set:
        found.append("key 'seed': every cell is run with the study's seeds, give those")
    if (
        not 1 <= len(seeds) <= SEEDS_MAX
        or len(set(seeds)) < len(seeds)
        or not 0 <= min(seeds) <= max(seeds) < 2**63
    ):
        found.append(
            f"seeds = {_shown(plan.seeds)}: must be a number from 1 to {SEEDS_MAX},"
            " or different seeds from 0 to 2^63 - 1"
        )
    cells = 1
    for axis in plan.all_axes:
        cells *= len(axis.levels)
    if cells > CELLS_MAX:
        found.append(f"axes: {cells} cells, at most {CELLS_MAX} are allowed")
    return found


def load_plan(
    source: str | Path | Mapping[str, Any], changes: Sequence[str] = (), seeds: int | None = None
) -> Plan:
    """A study from a shipped name, a TOML file or a mapping; checked with all its cells.

    ``changes``: ``key=value`` for the base scenario, as on the command line. ``seeds``: how many,
    instead of the study's own. Raises ``StudyError`` listing every problem.
    """
    name, tree, folder = _read(source)
    tree.setdefault("name", name)
    if seeds is not None:
        tree["seeds"] = seeds
    try:
        tree["scenario"] = _base(tree.get("scenario"), folder)
        plan = Plan.model_validate({**_anchored(tree, folder), "changes": tuple(changes)})
    except ValidationError as error:
        lines = [
            f"{_path(e['loc'])} = {_shown(e['input'])}: {_plain(e['msg'])}" for e in error.errors()
        ]
        raise StudyError(_listed(name, lines)) from None
    except ScenarioError as error:
        raise StudyError(_listed(name, [f"scenario: {error}"])) from None
    if problems := plan.problems():
        raise StudyError(_listed(name, problems))
    return plan


def _base(source: Any, folder: Path) -> Any:
    """The base scenario as a tree; one that stands in the study itself need not be whole yet."""
    if not isinstance(source, str):
        return source
    here = folder / source
    return load(here if here.is_file() else source).model_dump(mode="json", exclude_unset=True)


def _anchored(tree: Any, folder: Path, key: str = "") -> Any:
    """A study's tree with relative names of traces' files taken to lie beside it."""
    if isinstance(tree, Mapping):
        return {name: _anchored(value, folder, name) for name, value in tree.items()}
    if isinstance(tree, list | tuple):
        return [_anchored(value, folder, key) for value in tree]
    is_file = isinstance(tree, str) and (key == "file" or key.endswith(".file"))
    return str(folder.resolve() / tree) if is_file else tree


def _numbers(scenario: Scenario) -> dict[str, Any]:
    """What of a scenario its numbers depend on, but for the seed."""
    words = {"title", "description", "seed"}
    return scenario.model_dump(mode="json", exclude=words, exclude_defaults=True)


def _lines(changes: Mapping[str, Any]) -> list[str]:
    return [f"{key}={toml(value)}" for key, value in changes.items()]


def shipped_studies() -> dict[str, Path]:
    """The studies that come with the package, by name."""
    folder = resources.files("encircle.studies") / "shipped"
    files = [Path(str(f)) for f in folder.iterdir() if f.name.endswith(".toml")]
    return {path.stem: path for path in sorted(files)}


def _read(source: str | Path | Mapping[str, Any]) -> tuple[str, dict[str, Any], Path]:
    if isinstance(source, Mapping):
        return str(source.get("name", "study")), dict(source), Path()
    known = shipped_studies()
    path = known.get(str(source), Path(source))
    try:
        with open(path, "rb") as file:
            return path.stem, tomllib.load(file), path.parent
    except (FileNotFoundError, IsADirectoryError):
        raise StudyError(
            f"study {str(source)!r} is neither a file nor one of: {', '.join(known)}"
        ) from None
    except ValueError as error:  # tomllib's errors, and wrong UTF-8
        raise StudyError(f"study {str(source)!r} cannot be parsed: {error}") from None
    except OSError as error:
        raise StudyError(f"study {str(source)!r} cannot be read: {error.strerror}") from None


def toml(value: Any) -> str:
    """A value in TOML, on one line."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{json.dumps(k)} = {toml(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(toml, value)) + "]"
    return json.dumps(value)


def _text(tree: Any) -> str:
    return json.dumps(tree, sort_keys=True)


def _path(location: Sequence[str | int]) -> str:
    return ".".join(str(part) for part in location) or "study"


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 80 else text[:80] + "..."


def _plain(message: str) -> str:
    return (
        "unknown key"
        if message.startswith("Extra inputs")
        else message.removeprefix("Value error, ")
    )


def _listed(name: str, lines: Sequence[str]) -> str:
    many = "one problem" if len(lines) == 1 else f"{len(lines)} problems"
    return "\n".join([f"study {name!r} has {many}:", *(f"  {line}" for line in lines)])
