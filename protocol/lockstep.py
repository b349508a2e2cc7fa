"""The lock-step table: which messages are legal when, and when a round is complete. Sans I/O.

The world asks every robot by sending an observation. Each robot answers with exactly one pose and
one command for that tick, in either order, or with a command alone which says that no pose comes.
``TABLE`` holds the legal moves of one robot; any other move is out of turn. A round is complete
when no answer is missing, in whole or in part. A robot that has left is not asked, and no answer of
it is waited for, until it joins again.
"""

from collections.abc import Sequence
from enum import StrEnum

from encircle.protocol.errors import OutOfTurn


class Phase(StrEnum):
    """Where one robot stands."""

    ABSENT = "absent"
    IDLE = "idle"
    ASKED = "asked"
    POSED = "posed"
    COMMANDED = "commanded"
    LEFT = "left"


class Move(StrEnum):
    """What can happen to one robot."""

    JOIN = "join"
    ASK = "ask"
    POSE = "pose"
    COMMAND = "command"
    COMMAND_ALONE = "command alone"
    LEAVE = "leave"


TABLE: dict[tuple[Phase, Move], Phase] = {
    (Phase.ABSENT, Move.JOIN): Phase.IDLE,
    (Phase.IDLE, Move.ASK): Phase.ASKED,
    (Phase.ASKED, Move.POSE): Phase.POSED,
    (Phase.ASKED, Move.COMMAND): Phase.COMMANDED,
    (Phase.ASKED, Move.COMMAND_ALONE): Phase.IDLE,
    (Phase.POSED, Move.COMMAND): Phase.IDLE,
    (Phase.COMMANDED, Move.POSE): Phase.IDLE,
    (Phase.IDLE, Move.LEAVE): Phase.LEFT,
    (Phase.ASKED, Move.LEAVE): Phase.LEFT,
    (Phase.POSED, Move.LEAVE): Phase.LEFT,
    (Phase.COMMANDED, Move.LEAVE): Phase.LEFT,
    (Phase.LEFT, Move.JOIN): Phase.IDLE,
}
_UNANSWERED = (Phase.ASKED, Phase.POSED, Phase.COMMANDED)


class LockStep:
    """The table for a whole team, with the tick that is being answered."""

    def __init__(self, robots: Sequence[str]) -> None:
        self._phases = dict.fromkeys(robots, Phase.ABSENT)
        self._open = 0
        self.tick = -1

    @property
    def complete(self) -> bool:
        """Whether every robot that was asked has answered."""
        return self._open == 0

    def in_phase(self, *phases: Phase) -> tuple[str, ...]:
        """The robots in any of these phases, in robot order."""
        return tuple(robot for robot, phase in self._phases.items() if phase in phases)

    def waiting(self) -> tuple[str, ...]:
        """The robots whose answer is still to come, in robot order."""
        return self.in_phase(*_UNANSWERED)

    def move(self, robot: str, move: Move, tick: int | None = None) -> Phase:
        """Make a move; ``OutOfTurn`` for an unknown robot, another tick or an illegal move."""
        before = self._phases.get(robot)
        if before is None:
            raise OutOfTurn(f"robot {robot!r} is not in this team ({', '.join(self._phases)})")
        if tick is not None and tick != self.tick:
            raise OutOfTurn(f"{move.value} of {robot} is for tick {tick}, this is tick {self.tick}")
        after = TABLE.get((before, move))
        if after is None:
            raise OutOfTurn(f"{move.value} of {robot} at tick {self.tick}: it is {before.value}")
        self._phases[robot] = after
        self._open += (after in _UNANSWERED) - (before in _UNANSWERED)
        return after

    def ask_all(self, tick: int) -> tuple[str, ...]:
        """Open a round for a tick; returns the robots that are to answer."""
        assert self.complete, f"tick {self.tick} still waits for {self.waiting()}"
        self.tick = tick
        asked = self.in_phase(Phase.IDLE)
        for robot in asked:
            self.move(robot, Move.ASK)
        return asked
