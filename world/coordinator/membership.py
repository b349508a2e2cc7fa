"""Who takes part in a run, tick by tick. Sans I/O.

A robot is there once it has joined and until it is lost, which the shell says of it (``leave``) or
the scenario's crash events, which follow from the tick alone. It is back when neither keeps it
away: the shell has said that it is there again (``join``), and no crash is going on. That counts
from the next round on, so that rounds are whole for whoever is asked.
"""

from collections.abc import Iterable

from encircle.protocol.lockstep import LockStep, Move, Phase
from encircle.world.scenario.channel_model import Crash

CRASHED = "a crash in the scenario"


class Membership:
    """The roll of one run, on its lock-step table. ``departures``: as in ``Result``."""

    def __init__(self, table: LockStep, events: Iterable[object]) -> None:
        self.departures: list[tuple[int, str, str]] = []
        self._table = table
        self._crashes = [event for event in events if isinstance(event, Crash)]
        self._gone: set[str] = set()

    @property
    def lost(self) -> tuple[str, ...]:
        """The robots that are lost now, in robot order."""
        return self._table.in_phase(Phase.LEFT)

    @property
    def begun(self) -> bool:
        """Whether the first round has been opened."""
        return self._table.tick >= 0

    def join(self, robot: str) -> None:
        """A robot is there; ``OutOfTurn`` if it is not of the team or there already."""
        if robot in self._gone:
            self._gone.remove(robot)
            if self.begun:
                return
        if not self.begun or robot not in self.lost:
            self._table.move(robot, Move.JOIN)

    def leave(self, robot: str, tick: int, why: str) -> bool:
        """A robot is lost at a tick; whether the open round has waited for it.

        ``OutOfTurn`` if it is not of the team or has not joined.
        """
        if robot in self._gone:
            return False
        if robot in self.lost:
            # The scenario has taken it away already, and is not to bring it back.
            self._gone.add(robot)
            return False
        owed = robot in self._table.waiting()
        self._table.move(robot, Move.LEAVE)
        self._gone.add(robot)
        if self.begun:
            self.departures.append((tick, robot, f"lost: {why}"))
        return owed

    def open_round(self, tick: int) -> list[str]:
        """Ask those that are there at a tick; returns those of them that are back, robot order."""
        crashed = {
            event.robot
            for event in self._crashes
            if event.tick <= tick and (event.ticks is None or tick < event.tick + event.ticks)
        }
        back = []
        for robot in self.lost:
            if robot not in crashed and robot not in self._gone:
                self._table.move(robot, Move.JOIN)
                self.departures.append((tick, robot, "back"))
                back.append(robot)
        if crashed:
            for robot in self._table.in_phase(Phase.IDLE):
                if robot in crashed:
                    self._table.move(robot, Move.LEAVE)
                    self.departures.append((tick, robot, f"lost: {CRASHED}"))
        self._table.ask_all(tick)
        return back
