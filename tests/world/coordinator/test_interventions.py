"""Interventions: a run that is changed while it goes on is the run that had it all written.

The oracle is a run whose scenario has the same events: every state, observation, packet and fate
must be the same bytes.
"""

from dataclasses import replace

import pytest
from helpers_interventions import drawn_plan, given, hunted_with, rounds
from helpers_scenarios import scenario_of
from helpers_world import RUN, answers, arena, begun, small
from hypothesis import given as drawn
from hypothesis import settings
from hypothesis import strategies as st

from encircle.protocol.codec import decode
from encircle.protocol.messages import Intervention
from encircle.world.coordinator.world_core import WorldCore
from encircle.world.loading import interventions
from encircle.world.loading.interventions import InterventionRefused, as_played
from encircle.world.loading.load import load

LIVELY = [
    "target.behaviour=flee",
    "ticks_max=40",
    "channel.loss={model='burst', rate=0.3, burst_packets=4}",
]


@settings(deadline=None, derandomize=True, max_examples=25)
@drawn(st.integers(0, 10**6))
def test_a_run_with_interventions_has_the_rounds_of_the_scenario_that_has_them_written(seed):
    scenario = scenario_of(seed)
    plan = drawn_plan(seed, scenario.ids, scenario.ticks_max)
    result, messages = hunted_with(scenario, plan)
    events = [decode(Intervention, payload, RUN).event for _, _, payload in given(messages)]
    tree = scenario.model_dump(mode="json", exclude_unset=True)
    written = load({**tree, "events": [*tree.get("events", []), *events]})
    expected, without = hunted_with(written, {})
    assert rounds(messages) == without
    assert list(result.interventions) == [plain(event) for event in events]
    header = (result.digest == expected.digest) == (events == [])
    assert header
    assert replace(expected, digest=result.digest, interventions=result.interventions) == result


def plain(value):
    """As it was before it went over the wire: lists, not tuples."""
    if isinstance(value, dict):
        return {name: plain(part) for name, part in value.items()}
    return [plain(part) for part in value] if isinstance(value, tuple | list) else value


def test_one_without_a_tick_is_of_the_next_and_the_target_stands_there_then():
    core = begun(WorldCore(arena("ticks_max=12"), RUN))
    for _ in range(3):
        for message in answers(core):
            core.receive(*message)
    assert core.state.tick == 3
    event = core.intervene({"kind": "move-target", "position": [1.0, 1.5]})
    assert event.tick == 4
    assert core.state.positions[4].tolist() == [0.0, 0.0]
    for message in answers(core):
        core.receive(*message)
    assert core.state.positions[4].tolist() == [1.0, 1.5]


