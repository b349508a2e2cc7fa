"""Stage and frames as JSON: version 1 of the format in docs/scene.md, compact and rounded.

Lengths are rounded to mm, angles to mrad, shares and ages to thousandths.
"""

from collections.abc import Iterable
from math import isfinite
from typing import Any

from encircle.scene.frame import Belief, Frame, Values
from encircle.scene.stage import Stage

VERSION = 1
DIGITS = 3
COVARIANCE_DIGITS = 6


def stage_json(stage: Stage) -> dict[str, Any]:
    """A stage as plain values for JSON."""
    return {
        "v": VERSION,
        "run": stage.run,
        "title": stage.title,
        "seed": stage.seed,
        "tick_s": stage.tick_s,
        "ticks_max": stage.ticks_max,
        "clock": stage.clock,
        "robots": list(stage.robots),
        "policies": list(stage.policies),
        "radius_m": stage.radius_m,
        "target_radius_m": stage.target_radius_m,
        "obstacles": [list(obstacle) for obstacle in stage.obstacles],
        "sensing_ranges_m": list(stage.sensing_ranges_m),
        "stop_distance_m": stage.stop_distance_m,
        "capture_count": stage.capture_count,
        "behaviour": stage.behaviour,
        "channel": list(stage.channel),
        "causes": list(stage.causes),
    }


def frame_json(frame: Frame) -> dict[str, Any]:
    """A frame as plain values for JSON."""
    return {
        "t": frame.tick,
        "r": [_rounded(point) for point in frame.robots],
        "h": _rounded(frame.headings_rad),
        "g": _rounded(frame.target),
        "cap": int(frame.captured),
        "con": [list(pair) for pair in frame.contacts],
        "lost": [int(so) for so in frame.lost],
        "sil": [int(so) for so in frame.silent],
        "mode": list(frame.modes),
        "xi": [_number(xi) for xi in frame.xi],
        "pt": list(frame.points),
        "goal": [None if goal is None else _rounded(goal) for goal in frame.goals],
        "pk": [list(packet) for packet in frame.packets],
        "age": [list(row) for row in frame.ages],
        "bel": [None if belief is None else _belief(belief) for belief in frame.beliefs],
        "unsure": list(frame.beliefs_unsure),
        "val": _values(frame.values),
        "ev": [[event.kind, event.text, list(event.robots)] for event in frame.events],
    }


def _belief(belief: Belief) -> dict[str, Any]:
    return {
        "p": _rounded(belief.position),
        "n": [
            [peer.robot, _number(peer.x), _number(peer.y), peer.age_ticks, int(peer.planned_with)]
            for peer in belief.peers
        ],
        "e": None if belief.estimate is None else _rounded(belief.estimate),
        "c": None
        if belief.covariance is None
        else [_number(entry, COVARIANCE_DIGITS) for entry in belief.covariance],
        "f": [_rounded(point) for point in belief.prediction],
    }


def _values(values: Values) -> dict[str, Any]:
    return {
        "d": _rounded(values.distances_m),
        "gap": _number(values.gap_rad),
        "slack": _number(values.slack_rad),
        "age": _number(values.age_ticks_mean),
        "conf": values.conflicts,
        "del": _number(values.delivery),
    }


def _rounded(numbers: Iterable[float]) -> list[float | None]:
    return [_number(number) for number in numbers]


def _number(number: float | None, digits: int = DIGITS) -> float | None:
    """A number that JSON can hold, shortened; None for what is none."""
    if number is None or not isfinite(number):
        return None
    short = round(number, digits)
    return int(short) if short == int(short) else short
