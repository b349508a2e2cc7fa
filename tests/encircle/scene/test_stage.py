"""The stage of a scenario, its radio in sentences, and what happens at a tick."""

import pytest

from encircle.scene.channel_text import channel_sentences
from encircle.scene.events import Schedule
from encircle.scene.stage import stage_of
from encircle.world.channel.loss_causes import CAUSES
from encircle.world.loading.load import load
from encircle.world.scenario.channel_model import Silence

BASE = {"team": {"robots": 4}}


def test_a_stage_tells_robots_apart():
    robots = {"count": 3, "r2": {"strategy": "auction", "sensing_range_m": 2.5}}
    stage = stage_of(load({"team": {"robots": robots}}), 7, "run-1")
    assert stage.policies == ("xi-star", "auction", "xi-star")
    assert stage.sensing_ranges_m == (6.0, 2.5, 6.0)
    assert (stage.seed, stage.run, stage.robots) == (7, "run-1", ("r1", "r2", "r3"))


def test_causes_stand_at_their_codes():
    causes = stage_of(load(BASE), 1, "x").causes
    assert causes[0] == "none"
    assert dict(enumerate(causes[1:], 1)) == CAUSES


@pytest.mark.parametrize(
    ("changes", "sentences"),
    [
        ([], ["no loss", "no delay"]),
        (["channel.loss={model='bernoulli', rate=0.6}"], ["loss 60 % (bernoulli)", "no delay"]),
        (
            ["channel.loss={model='burst', rate=0.25, burst_packets=4.0}"],
            ["loss 25 % in bursts of 4 packets (burst)", "no delay"],
        ),
        (
            # The chain is in the bad state for a third of the time, and loses all there.
            ["channel.loss={model='gilbert-elliott', good_to_bad=0.1, bad_to_good=0.2}"],
            ["loss 33.3 % in bursts (gilbert-elliott)", "no delay"],
        ),
        (
            ["channel.loss={model='range', cutoff_m=5.0}"],
            ["loss: range, cutoff_m = 5", "no delay"],
        ),
        (["channel.delay.mean_s=0.25"], ["no loss", "delay 250 ms (constant)"]),
        (
            ["channel.delay={model='gamma', mean_s=0.3, std_s=0.2}"],
            ["no loss", "delay 300 ms on average (gamma, std_s = 0.2)"],
        ),
        (
            ["channel.delay={model='uniform', low_s=0.1, high_s=0.2}"],
            ["no loss", "delay 150 ms on average (uniform, low_s = 0.1, high_s = 0.2)"],
        ),
        (
            ["channel.delay={model='exponential', mean_s=0.1}", "channel.duplication.rate=0.5"],
            ["no loss", "delay 100 ms on average (exponential)", "50 % of packets arrive twice"],
        ),
        (
            [
                "channel.rate_limit.packets_per_s=5.0",
                "channel.order=kept",
                "channel.links=[{sender='r1', loss={model='bernoulli', rate=0.5}}]",
                "team.robots={count=4, r3={radio_range_m=3.0, loss_rate=0.1}}",
            ],
            [
                "no loss",
                "no delay",
                "rate limit: packets_per_s = 5",
                "packets keep their order",
                "r1 to any: loss 50 % (bernoulli)",
                "r3's radio reaches 3 m",
                "r3's radio loses 10 %",
            ],
        ),
    ],
)
def test_the_radio_in_sentences(changes, sentences):
    assert list(channel_sentences(load(BASE, changes))) == sentences


def test_only_so_many_links_are_told():
    links = ",".join(
        f"{{sender='r1', receiver='r{k}', delay={{mean_s=0.1}}}}" for k in range(2, 17)
    )
    scenario = load({"team": {"robots": 16}}, [f"channel.links=[{links}]"])
    assert channel_sentences(scenario)[-1] == "and 3 more"


def events(*listed):
    return Schedule(load({**BASE, "events": [dict(event) for event in listed]}))


def told(schedule, ticks=30):
    return {tick: [e.text for e in schedule.at(tick)] for tick in range(ticks) if schedule.at(tick)}


def test_events_are_told_as_they_begin_and_end():
    schedule = events(
        {"kind": "silence", "tick": 2, "ticks": 3, "robot": "r3"},
        {"kind": "partition", "tick": 3, "ticks": 9, "groups": [["r1", "r2"], ["r3"]]},
        {"kind": "outage", "tick": 4, "ticks": 1, "sender": "r1"},
        {"kind": "move-target", "tick": 6, "position": [1.5, -2.0]},
        {"kind": "loss", "tick": 7, "ticks": 2, "rate": 0.5},
        {"kind": "heal", "tick": 8},
        {"kind": "crash", "tick": 9, "ticks": 2, "robot": "r4"},
    )
    assert told(schedule) == {
        2: ["r3's radio is off"],
        3: ["the team is cut: r1, r2 | r3"],
        4: ["outage from r1 to any robot"],
        5: ["r3's radio is on again", "no outage from r1 to any robot any more"],
        6: ["the target is moved towards (1.5, -2) m"],
        7: ["every link loses 50 % of packets"],
        8: ["the team is whole again", "silences, outages and partitions are over"],
        9: ["loss as the scenario has it again"],
    }
    assert [schedule.silent(tick) for tick in (1, 2, 4, 5)] == [set(), {2}, {2}, set()]


def test_an_event_can_be_added_while_a_run_goes_on():
    schedule = events()
    schedule.add(Silence(kind="silence", tick=4, ticks=2, robot="r1"))
    assert told(schedule) == {4: ["by hand: r1's radio is off"], 6: ["r1's radio is on again"]}
    assert schedule.silent(5) == {0}
