"""From rounds of a running hunt to frames, whatever is missing or wrong in them. Sans I/O."""

from collections.abc import Iterable, Sequence

from encircle.live.rounds import Message, Round
from encircle.live.updates import RunState, Status
from encircle.protocol.endings import EndReason
from encircle.protocol.errors import ProtocolError
from encircle.protocol.process.log import printable
from encircle.scene.builder import SceneBuilder
from encircle.scene.frame import Frame
from encircle.scene.stage import Stage, stage_of
from encircle.world.recording.recording import RecordingError
from encircle.world.scenario.model import Scenario

NAMES_MAX = 8


class SceneFeed:
    """The frames of one run. ``joined_tick``: the first tick that was seen, None before it.

    ``refused``: how many messages could not be understood. ``unsure``: the robots of which it
    cannot be worked out now what they believe; ``last_tick``: of the last round so far.
    """

    def __init__(self, scenario: Scenario, seed: int, run: str, beliefs: bool = True) -> None:
        self.stage: Stage = stage_of(scenario, seed, run)
        self.joined_tick: int | None = None
        self.refused = 0
        self.unsure: tuple[str, ...] = ()
        self.last_tick = -1
        self._has_beliefs = beliefs and scenario.clock != "wall"
        self._builder = SceneBuilder(scenario, seed, run, beliefs)

    def take(self, rounds: Iterable[Round]) -> tuple[list[Message], list[Frame]]:
        """The messages of some rounds, and the frames that are whole with them."""
        messages, frames = [], []
        for heard in rounds:
            if heard.tick > self.last_tick + 1:
                frames += self._builder.skip_to(heard.tick)
            self.last_tick = heard.tick
            if self.joined_tick is None:
                self.joined_tick = heard.tick
            for message in heard.messages:
                messages.append(message)
                frames += self._frames(message)
        return messages, self._noted(frames)

    def finish(self) -> list[Frame]:
        """The frames that are left when nothing more will come."""
        return self._noted(self._builder.finish())

    def status(self, state: RunState, reason: str, missed_ticks: int) -> Status:
        """How the run stands. ``reason``: of its end, if it is known."""
        broke_off = state is RunState.ENDED and reason not in tuple(EndReason)
        texts = [f"{reason or 'the run broke off'} (tick {max(self.last_tick, 0)})"] * broke_off
        if self.joined_tick:
            texts.append(f"seen from tick {self.joined_tick} on")
        if missed_ticks:
            texts.append(f"{missed_ticks} tick{'s' if missed_ticks > 1 else ''} missed")
        if self.unsure:
            texts.append(
                f"what {names(self.unsure)} believe{'s' * (len(self.unsure) == 1)} is unsure"
            )
        text = printable("; ".join(texts))
        return Status(state, text, not broke_off, missed_ticks, self._has_beliefs)

    def _frames(self, message: Message) -> list[Frame]:
        try:
            return self._builder.take(*message)
        except (ProtocolError, RecordingError):
            # Anybody may send anything where there are no certificates.
            self.refused += 1
            return []

    def _noted(self, frames: list[Frame]) -> list[Frame]:
        if frames:
            self.unsure = frames[-1].beliefs_unsure
        return frames


def names(robots: Sequence[str]) -> str:
    """A list of robots for one line."""
    more = f" and {len(robots) - NAMES_MAX} more" if len(robots) > NAMES_MAX else ""
    return ", ".join(robots[:NAMES_MAX]) + more
