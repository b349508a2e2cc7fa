"""Who is shown a hunt while it goes on: what a runner tells it. It changes nothing of the hunt."""

from collections.abc import Iterable
from concurrent.futures import Future
from typing import Protocol

from encircle.world.scenario.model import Scenario


class HuntOnlooker(Protocol):
    """Looks on at one hunt; its functions come back at once, but ``begin``."""

    def begin(
        self, scenario: Scenario, run: str, so_far: Iterable[tuple[int, str, bytes]] = ()
    ) -> None:
        """A hunt is about to begin, or to go on after what is recorded: (tick, key, payload).

        It begins when this comes back.
        """

    def look_on(self, endpoint: str) -> "Future[None]":
        """Over Zenoh: the hunt's world is there. No robot is started before this is done."""

    def hear(self, tick: int, key: str, payload: bytes) -> None:
        """In memory: a message of the hunt, in the order of its recording."""

    def end(self) -> None:
        """The hunt is over, however it ended."""
