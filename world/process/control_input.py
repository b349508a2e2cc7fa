"""Control lines: interventions from the program that started this world, on standard input.

Nobody else can write there, and no key of the network leads here. A line is one event as JSON.
Lines that come before the first round wait for it. What became of each is reported.
"""

import json
import os
from collections.abc import Mapping
from functools import partial
from threading import Lock
from typing import Any

from encircle.world.coordinator.outgoing import Outgoing
from encircle.world.coordinator.real_time_core import RealTimeWorldCore
from encircle.world.coordinator.world_core import WorldCore
from encircle.world.loading.interventions import (
    INTERVENTIONS_MAX,
    LINE_BYTES_MAX,
    InterventionRefused,
    table_of,
)
from encircle.world.process.core_access import CoreAccess
from encircle.world.process.reports import Reporter

READ_BYTES = 64 * 1024


class ControlLines:
    """Bytes to lines, sans I/O. A line that is too long is left out, and shows as None."""

    def __init__(self) -> None:
        self._rest = b""
        self._skips = False

    def feed(self, data: bytes) -> list[bytes | None]:
        """The lines that are whole now."""
        *whole, self._rest = (self._rest + data).split(b"\n")
        lines: list[bytes | None] = []
        for line in whole:
            too_long = self._skips or len(line) > LINE_BYTES_MAX
            self._skips = False
            if line.strip() or too_long:
                lines.append(None if too_long else line)
        if len(self._rest) > LINE_BYTES_MAX:
            # Its beginning is not needed any more, only where it ends.
            self._rest, self._skips = b"", True
        return lines


def read_event(line: bytes | None) -> Mapping[str, Any]:
    """The event of a line; ``InterventionRefused`` if it is none."""
    if line is None:
        raise InterventionRefused(
            f"intervention: a line of more than {LINE_BYTES_MAX} bytes is none"
        )
    try:
        event = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise InterventionRefused(f"intervention: a line is not JSON: {error}") from None
    if not isinstance(event, dict):
        raise InterventionRefused("intervention: a line must be a table with a kind")
    return event


class ControlInput:
    """The control lines of one run, from a file descriptor that is read when it is readable."""

    def __init__(
        self, core: WorldCore | RealTimeWorldCore, access: CoreAccess, report: Reporter
    ) -> None:
        self._core = core
        self._access = access
        self._report = report
        self._lines = ControlLines()
        self._held: list[bytes | None] = []
        self._begun = False
        self._lock = Lock()

    def readable(self, descriptor: int) -> bool:
        """Read what is there; whether there may be more later: not when the writer is gone."""
        data = os.read(descriptor, READ_BYTES)
        with self._lock:
            self._held += self._lines.feed(data)
            # What is beyond could not be given either.
            del self._held[2 * INTERVENTIONS_MAX :]
            if self._begun:
                self._give_held()
        return bool(data)

    def begin(self) -> None:
        """The first round is open: give what has been waiting for it."""
        with self._lock:
            self._begun = True
            self._give_held()

    def _give_held(self) -> None:
        held, self._held = self._held, []
        for line in held:
            self._access.change(partial(self._give, line))

    def _give(self, line: bytes | None) -> Outgoing:
        tick = self._core.state.tick
        try:
            event = self._core.intervene(read_event(line))
        except InterventionRefused as refused:
            self._report({"refused_intervention": str(refused)})
            return []
        self._report({"intervention": {"given": tick, "event": table_of(event)}})
        # Recorded and shown at once, however long the round takes.
        return self._core.rounds.commit()
