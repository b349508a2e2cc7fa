"""A run as tidy tables: one row for each thing that was so at a tick; units in columns' names.

A column that does not apply to a row, or whose value is not known, is None there. Every table
begins with ``tick`` and ``time_s``, which is ticks times their length.
"""

from collections.abc import Iterator
from typing import Any

from encircle.scene.frame import Frame
from encircle.scene.stage import Stage

Row = tuple[Any, ...]
WHEN = (("tick", "int"), ("time_s", "float"))
TABLES: dict[str, tuple[tuple[str, str], ...]] = {
    "truth": (
        *WHEN,
        ("body", "name"),
        ("x_m", "float"),
        ("y_m", "float"),
        ("heading_rad", "float"),
        ("target_distance_m", "float"),
        ("lost", "bool"),
        ("silent", "bool"),
    ),
    "decisions": (
        *WHEN,
        ("robot", "name"),
        ("mode", "name"),
        ("xi_ticks", "float"),
        ("point", "int"),
        ("goal_x_m", "float"),
        ("goal_y_m", "float"),
    ),
    "beliefs": (
        *WHEN,
        ("robot", "name"),
        ("about", "name"),
        ("x_m", "float"),
        ("y_m", "float"),
        ("age_ticks", "int"),
        ("planned_with", "bool"),
        ("vx_mps", "float"),
        ("vy_mps", "float"),
        ("p00_m2", "float"),
        ("p01_m2ps", "float"),
        ("p11_m2ps2", "float"),
    ),
    "packets": (
        *WHEN,
        ("sender", "name"),
        ("receiver", "name"),
        ("fate", "name"),
        ("arrival_tick", "int"),
        ("delay_ticks", "int"),
        ("delay_s", "float"),
        ("copy_arrival_tick", "int"),
    ),
    "ages": (
        *WHEN,
        ("receiver", "name"),
        ("sender", "name"),
        ("age_ticks", "int"),
        ("age_s", "float"),
    ),
    "values": (
        *WHEN,
        ("gap_rad", "float"),
        ("slack_rad", "float"),
        ("age_ticks_mean", "float"),
        ("conflicts", "int"),
        ("delivery_share", "float"),
        ("captured", "bool"),
    ),
    "contacts": (*WHEN, ("body", "name"), ("other", "name")),
    "events": (*WHEN, ("kind", "name"), ("text", "text"), ("robots", "names")),
}
"""Columns of each table: name, and kind of value."""
ARRIVED, IN_FLIGHT, TARGET = "arrived", "in-flight", "target"


def rows_of(stage: Stage, frame: Frame, last_tick: int) -> Iterator[tuple[str, Row]]:
    """All rows of a frame, each with the name of its table; ``last_tick``: that of the run."""
    time_s = frame.tick * stage.tick_s
    for table, rows in (
        ("truth", _truth(stage, frame)),
        ("decisions", _decisions(stage, frame)),
        ("beliefs", _beliefs(stage, frame)),
        ("packets", _packets(stage, frame, last_tick)),
        ("ages", _ages(stage, frame)),
        ("values", _values(frame)),
        ("contacts", iter(frame.contacts)),
        ("events", ((kind, text, list(robots)) for kind, text, robots in frame.events)),
    ):
        for row in rows:
            yield table, (frame.tick, time_s, *row)


def _truth(stage: Stage, frame: Frame) -> Iterator[Row]:
    for k, robot in enumerate(stage.robots):
        distance_m = frame.values.distances_m[k]
        state = frame.lost[k], frame.silent[k]
        yield robot, *frame.robots[k], frame.headings_rad[k], distance_m, *state
    yield TARGET, *frame.target, None, None, None, None


def _decisions(stage: Stage, frame: Frame) -> Iterator[Row]:
    for k, robot in enumerate(stage.robots):
        if frame.modes[k] is not None:
            goal = frame.goals[k] or (None, None)
            yield robot, frame.modes[k], frame.xi[k], frame.points[k], *goal


def _beliefs(stage: Stage, frame: Frame) -> Iterator[Row]:
    """Of itself, of its peers, and of the target; of the target there is no age."""
    unknown = (None,) * 5
    for robot, belief in zip(stage.robots, frame.beliefs, strict=True):
        if belief is None:
            continue
        yield robot, robot, *belief.position, 0, True, *unknown
        for peer in belief.peers:
            name = stage.robots[peer.robot]
            yield robot, name, peer.x, peer.y, peer.age_ticks, peer.planned_with, *unknown
        if belief.estimate is not None:
            x, y, vx, vy = belief.estimate
            yield robot, TARGET, x, y, None, None, vx, vy, *(belief.covariance or (None,) * 3)


def _packets(stage: Stage, frame: Frame, last_tick: int) -> Iterator[Row]:
    for packet in frame.packets:
        ends = stage.robots[packet.sender], stage.robots[packet.receiver]
        arrivals = sorted(due for due in (packet.due, packet.copy_due) if due > 0)
        if not arrivals:
            yield *ends, stage.causes[-packet.due], None, None, None, None
            continue
        first, copy = arrivals[0], arrivals[1] if len(arrivals) > 1 else None
        delay_ticks = first - frame.tick
        fate = ARRIVED if first <= last_tick else IN_FLIGHT
        yield *ends, fate, first, delay_ticks, delay_ticks * stage.tick_s, copy


def _ages(stage: Stage, frame: Frame) -> Iterator[Row]:
    for receiver, row in zip(stage.robots, frame.ages, strict=True):
        for sender, age in zip(stage.robots, row, strict=True):
            if sender != receiver:
                known = (None, None) if age < 0 else (age, age * stage.tick_s)
                yield receiver, sender, *known


def _values(frame: Frame) -> Iterator[Row]:
    values = frame.values
    yield (
        values.gap_rad,
        values.slack_rad,
        values.age_ticks_mean,
        values.conflicts,
        values.delivery,
        frame.captured,
    )
