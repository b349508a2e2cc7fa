"""Where packets are between two ticks, and how many of each fate there have been.

The channel decides a packet's fate when it is sent, and nothing travels in between; the picture
lets it fly. A packet due at tick d leaves its sender at the tick t at which it was sent and is at
its receiver, wherever that is by then, at d. A lost one flies as fast as one that is on time, as
far as its cause lets it (``encircle.scene.palette``), and leaves a cross that fades.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from encircle.scene.frame import Frame
from encircle.scene.palette import ARRIVED, LATE, LOST, UNKNOWN_LOSS, PacketStyle

SPREAD = 0.2
"""Over what share of the way the crosses of one link lie, so that they do not hide each other."""
SPREAD_STEPS = 5
ON_TIME, TOO_LATE, UNKNOWN = "on time", "late", "lost"
"""Fates that are no causes of loss; the last is a loss whose cause has no name."""

Place = tuple[float, float]


class Sent(NamedTuple):
    """A packet as it was sent: its tick, the robots' indices, when it is due, and its fate."""

    tick: int
    sender: int
    receiver: int
    due: int
    fate: str


class Flight(NamedTuple):
    """A packet, or its cross, at a moment. ``start``, ``goal``: ends of its way, in m.

    ``share``: how far it is on its way. ``fading``: from 0 when it is lost to 1 when its cross is
    gone; below 0 before.
    """

    style: PacketStyle
    sender: int
    receiver: int
    start: Place
    goal: Place
    share: float
    fading: float


class Flights:
    """All packets of a run.

    ``causes``: their names, by code. ``lingering_ticks``: how long crosses stay. Frames follow each
    other tick by tick.
    """

    def __init__(
        self, frames: Sequence[Frame], causes: Sequence[str], lingering_ticks: float
    ) -> None:
        self._frames, self._lingering_ticks = frames, lingering_ticks
        self._first = frames[0].tick
        self._seen: list[list[Sent]] = [[] for _ in frames]
        decided: list[Counter[str]] = [Counter() for _ in frames]
        for sent in _all_sent(frames, causes):
            since = sent.tick - self._first
            until = sent.due if sent.due > 0 else sent.tick + 1 + reach_of(sent) + lingering_ticks
            for row in range(since, min(int(until) - self._first + 1, len(frames))):
                self._seen[row].append(sent)
            end = max(sent.due, sent.tick + 1) - self._first
            if end < len(frames):
                decided[end][sent.fate] += 1
        self._counts = list(_running(decided))

    def counts(self, tick: int) -> Counter[str]:
        """How many packets of each fate there have been up to a tick."""
        return self._counts[min(tick - self._first, len(self._counts) - 1)]

    def at(self, moment_ticks: float, robots: Sequence[Place]) -> list[Flight]:
        """What flies at a moment, and the crosses that are still there, oldest first.

        ``moment_ticks``: tick and the share of one that has passed. ``robots``: where they are
        then, in m.
        """
        row = min(int(moment_ticks) - self._first, len(self._seen) - 1)
        flights = (self._flight(sent, moment_ticks, robots) for sent in self._seen[row])
        return [flight for flight in flights if flight is not None]

    def _flight(self, sent: Sent, moment_ticks: float, robots: Sequence[Place]) -> Flight | None:
        style, passed_ticks = style_of(sent.fate), moment_ticks - sent.tick
        then = self._frames[sent.tick - self._first].robots
        start, ends = then[sent.sender], (sent.sender, sent.receiver)
        if sent.due > 0:
            share = passed_ticks / (sent.due - sent.tick)
            return (
                Flight(style, *ends, start, robots[sent.receiver], share, -1.0)
                if share < 1
                else None
            )
        reach = reach_of(sent)
        fading = (passed_ticks - reach) / self._lingering_ticks
        if fading >= 1.0:
            return None
        share = min(passed_ticks, reach)
        return Flight(style, *ends, start, then[sent.receiver], share, fading)


def _all_sent(frames: Sequence[Frame], causes: Sequence[str]) -> Iterator[Sent]:
    """Every packet and every copy of one, in the order in which they were sent."""
    for frame in frames:
        for packet in frame.packets:
            for due in (packet.due, packet.copy_due):
                if due:
                    fate = _fate(frame.tick, due, causes)
                    yield Sent(frame.tick, packet.sender, packet.receiver, due, fate)


def _fate(tick: int, due: int, causes: Sequence[str]) -> str:
    if due > 0:
        return ON_TIME if due == tick + 1 else TOO_LATE
    return causes[-due] if -due < len(causes) else UNKNOWN


def style_of(fate: str) -> PacketStyle:
    """How packets of a fate look."""
    return {ON_TIME: ARRIVED, TOO_LATE: LATE}.get(fate) or LOST.get(fate, UNKNOWN_LOSS)


def reach_of(sent: Sent) -> float:
    """The share of its way that a lost packet makes; it differs from tick to tick."""
    step = (sent.tick + sent.sender + 2 * sent.receiver) % SPREAD_STEPS
    return style_of(sent.fate).reach + SPREAD * (step / (SPREAD_STEPS - 1) - 0.5)


def _running(decided: Sequence[Counter[str]]) -> Iterator[Counter[str]]:
    total: Counter[str] = Counter()
    for counts in decided:
        total = total + counts
        yield total
