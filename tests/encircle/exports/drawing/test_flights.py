"""Packets on their way: each covers its link once, in as many pieces as it takes ticks."""

from dataclasses import replace
from math import dist

import pytest
from helpers_exports import lossy_hunt

from encircle.exports.drawing.flights import Flights, fate_of, style_of
from encircle.scene.builder import scene_of_recording
from encircle.scene.frame import Packet

CAUSES = ("none", "loss", "burst-loss", "sender-silent")


def frames_with(packets_by_tick, ticks):
    """Frames of robots that stand still at (0, 0), (10, 0) and (0, 10)."""
    frame = scene_of_recording(lossy_hunt()).frames[0]
    places = ((0.0, 0.0), (10.0, 0.0), (0.0, 10.0))
    return [
        replace(frame, tick=t, robots=places, packets=tuple(packets_by_tick.get(t, ())))
        for t in range(ticks)
    ]


def legs_of(packets_by_tick, ticks):
    flights = Flights(CAUSES)
    return [
        [(leg.start, leg.end, leg.fate) for leg in flights.take(frame)]
        for frame in frames_with(packets_by_tick, ticks)
    ]


def test_a_packet_on_time_covers_its_link_at_once():
    legs = legs_of({0: [Packet(0, 1, 1, 0)]}, 3)
    assert legs == [[((0.0, 0.0), (10.0, 0.0), "arrived")], [], []]


def test_a_late_packet_covers_a_part_of_its_link_in_each_tick():
    legs = legs_of({1: [Packet(0, 1, 5, 0)]}, 6)
    assert [len(at) for at in legs] == [0, 1, 1, 1, 1, 0]
    pieces = [at[0] for at in legs if at]
    assert [start[0] for start, _, _ in pieces] == [0.0, 2.5, 5.0, 7.5]
    assert [end[0] for _, end, _ in pieces] == [2.5, 5.0, 7.5, 10.0]
    assert {fate for *_, fate in pieces} == {"late"}


def test_a_lost_packet_ends_on_its_way_where_its_cause_says():
    legs = legs_of({0: [Packet(0, 2, -1, 0), Packet(0, 2, -3, 0)]}, 2)
    assert legs[1] == []
    for start, end, fate in legs[0]:
        assert start == (0.0, 0.0)
        assert end == pytest.approx((0.0, 10.0 * style_of(fate).reach))
    assert [fate for *_, fate in legs[0]] == ["loss", "sender-silent"]


def test_fates_are_told_by_the_tick_at_which_a_packet_was_sent():
    assert fate_of(Packet(0, 1, 8, 0), 7, CAUSES) == "arrived"
    assert fate_of(Packet(0, 1, 9, 0), 7, CAUSES) == "late"
    assert fate_of(Packet(0, 1, -2, 0), 7, CAUSES) == "burst-loss"


def test_legs_of_a_hunt_are_as_many_as_its_packets_take_ticks():
    scene = scene_of_recording(lossy_hunt())
    flights, last = Flights(scene.stage.causes), scene.frames[-1].tick
    legs = sum(len(flights.take(frame)) for frame in scene.frames)
    expected = 0
    for frame in scene.frames:
        for packet in frame.packets:
            ends = min(packet.due, last + 1) if packet.due > 0 else frame.tick + 1
            expected += ends - frame.tick
    assert legs == expected > 0


def test_a_leg_that_ends_a_link_ends_at_the_receiver():
    scene = scene_of_recording(lossy_hunt())
    flights = Flights(scene.stage.causes)
    for frame in scene.frames:
        for leg in flights.take(frame):
            if leg.fate == "arrived":
                assert min(dist(leg.end, robot) for robot in frame.robots) < 1e-9
