"""A hunt in a notebook: what came of it, and the trails of all bodies."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from encircle.notebook.html import facts, framed
from encircle.notebook.sketch import GREY, Sketch, draw_bodies
from encircle.runlog.ground_truth import ground_truth_of
from encircle.runner.hunts import Hunt
from encircle.scene.channel_text import channel_sentences
from encircle.scene.palette import robot_colour
from encircle.world.recording.recording import RecordingError, read_recording
from encircle.world.scenario.model import MoveTarget, Scenario

Floats = NDArray[np.float64]
FARTHER_M = 0.001
"""By how much a way in a tick must be longer than the longest step to be none: they are rounded."""
NOT_KNOWN = (
    "Where everybody was is not known here: it is known of hunts in memory, and of those that are"
    " recorded, with out=DIRECTORY."
)
TRAILS_NOTE = (
    "Trails begin at small rings; discs, to scale, are bodies at the end, the filled one the"
    " target, in the circle of the stop distance."
)


def hunt_html(hunt: Hunt) -> str:
    """A hunt as HTML: a table, and a drawing of the trails if they are known."""
    places = positions_of(hunt)
    drawing = "" if places is None else trails_svg(hunt.scenario, places)
    note = NOT_KNOWN if places is None else TRAILS_NOTE
    return framed(hunt.scenario.title or "Hunt", [facts(_facts(hunt)), drawing], note)


def positions_of(hunt: Hunt) -> Floats | None:
    """(T, N + 1, 2) where robots and target were, in m; None if that is not known."""
    if hunt.positions is not None:
        return hunt.positions
    if hunt.out is None:
        return None
    try:
        return ground_truth_of(read_recording(hunt.out)).positions
    except RecordingError:
        # As of a directory that has been removed since.
        return None


def trails_svg(scenario: Scenario, positions: Floats) -> str:
    """A drawing of trails (T, N + 1, 2) in m, and of the bodies at their ends."""
    radius_m, target_radius_m = scenario.team.radius_m, scenario.target.radius_m
    stop_m = scenario.capture.stop_distance_m
    discs = [(*place, radius_m) for place in positions[-1, :-1].tolist()]
    discs += [(*positions[-1, -1].tolist(), max(stop_m, target_radius_m))]
    discs += [(*o.position, o.radius_m) for o in scenario.obstacles]
    corners = [(x + side * r, y + side * r) for x, y, r in discs for side in (-1.0, 1.0)]
    shown = np.vstack([positions.reshape(-1, 2), corners])
    sketch = Sketch(shown.min(axis=0), shown.max(axis=0), "Trails of the robots and the target")
    for obstacle in scenario.obstacles:
        sketch.circle(obstacle.position, obstacle.radius_m, GREY, GREY)
    for k in range(positions.shape[1] - 1):
        sketch.trail(positions[:, k], robot_colour(k))
    for part in np.split(positions[:, -1], moved_ticks(scenario, positions[:, -1])):
        sketch.trail(part, "currentColor")
    sketch.circle(positions[-1, -1].tolist(), stop_m, "currentColor")
    draw_bodies(sketch, positions[-1, :-1], positions[-1, -1], radius_m, target_radius_m)
    return sketch.svg()


def moved_ticks(scenario: Scenario, target: Floats) -> list[int]:
    """The ticks to which the target (T, 2) did not run but was moved, in order.

    By the scenario, or by hand: then it went farther than it can run, or nothing is to be seen.
    """
    ticks = {e.tick for e in scenario.events if isinstance(e, MoveTarget)}
    steps_m = np.hypot(*np.diff(target, axis=0).T)
    ticks |= set((1 + np.flatnonzero(steps_m > scenario.target.step_m_max + FARTHER_M)).tolist())
    return sorted(tick for tick in ticks if 0 < tick < len(target))


def _facts(hunt: Hunt) -> Iterator[tuple[str, str]]:
    scenario, result = hunt.scenario, hunt.result
    end_s = result.ticks * scenario.tick_s
    if hunt.capture_tick is not None:
        yield "captured", f"at tick {hunt.capture_tick} ({end_s:.4g} s)"
    else:
        yield "not captured", f"{result.ended}, after {result.ticks} ticks ({end_s:.4g} s)"
    policies = ", ".join(dict.fromkeys(map(scenario.strategy_of, scenario.ids)))
    yield "team", f"{len(scenario.ids)} robots, {policies}"
    yield "radio", "; ".join(channel_sentences(scenario))
    yield "packets", _packets(hunt)
    if result.delay_s_mean is not None and result.delay_s_mean_asked:
        yield "mean delay", f"{result.delay_s_mean:.4g} s, {result.delay_s_mean_asked:.4g} s asked"
    near = zip(scenario.ids, result.distances_m, strict=True)
    yield "distances", ", ".join(f"{robot} {distance_m:.2f} m" for robot, distance_m in near)
    yield "contacts", f"{result.contacts}"
    for tick, robot, what in result.departures:
        yield f"tick {tick}", f"{robot} is {what}"
    yield "seed", f"{hunt.seed}"
    yield "digest", hunt.digest
    if hunt.out is not None:
        yield "recorded in", str(hunt.out)


def _packets(hunt: Hunt) -> str:
    lost = sum(hunt.result.packets_lost.values())
    causes = ", ".join(f"{n} by {cause}" for cause, n in hunt.result.packets_lost.items())
    return f"{hunt.result.packets_sent} sent, {lost} lost" + (f" ({causes})" if causes else "")
