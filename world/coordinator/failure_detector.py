"""Who of the team is there, and what the world does about it. Sans I/O.

A robot is there when its liveliness token is. One whose token goes, or that owes an answer for too
long, is lost: the run goes on without it, or ends, as it was asked to. A lost robot is taken in
again when its token comes back or when it says something that only it would say, such as the late
answer of one that was frozen. One that fell silent may have missed what it was asked, and would
wait for ever; one whose token went may be there all the same: they are asked anew until they say
something. Robots that the scenario itself takes away are no concern of this.
"""

from collections.abc import Mapping, Sequence

from encircle.protocol.codec import decode, decode_pose
from encircle.protocol.errors import OutOfTurn, ProtocolError
from encircle.protocol.keys import parse_key, robot_key
from encircle.protocol.messages import Command
from encircle.world.coordinator.result import END, GO_ON
from encircle.world.coordinator.world_core import Outgoing, WorldCore

NO_ANSWER = "no answer"
GRACE_LOOKS = 2
"""For so many looks at who owes an answer, what comes of one that is gone was still under way."""


class RunCannotContinue(Exception):
    """The run cannot go on; the message says why."""


class FailureDetector:
    """The roll of one run. ``begun``: whether its rounds are under way.

    ``briefings``: for a run that is resumed, what each robot that is asked has to know before.
    """

    def __init__(
        self,
        core: WorldCore,
        when_lost: str = GO_ON,
        histories: Mapping[str, Outgoing] | None = None,
    ) -> None:
        self.begun = False
        self._core = core
        self._when_lost = when_lost
        self._histories = histories
        self._present: set[str] = set()
        self._lost: set[str] = set()
        self._restart_messages: dict[str, Outgoing] = {}
        self._grace_looks: dict[str, int] = {}
        self._tokenless: set[str] = set()

    @property
    def expected(self) -> tuple[str, ...]:
        """The robots, in robot order, that the run waits for at its beginning."""
        awaited = self._core.arena.ids if self._histories is None else tuple(self._histories)
        return tuple(robot for robot in awaited if robot not in self._present)

    @property
    def may_begin(self) -> bool:
        """Whether the run can begin without those that are expected: only one that had begun."""
        return self._histories is not None and bool(self._present & self._histories.keys())

    def token_appeared(self, robot: str) -> Outgoing:
        """A token is there: what to tell its robot. ``OutOfTurn`` if it is not of the team."""
        if robot not in self._core.arena.ids:
            raise OutOfTurn(f"robot {robot!r} is not in this team")
        known = robot in self._tokenless - self._lost
        self._tokenless.discard(robot)
        if known:
            return []
        self._present.add(robot)
        if self.begun or self._histories is None:
            return self._readmit(robot)
        own = robot_key(self._core.run, robot, "")
        asked = [message for message in self._core.unanswered() if message[0].startswith(own)]
        return [*self._histories.get(robot, ()), *asked]

    def token_vanished(self, robot: str) -> Outgoing:
        """A token is gone: what to tell the others; raises ``RunCannotContinue``."""
        if robot not in self._present or self._core.ended is not None:
            return []
        self._present.remove(robot)
        if self.begun:
            self._grace_looks[robot] = GRACE_LOOKS
            self._restart_messages.setdefault(robot, self._core.restart_messages(robot))
            return self._mark_lost((robot,), "it is gone", f"robot {robot} is gone")
        if self._when_lost == END:
            raise RunCannotContinue(f"robot {robot} is gone before the run has begun")
        return self._core.leave(robot, "it is gone") if self._histories is None else []

    def answer_overdue(self, tick: int, answer_s_max: float) -> Outgoing:
        """No answer at a tick for so long: what to tell others; raises ``RunCannotContinue``."""
        if self._core.state.tick != tick:
            # It has come at last, and the next round has begun: nobody owes that for long.
            return []
        return self.suspect(self._core.table.waiting(), answer_s_max)

    def suspect(self, names: Sequence[str], answer_s_max: float) -> Outgoing:
        """As ``silent``, of these robots."""
        lasted = f"for {answer_s_max:g} s"
        message = f"no answer from {', '.join(names)} {lasted}"
        self._restart_messages |= {robot: self._core.restart_messages(robot) for robot in names}
        return self._mark_lost(names, f"{NO_ANSWER} {lasted}", message)

    def reminders(self) -> Outgoing:
        """What those that fell silent or are gone are asked anew."""
        self._grace_looks = {r: looks - 1 for r, looks in self._grace_looks.items() if looks > 1}
        due = (self._restart_messages.keys() & self._lost) - self._grace_looks.keys()
        return [message for robot in sorted(due) for message in self._restart_messages[robot]]

    def begin(self) -> Outgoing:
        """The rounds begin, with whoever is there: what to send; raises ``RunCannotContinue``."""
        self.begun = True
        core, absent = self._core, self.expected
        outgoing: Outgoing = []
        if self._histories is None:
            # Whoever went in the last moment is lost in the first round, as in any other.
            for robot in absent:
                core.join(robot)
            outgoing = core.begin()
            message = f"robot {', '.join(absent)} is gone"
            return outgoing + self._mark_lost(absent, "it is gone", message)
        why = "it did not come back"
        for robot in core.lost:
            if robot in self._present:
                outgoing += core.join(robot)
            elif self._when_lost != END:
                # Said of those too that the scenario has taken away: it is not to bring them back.
                self._lost.add(robot)
                core.leave(robot, why)
        return outgoing + self._mark_lost(absent, why, f"{', '.join(absent)} did not come back")

    def sign_of_life(self, key: str, payload: bytes) -> Outgoing:
        """A message has come: if it is a lost robot's sign of life, what to tell that robot."""
        if not self._lost:
            return []
        try:
            of_run, robot, channel = parse_key(key)
            run = self._core.run
            if robot not in self._lost or channel not in ("pose", "command"):
                return []
            message = (
                decode_pose(payload, run) if channel == "pose" else decode(Command, payload, run)
            )
        except ProtocolError:
            return []
        if message.robot != robot or of_run != run or robot in self._grace_looks:
            return []
        if robot not in self._present:
            self._present.add(robot)
            self._tokenless.add(robot)
        return self._readmit(robot)

    def _readmit(self, robot: str) -> Outgoing:
        self._lost.discard(robot)
        self._restart_messages.pop(robot, None)
        self._grace_looks.pop(robot, None)
        return self._core.join(robot)

    def _mark_lost(self, names: Sequence[str], why: str, message: str) -> Outgoing:
        core = self._core
        names = [robot for robot in names if robot not in self._lost]
        if not names:
            return []
        if self._when_lost == END:
            raise RunCannotContinue(f"{message} at tick {core.state.tick}")
        if {*core.lost, *names} == {*core.arena.ids}:
            raise RunCannotContinue(f"{message} at tick {core.state.tick}, and no robot is left")
        outgoing = []
        for robot in names:
            self._lost.add(robot)
            outgoing += core.leave(robot, why)
        return outgoing
