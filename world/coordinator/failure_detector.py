"""Which robots of the team are present, and what the world does about the others. Sans I/O.

A robot is present when its liveliness token is. It is lost when its token goes, or when it owes an
answer for too long: the run goes on without it, or ends, as the user has asked. A lost robot is
readmitted when its token comes back, or when it sends something that only it would send, such as
the late answer of a robot that was frozen. A robot that fell silent may have missed its
observation, and would wait for ever; a robot whose token went may be present all the same. Both get
reminders until they send something. Robots that the scenario itself takes away do not count here.
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress

from encircle.protocol.envelopes import ANSWERS, opened
from encircle.protocol.errors import OutOfTurn, ProtocolError
from encircle.protocol.keys import channel_of, parse_key
from encircle.world.coordinator.incoming import read_answer
from encircle.world.coordinator.membership import DepartureCause
from encircle.world.coordinator.outgoing import Outgoing
from encircle.world.coordinator.real_time_core import RealTimeWorldCore
from encircle.world.coordinator.result import END, GO_ON
from encircle.world.coordinator.world_core import WorldCore
from encircle.world.scenario.model import Scenario

GRACE_REMINDERS = 2
"""A message of a robot whose token is gone counts as sent before that, for so many reminders."""


class RunCannotContinue(Exception):
    """The run cannot go on; the message says why."""


def policies_of(scenario: Scenario, robots: Sequence[str]) -> str:
    """By which policies robots decide, as in ``policy 'xi-star'``: who is silent may be slow."""
    names = list(dict.fromkeys(repr(scenario.strategy_of(robot)) for robot in robots))
    return f"{'policy' if len(names) == 1 else 'policies'} {', '.join(names)}"


class FailureDetector:
    """The failure detector of one run. ``begun``: whether its rounds are under way.

    ``histories``: for a run that is resumed, what each robot that is asked has to receive before.
    The methods return the messages to send, and raise ``RunCannotContinue`` if the run ends here.
    """

    def __init__(
        self,
        core: WorldCore | RealTimeWorldCore,
        when_lost: str = GO_ON,
        histories: Mapping[str, Outgoing] | None = None,
    ) -> None:
        self.begun = False
        self._core = core
        self._rounds = core.rounds
        self._when_lost = when_lost
        self._histories = histories
        self._present: set[str] = set()
        self._lost: set[str] = set()
        self._restart_messages: dict[str, Outgoing] = {}
        self._grace_reminders: dict[str, int] = {}
        self._tokenless: set[str] = set()

    @property
    def expected(self) -> tuple[str, ...]:
        """The robots, in robot order, that the run waits for at its beginning."""
        team = self._core.arena.ids if self._histories is None else tuple(self._histories)
        return tuple(robot for robot in team if robot not in self._present)

    @property
    def may_begin(self) -> bool:
        """Whether the run can begin without the expected robots: only a resumed one can."""
        return self._histories is not None and bool(self._present & self._histories.keys())

    def token_appeared(self, robot: str) -> Outgoing:
        """A robot's token is there. ``OutOfTurn`` if the robot is not of the team."""
        if robot not in self._core.arena.ids:
            raise OutOfTurn(f"robot {robot!r} is not in this team")
        readmitted = robot in self._tokenless - self._lost
        self._tokenless.discard(robot)
        if readmitted:
            return []
        self._present.add(robot)
        if self.begun or self._histories is None:
            return self._readmit(robot)
        waiting = [robot] if robot in self._rounds.table.waiting() else []
        return [*self._histories.get(robot, ()), *self._rounds.open_round.messages_to(waiting)]

    def token_vanished(self, robot: str) -> Outgoing:
        """A robot's token is gone."""
        if robot not in self._present or self._core.ended is not None:
            return []
        self._present.remove(robot)
        cause = DepartureCause.GONE
        if self.begun:
            self._grace_reminders[robot] = GRACE_REMINDERS
            self._restart_messages.setdefault(robot, self._rounds.restart_messages(robot))
            return self._mark_lost((robot,), f"robot {robot} is gone", cause)
        if self._when_lost == END:
            raise RunCannotContinue(f"robot {robot} is gone before the run has begun")
        return self._core.leave(robot, cause) if self._histories is None else []

    def answer_overdue(self, tick: int, answer_s_max: float) -> Outgoing:
        """For so long, answers at a tick have not come."""
        if self._core.state.tick != tick:
            # They have come at last, and the next round has begun: no robot owes that for long.
            return []
        return self.suspect(self._rounds.table.waiting(), answer_s_max)

    def suspect(self, robots: Sequence[str], answer_s_max: float) -> Outgoing:
        """For so long, nothing has come from these robots."""
        duration = f"for {answer_s_max:g} s"
        for robot in robots:
            self._restart_messages[robot] = self._rounds.restart_messages(robot)
        reason = f"no answer from {', '.join(robots)} {duration}"
        return self._mark_lost(robots, reason, DepartureCause.NO_ANSWER, duration)

    def reminders(self) -> Outgoing:
        """Setup and observation once more, for the lost robots that may be present all the same."""
        self._grace_reminders = {r: n - 1 for r, n in self._grace_reminders.items() if n > 1}
        reminded = (self._restart_messages.keys() & self._lost) - self._grace_reminders.keys()
        return [message for robot in sorted(reminded) for message in self._restart_messages[robot]]

    def begin(self) -> Outgoing:
        """The rounds begin, with the robots that are present."""
        self.begun = True
        absent = self.expected
        if self._histories is not None:
            return self._resume(absent)
        # A robot that went in the last moment is lost in the first round, as in any other.
        for robot in absent:
            self._core.join(robot)
        outgoing = self._core.begin()
        reason = f"robot {', '.join(absent)} is gone"
        return outgoing + self._mark_lost(absent, reason, DepartureCause.GONE)

    def _resume(self, absent: Sequence[str]) -> Outgoing:
        """The rounds go on from where they were."""
        outgoing: Outgoing = []
        cause = DepartureCause.NOT_RETURNED
        for robot in self._rounds.lost:
            if robot in self._present:
                outgoing += self._core.join(robot)
            elif self._when_lost != END:
                # Also if the scenario has taken the robot away: it must not bring it back.
                self._lost.add(robot)
                self._core.leave(robot, cause)
        return outgoing + self._mark_lost(absent, f"{', '.join(absent)} did not come back", cause)

    def sign_of_life(self, key: str, payload: bytes) -> Outgoing:
        """A message has come; if a lost robot has sent it, that robot is readmitted."""
        if not self._lost:
            return []
        if channel_of(key) != ANSWERS:
            return self._sign_of(key, payload)
        outgoing: Outgoing = []
        with suppress(ProtocolError):  # the core has refused it
            for inner_key, inner in opened(ANSWERS, payload, self._core.run):
                outgoing += self._sign_of(inner_key, inner)
        return outgoing

    def _sign_of(self, key: str, payload: bytes) -> Outgoing:
        try:
            sender = parse_key(key).robot
            if sender not in self._lost or sender in self._grace_reminders:
                return []
            robot = read_answer(key, payload, self._core.run).robot
        except ProtocolError:
            return []
        if robot not in self._present:
            self._present.add(robot)
            self._tokenless.add(robot)
        return self._readmit(robot)

    def _readmit(self, robot: str) -> Outgoing:
        self._lost.discard(robot)
        self._restart_messages.pop(robot, None)
        self._grace_reminders.pop(robot, None)
        return self._core.join(robot)

    def _mark_lost(
        self, robots: Sequence[str], reason: str, cause: DepartureCause, detail: str = ""
    ) -> Outgoing:
        """The run goes on without robots, or ends for this reason."""
        core, lost_before = self._core, self._rounds.lost
        newly_lost = [robot for robot in robots if robot not in self._lost]
        if not newly_lost:
            return []
        reason = f"{reason} at tick {core.state.tick}"
        is_silent = cause is DepartureCause.NO_ANSWER
        policies = f" ({policies_of(core.arena.scenario, robots)})" if is_silent else ""
        if self._when_lost == END:
            raise RunCannotContinue(reason + policies)
        if {*lost_before, *newly_lost} == {*core.arena.ids}:
            raise RunCannotContinue(f"{reason}, and no robot is left{policies}")
        outgoing = []
        for robot in newly_lost:
            self._lost.add(robot)
            outgoing += core.leave(robot, cause, detail)
        return outgoing
