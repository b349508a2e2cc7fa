"""Messages of a running hunt, put into rounds as its recording has them. Sans I/O.

Who looks on hears each node by itself: a state may come after the answers to its tick, an
observation that was asked for again comes twice, and what there was no time for does not come at
all. Here each message is checked and kept once, and given on with its round, rounds in the order of
ticks. A round of which something does not come is given on without it once later rounds are there.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from encircle.protocol.codec import decode
from encircle.protocol.envelopes import INSIDE, opened
from encircle.protocol.errors import ProtocolError, WrongSender
from encircle.protocol.keys import channel_of, parse_key
from encircle.protocol.messages import Command, End, Intervention, Observation, Setup
from encircle.world.loading.interventions import INTERVENTIONS_MAX
from encircle.world.recording.schemas import KINDS

Message = tuple[int, str, bytes]
"""A message as recordings have it: tick, topic (the key without its run), payload."""

ROUNDS_WAITED_MAX = 32
"""How many later rounds may be there before one goes on that is not whole; in a run that goes as
fast as it can, messages of other lanes may be as many rounds behind."""
ROUNDS_WAITED_MIN = 2
"""The same where nothing more has come for some time."""
ROUNDS_PATIENT = 4
"""How many later rounds must be there before it is believed that a robot was lost in one."""
ROUNDS_KEPT_MAX = 128
PARTS = ("state", "setup", "observation", "intervention", "pose", "command", "radio", "end")
"""The order of channels within a round."""


class Round(NamedTuple):
    """What was heard of a tick. ``whole``: whether that is all that was said."""

    tick: int
    messages: tuple[Message, ...]
    whole: bool


@dataclass(slots=True)
class _Open:
    """A round that is being heard: payloads by channel and robot, and what they tell of it."""

    payloads: dict[tuple[str, str], bytes] = field(default_factory=dict)
    interventions: list[bytes] = field(default_factory=list)
    """Those given at this tick, in their order; they are sent once."""
    lost: frozenset[str] = frozenset()
    silent: set[str] = field(default_factory=set)
    """Those whose command says that no pose goes with it."""


class RoundCollector:
    """The rounds of one run. ``refused`` counts messages that are none of it.

    ``missed_ticks``: rounds that did not come whole since the first one that did; ``end``: the
    run's end, once it was told. ``by_clock``: whether ticks end without waiting for answers.
    """

    def __init__(self, run: str, robots: Sequence[str], ticks_max: int, by_clock: bool) -> None:
        self.refused = 0
        self.missed_ticks = 0
        self.end: End | None = None
        self._run = run
        self._robots = tuple(robots)
        self._ticks_max = ticks_max
        self._by_clock = by_clock
        self._open: dict[int, _Open] = {}
        self._lost_before: frozenset[str] = frozenset()
        self._next: int | None = None

    @property
    def first_to_come(self) -> int | None:
        """The tick of the next round, None before the first."""
        return self._next

    def take(self, key: str, payload: bytes) -> list[Round]:
        """Take in a message, or those of an envelope; returns the rounds that can go on, in order.

        Never raises.
        """
        channel = channel_of(key)
        if channel not in INSIDE:
            return self._take(key, payload)
        rounds: list[Round] = []
        try:
            for inner_key, inner in opened(channel, payload, self._run):
                rounds += self._take(inner_key, inner)
        except ProtocolError:
            self.refused += 1
        return rounds

    def _take(self, key: str, payload: bytes) -> list[Round]:
        try:
            channel, robot, message = self._read(key, payload)
        except ProtocolError:
            self.refused += 1
            return []
        tick = message.answer_tick if isinstance(message, Setup) else message.tick
        if tick > self._ticks_max or robot not in (*self._robots, "world"):
            self.refused += 1
            return []
        if isinstance(message, Setup) and message.first_tick < message.answer_tick:
            # Of a resumed run: a new process takes its robot's past in, and no robot begins anew.
            return []
        if isinstance(message, End):
            self.end = self.end or message
        if self._next is not None and tick < self._next:
            return []
        opened = self._open.setdefault(tick, _Open())
        if isinstance(message, Intervention):
            opened.interventions.append(payload)
            del opened.interventions[INTERVENTIONS_MAX:]
        elif opened.payloads.setdefault((channel, robot), payload) is payload:
            if isinstance(message, Observation):
                opened.lost |= frozenset(message.lost)
            elif isinstance(message, Command) and not message.published:
                opened.silent.add(robot)
        while len(self._open) > ROUNDS_KEPT_MAX:
            del self._open[min(self._open)]
        return self._passed_on()

    def give_up(self) -> list[Round]:
        """The rounds that go on without what has not come for some time."""
        return self._passed_on(ROUNDS_WAITED_MIN)

    def flush(self) -> list[Round]:
        """The rounds that are left, whole or not: nothing more will come."""
        return [self._close(tick) for tick in sorted(self._open) if self._is_shown(tick)]

    def _read(self, key: str, payload: bytes) -> tuple[str, str, Any]:
        parsed = parse_key(key)
        kind = KINDS.get(parsed.channel)
        if parsed.run != self._run or kind is None:
            raise WrongSender(f"key {key!r} is of no message of this run")
        message = decode(kind, payload, self._run)
        if parsed.robot is not None and message.robot != parsed.robot:
            raise WrongSender(f"key {key!r} has a message of {message.robot}")
        return parsed.channel, parsed.robot or "world", message

    def _passed_on(self, waited_max: int = ROUNDS_WAITED_MAX) -> list[Round]:
        rounds: list[Round] = []
        while self._open:
            tick = min(self._open)
            later = sum(1 for other in self._open if other > tick and self._is_shown(other))
            if self._is_whole(tick, later) and (self._next in (None, tick) or later >= waited_max):
                rounds.append(self._close(tick))
            elif later < waited_max:
                break
            elif self._next is None or not self._is_shown(tick):
                # From before this viewer was there, or nothing of it can be shown.
                del self._open[tick]
            else:
                rounds.append(self._close(tick))
        return rounds

    def _close(self, tick: int) -> Round:
        whole = self._is_whole(tick, ROUNDS_WAITED_MAX)
        if self._next is not None:
            self.missed_ticks += tick - self._next
        self.missed_ticks += not whole
        self._next = tick + 1
        closed = self._open.pop(tick)
        self._lost_before = closed.lost
        order = {robot: number for number, robot in enumerate(("world", *self._robots))}
        messages = [(key, payload) for key, payload in closed.payloads.items()]
        messages += [(("intervention", "world"), payload) for payload in closed.interventions]
        # Sorting keeps the order of interventions.
        messages.sort(key=lambda message: (PARTS.index(message[0][0]), order[message[0][1]]))
        return Round(
            tick,
            tuple([(tick, _topic(*key), payload) for key, payload in messages]),
            whole,
        )

    def _is_shown(self, tick: int) -> bool:
        return ("state", "world") in self._open[tick].payloads

    def _is_whole(self, tick: int, later: int) -> bool:
        """Whether all was heard; of a run by the clock, whose robots may not answer, in time."""
        opened = self._open[tick]
        if not self._is_shown(tick):
            return False
        if self.end is not None and tick >= self.end.tick:
            return True
        if ("radio", "world") not in opened.payloads:
            return False
        nobody_asked = not any(channel == "observation" for channel, _ in opened.payloads)
        if self._by_clock:
            return later > 0
        patient = later >= ROUNDS_PATIENT
        if nobody_asked:
            return patient
        back = self._lost_before if tick == self._next else frozenset()
        return all(
            self._is_answered(opened, robot, robot in back) or (patient and self._left(tick, robot))
            for robot in self._robots
            if robot not in opened.lost
        )

    def _is_answered(self, opened: _Open, robot: str, is_back: bool) -> bool:
        needed = ["observation", "command"]
        needed += [] if robot in opened.silent else ["pose"]
        needed += ["setup"] if is_back else []
        return all((channel, robot) in opened.payloads for channel in needed)

    def _left(self, tick: int, robot: str) -> bool:
        """Whether a robot was lost before it had answered, as the next round shows."""
        following = self._open.get(tick + 1)
        return following is not None and (
            robot in following.lost or ("setup", robot) in following.payloads
        )


def _topic(channel: str, robot: str) -> str:
    return f"world/{channel}" if robot == "world" else f"robots/{robot}/{channel}"
