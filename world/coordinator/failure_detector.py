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
LOOKS_GONE = 2
"""For so many looks at who owes an answer, what comes of one that is gone was still under way."""


class RunEnded(Exception):
    """The run cannot go on; the message says why."""


class Attendance:
    """The roll of one run. ``begun``: whether its rounds are under way.

    ``briefings``: for a run that is resumed, what each robot that is asked has to know before.
    """

    def __init__(
        self,
        core: WorldCore,
        when_lost: str = GO_ON,
        briefings: Mapping[str, Outgoing] | None = None,
    ) -> None:
        self.begun = False
        self._core = core
        self._when_lost = when_lost
        self._briefings = briefings
        self._present: set[str] = set()
        self._lost: set[str] = set()
        self._owed: dict[str, Outgoing] = {}
        self._just_gone: dict[str, int] = {}
        self._without_token: set[str] = set()

    @property
    def expected(self) -> tuple[str, ...]:
        """The robots, in robot order, that the run waits for at its beginning."""
        awaited = self._core.arena.ids if self._briefings is None else tuple(self._briefings)
        return tuple(robot for robot in awaited if robot not in self._present)

    @property
    def may_begin(self) -> bool:
        """Whether the run can begin without those that are expected: only one that had begun."""
        return self._briefings is not None and bool(self._present & self._briefings.keys())

    def came(self, robot: str) -> Outgoing:
        """A token is there: what to tell its robot. ``OutOfTurn`` if it is not of the team."""
        if robot not in self._core.arena.ids:
            raise OutOfTurn(f"robot {robot!r} is not in this team")
        known = robot in self._without_token - self._lost
        self._without_token.discard(robot)
        if known:
            return []
        self._present.add(robot)
        if self.begun or self._briefings is None:
            return self._taken_in(robot)
        own = robot_key(self._core.run, robot, "")
        asked = [said for said in self._core.unanswered() if said[0].startswith(own)]
        return [*self._briefings.get(robot, ()), *asked]

    def went(self, robot: str) -> Outgoing:
        """A token is gone: what to tell the others; raises ``RunEnded``."""
        if robot not in self._present or self._core.ended is not None:
            return []
        self._present.remove(robot)
        if self.begun:
            self._just_gone[robot] = LOOKS_GONE
            self._owed.setdefault(robot, self._core.asked_anew(robot))
            return self._lose((robot,), "it is gone", f"robot {robot} is gone")
        if self._when_lost == END:
            raise RunEnded(f"robot {robot} is gone before the run has begun")
        return self._core.leave(robot, "it is gone") if self._briefings is None else []

    def silent(self, tick: int, answer_s_max: float) -> Outgoing:
        """No answer has come at a tick for so long: what to tell others; raises ``RunEnded``."""
        if self._core.state.tick != tick:
            # It has come at last, and the next round has begun: nobody owes that for long.
            return []
        return self.owing(self._core.table.waiting(), answer_s_max)

    def owing(self, names: Sequence[str], answer_s_max: float) -> Outgoing:
        """As ``silent``, of these robots."""
        lasted = f"for {answer_s_max:g} s"
        said = f"no answer from {', '.join(names)} {lasted}"
        self._owed |= {robot: self._core.asked_anew(robot) for robot in names}
        return self._lose(names, f"{NO_ANSWER} {lasted}", said)

    def reminders(self) -> Outgoing:
        """What those that fell silent or are gone are asked anew."""
        self._just_gone = {r: looks - 1 for r, looks in self._just_gone.items() if looks > 1}
        due = (self._owed.keys() & self._lost) - self._just_gone.keys()
        return [said for robot in sorted(due) for said in self._owed[robot]]

    def begin(self) -> Outgoing:
        """The rounds begin, with whoever is there: what to send; raises ``RunEnded``."""
        self.begun = True
        core, absent = self._core, self.expected
        outgoing: Outgoing = []
        if self._briefings is None:
            # Whoever went in the last moment is lost in the first round, as in any other.
            for robot in absent:
                core.join(robot)
            outgoing = core.begin()
            said = f"robot {', '.join(absent)} is gone"
            return outgoing + self._lose(absent, "it is gone", said)
        why = "it did not come back"
        for robot in core.lost:
            if robot in self._present:
                outgoing += core.join(robot)
            elif self._when_lost != END:
                # Said of those too that the scenario has taken away: it is not to bring them back.
                self._lost.add(robot)
                core.leave(robot, why)
        return outgoing + self._lose(absent, why, f"{', '.join(absent)} did not come back")

    def heard(self, key: str, payload: bytes) -> Outgoing:
        """A message has come: if it is a lost robot's sign of life, what to tell that robot."""
        if not self._lost:
            return []
        try:
            of_run, robot, channel = parse_key(key)
            run = self._core.run
            if robot not in self._lost or channel not in ("pose", "command"):
                return []
            said = decode_pose(payload, run) if channel == "pose" else decode(Command, payload, run)
        except ProtocolError:
            return []
        if said.robot != robot or of_run != run or robot in self._just_gone:
            return []
        if robot not in self._present:
            self._present.add(robot)
            self._without_token.add(robot)
        return self._taken_in(robot)

    def _taken_in(self, robot: str) -> Outgoing:
        self._lost.discard(robot)
        self._owed.pop(robot, None)
        self._just_gone.pop(robot, None)
        return self._core.join(robot)

    def _lose(self, names: Sequence[str], why: str, said: str) -> Outgoing:
        core = self._core
        names = [robot for robot in names if robot not in self._lost]
        if not names:
            return []
        if self._when_lost == END:
            raise RunEnded(f"{said} at tick {core.state.tick}")
        if {*core.lost, *names} == {*core.arena.ids}:
            raise RunEnded(f"{said} at tick {core.state.tick}, and no robot is left")
        outgoing = []
        for robot in names:
            self._lost.add(robot)
            outgoing += core.leave(robot, why)
        return outgoing