@pytest.mark.parametrize(
    ("event", "line"),
    [
        ({"kind": "loss", "rate": 1.5}, "intervention.rate = 1.5: must be at most 1"),
        ({"kind": "loss", "rate": float("nan")}, "intervention.rate = nan: must be "),
        (
            {"kind": "loss", "reate": 0.5},
            "intervention.reate = 0.5: unknown key (did you mean 'rate'?)",
        ),
        ({"kind": "lose"}, "intervention.kind = 'lose': must be one of "),
        ({}, "intervention = {'tick': 1}: must have kind"),
        (
            {"kind": "silence", "robot": "r9"},
            "intervention.robot = 'r9': robots are r1, r2, r3, r4",
        ),
        (
            {"kind": "silence"},
            "intervention.robot: is missing; it must be given for kind 'silence'",
        ),
        (
            {"kind": "partition", "groups": [["r1", "r2"]]},
            "intervention.groups = (('r1', 'r2'),): must be two groups or more",
        ),
        ({"kind": "range", "range_m": 0}, "intervention.range_m = 0: must be above 0"),
        (
            {"kind": "silence", "robot": "r1", "ticks": 10**9},
            "intervention.ticks = 1000000000: must be below 1000000000",
        ),
        (
            {"kind": "move-target", "tick": 2**64, "position": [0.0, 0.0]},
            "intervention.tick = 18446744073709551616: must be below 1000000000",
        ),
        ({"kind": "delay", "delay_s": -1}, "intervention.delay_s = -1: must be at least 0"),
        ({"kind": "heal", "tick": 0}, "intervention.tick = 0: has begun; the next one is tick 1"),
        (
            {"kind": "crash", "robot": "r3"},
            "intervention.tick = 1: r3 is away already, for ever, by ",
        ),
        ([1, 2], "intervention = [1, 2]: must be a table with a kind"),
        ({1: 2}, "intervention = {1: 2}: must be a table with a kind"),
        ("loss", "intervention = 'loss': must be a table with a kind"),
        (
            {"kind": "loss", "a": 1, "b": 2, "c": 3, "d": 4, "e": 5},
            "intervention.a = 1: unknown key; intervention.b = 2: unknown key;"
            " intervention.c = 3: unknown key; and 2 more",
        ),
    ],
)
def test_what_makes_no_sense_is_refused_with_one_line_and_changes_nothing(event, line):
    messages = []
    core = begun(
        WorldCore(
            arena("events=[{kind='crash', robot='r3', tick=0}]"),
            RUN,
            record=lambda *message: messages.append(message),
        )
    )
    core.rounds.commit()
    before = (core.arena, core.rounds.journal.digest, list(messages))
    with pytest.raises(InterventionRefused) as refused:
        core.intervene(event)
    assert str(refused.value).startswith(line)
    assert "\n" not in str(refused.value)
    core.rounds.commit()
    assert (core.arena, core.rounds.journal.digest, messages) == before
    assert core.rounds.interventions == []


def test_one_for_as_long_as_a_message_can_say_is_recorded_and_read_back():
    event = {"kind": "silence", "tick": 1, "ticks": 10**9 - 1, "robot": "r1"}
    _, messages = hunted_with(small("ticks_max=3"), {0: [event]})
    ((_, _, payload),) = given(messages)
    assert decode(Intervention, payload, RUN).event == event
    assert as_played(small("ticks_max=3"), payload, RUN).events[0].ticks == 10**9 - 1


def test_before_the_run_and_after_it_and_beyond_the_most_there_are_none(monkeypatch):
    core = WorldCore(arena("ticks_max=3"), RUN)
    with pytest.raises(InterventionRefused, match="the run has not begun"):
        core.intervene({"kind": "heal"})
    begun(core)
    monkeypatch.setattr("encircle.world.coordinator.round_engine.INTERVENTIONS_MAX", 2)
    assert interventions.INTERVENTIONS_MAX == 1000
    for _ in range(2):
        core.intervene({"kind": "heal"})
    with pytest.raises(InterventionRefused, match="has had 2 of them"):
        core.intervene({"kind": "heal"})
    while core.ended is None:
        for message in answers(core):
            core.receive(*message)
    with pytest.raises(InterventionRefused, match="the run is over"):
        core.intervene({"kind": "heal"})


def test_the_scenario_as_played_is_the_written_one_with_what_was_recorded():
    plan = drawn_plan(3, small().ids, 40, count=20)
    _, messages = hunted_with(small(*LIVELY), plan)
    played = small(*LIVELY)
    for _, _, payload in given(messages):
        played = as_played(played, payload, RUN)
    assert len(played.events) == len(given(messages)) > 10
    events = [event.model_dump(mode="json", exclude_defaults=True) for event in played.events]
    assert load({**small(*LIVELY).model_dump(mode="json"), "events": events}) == load(
        played.model_dump(mode="json")
    )


def test_viewers_get_what_was_given_whether_or_not_they_get_states():
    core = begun(WorldCore(arena(), RUN))
    core.intervene({"kind": "loss", "rate": 0.5})
    ((key, payload),) = core.rounds.commit()
    assert key == f"encircle/{RUN}/world/intervention"
    expected = Intervention(0, {"kind": "loss", "tick": 1, "rate": 0.5})
    assert decode(Intervention, payload, RUN) == expected
