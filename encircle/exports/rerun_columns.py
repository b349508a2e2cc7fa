"""Columns over time for a Rerun recording: an entity is written for many ticks at once.

Rerun shows of an entity the newest row at or before the time that one looks at. An entity that
comes and goes therefore has a row for each tick, empty where there is nothing, from its first one
on.
"""

from collections.abc import Sequence
from itertools import chain
from typing import Any, TypeVar

import numpy as np
import pyarrow as pa
import rerun as rr
from numpy.typing import NDArray
from rerun.components import LineStrip3DBatch

from encircle.exports.drawing.shapes import Disc, Entity, Label, Line, Point, Segments, Shape

Floats = NDArray[np.float32]
S = TypeVar("S", bound=Shape)
DISC_HEIGHT_M = 0.05
TICK, TIME = "tick", "simulated time"


class RerunColumns:
    """Writes to a recording along the timelines ``tick`` and ``simulated time``."""

    def __init__(self, recording: rr.RecordingStream, tick_s: float) -> None:
        self._recording, self._tick_s = recording, tick_s
        self._names: dict[str, dict[str, None]] = {}

    def send(self, path: str, ticks: Sequence[int], columns: Any) -> None:
        """Write an entity's columns, with a value for each of the ticks."""
        times = [tick * self._tick_s for tick in ticks]
        indexes = [rr.TimeColumn(TICK, sequence=ticks), rr.TimeColumn(TIME, duration=times)]
        self._recording.send_columns(path, indexes, columns)

    def send_numbers(
        self, path: str, ticks: Sequence[int], numbers: Sequence[float | None]
    ) -> None:
        """Write a number over time; nothing where it is not known."""
        known = [
            (tick, number)
            for tick, number in zip(ticks, numbers, strict=True)
            if number is not None
        ]
        if known:
            at, values = zip(*known, strict=True)
            self.send(path, at, rr.Scalars.columns(scalars=values))

    def send_table(
        self, path: str, tick: int, table: Floats, names: Sequence[str], shown: tuple[float, float]
    ) -> None:
        """Write a table at a tick: what its rows and columns count, and the range of its colours.

        Rerun takes no column of tensors.
        """
        self._recording.set_time(TICK, sequence=tick)
        self._recording.set_time(TIME, duration=tick * self._tick_s)
        self._recording.log(path, rr.Tensor(table, dim_names=names, value_range=shown))
        self._recording.reset_time()

    def send_layer(
        self, path: str, ticks: Sequence[int], layer: Sequence[Sequence[Entity]]
    ) -> None:
        """Write what is drawn below a path at ticks that follow those written before."""
        names = self._names.setdefault(path, {})
        by_name: dict[str, list[Sequence[Shape]]] = {name: [()] * len(ticks) for name in names}
        for row, entities in enumerate(layer):
            for entity in entities:
                if entity.name not in by_name:
                    by_name[entity.name] = [()] * len(ticks)
                    solid = rr.Cylinders3D.from_fields(fill_mode="solid")
                    self._recording.log(f"{path}/{entity.name}", solid, static=True)
                by_name[entity.name][row] = entity.shapes
        names.update(dict.fromkeys(by_name))
        for name, rows in by_name.items():
            columns = [*_disc_columns(rows), *_line_columns(rows), *_label_columns(rows)]
            self.send(f"{path}/{name}", ticks, columns)


def _of_kind(rows: Sequence[Sequence[Shape]], kind: type[S]) -> tuple[list[S], list[int]]:
    """The shapes of a kind, and how many of them are in each row."""
    by_row = [[shape for shape in row if isinstance(shape, kind)] for row in rows]
    return list(chain.from_iterable(by_row)), list(map(len, by_row))


def _disc_columns(rows: Sequence[Sequence[Shape]]) -> Any:
    discs, lengths = _of_kind(rows, Disc)
    return rr.Cylinders3D.columns(
        centers=_points([(*disc.centre, disc.z_m) for disc in discs]),
        radii=_numbers([disc.radius_m for disc in discs]),
        lengths=_numbers([DISC_HEIGHT_M] * len(discs)),
        colors=_colours(discs),
    ).partition(lengths)


def _label_columns(rows: Sequence[Sequence[Shape]]) -> Any:
    labels, lengths = _of_kind(rows, Label)
    return rr.Points3D.columns(
        positions=_points([(*label.centre, label.z_m) for label in labels]),
        radii=_numbers([0.0] * len(labels)),
        colors=_colours(labels),
        labels=[label.text for label in labels],
    ).partition(lengths)


def _line_columns(rows: Sequence[Sequence[Shape]]) -> Any:
    lines: list[tuple[Sequence[Point], float]] = []
    lengths, radii, colours = [], [], []
    for row in rows:
        before = len(lines)
        for shape in row:
            if isinstance(shape, Line | Segments):
                made = [(points, shape.z_m) for points in _strips(shape)]
                lines += made
                radii += [shape.width_m / 2.0] * len(made)
                colours += [shape.colour.rgba8] * len(made)
        lengths.append(len(lines) - before)
    return rr.LineStrips3D.columns(
        strips=_strip_array(lines),
        radii=_numbers(radii),
        colors=np.array(colours, np.uint8).reshape(-1, 4),
    ).partition(lengths)


def _strips(shape: Line | Segments) -> list[Sequence[Point]]:
    points = shape.points
    if isinstance(shape, Segments):
        return [points[k : k + 2] for k in range(0, len(points), 2)]
    return [(*points, points[0])] if shape.closed else [points]


def _strip_array(lines: Sequence[tuple[Sequence[Point], float]]) -> Any:
    """The lines as the Arrow array that Rerun would make of them, several times faster."""
    kind = LineStrip3DBatch._ARROW_DATATYPE
    assert kind is not None, "the type of a component is known"
    flat = [number for points, z_m in lines for x, y in points for number in (x, y, z_m)]
    offsets = np.cumsum([0, *(len(points) for points, _ in lines)])
    numbers = pa.array(np.array(flat, np.float32))
    points = pa.FixedSizeListArray.from_arrays(numbers, type=kind.value_type)
    return pa.ListArray.from_arrays(pa.array(offsets, pa.int32()), points, type=kind)


def _points(points: Sequence[tuple[float, float, float]]) -> Floats:
    return np.array(points, np.float32).reshape(-1, 3)


def _numbers(numbers: Sequence[float]) -> Floats:
    return np.array(numbers, np.float32)


def _colours(shapes: Sequence[Disc | Label]) -> NDArray[np.uint8]:
    return np.array([shape.colour.rgba8 for shape in shapes], np.uint8).reshape(-1, 4)
