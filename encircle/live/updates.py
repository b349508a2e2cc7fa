"""What a feed of a running hunt gives: messages in rounds, frames, and how the run stands."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol

from encircle.live.rounds import Message
from encircle.scene.frame import Frame
from encircle.scene.stage import Stage
from encircle.world.scenario.model import Scenario


class RunState(StrEnum):
    """How far a run is. ``ENDED``: no frame will follow, however that came about."""

    WAITING = "waiting"
    RUNNING = "running"
    ENDED = "ended"


@dataclass(frozen=True, slots=True)
class Status:
    """How a run stands. ``text``: one line for people of what is not as it should be, or "".

    ``complete``: False if the run broke off; ``missed_ticks``: how many rounds were not seen, or
    not whole, since this feed saw its first; ``beliefs``: whether beliefs are worked out.
    """

    state: RunState
    text: str = ""
    complete: bool = True
    missed_ticks: int = 0
    beliefs: bool = True


@dataclass(frozen=True, slots=True)
class Update:
    """What is new. ``messages``: of further rounds, (tick, topic, payload), in a recording's order.

    ``frames``: those that are whole now, in order of ticks.
    """

    messages: tuple[Message, ...]
    frames: tuple[Frame, ...]
    status: Status


class Feed(Protocol):
    """Looks on at one running hunt, wherever that runs."""

    @property
    def scenario(self) -> Scenario:
        """The hunt's scenario."""

    @property
    def stage(self) -> Stage:
        """The hunt's constants."""

    def take(self, wait_s: float) -> Update:
        """What is new; waits up to ``wait_s`` s for something.

        Once the status is ``ENDED`` there is nothing more to come.
        """

    def close(self) -> None:
        """Look on no longer; may be called twice, and from any thread."""
