"""What is drawn: rings, regions, marks and ghosts against what they stand for."""

from dataclasses import replace
from math import dist, hypot

import numpy as np
import pytest
from helpers_exports import lossy_hunt
from helpers_scene import hunted

from encircle.exports.drawing import layers
from encircle.exports.drawing.flights import Leg
from encircle.exports.drawing.shapes import Disc, Label, Line, Segments, colour_of
from encircle.protocol.parameters import Parameters
from encircle.scene.builder import scene_of_recording
from encircle.scene.frame import Belief, PeerBelief
from encircle.scene.palette import ARRIVED, LATE, LOST
from encircle.world.loading.load import load

CLEAR = (0.0, 0.0)


def entity(entities, name):
    (found,) = [e for e in entities if e.name == name]
    return found


def shapes(entities, name, kind):
    return [shape for shape in entity(entities, name).shapes if isinstance(shape, kind)]


def test_the_ring_of_a_goal_is_as_large_as_the_scenario_says():
    """Goals are points of a ring of that radius (Eq. 1); nothing here knows the radius."""
    recording, _ = hunted("sim1", ["ticks_max=20"])
    radius_m = Parameters.from_mapping(recording.scenario.parameters).ring_radius_m
    scene, rings = scene_of_recording(recording), 0
    for frame in scene.frames:
        for k in range(len(scene.stage.robots)):
            if frame.modes[k] == "encircle" and (ring := layers.ring_of(frame, k)):
                centre, drawn_m = ring
                assert drawn_m == pytest.approx(radius_m, rel=0.01)
                assert dist(centre, frame.goals[k]) == drawn_m
                rings += 1
    assert rings > 20


def test_the_region_of_an_estimate_holds_the_target_with_its_probability():
    """Of normal errors with the drawn variance, as many fall within as it says: by counting."""
    scene = scene_of_recording(lossy_hunt())
    frame = next(f for f in scene.frames if f.beliefs[2] and f.beliefs[2].estimate)
    variance_m2 = 0.04
    belief = frame.beliefs[2]._replace(covariance=(variance_m2, 0.0, 1.0))
    frame = replace(frame, beliefs=(None, None, belief))
    (disc,) = shapes(layers.beliefs(scene.stage, frame, 2), "target", Disc)
    assert disc.centre == belief.estimate[:2]
    errors = np.random.default_rng(1).normal(0.0, variance_m2**0.5, (40_000, 2))
    within = (np.hypot(*errors.T) <= disc.radius_m).mean()
    assert within == pytest.approx(layers.CONFIDENCE, abs=0.005)


def test_a_ghost_fades_with_age_and_tells_it():
    scene = scene_of_recording(lossy_hunt())
    frame = scene.frames[0]
    ages = {0: "0 ticks", 1: "1 tick", 20: "20 ticks", 40: "40 ticks"}
    for age_ticks, told in ages.items():
        peer = PeerBelief(1, 3.0, 4.0, age_ticks, False)
        belief = Belief(CLEAR, (peer,), None, None, ())
        drawn = layers.beliefs(scene.stage, replace(frame, beliefs=(belief, None, None)), 0)
        (outline,) = shapes(drawn, "r2", Line)
        assert outline.colour.a == pytest.approx(3.0 ** (-age_ticks / 20))
        assert not shapes(drawn, "r2", Disc), "it is not planned with"
        (label,) = shapes(drawn, "r2", Label)
        assert label.text == f"r2, {told}"


def test_a_large_team_s_ghosts_are_discs_alone():
    recording, _ = hunted(load({"team": {"robots": 20}, "ticks_max": 3}))
    scene = scene_of_recording(recording)
    drawn = [e for e in layers.beliefs(scene.stage, scene.frames[2], 0) if e.name != "target"]
    assert len(drawn) > 10
    assert all([type(shape) for shape in ghost.shapes] == [Disc] for ghost in drawn)


def test_bodies_say_who_is_lost_and_who_is_silent():
    scene = scene_of_recording(lossy_hunt())
    texts = {}
    for frame in scene.frames:
        for thing in layers.bodies(scene.stage, frame):
            (label,) = [s for s in thing.shapes if isinstance(s, Label)]
            texts.setdefault(frame.tick, []).append(label.text)
    assert texts[8] == ["r1 silent", "r2 lost", "r3", "target"]
    assert texts[20] == ["r1", "r2", "r3", "target"]


def test_each_fate_has_a_mark_of_its_own():
    styles = [ARRIVED, LATE, *LOST.values()]
    marks = {style.shape: layers.mark(style.shape, CLEAR) for style in styles}
    assert all(marks.values())
    assert len({repr(mark) for mark in marks.values()}) == len(marks)
    for pieces in marks.values():
        assert all(hypot(*point) <= layers.MARK_M / 2 + 1e-9 for p in pieces for point in p)


def test_packets_are_drawn_by_fate():
    legs = [Leg(CLEAR, (1.0, 0.0), fate) for fate in ("loss", "arrived", "loss")]
    drawn = layers.packets(legs)
    assert [thing.name for thing in drawn] == ["arrived", "loss"]
    ways, marks = entity(drawn, "loss").shapes
    assert isinstance(ways, Segments)
    assert len(ways.points) == 4
    assert len(marks.points) == 2 * 2 * len(layers.mark("x", CLEAR))


def test_colours_are_read_from_their_codes():
    assert colour_of("#0072B2").rgba8 == (0, 0x72, 0xB2, 255)
    assert colour_of("#0072B2").faded(0.5).a == 0.5
