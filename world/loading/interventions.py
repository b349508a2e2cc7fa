"""Interventions: events that are given to a run while it goes on.

An intervention is an event as a scenario's file has it. It takes effect at the next tick, or at the
later one that it names, and the run goes on as if the scenario had had it from the start: that is
the *scenario as played*. Here is what is checked of one before it counts, and how the scenario as
played is put together; the world applies them (``encircle.world.coordinator.round_engine``).
"""

from collections.abc import Mapping, Sequence
from typing import Any

from pydantic import ValidationError

from encircle.protocol.codec import decode
from encircle.protocol.errors import MalformedMessage
from encircle.protocol.messages import Intervention
from encircle.protocol.wire.limits import NUMBER_MAX
from encircle.world.loading.channel_consistency import problems_of_events
from encircle.world.scenario.errors import ScenarioError
from encircle.world.scenario.fields import Model, shown
from encircle.world.scenario.model import Event, Scenario
from encircle.world.scenario.validation import problems_in

INTERVENTIONS_MAX = 1000
"""In one run: each is looked at in all that follow."""
LINE_BYTES_MAX = 16 * 1024
"""What one event may take as JSON."""
PROBLEMS_SHOWN_MAX = 3


class InterventionRefused(ScenarioError):
    """An intervention that cannot be; the message says in one line what and why."""


class _Given(Model):
    """A table around one event, by whose key problems are named."""

    intervention: Event


def event_of(given: Any, scenario: Scenario, tick: int) -> Event:
    """The event that is given to a run, which is at a tick of a scenario as played so far.

    Without a ``tick`` it is of the next one. ``InterventionRefused`` if it is no event, if it does
    not fit the scenario, or if its tick has begun.
    """
    if not isinstance(given, Mapping) or not all(isinstance(key, str) for key in given):
        raise InterventionRefused(f"intervention = {shown(given)}: must be a table with a kind")
    tree = {"intervention": {"tick": tick + 1, **given}}
    try:
        event = _Given.model_validate(tree).intervention
    except ValidationError as error:
        raise _refused(list(problems_in(error, _Given, tree).values())) from None
    if event.tick <= tick:
        raise _refused(
            [f"intervention.tick = {event.tick}: has begun; the next one is tick {tick + 1}"]
        )
    too_large = {
        name: value
        for name, value in table_of(event).items()
        if type(value) is int and value >= NUMBER_MAX
    }
    if too_large:
        # It could not be recorded, and so not be replayed.
        raise _refused(
            [
                f"intervention.{name} = {shown(value)}: must be below {NUMBER_MAX:.0f}"
                for name, value in too_large.items()
            ]
        )
    place = len(scenario.events)
    problems = problems_of_events([*scenario.events, event], scenario.ids, since=place)
    if problems:
        raise _refused([line.replace(f"events.{place}", "intervention") for line in problems])
    return event


def table_of(event: Event) -> dict[str, Any]:
    """An event as a scenario's file has it, without what it leaves at its default."""
    table: dict[str, Any] = event.model_dump(mode="json", exclude_defaults=True)
    return table


def recorded_event(payload: bytes, run: str, robots: Sequence[str]) -> Event:
    """The event in the payload of an Intervention; ``ProtocolError`` if it holds none of a team."""
    tree = {"intervention": decode(Intervention, payload, run).event}
    try:
        event = _Given.model_validate(tree).intervention
    except ValidationError as error:
        problems = list(problems_in(error, _Given, tree).values())
    else:
        named = problems_of_events([event], robots)
        problems = [line.replace("events.0", "intervention") for line in named]
        if not problems:
            return event
    raise MalformedMessage(f"Intervention: {_refused(problems)}")


def as_played(scenario: Scenario, payload: bytes, run: str) -> Scenario:
    """The scenario as played, with one recorded intervention more: the payload of its message.

    ``ProtocolError`` as ``recorded_event``.
    """
    return scenario.with_event(recorded_event(payload, run, scenario.ids))


def _refused(problems: list[str]) -> InterventionRefused:
    more = len(problems) - PROBLEMS_SHOWN_MAX
    listed = [*problems[:PROBLEMS_SHOWN_MAX], *([f"and {more} more"] if more > 0 else [])]
    return InterventionRefused("; ".join(listed))
