"""Showing a hunt on the page: a feed or a recording on one side, the server on the other.

The page stays reachable when the hunt is over, until Ctrl-C or whenever ``WatchEnd`` says.
"""

import os
import sys
import threading
import time
import webbrowser
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from itertools import islice
from typing import Any

from encircle.live.updates import Feed, RunState, Status
from encircle.protocol.process.log import printable, say_error
from encircle.scene.builder import frames_of_recording
from encircle.scene.frame import Frame
from encircle.scene.stage import Stage
from encircle.viewer.addresses import LOOPBACK
from encircle.viewer.handlers import Taken
from encircle.viewer.history import History
from encircle.viewer.server import PageServer
from encircle.world.recording.recording import Recording

TAKE_S = 0.2
FRAMES_AT_ONCE = 50
"""Of a recording: so many are handed over together."""
UNSEEN_S = 3.0
"""How long no page may be open before nobody is taken to look on: a page that is loaded anew is
not open for a moment."""
STEP_S = 0.1
START_S_MAX = 10.0


class WatchEnd(StrEnum):
    """When the page is no longer served.

    ``STAY``: at Ctrl-C. ``CLOSED``: when the run is over and no page is open any more. ``RUN``:
    when the run is over.
    """

    STAY = "stay"
    CLOSED = "closed"
    RUN = "run"


@dataclass(frozen=True, slots=True)
class ShowOptions:
    """How a hunt is shown. ``port``: 0 for any that is free; ``browser``: whether to open one.

    ``start_s_max``: how long a hunt that is to begin waits for a page to be open, in s; None is
    ``START_S_MAX`` if a browser could be opened, and not at all otherwise.
    """

    port: int = 0
    host: str = LOOPBACK
    browser: bool = True
    end: WatchEnd = WatchEnd.STAY
    start_s_max: float | None = None


class Show:
    """The page of one hunt, from ``start`` to ``stop``. Raises ``ServerFailed`` if it cannot be."""

    def __init__(self, stage: Stage, options: ShowOptions, on_message: Taken | None = None) -> None:
        self.history = History(stage)
        self.server = PageServer(self.history, options.host, options.port, on_message)
        self._options = options
        self._has_browser = False

    def start(self) -> None:
        """Serve the page, and say where; open a browser if there is one."""
        self.server.start()
        say_error(f"encircle: the page is at {self.server.address}")
        if self._options.browser:
            self._has_browser = open_browser(self.server.address)

    def await_page(self, stopped: Callable[[], bool]) -> None:
        """Wait for a page to be open, as long as the options say, or until ``stopped``."""
        s_max = self._options.start_s_max
        if s_max is None:
            s_max = START_S_MAX if self._has_browser else 0.0
        until_s = time.monotonic() + s_max
        while not self.server.site.pages and not stopped() and time.monotonic() < until_s:
            time.sleep(STEP_S)

    def feed(self, feed: Feed, stopped: Callable[[], bool] = lambda: False) -> Status:
        """Show what a feed gives, until its end or until ``stopped``; how the run stood then.

        What goes wrong in that is raised, and pages are told that nothing more will come.
        """
        try:
            while True:
                update = feed.take(TAKE_S)
                self.history.add(update.frames, status_json(update.status))
                if update.status.state is RunState.ENDED or stopped():
                    return update.status
        except Exception as error:
            text = printable(f"this page shows no more of the run: {type(error).__name__}: {error}")
            self.history.add([], {"state": "ended", "text": text, "complete": False})
            raise

    def recording(self, recording: Recording, stopped: Callable[[], bool]) -> None:
        """Show a recording, its first frames while the others are made; ``RecordingError``."""
        for frames in batched(frames_of_recording(recording)):
            self.history.add(frames)
            if stopped():
                return
        # How it ended is known when no frame will follow.
        self.history.add([], {"state": "ended", "complete": recording.complete})

    def stay(self, stopped: Callable[[], bool], awaits_page: bool = False) -> None:
        """Serve on until ``stopped``, or until the options say so.

        ``awaits_page``: that no page was opened yet does not count as none being open any more.
        """
        end, site = self._options.end, self.server.site
        over_s = time.monotonic()
        while not stopped() and end is not WatchEnd.RUN:
            unseen_s = time.monotonic() - max(over_s, site.last_closed_s)
            may_end = site.opened > 0 or not awaits_page
            if end is WatchEnd.CLOSED and not site.pages and may_end and unseen_s > UNSEEN_S:
                return
            time.sleep(STEP_S)

    def stop(self) -> None:
        """Serve no longer; may be called twice."""
        self.server.stop()


def batched(frames: Iterable[Frame]) -> Iterator[list[Frame]]:
    """Frames, some at a time."""
    left = iter(frames)
    while some := list(islice(left, FRAMES_AT_ONCE)):
        yield some


def status_json(status: Status) -> dict[str, Any]:
    """A status as the page takes it (``page/source.js``)."""
    return {
        "state": status.state.value,
        "text": status.text,
        "complete": status.complete,
        "beliefs": status.beliefs,
        "missed_ticks": status.missed_ticks,
    }


def open_browser(address: str) -> bool:
    """Open a page in the user's browser; whether there is one, and a display for its window."""
    if sys.platform.startswith("linux") and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    ):
        return False
    try:
        browser = webbrowser.get()
    except webbrowser.Error:
        browser = None
    if browser is None or type(browser) is webbrowser.GenericBrowser:
        # One of the latter kind takes the terminal.
        say_error("encircle: no browser was found here; open the address in one yourself")
        return False

    def show() -> None:
        if not browser.open(address):
            say_error("encircle: the browser did not open; open the address yourself")

    # It may take seconds to answer.
    threading.Thread(target=show, name="browser", daemon=True).start()
    return True
