"""Packets between two ticks: where they are, and how many have met each fate."""

from collections import Counter

import pytest
from helpers_made_scenes import CAUSES, standing_scene

from encircle.exports.pictures.flights import ON_TIME, TOO_LATE, UNKNOWN, Flights
from encircle.runner.hunts import run
from encircle.scene.builder import scene_of_recording
from encircle.world.recording.recording import read_recording

PLACES = ((0.0, 0.0), (12.0, 0.0))


def flights_of(packets_of_tick, ticks=10, lingering_ticks=1.0):
    scene = standing_scene(packets_of_tick, ticks)
    return Flights(scene.frames, CAUSES, lingering_ticks)


def test_a_packet_on_time_flies_for_a_tick_and_is_there():
    flights = flights_of({3: [(0, 1, 4, 0)]})
    assert flights.at(2.9, PLACES) == []
    [flight] = flights.at(3.25, PLACES)
    assert (flight.start, flight.goal) == ((0.0, 0.0), (12.0, 0.0))
    assert flight.share == pytest.approx(0.25)
    assert flight.fading < 0.0
    assert flights.at(4.0, PLACES) == []


def test_a_late_packet_flies_until_it_is_due_to_where_its_receiver_is_then():
    flights = flights_of({2: [(1, 0, 6, 0)]})
    [flight] = flights.at(5.0, ((1.0, 2.0), (9.0, 9.0)))
    assert flight.share == pytest.approx(0.75)
    assert (flight.start, flight.goal) == ((12.0, 0.0), (1.0, 2.0))
    assert flight.style.shape == "diamond"


def test_a_lost_packet_leaves_a_cross_that_fades_and_goes():
    flights = flights_of({0: [(0, 1, -1, 0)]}, lingering_ticks=2.0)
    [early] = flights.at(0.1, PLACES)
    [late] = flights.at(1.5, PLACES)
    assert early.fading < 0.0 < late.fading < 1.0
    # By chance about half-way, as the palette has it, and a little spread.
    assert 0.4 <= late.share <= 0.6
    assert flights.at(0.6 + 2.0, PLACES) == []


def test_counts_are_of_fates_that_are_decided():
    packets = {
        0: [(0, 1, 1, 0), (1, 0, 3, 0)],
        1: [(0, 1, -2, 0), (1, 0, 2, 4)],
        2: [(0, 1, -9, 0)],
    }
    flights = flights_of(packets)
    assert flights.counts(0) == Counter()
    assert flights.counts(1) == Counter({ON_TIME: 1})
    assert flights.counts(2) == Counter({ON_TIME: 2, "burst-loss": 1})
    assert flights.counts(3) == Counter({ON_TIME: 2, TOO_LATE: 1, "burst-loss": 1, UNKNOWN: 1})
    assert flights.counts(10) == Counter({ON_TIME: 2, TOO_LATE: 2, "burst-loss": 1, UNKNOWN: 1})


def test_counts_of_a_run_are_those_of_its_result(tmp_path):
    """The world's own account is the oracle; what is in flight at the end has met no fate."""
    hunt = run(
        "sim1",
        link="memory",
        out=tmp_path / "run",
        overrides=[
            'channel.loss={model="gilbert-elliott", good_to_bad=0.2, bad_to_good=0.3}',
            'channel.delay={model="uniform", low_s=0.0, high_s=0.5}',
            "channel.duplication.rate=0.2",
            "ticks_max=25",
        ],
    )
    scene = scene_of_recording(read_recording(tmp_path / "run"), beliefs=False)
    flights = Flights(scene.frames, scene.stage.causes, 1.0)
    counts = flights.counts(hunt.result.ticks)
    lost = {fate: n for fate, n in counts.items() if fate not in (ON_TIME, TOO_LATE)}
    assert lost == hunt.result.packets_lost
    assert counts[ON_TIME] + counts[TOO_LATE] == hunt.result.packets_delivered
    assert hunt.result.packets_copied > 0
