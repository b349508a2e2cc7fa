"""A hunt that this program runs, shown on the page while it goes on, and after it.

The hunt's threads hand over what they hear and never wait; frames are made in a thread of this
room's own, and the server has another.
"""

import contextlib
import threading
from collections.abc import Callable, Iterable
from concurrent.futures import Future
from typing import Any

from encircle.live.in_memory import MemoryFeed
from encircle.live.over_zenoh import NothingToSee, ZenohFeed
from encircle.live.updates import Feed
from encircle.protocol.process.interrupts import is_signal_held
from encircle.protocol.process.log import say_error
from encircle.protocol.zenoh.endpoints import ConnectionFailed, Endpoints
from encircle.runner.interventions import Interventions
from encircle.scene.stage import stage_of
from encircle.viewer.control import Control
from encircle.viewer.showing import Show, ShowOptions
from encircle.world.loading.interventions import as_played
from encircle.world.scenario.model import Scenario

LAST_S_MAX = 5.0
"""How long what was heard last may take to be shown."""


class HuntShow:
    """Shows one hunt: an ``encircle.runner.onlooking.HuntOnlooker``.

    ``in_memory``: whether the hunt runs in this process. ``interventions``: those of the hunt,
    which a page with the token may give; without them no page may. ``ServerFailed`` comes from
    ``begin``.
    """

    def __init__(
        self, options: ShowOptions, in_memory: bool, interventions: Interventions | None = None
    ) -> None:
        self.show: Show | None = None
        self._options = options
        self._in_memory = in_memory
        self.interventions = interventions
        self._control: Control | None = None
        self._run = ""
        self._so_far: tuple[tuple[int, str, bytes], ...] = ()
        self._memory: MemoryFeed | None = None
        self._over = threading.Event()
        self._thread: threading.Thread | None = None

    def begin(
        self, scenario: Scenario, run: str, so_far: Iterable[tuple[int, str, bytes]] = ()
    ) -> None:
        """Serve the page of a hunt that is about to begin, and wait for it to be opened."""
        self._run, self._so_far = run, tuple(so_far)
        stage = stage_of(scenario, scenario.seed, run)
        if self.interventions is None:
            self.show = Show(stage, self._options)
        else:
            played = _as_played(scenario, run, self._so_far)
            self._control = Control(played, self.interventions)
            self.show = Show(stage, self._options, self._control.on_message)
            self._control.tell = self.show.server.tell
        self.show.start()
        self.show.await_page(is_signal_held)
        if self._in_memory:
            self._memory = MemoryFeed(scenario, run, so_far=self._so_far)
            self._follow(self._memory)

    def look_on(self, endpoint: str) -> "Future[None]":
        """Look on at a hunt over Zenoh from now on."""
        looking: Future[None] = Future()

        def run() -> None:
            try:
                where = Endpoints(connect=(endpoint,))
                feed = ZenohFeed(where, self._run, so_far=self._so_far)
            except (ConnectionFailed, NothingToSee) as error:
                if not self._over.is_set():
                    say_error(f"encircle: the page shows nothing: {error}")
                return
            finally:
                looking.set_result(None)
            with contextlib.closing(feed):
                self._show(feed)

        self._start(run)
        return looking

    def hear(self, tick: int, key: str, payload: bytes) -> None:
        """Take in a message of a hunt in memory."""
        if self._memory is not None:
            self._memory.hear(tick, key, payload)

    def on_report(self, report: dict[str, Any]) -> None:
        """Take in a report of the hunt: pages are told what became of their events."""
        if self._control is not None:
            self._control.on_report(report)

    def end(self) -> None:
        """The hunt is over: show what was heard last."""
        if self._control is not None:
            self._control.end()
        if self._memory is not None:
            self._memory.end()
        self._over.set()
        if self._thread is not None:
            self._thread.join(LAST_S_MAX)

    def stay(self, stopped: Callable[[], bool]) -> None:
        """Serve on as the options say, or until ``stopped``."""
        if self.show is not None:
            self.show.stay(stopped)

    def stop(self) -> None:
        """Serve no longer; may be called twice, and if nothing was ever shown."""
        if self.show is not None:
            self.show.stop()

    def _follow(self, feed: Feed) -> None:
        self._start(lambda: self._show(feed))

    def _show(self, feed: Feed) -> None:
        assert self.show is not None
        self.show.feed(feed)

    def _start(self, run: Callable[[], None]) -> None:
        self._thread = threading.Thread(target=run, name="show", daemon=True)
        self._thread.start()


def _as_played(scenario: Scenario, run: str, so_far: Iterable[tuple[int, str, bytes]]) -> Scenario:
    """The scenario with the interventions that are recorded of a hunt that is gone on with."""
    for _, key, payload in so_far:
        if key.endswith("/world/intervention"):
            scenario = as_played(scenario, payload, run)
    return scenario
