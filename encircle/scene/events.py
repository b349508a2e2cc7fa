"""What happens at a tick, in short sentences: by the scenario, and from frame to frame."""

from collections.abc import Mapping, Sequence
from math import hypot

from encircle.protocol.endings import EndReason
from encircle.protocol.messages import State
from encircle.scene.frame import Event
from encircle.world.loading.interventions import INTERVENTIONS_MAX
from encircle.world.scenario.channel_events import (
    Change,
    Cut,
    DelayChange,
    Heal,
    LossChange,
    RangeChange,
    cut_spans,
    last_and_one,
)
from encircle.world.scenario.channel_model import Outage, Partition, Silence
from encircle.world.scenario.model import Event as ScenarioEvent
from encircle.world.scenario.model import MoveTarget, Scenario

BY_HAND = "by hand: "
UNSURE = "unsure"
"""Kind of the event that says why it is not known any more what a robot believes."""
Pairs = tuple[tuple[str, str], ...]


class Schedule:
    """What a scenario lets happen, and whose radio is off.

    Events may be added while the run goes on: what they begin is told as done by hand.

    That a robot crashes is not in it: it shows in who is asked.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._robots = scenario.ids
        self._events = list(scenario.events)
        self._spans = cut_spans(self._events)
        self._written = len(self._events)
        self._known = list(self._events)

    def add(self, event: ScenarioEvent) -> None:
        """One event more, the last in order.

        A viewer that comes late has been told the scenario with all that was given before, and may
        hear of the newest of that again.
        """
        if event in self._known:
            self._known.remove(event)
        elif len(self._events) - self._written < INTERVENTIONS_MAX:
            self._events.append(event)
            self._spans = cut_spans(self._events)

    def silent(self, tick: int) -> set[int]:
        """Indices of the robots whose radio is off at a tick."""
        return {
            self._robots.index(span.cut.robot)
            for span in self._spans
            if isinstance(span.cut, Silence) and span.first <= tick < span.after
        }

    def at(self, tick: int) -> list[Event]:
        """What begins or ends at a tick, in the scenario's order."""
        begun = [
            self._begun(event, BY_HAND if k >= self._written else "")
            for k, event in enumerate(self._events)
            if event.tick == tick
        ]
        ended = [self._ended(span.cut, tick) for span in self._spans if span.after == tick]
        ended += [
            self._changed_back(event, tick)
            for event in self._events
            if isinstance(event, Change) and last_and_one(event) == tick
        ]
        return [event for event in dict.fromkeys((*ended, *begun)) if event is not None]

    def _ended(self, cut: Cut, tick: int) -> Event | None:
        """That a cut is over, if no other one goes on that comes to the same."""
        others = [span.cut for span in self._spans if span.first <= tick < span.after]
        if any(_cuts(other) == _cuts(cut) for other in others):
            return None
        match cut:
            case Silence():
                return Event("silence", f"{cut.robot}'s radio is on again", (cut.robot,))
            case Outage():
                return Event("outage", f"no outage from {_ends(cut)} any more", _named(cut))
        is_cut = any(isinstance(other, Partition) for other in others)
        text = f"no longer cut: {_groups(cut)}" if is_cut else "the team is whole again"
        return Event("partition", text, _members(cut))

    def _changed_back(self, event: Change, tick: int) -> Event | None:
        """What a change gives way to as it ends, if it was in force up to then."""
        now = self._in_force(event.kind, tick)
        if self._in_force(event.kind, tick - 1) is not event or (now and now.tick == tick):
            return None
        text = f"{event.kind} as the scenario has it" if now is None else _change(now)
        return Event(event.kind, f"{text} again", ())

    def _in_force(self, kind: str, tick: int) -> Change | None:
        """The change of a kind that counts at a tick: the one that began last."""
        going_on = [
            event
            for event in self._events
            if isinstance(event, Change)
            and event.kind == kind
            and event.tick <= tick < last_and_one(event)
        ]
        return sorted(going_on, key=lambda event: event.tick)[-1] if going_on else None

    def _begun(self, event: ScenarioEvent, by: str) -> Event | None:
        robots: tuple[str, ...] = ()
        match event:
            case MoveTarget():
                x, y = event.position
                text = f"the target is moved towards ({x:g}, {y:g}) m"
            case Silence():
                text, robots = f"{event.robot}'s radio is off", (event.robot,)
            case Outage():
                text, robots = f"outage from {_ends(event)}", _named(event)
            case Partition():
                text, robots = f"the team is cut: {_groups(event)}", _members(event)
            case Heal():
                text = "silences, outages and partitions are over"
            case LossChange() | DelayChange() | RangeChange():
                text = _change(event)
            case _:
                return None
        return Event("moved" if isinstance(event, MoveTarget) else event.kind, by + text, robots)


def _cuts(cut: Cut) -> dict[str, object]:
    """What a cut cuts, whenever that is."""
    return cut.model_dump(exclude={"tick", "ticks"})


def _change(event: Change) -> str:
    match event:
        case LossChange(rate=float(rate)):
            return f"every link loses {100.0 * rate:.3g} % of packets"
        case DelayChange(delay_s=float(delay_s)):
            return f"every packet takes {1e3 * delay_s:.4g} ms"
        case RangeChange(range_m=float(range_m)):
            return f"radios reach {range_m:g} m"
    return f"{event.kind} as the scenario has it"


def _ends(outage: Outage) -> str:
    return f"{outage.sender or 'any robot'} to {outage.receiver or 'any robot'}"


def _named(outage: Outage) -> tuple[str, ...]:
    return tuple([end for end in (outage.sender, outage.receiver) if end])


def _groups(partition: Partition) -> str:
    return " | ".join(", ".join(group) for group in partition.groups)


def _members(partition: Partition) -> tuple[str, ...]:
    return tuple([robot for group in partition.groups for robot in group])


def lost_and_back(
    robots: Sequence[str], before: Sequence[bool], now: Sequence[bool]
) -> list[Event]:
    """Who is lost since the tick before, and who is back."""
    events = []
    for robot, was, is_lost in zip(robots, before, now, strict=True):
        if is_lost and not was:
            events.append(Event("lost", f"{robot} is lost", (robot,)))
        elif was and not is_lost:
            events.append(Event("back", f"{robot} is back", (robot,)))
    return events


def new_contacts(robots: Sequence[str], before: Pairs, now: Pairs) -> list[Event]:
    """Which bodies touch that did not at the tick before."""
    return [
        Event("contact", f"{one} and {other} touch", tuple(n for n in (one, other) if n in robots))
        for one, other in now
        if (one, other) not in before
    ]


def new_doubts(before: Mapping[str, str], now: Mapping[str, str]) -> list[Event]:
    """Of which robots it is not known any more what they believe, and why."""
    return [
        Event(UNSURE, f"what {robot} believes is not known: {why}", (robot,))
        for robot, why in now.items()
        if robot not in before
    ]


def ending(
    state: State, robots: Sequence[str], there: Sequence[bool], reason: str | None, reach_m: float
) -> list[Event]:
    """How the run ends at a tick: a capture, and by whom; else the reason, None if not known."""
    if state.captured:
        x, y = state.target
        captors = tuple(
            robot
            for robot, place, is_there in zip(robots, state.robots, there, strict=True)
            if is_there and hypot(place[0] - x, place[1] - y) <= reach_m
        )
        return [Event("capture", f"captured by {', '.join(captors)}", captors)]
    if reason is None:
        return [Event("cut-off", "nothing more is known of this run", ())]
    text = "the time is up" if reason == EndReason.TICKS else reason
    return [Event("end", text, ())]
