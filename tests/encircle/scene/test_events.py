"""What is told of the radio, put together tick by tick, is what the radio does."""

import random

import pytest

from encircle.scene.events import Schedule
from encircle.world.channel.changes import in_force
from encircle.world.loading.load import load
from encircle.world.scenario.channel_events import Heal
from encircle.world.scenario.channel_model import Partition, Silence

TICKS = 40
VALUES = {"loss": ("rate", 0.01), "delay": ("delay_s", 1e-3), "range": ("range_m", 1.0)}
WORDS = {"loss": "every link loses", "delay": "every packet takes", "range": "radios reach"}
SILENCES, PARTITIONS = "silence", "partition"


def drawn(seed):
    """A scenario in which events of one kind overlap, end together and follow each other."""
    draws = random.Random(seed)
    sides = [[["r1", "r2"], ["r3", "r4"]], [["r1"], ["r2", "r3", "r4"]]]
    events = []
    for _ in range(draws.randint(2, 14)):
        kind = draws.choice([*VALUES, *[SILENCES, PARTITIONS] * 2, "heal"])
        event = {"kind": kind, "tick": draws.randint(1, 25)}
        if kind != "heal" and draws.random() < 0.8:
            event["ticks"] = draws.randint(1, 12)
        if kind in VALUES and draws.random() < 0.8:
            key, unit = VALUES[kind]
            event[key] = unit * draws.randint(1, 90)
        if kind == SILENCES:
            event["robot"] = draws.choice(["r1", "r2"])
        if kind == PARTITIONS:
            event["groups"] = draws.choice(sides)
        events.append(event)
    tree = load("sim1", [f"ticks_max={TICKS}"]).model_dump(mode="json", exclude_unset=True)
    return load(tree | {"events": events})


def number_told(kind, text):
    """The number in a sentence on a change, None for the scenario's own."""
    if text.startswith(f"{kind} as the scenario has it"):
        return None
    assert text.startswith(WORDS[kind]), text
    return VALUES[kind][1] * next(float(word) for word in text.split() if word[0].isdigit())


def is_going_on(event, place, events, tick):
    """Whether a cut is in force, by the words of the events: no heal since, nor past its end."""
    if not event.tick <= tick or (event.ticks is not None and tick >= event.tick + event.ticks):
        return False
    return not any(
        isinstance(heal, Heal) and (event.tick, place) < (heal.tick, k) and heal.tick <= tick
        for k, heal in enumerate(events)
    )


@pytest.mark.parametrize("seed", range(100))
def test_what_is_told_is_what_is_in_force(seed):
    scenario = drawn(seed)
    schedule, events = Schedule(scenario), scenario.events
    numbers, silent, is_cut = dict.fromkeys(VALUES), set(), False
    for tick in range(TICKS):
        told = schedule.at(tick)
        assert len(set(told)) == len(told)
        for kind, text, robots in told:
            if kind in VALUES:
                numbers[kind] = number_told(kind, text)
            elif kind == SILENCES:
                (silent.add if text.endswith("off") else silent.discard)(*robots)
            elif kind == PARTITIONS:
                is_cut = text != "the team is whole again"
            elif kind == "heal":
                silent, is_cut = set(), False
        going_on = [
            event
            for place, event in enumerate(events)
            if isinstance(event, Silence | Partition) and is_going_on(event, place, events, tick)
        ]
        assert list(numbers.values()) == [
            None if value is None else pytest.approx(value, rel=1e-2)
            for value in in_force(events, tick)
        ], (tick, events)
        assert silent == {e.robot for e in going_on if isinstance(e, Silence)}, (tick, events)
        assert is_cut == any(isinstance(e, Partition) for e in going_on), (tick, events)


def test_what_a_change_gives_way_to_is_told_and_nothing_if_it_was_not_in_force():
    events = (
        "events=[{kind='loss', tick=2, rate=0.9}, {kind='loss', tick=4, ticks=4, rate=0.5},"
        " {kind='delay', tick=2, ticks=9, delay_s=0.5}, {kind='delay', tick=3, delay_s=0.2}]"
    )
    schedule = Schedule(load("sim1", [events]))
    assert [event.text for event in schedule.at(8)] == ["every link loses 90 % of packets again"]
    assert schedule.at(11) == []
