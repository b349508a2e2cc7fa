"""The control of a run by its page: who may, what becomes of it, and what is in force."""

import json

import pytest
from helpers_interventions import hunted_with
from helpers_world import RUN

from encircle.runner.interventions import Interventions
from encircle.viewer.control import NOT_ALLOWED, NOT_UNDERSTOOD, OVER, Control
from encircle.viewer.hunt_show import HuntShow
from encircle.viewer.showing import ShowOptions, WatchEnd
from encircle.world.loading.load import load

LOSS = {"kind": "loss", "rate": 0.6}


def control_of(*changes):
    queue, told = Interventions(), []
    control = Control(load("sim1", changes), queue)
    control.tell = told.append
    return control, queue, told


def refused(answer):
    return answer["control"]["refused"]


@pytest.mark.parametrize("said", [{"intervene": LOSS}, {"radio": True}, {"else": 1}, {}])
def test_a_page_without_the_token_is_refused_and_gives_nothing(said):
    control, queue, _ = control_of()
    assert refused(control.on_message(False, said)) == NOT_ALLOWED
    assert queue.take() == []


def test_an_event_of_a_page_with_the_token_goes_to_the_run():
    control, queue, told = control_of()
    assert control.on_message(True, {"intervene": LOSS}) is None
    assert [json.loads(line) for line in queue.take()] == [LOSS]
    taken = {"given": 7, "event": LOSS | {"tick": 8}}
    control.on_report({"intervention": taken})
    control.on_report({"refused_intervention": "intervention.rate = 2: must be at most 1.0"})
    assert told[0] == {"control": {"taken": taken}}
    assert refused(told[1]) == "intervention.rate = 2: must be at most 1.0"
    control.end()
    assert refused(control.on_message(True, {"intervene": LOSS})) == OVER
    assert queue.take() == []
    assert "radio" in control.on_message(True, {"radio": True})["control"]


def test_what_the_run_has_not_taken_when_it_ends_is_refused():
    control, queue, told = control_of()
    for _ in range(2):
        assert control.on_message(True, {"intervene": LOSS}) is None
    control.end()
    assert [refused(answer) for answer in told] == [OVER, OVER]
    assert queue.take() == []


@pytest.mark.parametrize("said", [{}, {"resume": None}, {"interfere": LOSS}])
def test_what_is_not_understood_is_refused(said):
    control, queue, _ = control_of()
    assert refused(control.on_message(True, said)) == NOT_UNDERSTOOD
    assert queue.take() == []


def test_what_cannot_be_an_event_at_all_is_refused_at_once():
    control, queue, _ = control_of()
    assert "as JSON" in refused(control.on_message(True, {"intervene": "x" * 20_000}))
    assert queue.take() == []


@pytest.mark.parametrize(
    ("changes", "own"),
    [
        ([], (0.0, 0.0, None)),
        (["channel.loss={model='bernoulli', rate=0.3}"], (0.3, 0.0, None)),
        (["channel.delay.mean_s=0.4"], (0.0, 0.4, None)),
        (["channel.loss={model='range', cutoff_m=9}"], (None, 0.0, 9.0)),
        (["channel.loss={model='burst', rate=0.3, burst_packets=5}"], (None, 0.0, None)),
        (["channel.delay={model='gamma', mean_s=0.3, std_s=0.2}"], (0.0, None, None)),
    ],
)
def test_the_scenarios_own_numbers_are_shown_where_it_has_some(changes, own):
    control, _, _ = control_of(*changes)
    radio = control.on_message(True, {"radio": True})["control"]["radio"]
    assert tuple(radio["own"].values()) == own
    assert set(radio["now"].values()) == {None}
    assert radio["tick_s"] == 0.1


def test_what_is_in_force_follows_written_events_and_those_given():
    control, _, _ = control_of("events=[{kind='delay', tick=20, ticks=5, delay_s=0.5}]")
    assert control.radio()["now"] == {"rate": None, "delay_s": None, "range_m": None}
    control.on_report({"tick": 19, "distances_m": []})
    assert control.radio()["now"]["delay_s"] == 0.5
    control.on_report({"intervention": {"given": 20, "event": LOSS | {"tick": 21}}})
    assert control.radio()["now"] == {"rate": 0.6, "delay_s": 0.5, "range_m": None}
    control.on_report({"intervention": {"given": 30, "event": {"kind": "loss", "tick": 31}}})
    assert control.radio()["now"] == {"rate": None, "delay_s": None, "range_m": None}


def test_the_page_of_a_run_that_is_gone_on_with_knows_what_was_given_before():
    scenario = load("sim1", ["ticks_max=9"])
    events = [{"kind": "range", "range_m": 9.0, "tick": 1}, {"kind": "loss", "rate": 0.2}]
    _, messages = hunted_with(scenario, {0: events})
    show = HuntShow(ShowOptions(browser=False, end=WatchEnd.RUN), True, Interventions())
    try:
        show.begin(scenario, RUN, messages)
        answer = show._control.on_message(True, {"radio": True})
    finally:
        show.end()
        show.stop()
    assert answer["control"]["radio"]["now"] == {"rate": 0.2, "delay_s": None, "range_m": 9.0}
