"""Who takes part in a run, tick by tick. Sans I/O.

A robot takes part from its joining until it is lost. Two things can take it away: the shell reports
that it is lost (``leave``), or a crash event of the scenario is going on, which follows from the
tick alone. It takes part again as soon as neither holds: the shell has reported its return
(``join``), and no crash is going on. Robots return only when a round is opened, so that a round is
whole for every robot that was asked.
"""

from collections.abc import Iterable
from enum import StrEnum
from typing import NamedTuple

from encircle.protocol.lockstep import LockStep, Move, Phase
from encircle.world.scenario.channel_model import Crash

DepartureRow = tuple[int, str, str]
"""A departure in results and reports: ``(tick, robot, text)``."""


class DepartureCause(StrEnum):
    """Why a robot is lost, or that it is back; the value is what people read."""

    GONE = "it is gone"
    NO_ANSWER = "no answer"
    CRASH = "a crash in the scenario"
    NOT_RETURNED = "it did not come back"
    BEFORE_RESUMING = "before the run was resumed"
    BACK = "back"


class Departure(NamedTuple):
    """One robot was lost at a tick, or came back then. ``detail`` follows the cause in the text."""

    tick: int
    robot: str
    cause: DepartureCause
    detail: str = ""

    @property
    def text(self) -> str:
        """What happened: ``back``, or ``lost:`` and why."""
        if self.cause is DepartureCause.BACK:
            return self.cause.value
        return f"lost: {' '.join(filter(None, (self.cause.value, self.detail)))}"

    @property
    def row(self) -> DepartureRow:
        """The departure as results and reports show it."""
        return self.tick, self.robot, self.text


class Membership:
    """The members of one run, on its lock-step table. ``departures``: all so far, in order."""

    def __init__(self, table: LockStep, events: Iterable[object]) -> None:
        self.departures: list[Departure] = []
        self._table = table
        self._crashes = [event for event in events if isinstance(event, Crash)]
        self._absent: set[str] = set()

    @property
    def lost(self) -> tuple[str, ...]:
        """The robots that are lost now, in robot order."""
        return self._table.in_phase(Phase.LEFT)

    @property
    def begun(self) -> bool:
        """Whether the first round has been opened."""
        return self._table.tick >= 0

    def join(self, robot: str) -> None:
        """A robot is present; ``OutOfTurn`` if it is not of the team or present already."""
        if robot in self._absent:
            self._absent.remove(robot)
            if self.begun:
                return
        if not self.begun or robot not in self.lost:
            self._table.move(robot, Move.JOIN)

    def leave(self, robot: str, tick: int, cause: DepartureCause, detail: str = "") -> bool:
        """A robot is lost at a tick; whether the open round has waited for it.

        ``OutOfTurn`` if it is not of the team or has not joined.
        """
        if robot in self._absent:
            return False
        if robot in self.lost:
            # The scenario has taken it away already, and must not bring it back.
            self._absent.add(robot)
            return False
        owes_answer = robot in self._table.waiting()
        self._table.move(robot, Move.LEAVE)
        self._absent.add(robot)
        if self.begun:
            self.departures.append(Departure(tick, robot, cause, detail))
        return owes_answer

    def add_event(self, event: object) -> None:
        """An event more, of a tick that has not begun."""
        if isinstance(event, Crash):
            self._crashes.append(event)

    def open_round(self, tick: int) -> list[str]:
        """Ask the robots that are present at a tick; returns those that are back, robot order."""
        crashed = {event.robot for event in self._crashes if is_crashed(event, tick)}
        returned = [r for r in self.lost if r not in crashed and r not in self._absent]
        for robot in returned:
            self._table.move(robot, Move.JOIN)
            self.departures.append(Departure(tick, robot, DepartureCause.BACK))
        if crashed:
            for robot in self._table.in_phase(Phase.IDLE):
                if robot in crashed:
                    self._table.move(robot, Move.LEAVE)
                    self.departures.append(Departure(tick, robot, DepartureCause.CRASH))
        self._table.ask_all(tick)
        return returned


def is_crashed(crash: Crash, tick: int) -> bool:
    """Whether a crash of the scenario is going on at a tick."""
    return crash.tick <= tick and (crash.ticks is None or tick < crash.tick + crash.ticks)
