"""Columns over time for a Rerun recording: each entity is written once, with all its ticks.

Rerun shows of an entity the newest row at or before the time that one looks at. An entity that
comes and goes therefore has a row for each tick, empty where there is nothing.
"""

from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from encircle.exports.shapes import Disc, Entity, Label, Line, Point, Segments, Shape

Floats = NDArray[np.float32]
DISC_HEIGHT_M = 0.05
TICK, TIME = "tick", "simulated time"


class RerunColumns:
    """Writes to a recording along the timelines ``tick`` and ``simulated time``."""

    def __init__(self, recording: rr.RecordingStream, ticks: Sequence[int], tick_s: float) -> None:
        self._recording, self._ticks, self._tick_s = recording, ticks, tick_s

    def send(self, path: str, columns: Any, rows: Sequence[int] | None = None) -> None:
        """Write an entity's columns: a value for each of the rows, which are all unless given."""
        ticks = self._ticks if rows is None else [self._ticks[row] for row in rows]
        times = [tick * self._tick_s for tick in ticks]
        indexes = [rr.TimeColumn(TICK, sequence=ticks), rr.TimeColumn(TIME, duration=times)]
        self._recording.send_columns(path, indexes, columns)

    def send_numbers(self, path: str, numbers: Sequence[float | None]) -> None:
        """Write a number over time; nothing where it is not known."""
        rows = [row for row, number in enumerate(numbers) if number is not None]
        if rows:
            known = [number for number in numbers if number is not None]
            self.send(path, rr.Scalars.columns(scalars=known), rows)

    def send_tensors(
        self, path: str, tables: Floats, names: Sequence[str], shown: tuple[float, float]
    ) -> None:
        """Write a table over time: (T, rows, columns), what the two count, and the range shown."""
        for tick, table in zip(self._ticks, tables, strict=True):
            self._recording.set_time(TICK, sequence=tick)
            self._recording.set_time(TIME, duration=tick * self._tick_s)
            # Rerun takes no column of tensors.
            self._recording.log(path, rr.Tensor(table, dim_names=names, value_range=shown))
        self._recording.reset_time()

    def send_layer(self, path: str, layer: Sequence[Sequence[Entity]]) -> None:
        """Write what is drawn below a path, tick by tick."""
        by_name: dict[str, dict[int, Sequence[Shape]]] = {}
        for row, entities in enumerate(layer):
            for entity in entities:
                by_name.setdefault(entity.name, {})[row] = entity.shapes
        for name, shapes in by_name.items():
            self._send_shapes(f"{path}/{name}", shapes)

    def _send_shapes(self, path: str, shapes: Mapping[int, Sequence[Shape]]) -> None:
        rows = [shapes.get(row, ()) for row in range(len(self._ticks))]
        discs = [[s for s in row if isinstance(s, Disc)] for row in rows]
        lines = [[s for s in row if isinstance(s, Line | Segments)] for row in rows]
        labels = [[s for s in row if isinstance(s, Label)] for row in rows]
        columns = [*_disc_columns(discs), *_line_columns(lines), *_label_columns(labels)]
        self.send(path, columns)
        if any(discs):
            solid = rr.Cylinders3D.from_fields(fill_mode="solid")
            self._recording.log(path, solid, static=True)


def _disc_columns(rows: Sequence[Sequence[Disc]]) -> Any:
    discs = list(chain.from_iterable(rows))
    if not discs:
        return ()
    return rr.Cylinders3D.columns(
        centers=[(*d.centre, d.z_m) for d in discs],
        radii=[d.radius_m for d in discs],
        lengths=[DISC_HEIGHT_M] * len(discs),
        colors=[d.colour.rgba8 for d in discs],
    ).partition([len(row) for row in rows])


def _line_columns(rows: Sequence[Sequence[Line | Segments]]) -> Any:
    strips: list[list[tuple[float, float, float]]] = []
    widths, colours, lengths = [], [], []
    for row in rows:
        lengths.append(0)
        for shape in row:
            made = _strips(shape)
            strips += made
            lengths[-1] += len(made)
            widths += [shape.width_m / 2.0] * len(made)
            colours += [shape.colour.rgba8] * len(made)
    if not strips:
        return ()
    return rr.LineStrips3D.columns(strips=strips, radii=widths, colors=colours).partition(lengths)


def _strips(shape: Line | Segments) -> list[list[tuple[float, float, float]]]:
    points = shape.points
    lines: list[Sequence[Point]] = [points]
    if isinstance(shape, Segments):
        lines = [points[k : k + 2] for k in range(0, len(points), 2)]
    elif shape.closed:
        lines = [(*points, points[0])]
    return [[(x, y, shape.z_m) for x, y in line] for line in lines]


def _label_columns(rows: Sequence[Sequence[Label]]) -> Any:
    labels = list(chain.from_iterable(rows))
    if not labels:
        return ()
    return rr.Points3D.columns(
        positions=[(*s.centre, s.z_m) for s in labels],
        radii=[0.0] * len(labels),
        colors=[s.colour.rgba8 for s in labels],
        labels=[s.text for s in labels],
    ).partition([len(row) for row in rows])
