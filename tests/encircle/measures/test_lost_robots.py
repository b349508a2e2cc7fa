"""How measures count robots that are lost, on logs made by hand."""

import numpy as np
import pytest
from helpers_measures import RING_M, standing

from encircle.measures.registry import measure

TICKS = 10


def without(robot, first=0, last=TICKS, **changes):
    """Four in a square about the target, one of whom takes no part in some rounds."""
    there = np.full((TICKS, 4), True)
    there[first:last, robot] = False
    due = np.where(np.eye(4, dtype=bool), 0, np.arange(TICKS)[:, None, None] + 1)
    due[first:last, robot] = 0
    due[first:last, :, robot] = -4
    due[first:last, robot, robot] = 0
    away = {
        "estimates": np.where(there[..., None], 0.0, np.nan) * np.ones(4),
        "points": np.where(there, np.arange(4), -1),
        "goals": np.where(there[..., None], 1.0, np.nan)
        * np.array([[4, 0], [0, 4], [-4, 0], [0, -4]]),
    }
    log = standing(TICKS, there=there, due=due, **{**away, **changes})
    log.believed[first:last, robot] = np.nan
    log.believed[first:last, :, robot] = np.nan
    return log


def test_the_gap_and_the_ring_are_those_of_the_robots_that_are_left():
    found = measure(without(2), ["gap_rad_mean", "gap_rad_final"])
    assert found == pytest.approx({"gap_rad_mean": np.pi, "gap_rad_final": np.pi})
    later = measure(without(2, 5), ["gap_rad_mean", "gap_rad_final", "ring_tick"])
    # Ticks 0 to 4 with four, 5 to 10 with three: the last tick is that of the last round.
    assert later["gap_rad_mean"] == pytest.approx((5 * np.pi / 2 + 6 * np.pi) / 11)
    assert later["ring_tick"] == 0.0


def test_a_ring_does_not_wait_for_a_robot_that_is_lost_far_away():
    places = np.array([[RING_M, 0], [-2.0, 3.4], [90.0, 90.0], [-2.0, -3.4], [0, 0]])
    both = ["ring_tick", "enclosed_share"]
    assert measure(without(2, positions=places), both) == {"ring_tick": 0.0, "enclosed_share": 1.0}
    assert np.isnan(measure(standing(TICKS, positions=places), ["ring_tick"])["ring_tick"])


def test_with_nobody_left_the_gap_is_a_full_turn_and_there_is_no_ring():
    log = standing(TICKS, there=np.full((TICKS, 4), False))
    found = measure(log, ["gap_rad_mean", "ring_tick", "age_ticks_mean", "peer_missing_share"])
    assert found["gap_rad_mean"] == pytest.approx(2 * np.pi)
    assert np.isnan(found["ring_tick"])
    assert np.isnan(found["age_ticks_mean"])
    assert np.isnan(found["peer_missing_share"])


def test_links_with_a_lost_robot_at_an_end_do_not_age_in_the_mean():
    names = ["age_ticks_mean", "age_ticks_max", "age_ticks_mean_worst", "unheard_share"]
    found = measure(without(1), names)
    assert found == {
        "age_ticks_mean": 1.0,
        "age_ticks_max": 1.0,
        "age_ticks_mean_worst": 1.0,
        "unheard_share": 0.0,
    }


def test_a_robot_that_is_back_has_links_as_old_as_what_was_last_delivered():
    # Lost in rounds 2, 3, 4; in round 5 the newest from it is of tick 1, in round 6 of tick 5.
    found = measure(without(1, 2, 5), ["age_ticks_max", "age_ticks_mean_worst"])
    assert found["age_ticks_max"] == 4.0
    assert found["age_ticks_mean_worst"] == pytest.approx((6 * 1 + 4) / 7)


def test_only_links_between_robots_that_are_there_can_lack_a_peer():
    assert measure(without(0), ["peer_missing_share"]) == {"peer_missing_share": 0.0}
    log = without(0)
    log.believed[:, 1, 2] = np.nan
    # One of six links.
    assert measure(log, ["peer_missing_share"])["peer_missing_share"] == pytest.approx(1 / 6)


def test_a_lost_robot_lacks_no_estimate_and_leaves_regret_undefined():
    found = measure(
        without(3, 6), ["estimate_missing_share", "regret_defined_share", "delivery_ratio"]
    )
    assert found["estimate_missing_share"] == 0.0
    assert found["regret_defined_share"] == pytest.approx(0.6)
    # 12 packets in each of 6 rounds, then 9 of which 3 are to the lost one.
    assert found["delivery_ratio"] == pytest.approx((72 + 24) / (72 + 36))
