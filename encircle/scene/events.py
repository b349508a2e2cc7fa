"""What happens at a tick, in short sentences: by the scenario, and from frame to frame."""

from collections.abc import Mapping, Sequence
from math import hypot

from encircle.protocol.endings import EndReason
from encircle.protocol.messages import State
from encircle.scene.frame import Event
from encircle.world.scenario.channel_model import Outage, Partition, Silence
from encircle.world.scenario.model import MoveTarget, Scenario

Pairs = tuple[tuple[str, str], ...]


def scheduled_events(scenario: Scenario) -> dict[int, list[Event]]:
    """What the scenario lets happen, by tick; that a robot crashes shows in who is asked."""
    events: dict[int, list[Event]] = {}
    for event in scenario.events:
        match event:
            case MoveTarget():
                x, y = event.position
                text = f"the target is moved by hand towards ({x:g}, {y:g}) m"
                _add(events, event.tick, "moved", text)
            case Silence():
                robot = event.robot
                text = f"{robot}'s radio is off for {event.ticks} ticks"
                _add(events, event.tick, "silence", text, robot)
                text = f"{robot}'s radio is on again"
                _add(events, event.tick + event.ticks, "silence", text, robot)
            case Outage():
                ends = f"{event.sender or 'any robot'} to {event.receiver or 'any robot'}"
                robots = [robot for robot in (event.sender, event.receiver) if robot]
                text = f"outage from {ends} for {event.ticks} ticks"
                _add(events, event.tick, "outage", text, *robots)
                _add(events, event.tick + event.ticks, "outage", f"no outage from {ends}", *robots)
            case Partition():
                groups = " | ".join(", ".join(group) for group in event.groups)
                robots = [robot for group in event.groups for robot in group]
                text = f"the team is cut for {event.ticks} ticks: {groups}"
                _add(events, event.tick, "partition", text, *robots)
                text = "the team is whole again"
                _add(events, event.tick + event.ticks, "partition", text, *robots)
    return events


def _add(events: dict[int, list[Event]], tick: int, kind: str, text: str, *robots: str) -> None:
    events.setdefault(tick, []).append(Event(kind, text, robots))


def silences(scenario: Scenario) -> list[tuple[int, int, int]]:
    """When whose radio is off: index of the robot, first tick, and the tick after the last."""
    return [
        (scenario.ids.index(event.robot), event.tick, event.tick + event.ticks)
        for event in scenario.events
        if isinstance(event, Silence)
    ]


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
        Event("unsure", f"what {robot} believes is not known: {why}", (robot,))
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
