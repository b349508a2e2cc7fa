"""What a page is shown: stage, frames and status, kept as JSON for whoever comes, and when.

One thread adds what is new; the server's thread reads. Frames are made into text once, however many
pages there are, and are kept so that a page that is opened late or anew gets all of them. What is
kept is bounded: when there is too much, the oldest frames go.
"""

import json
import threading
from bisect import bisect_left
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from encircle.scene.as_json import frame_json, stage_json
from encircle.scene.frame import Frame
from encircle.scene.stage import Stage

KEPT_BYTES_MAX = 256 * 1024 * 1024
MESSAGE_BYTES_MAX = 256 * 1024
"""How long a message of several frames may become; one frame always goes."""


class Position(NamedTuple):
    """How far a page is: the next tick that it needs, and the version of the status it has.

    ``has_stage``: whether it shows this run already.
    """

    tick: int = 0
    status: int = -1
    has_stage: bool = False


class History:
    """What there is to see of one run so far. ``changed`` is called after each addition."""

    def __init__(self, stage: Stage, kept_bytes_max: int = KEPT_BYTES_MAX) -> None:
        self.run = stage.run
        self.changed: Callable[[], None] = lambda: None
        self._stage = as_text(stage_json(stage))
        self._kept_bytes_max = kept_bytes_max
        self._ticks: list[int] = []
        self._frames: list[str] = []
        self._bytes = 0
        self._status: dict[str, Any] = {"state": "waiting", "text": "", "complete": True}
        self._status_version = 0
        self._lock = threading.Lock()

    def add(self, frames: Iterable[Frame], status: dict[str, Any] | None = None) -> None:
        """Add frames, in the order of ticks, and what of the status has changed."""
        texts = [(frame.tick, as_text(frame_json(frame))) for frame in frames]
        with self._lock:
            for tick, text in texts:
                if self._ticks and tick <= self._ticks[-1]:
                    continue
                self._ticks.append(tick)
                self._frames.append(text)
                self._bytes += len(text)
            self._forget()
            news = {k: v for k, v in (status or {}).items() if self._status.get(k) != v}
            if news:
                self._status |= news
                self._status_version += 1
        if texts or news:
            self.changed()

    def next_message(self, at: Position, extra: dict[str, Any]) -> tuple[str, Position] | None:
        """The next message to a page, and how far it then is; None if it has all there is.

        ``extra``: what only this page's status has.
        """
        with self._lock:
            parts, first = [], bisect_left(self._ticks, at.tick)
            if not at.has_stage:
                parts.append(f'"stage":{self._stage}')
            last, size = first, 0
            while last < len(self._frames) and (
                last == first or size + len(self._frames[last]) <= MESSAGE_BYTES_MAX
            ):
                size += len(self._frames[last])
                last += 1
            if last > first:
                parts.append(f'"frames":[{",".join(self._frames[first:last])}]')
            # That a run has ended is told when all of it was sent.
            if at.status != self._status_version and last == len(self._frames):
                parts.append(f'"status":{as_text(self._status | extra)}')
                at = at._replace(status=self._status_version)
            if last > first:
                at = at._replace(tick=self._ticks[last - 1] + 1)
        return (f"{{{','.join(parts)}}}", at._replace(has_stage=True)) if parts else None

    def _forget(self) -> None:
        number = 0
        while self._bytes > self._kept_bytes_max and number < len(self._frames) - 1:
            self._bytes -= len(self._frames[number])
            number += 1
        if number:
            del self._ticks[:number], self._frames[:number]


def as_text(content: Any) -> str:
    """An object as JSON without spaces."""
    return json.dumps(content, separators=(",", ":"), allow_nan=False)
