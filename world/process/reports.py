"""Reports of a world on its progress: lines for a person, or JSON for the program that started it.

Departures of robots, the reason of a failure and the result are lines on standard error in any
case; they are not reported here.
"""

import json
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from typing import Any, TextIO

from encircle.protocol.process.log import say_error, write_line

Reporter = Callable[[dict[str, Any]], None]
PERIOD_S = 1.0
SHOWN_MAX = 6


@contextmanager
def json_reports() -> Iterator[Reporter]:
    """Reports as JSON objects on standard output; that the reader is gone is no reason to fail.

    Meanwhile what a plug-in prints goes to standard error: it must not stand among the reports.
    """
    stream: TextIO | None = sys.stdout

    def report(event: dict[str, Any]) -> None:
        nonlocal stream
        try:
            write_line(stream, json.dumps(event))
        except BrokenPipeError:
            stream = None

    try:
        with redirect_stdout(sys.stderr):
            yield report
    finally:
        sys.stdout = stream


class ConsoleReporter:
    """Lines on standard error: which robots the world waits for, and the tick once a second."""

    def __init__(self, clock_s: Callable[[], float] = time.monotonic) -> None:
        self._clock_s = clock_s
        self._reported_s = clock_s()

    def __call__(self, event: dict[str, Any]) -> None:
        """Print what is of interest to a person."""
        if "expected" in event:
            names = shortened(event["expected"])
            say_error(f"world: waiting for {names}" if names else "world: every robot is there")
        elif event.get("waiting"):
            say_error(f"world: waiting for the answer of {shortened(event['waiting'])}")
        elif "tick" in event and self._clock_s() - self._reported_s >= PERIOD_S:
            self._reported_s = self._clock_s()
            say_error(tick_line(event["tick"], event["lost"], event["distances_m"]))


def tick_line(tick: int, lost: Sequence[str], distances_m: Sequence[float]) -> str:
    """How far the run is. ``distances_m``: of the robots to the target, in their order."""
    away = shortened([f"{distance_m:.1f}" for distance_m in distances_m], " ")
    missing = f", without {shortened(lost)}" if lost else ""
    return f"world: tick {tick}{missing}, {away} m to the target"


def shortened(items: Sequence[str], between: str = ", ") -> str:
    """A list for one line."""
    more = [f"and {len(items) - SHOWN_MAX} more"] if len(items) > SHOWN_MAX else []
    return between.join([*items[:SHOWN_MAX], *more])
