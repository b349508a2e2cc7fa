"""Which cells of a figure are shown where: levels along an axis, lines, panels.

A line stands for a level of a second axis, a panel for a setting of the remaining axes. If there
are too many, an even selection is shown, with the first and the last, and the caption says so. Axes
with one level are not shown, as they do not vary.
"""

import itertools
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from encircle.studies.plan import Axis, Plan

LINES_MAX = 6
PANELS_MAX = 6
TEXT_LINES_MAX = 3
LABEL_MAX = 30
ELLIPSIS = "\N{HORIZONTAL ELLIPSIS}"
NO_BREAK_SPACE, NO_BREAK_CHARACTERS_MAX = "\N{NO-BREAK SPACE}", 24

LevelIndices = Mapping[str, int]


@dataclass(frozen=True)
class FigureLayout:
    """The cells of a figure.

    ``along``: the axis to draw along, if any. ``lines``: the axis with a line per level, shown
    at ``level_indices``. ``settings``: for each panel the level index of every other axis, by
    name. ``left_out``: a sentence on what is not shown, or an empty text.
    """

    plan: Plan
    along: Axis | None
    lines: Axis | None
    level_indices: tuple[int, ...]
    settings: tuple[LevelIndices, ...]
    left_out: str

    def cell(self, setting: LevelIndices, line: int, index: int = 0) -> int:
        """The cell of a panel, a line, and a level index along the axis if there is one."""
        chosen = dict(setting)
        if self.lines is not None:
            chosen[self.lines.name] = line
        if self.along is not None:
            chosen[self.along.name] = index
        return cell_at(self.plan, chosen)

    def title(self, setting: LevelIndices) -> str:
        """A panel's title: the levels that are fixed in it, empty if there are none."""
        return setting_text(self.plan, setting)

    @property
    def split_text(self) -> str:
        """What lines and panels stand for, as text to follow the name of what is drawn."""
        lines = f", by {axis_label(self.lines)}" if self.lines is not None else ""
        if len(self.settings) == 1:
            return lines
        panel_axes = [axis for axis in varied_axes(self.plan) if axis.name in self.settings[0]]
        return f"{lines}; panels by {' and '.join(map(axis_label, panel_axes))}"


def figure_layout(plan: Plan, along: Axis | None = None) -> FigureLayout:
    """Distribute cells over lines and panels.

    The compared axis makes the lines, or the first axis if that one is not free.
    """
    free = [axis for axis in varied_axes(plan) if axis is not along]
    lines = plan.compared_axis if plan.compared_axis in free else (free[0] if free else None)
    rest = [axis for axis in plan.all_axes if axis is not along and axis is not lines]
    every = settings_of(rest)
    settings = tuple(every[k] for k in evenly_spaced(len(every), PANELS_MAX))
    level_indices = evenly_chosen(drawing_order(lines), LINES_MAX) if lines is not None else (0,)
    omitted = []
    if lines is not None and len(level_indices) < len(lines.levels):
        omitted.append(f"{len(level_indices)} of {len(lines.levels)} levels of {axis_label(lines)}")
        if lines.numeric:  # names are in the legend, and may be long
            shown = ", ".join(level_text(lines, index) for index in level_indices)
            omitted[-1] += f" ({shown}{f' {lines.unit}' if lines.unit else ''})"
    if len(settings) < len(every):
        names = " and ".join(axis_label(axis) for axis in rest if len(axis.levels) > 1)
        omitted.append(f"{len(settings)} of {len(every)} settings of {names}")
    left_out = f"Shown are {' and '.join(omitted)}." if omitted else ""
    return FigureLayout(plan, along, lines, level_indices, settings, left_out)


def varied_axes(plan: Plan) -> list[Axis]:
    """The axes with more than one level."""
    return [axis for axis in plan.all_axes if len(axis.levels) > 1]


def cell_at(plan: Plan, level_indices: LevelIndices) -> int:
    """The cell with level indices by axis name; an axis without one is at its first level."""
    number = 0
    for axis in plan.all_axes:
        number = number * len(axis.levels) + level_indices.get(axis.name, 0)
    return number


def evenly_spaced(count: int, most: int) -> tuple[int, ...]:
    """At most ``most`` of ``count`` indices, evenly spaced, with the first and the last."""
    if count <= most:
        return tuple(range(count))
    if most == 1:
        return (0,)
    return tuple((2 * k * (count - 1) + most - 1) // (2 * (most - 1)) for k in range(most))


def evenly_chosen(level_indices: Sequence[int], most: int) -> tuple[int, ...]:
    """At most ``most`` of some level indices, evenly spaced."""
    return tuple(level_indices[k] for k in evenly_spaced(len(level_indices), most))


def drawing_order(axis: Axis) -> tuple[int, ...]:
    """Indices of an axis' levels in the order in which they are drawn: numbers ascending."""
    level_indices = range(len(axis.levels))
    return (
        tuple(sorted(level_indices, key=axis.table_value)) if axis.numeric else tuple(level_indices)
    )


def axis_label(axis: Axis) -> str:
    """An axis in a sentence, without its unit."""
    return axis.label or axis.name.replace("_", " ")


def level_text(axis: Axis, index: int, named: bool = False) -> str:
    """A level as a person reads it; ``named``: with the axis' label and unit.

    An axis whose label is too long for that is called by its name.
    """
    text = axis.display_level(axis.table_value(index))
    if not named:
        return text
    called = axis_label(axis) if len(axis_label(axis)) <= LABEL_MAX else axis.name
    text = f"{called} {text}" + (f"{NO_BREAK_SPACE}{axis.unit}" if axis.unit else "")
    return text.replace(" ", NO_BREAK_SPACE) if len(text) <= NO_BREAK_CHARACTERS_MAX else text


def setting_text(plan: Plan, level_indices: LevelIndices) -> str:
    """The levels of a setting as text, without the axes that do not vary."""
    return ", ".join(
        level_text(axis, level_indices[axis.name], named=True)
        for axis in varied_axes(plan)
        if axis.name in level_indices
    )


def wrapped(text: str, columns: int) -> str:
    """Text on as many lines as it needs, cut off after ``TEXT_LINES_MAX``."""
    lines = textwrap.wrap(text, columns, max_lines=TEXT_LINES_MAX, placeholder=f" {ELLIPSIS}")
    return "\n".join(lines)


def settings_of(axes: Sequence[Axis]) -> list[dict[str, int]]:
    """Level indices for every combination of levels of some axes, the last axis fastest."""
    spans = (range(len(axis.levels)) for axis in axes)
    return [
        dict(zip((axis.name for axis in axes), level_indices, strict=True))
        for level_indices in itertools.product(*spans)
    ]
