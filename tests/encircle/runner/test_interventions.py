"""The queue of interventions of one run, and hunts in memory that take from it."""

import threading

import pytest

import encircle
from encircle import InterventionRefused, Interventions
from encircle.world.loading.interventions import INTERVENTIONS_MAX

HEAL = {"kind": "heal"}


def test_events_of_many_threads_are_taken_once_each():
    queue, taken = Interventions(), []
    givers = [
        threading.Thread(target=lambda k=k: [queue.give({"kind": k, "n": n}) for n in range(100)])
        for k in range(5)
    ]
    for giver in givers:
        giver.start()
    while any(giver.is_alive() for giver in givers):
        taken += queue.take()
    taken += queue.take()
    assert len(taken) == len(set(taken)) == 500
    assert queue.take() == []


@pytest.mark.parametrize(
    ("event", "reason"),
    [
        ({"rate": float("nan")}, "cannot be written as JSON"),
        ({"rate": object()}, "cannot be written as JSON"),
        ({"text": "x" * 17_000}, "must have at most 16384"),
    ],
)
def test_what_is_no_json_or_too_long_is_refused_at_once(event, reason):
    queue = Interventions()
    with pytest.raises(InterventionRefused, match=reason):
        queue.give(event)
    assert queue.take() == []


def test_no_more_than_the_most_wait():
    queue = Interventions()
    for _ in range(INTERVENTIONS_MAX):
        queue.give(HEAL)
    with pytest.raises(InterventionRefused, match="1000 are waiting"):
        queue.give(HEAL)
    queue.take()
    queue.give(HEAL)


def test_whoever_waits_is_woken_by_each_and_no_longer_when_it_has_gone():
    queue, woken = Interventions(), []
    queue.on_given(lambda: woken.append(1))
    queue.give(HEAL)
    queue.give(HEAL)
    queue.on_given(None)
    queue.give(HEAL)
    assert len(woken) == 2


def test_progress_is_told_what_became_of_each_and_a_refused_one_changes_nothing():
    reports, queue = [], Interventions()
    queue.give({"kind": "loss", "rate": 0.5, "tick": 30})
    queue.give({"kind": "silence", "robot": "r7"})
    hunt = encircle.run("sim1", link="memory", interventions=queue, progress=reports.append)
    told = [r for r in reports if "intervention" in r or "refused_intervention" in r]
    loss = {"kind": "loss", "tick": 30, "rate": 0.5}
    assert told == [
        {"intervention": {"given": 0, "event": loss}},
        {
            "refused_intervention": "intervention.robot = 'r7': robots are r1, r2, r3, r4",
        },
    ]
    assert hunt.result.interventions == (loss,)
    assert hunt.result.packets_lost["loss"] > 0
    # Twelve links of four robots, in the ticks before the loss and in all others.
    assert hunt.result.packets_sent == 12 * hunt.result.ticks


def test_a_run_that_may_be_changed_and_is_not_is_the_same_run():
    plain = encircle.run("sim2", link="memory")
    assert encircle.run("sim2", link="memory", interventions=Interventions()).result == plain.result
