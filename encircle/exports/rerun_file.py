"""A recording as a file for Rerun, with a blueprint: what is seen where when it is opened.

Entities: ``scene/...`` and ``beliefs/ROBOT/...`` are the layers of
``encircle.exports.drawing.layers``, in three dimensions and seen from above, since Rerun's views of
two have the y axis downwards; ``trails`` and ``outlines`` of bodies, and ``truth``, their positions
as they are; ``ages`` as a tensor of receivers by senders; numbers under ``values``, ``distances_m``
and ``decisions``; ``modes`` as states; ``packets`` counts by fate; ``events`` as a text log;
``run`` as a document.
"""

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from os import SEEK_END
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr

from encircle.exports.drawing import curves, layers
from encircle.exports.drawing.events import is_warning
from encircle.exports.drawing.flights import Flights, fate_of
from encircle.exports.drawing.shapes import Entity, Line
from encircle.exports.native_errors import write_failures
from encircle.exports.rerun_blueprint import blueprint
from encircle.exports.rerun_columns import RerunColumns
from encircle.protocol.process.interrupts import check
from encircle.scene.builder import scene_of_recording
from encircle.scene.counts import counted
from encircle.scene.frame import Event, Frame
from encircle.scene.stage import Stage
from encircle.world.recording.recording import Recording

APPLICATION = "encircle"
AGE_SHOWN_TICKS_MIN = 5.0
"""The colours of ages reach at least this far, so that ages of a good channel look good; and as
far as all but the highest hundredth of a run's ages."""
LEGEND = (
    "**Packets** move along their links, and end in a mark: a blue hexagon arrives on time, an"
    " orange diamond late; a cross, star, plus or bar is lost. The entity's name is the cause.",
    "",
    "**Beliefs**: discs are where a robot takes its peers to be, white circles where they are."
    " The shaded disc holds the target with 95 %, if the robot's filter is right; the line is"
    " where it expects the target to go.",
)
"""What the views show, as Markdown."""
UNKNOWN_AGE = float("nan")
ROOM_BYTES = 128 * 1024
"""More than a blueprint takes for each robot."""
FLUSH_S_MAX = 30.0
"""How long nothing may be written while there is something to write, in s."""
TICKS_AT_ONCE = 50
"""What is drawn is held in memory for so many ticks."""


def export(recording: Recording, out: Path, *, beliefs: bool = True) -> None:
    """Write a recording for Rerun to a new file.

    ``beliefs``: whether to work out what robots believed, which takes the longest. Raises
    ``RecordingError`` for a message that cannot be read.
    """
    scene = scene_of_recording(recording, beliefs)
    with out.open("xb") as file:  # Rerun writes over what there is
        # It waits for ever if there is no room for the blueprint.
        file.write(bytes(ROOM_BYTES * (2 + len(scene.stage.robots))))
    with _strictly(), write_failures():
        _write(scene.stage, scene.frames, out)


@contextmanager
def _strictly() -> Iterator[None]:
    """Let Rerun raise an error for what it cannot write, of which it only warns by default."""
    before = rr.strict_mode()
    rr.set_strict_mode(True)
    try:
        yield
    finally:
        rr.set_strict_mode(before)


def _write(stage: Stage, frames: Sequence[Frame], out: Path) -> None:
    name = f"{stage.run}-{stage.seed}"
    # When it was exported is nothing of the run.
    stream = rr.RecordingStream(APPLICATION, recording_id=name, send_properties=False)
    stream.set_log_time_enabled(False)
    stream.set_log_tick_enabled(False)
    stream.save(out, default_blueprint=blueprint(stage, frames))
    stream.send_recording_name(f"{stage.title}, seed {stage.seed}")
    stream.log("run", rr.TextDocument(description(stage), media_type="text/markdown"), static=True)
    columns, flights = RerunColumns(stream, stage.tick_s), Flights(stage.causes)
    for first in range(0, len(frames), TICKS_AT_ONCE):
        _send_scene(columns, stage, frames[first : first + TICKS_AT_ONCE], flights)
    columns.send_layer("scene/arena", [frames[0].tick], [layers.arena(stage)])
    for send in (_send_truth, _send_numbers, _send_decisions, _send_packets, _send_events):
        check()
        send(columns, stage, frames)
    _flush(stream, out)
    stream.disconnect()
    with out.open("r+b") as file:
        # If there was no room for its end, of which Rerun only warns, there is none now.
        size = file.seek(0, SEEK_END)
        file.write(b"\0")
        file.truncate(size)


def _flush(stream: rr.RecordingStream, out: Path) -> None:
    """Wait until all is written, as long as there is more of it every now and then.

    Without an end to its wait, Rerun waits for ever for a thread that has failed to write.
    """
    size = -1
    while True:
        try:
            stream.flush(timeout_sec=FLUSH_S_MAX)
            return
        except RuntimeError as error:
            before, size = size, out.stat().st_size
            if size == before:
                raise OSError(f"Rerun has written no more than {size} bytes: {error}") from None


def description(stage: Stage) -> str:
    """What the run is, as Markdown."""
    rows = {
        "run": stage.run,
        "seed": stage.seed,
        "robots": len(stage.robots),
        "policies": ", ".join(dict.fromkeys(stage.policies)),
        "target": stage.behaviour,
        "channel": "; ".join(stage.channel) or "ideal",
        "tick": f"{stage.tick_s:g} s ({stage.clock})",
        "captures": f"{counted(stage.capture_count, 'robot')} within {stage.stop_distance_m:g} m",
    }
    lines = [f"| {name} | {_plain(str(value))} |" for name, value in rows.items()]
    return "\n".join(
        [f"# {_plain(stage.title or stage.run)}", "", "| | |", "|---|---|", *lines, "", *LEGEND]
    )


