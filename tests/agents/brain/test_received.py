"""Detections that robots of one process share, and those that only look alike."""

from encircle.agents.brain.received import detections_of
from encircle.protocol.messages import Observation, Pose


def heard(detection, tick=3):
    """What robot r1 makes of a packet of r2 with this detection."""
    packet = Pose("r2", tick, tick, (1.0, 1.0), (0.0, 0.0), detection, "encircle", None, None)
    observation = Observation("r1", tick + 1, (0.0, 0.0), 0.0, None, (), (), ())
    return detections_of(observation, 0, [(1, packet)], {"r1": 0, "r2": 1})


def test_robots_of_one_process_keep_one_object_of_a_detection():
    (first,), (second,) = heard((4.5, -2.0)), heard((4.5, -2.0))
    assert first == (3, 1, 4.5, -2.0)
    assert second is first


def test_zero_and_minus_zero_are_two_detections():
    told = [(0.0, -0.0), (-0.0, 0.0), (0.0, 0.0), (-0.0, -0.0), (0.0, 5.0), (-0.0, 5.0)]
    for position in (*told, *told):
        assert repr(heard(position)) == repr([(3, 1, *position)])
