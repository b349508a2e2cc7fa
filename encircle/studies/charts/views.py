"""Which cells of a study a figure shows: places along an axis, lines, panels.

A line stands for a level of a second axis, a panel for a setting of the rest. What does not fit is
left out evenly, first and last kept, and the figure's caption says so. Axes of one level are not
shown: they are the same everywhere.
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
CUT = "\N{HORIZONTAL ELLIPSIS}"
UNBROKEN, UNBROKEN_MAX = "\N{NO-BREAK SPACE}", 24

LevelIndices = Mapping[str, int]


@dataclass(frozen=True)
class FigureLayout:
    """Cells of a figure. ``lines``: the axis with a line per level, shown at ``places``.

    ``settings``: places of the levels of all axes but ``lines`` and ``along``, one for each panel.
    ``left_out`` says what is not shown, a sentence or nothing.
    """

    plan: Plan
    along: Axis | None
    lines: Axis | None
    places: tuple[int, ...]
    settings: tuple[LevelIndices, ...]
    left_out: str

    def cell(self, setting: LevelIndices, line: int, index: int = 0) -> int:
        """The cell of a panel and line, and of a place along the axis if there is one."""
        chosen = dict(setting)
        if self.lines is not None:
            chosen[self.lines.name] = line
        if self.along is not None:
            chosen[self.along.name] = index
        return cell_at(self.plan, chosen)

    def title(self, setting: LevelIndices) -> str:
        """What a panel holds fixed, empty if that is nothing."""
        return held_text(self.plan, setting)

    @property
    def spread(self) -> str:
        """What lines and panels stand for, in words to follow what is drawn."""
        lines = f", by {label(self.lines)}" if self.lines is not None else ""
        if len(self.settings) == 1:
            return lines
        held = [axis for axis in varied(self.plan) if axis.name in self.settings[0]]
        return f"{lines}; panels by {' and '.join(map(label, held))}"


def figure_layout(plan: Plan, along: Axis | None = None) -> FigureLayout:
    """Spread cells over lines and panels; the compared axis makes the lines, else the first."""
    free = [axis for axis in varied(plan) if axis is not along]
    lines = plan.compared if plan.compared in free else (free[0] if free else None)
    rest = [axis for axis in plan.all_axes if axis is not along and axis is not lines]
    every = settings_of(rest)
    settings = tuple(every[k] for k in evenly(len(every), PANELS_MAX))
    places = evenly_of(ordered(lines), LINES_MAX) if lines is not None else (0,)
    omitted = []
    if lines is not None and len(places) < len(lines.levels):
        omitted.append(f"{len(places)} of {len(lines.levels)} levels of {label(lines)}")
        if lines.numeric:  # names are in the legend, and may be long
            shown = ", ".join(level_text(lines, index) for index in places)
            omitted[-1] += f" ({shown}{f' {lines.unit}' if lines.unit else ''})"
    if len(settings) < len(every):
        names = " and ".join(label(axis) for axis in rest if len(axis.levels) > 1)
        omitted.append(f"{len(settings)} of {len(every)} settings of {names}")
    left_out = f"Shown are {' and '.join(omitted)}." if omitted else ""
    return FigureLayout(plan, along, lines, places, settings, left_out)


def varied(plan: Plan) -> list[Axis]:
    """The axes with more than one level."""
    return [axis for axis in plan.all_axes if len(axis.levels) > 1]


def cell_at(plan: Plan, places: LevelIndices) -> int:
    """The cell at places of levels by axis; axes without one are at their first level."""
    number = 0
    for axis in plan.all_axes:
        number = number * len(axis.levels) + places.get(axis.name, 0)
    return number


def evenly(count: int, most: int) -> tuple[int, ...]:
    """At most ``most`` of ``count`` places, evenly spread, the first and the last among them."""
    if count <= most:
        return tuple(range(count))
    if most == 1:
        return (0,)
    return tuple((2 * k * (count - 1) + most - 1) // (2 * (most - 1)) for k in range(most))


def evenly_of(places: Sequence[int], most: int) -> tuple[int, ...]:
    """At most ``most`` of some places, evenly spread."""
    return tuple(places[k] for k in evenly(len(places), most))


def ordered(axis: Axis) -> tuple[int, ...]:
    """Places of an axis' levels in the order in which they are drawn: numbers ascending."""
    places = range(len(axis.levels))
    return tuple(sorted(places, key=axis.column)) if axis.numeric else tuple(places)


def label(axis: Axis) -> str:
    """An axis in a sentence, without its unit."""
    return axis.label or axis.name.replace("_", " ")


def level_text(axis: Axis, index: int, named: bool = False) -> str:
    """A level as a person reads it; ``named``: with the axis' label and unit.

    An axis with a label too long for that goes by its name.
    """
    text = axis.shown(axis.column(index))
    if not named:
        return text
    called = label(axis) if len(label(axis)) <= LABEL_MAX else axis.name
    text = f"{called} {text}" + (f"{UNBROKEN}{axis.unit}" if axis.unit else "")
    return text.replace(" ", UNBROKEN) if len(text) <= UNBROKEN_MAX else text


def held_text(plan: Plan, places: LevelIndices) -> str:
    """The levels at some places, of axes that vary, in words."""
    return ", ".join(
        level_text(axis, places[axis.name], named=True)
        for axis in varied(plan)
        if axis.name in places
    )


def wrapped(text: str, columns: int) -> str:
    """Text on as many lines as it needs, cut off after ``TEXT_LINES_MAX``."""
    lines = textwrap.wrap(text, columns, max_lines=TEXT_LINES_MAX, placeholder=f" {CUT}")
    return "\n".join(lines)


def settings_of(axes: Sequence[Axis]) -> list[dict[str, int]]:
    """Places of levels for every combination of some axes, the last fastest."""
    spans = (range(len(axis.levels)) for axis in axes)
    return [
        dict(zip((axis.name for axis in axes), places, strict=True))
        for places in itertools.product(*spans)
    ]
