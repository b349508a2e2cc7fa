"""Interventions on their way to a run: a queue from any thread of the program that started it.

The run takes them between two ticks: in memory itself, over Zenoh by way of the world's standard
input (``encircle.world.process.control_input``). Nobody else has a way in.
"""

import json
from collections.abc import Callable, Mapping
from threading import Lock
from typing import Any

from encircle.world.loading.interventions import (
    INTERVENTIONS_MAX,
    LINE_BYTES_MAX,
    InterventionRefused,
)


class Interventions:
    """Events for one run that goes on, or is about to begin.

    >>> interventions = Interventions()
    >>> interventions.give({"kind": "loss", "rate": 0.6})
    >>> interventions.take()
    ['{"kind": "loss", "rate": 0.6}']
    """

    def __init__(self) -> None:
        self._waiting: list[str] = []
        self._lock = Lock()
        self._wake: Callable[[], object] | None = None

    def give(self, event: Mapping[str, Any]) -> None:
        """Give an event, as a scenario has it; without a ``tick`` it is of the next one.

        Whether it fits the run is known when the run takes it: ``progress`` is told.
        ``InterventionRefused`` if it is not made of JSON's values, or too much waits already.
        """
        try:
            line = json.dumps(event, allow_nan=False)
        except (TypeError, ValueError, RecursionError) as error:
            raise InterventionRefused(f"intervention: cannot be written as JSON: {error}") from None
        if len(line) > LINE_BYTES_MAX:
            raise InterventionRefused(
                f"intervention: has {len(line)} bytes as JSON, must have at most {LINE_BYTES_MAX}"
            )
        with self._lock:
            if len(self._waiting) >= INTERVENTIONS_MAX:
                raise InterventionRefused(
                    f"intervention: {INTERVENTIONS_MAX} are waiting already, which is the most"
                )
            self._waiting.append(line)
            if self._wake is not None:
                self._wake()

    def take(self) -> list[str]:
        """All that wait, as lines of JSON, in the order in which they were given."""
        with self._lock:
            taken, self._waiting = self._waiting, []
        return taken

    def on_given(self, wake: Callable[[], object] | None) -> None:
        """Have ``wake`` called, in whatever thread, when an event is given; None: no longer."""
        with self._lock:
            self._wake = wake