def _plain(text: str) -> str:
    """Text that Markdown shows as it is: titles and names may hold links and images."""
    return re.sub(r"([\\`*_{}\[\]()#!|<>~])", r"\\\1", text)


def _send_scene(
    columns: RerunColumns, stage: Stage, frames: Sequence[Frame], flights: Flights
) -> None:
    """Write what is drawn at ticks that follow those written before."""
    ticks = [frame.tick for frame in frames]
    columns.send_layer("scene/bodies", ticks, [layers.bodies(stage, f) for f in frames])
    columns.send_layer("scene/plan", ticks, [layers.plan(stage, f) for f in frames])
    packets = [layers.packets(flights.take(frame)) for frame in frames]
    columns.send_layer("scene/packets", ticks, packets)
    for k, robot in enumerate(stage.robots):
        check()
        believed = [layers.beliefs(stage, frame, k) for frame in frames]
        columns.send_layer(f"beliefs/{robot}", ticks, believed)


def _steps(stage: Stage, before: Frame, after: Frame) -> tuple[Entity, ...]:
    """The way of each body from one tick to the next."""
    colours = [layers.colour_of_robot(k, 0.6) for k in range(len(stage.robots))]
    colours.append(layers.role_colour("target", 0.6))
    starts, ends = [*before.robots, before.target], [*after.robots, after.target]
    named = zip([*stage.robots, "target"], starts, ends, colours, strict=True)
    return tuple(
        Entity(name, (Line((start, end), colour, layers.THIN_M),))
        for name, start, end, colour in named
    )


def _send_truth(columns: RerunColumns, stage: Stage, frames: Sequence[Frame]) -> None:
    """Positions as points, for whoever queries the file; outlines, and the ways between them."""
    ticks = [frame.tick for frame in frames]
    steps = [_steps(stage, *pair) for pair in pairwise(frames)]
    columns.send_layer("trails", ticks[1:], steps)
    columns.send_layer("outlines", ticks, [layers.outlines(stage, frame) for frame in frames])
    for k, robot in enumerate(stage.robots):
        places = [(*frame.robots[k], 0.0) for frame in frames]
        columns.send(f"truth/{robot}", ticks, rr.Points3D.columns(positions=places))
    places = [(*frame.target, 0.0) for frame in frames]
    columns.send("truth/target", ticks, rr.Points3D.columns(positions=places))


def _send_numbers(columns: RerunColumns, stage: Stage, frames: Sequence[Frame]) -> None:
    ticks = [frame.tick for frame in frames]
    found = [curves.values(frame) for frame in frames]
    for name in curves.VALUES:
        columns.send_numbers(f"values/{name}", ticks, [values.get(name) for values in found])
    for k, robot in enumerate(stage.robots):
        columns.send_numbers(
            f"distances_m/{robot}", ticks, [f.values.distances_m[k] for f in frames]
        )
    ages = np.array([frame.ages for frame in frames], np.float32)
    shown = (0.0, max(AGE_SHOWN_TICKS_MIN, float(np.percentile(ages, 99))))
    ages[ages < 0] = UNKNOWN_AGE
    for tick, table in zip(ticks, ages, strict=True):
        columns.send_table("ages", tick, table, ("receiver", "sender"), shown)


def _send_decisions(columns: RerunColumns, stage: Stage, frames: Sequence[Frame]) -> None:
    ticks = [frame.tick for frame in frames]
    for k, robot in enumerate(stage.robots):
        columns.send_numbers(f"decisions/{robot}/xi_ticks", ticks, [f.xi[k] for f in frames])
        columns.send_numbers(f"decisions/{robot}/point", ticks, [f.points[k] for f in frames])
        modes = [frame.modes[k] or "" for frame in frames]
        changed = [row for row, mode in enumerate(modes) if row == 0 or mode != modes[row - 1]]
        # None ends the state; the type of the argument does not know that.
        states: list[Any] = [modes[row] or None for row in changed]
        at = [ticks[row] for row in changed]
        columns.send(f"modes/{robot}", at, rr.StateChange.columns(state=states))


def _send_packets(columns: RerunColumns, stage: Stage, frames: Sequence[Frame]) -> None:
    """How many packets of each tick had which fate."""
    fates = [[fate_of(p, f.tick, stage.causes) for p in f.packets] for f in frames]
    ticks = [frame.tick for frame in frames]
    for fate in sorted({fate for row in fates for fate in row}):
        columns.send_numbers(f"packets/{fate}", ticks, [row.count(fate) for row in fates])


def _send_events(columns: RerunColumns, _stage: Stage, frames: Sequence[Frame]) -> None:
    by_kind: dict[str, list[tuple[int, Event]]] = {}
    for frame in frames:
        for event in frame.events:
            by_kind.setdefault(event.kind, []).append((frame.tick, event))
    for kind, found in by_kind.items():
        ticks, events = zip(*found, strict=True)
        levels = [rr.TextLogLevel.WARN if is_warning(e) else rr.TextLogLevel.INFO for e in events]
        texts = rr.TextLog.columns(text=[event.text for event in events], level=levels)
        columns.send(f"events/{kind}", ticks, texts)
