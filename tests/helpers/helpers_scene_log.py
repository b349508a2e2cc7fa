"""Frames against the log of the run and the measures: all that these know too must be equal."""

import numpy as np
import pytest

from encircle.measures.choice import shared_points
from encircle.measures.common import links, links_there
from encircle.measures.motion import gaps_rad, hunting
from encircle.measures.radio import ages_ticks
from encircle.measures.ring_closure import slacks_rad
from encircle.scene.frame import DELIVERY_TICKS


def assert_as_logged(frames, log):
    """Everything in frames that the log knows too."""
    assert [f.tick for f in frames] == list(range(log.ticks + 1))
    scenario, count = log.scenario, log.count
    assert np.array_equal([[*f.robots, f.target] for f in frames], log.positions)
    gaps, slacks, ages, there = gaps_rad(log), slacks_rad(log), ages_ticks(log), hunting(log)
    for frame in frames:
        values = frame.values
        rays = np.array(frame.robots) - frame.target
        assert values.distances_m == pytest.approx(np.hypot(*rays.T))
        if there[frame.tick].any():
            assert values.gap_rad == pytest.approx(gaps[frame.tick], abs=1e-12)
            assert values.slack_rad == pytest.approx(slacks[frame.tick], abs=1e-12)
        else:
            assert values.slack_rad is None
    shared = shared_points(log).sum(axis=1)
    for tick, frame in enumerate(frames[:-1]):
        assert [mode or "lost" for mode in frame.modes] == log.modes[tick].tolist()
        assert np.array_equal(
            [np.nan if xi is None else xi for xi in frame.xi], log.xi[tick], equal_nan=True
        )
        assert [-1 if q is None else q for q in frame.points] == log.points[tick].tolist()
        goals = [(np.nan, np.nan) if goal is None else goal for goal in frame.goals]
        assert np.array_equal(goals, log.goals[tick], equal_nan=True)
        assert frame.values.conflicts == shared[tick]
        due, copies = np.zeros((count, count), int), np.zeros((count, count), int)
        for packet in frame.packets:
            due[packet.sender, packet.receiver] = packet.due
            copies[packet.sender, packet.receiver] = packet.copy_due
        assert np.array_equal(due, log.due[tick])
        assert np.array_equal(copies, log.copies[tick])
        by_link = np.array(frame.ages).T[links(count)]
        by_link = np.where(by_link < 0, tick + 1, by_link)
        assert np.array_equal(by_link, ages[tick])
        known = by_link[links_there(log)[tick]]
        mean = known.mean() if len(known) else None
        assert frame.values.age_ticks_mean == (None if mean is None else pytest.approx(mean))
        window = slice(max(0, tick - DELIVERY_TICKS + 1), tick + 1)
        sent = np.count_nonzero(log.due[window])
        delivered = ((log.due[window] > 0) | (log.copies[window] > 0)).sum()
        assert frame.values.delivery == (pytest.approx(delivered / sent) if sent else None)
        _assert_believed(frame, log)
    assert not any(frame.beliefs_unsure for frame in frames)
    assert frames[-1].captured == log.captured
    assert scenario.ids == tuple(log.scenario.ids)


def _assert_believed(frame, log):
    tick = frame.tick
    for robot, belief in enumerate(frame.beliefs):
        assert (belief is not None) == log.there[tick, robot]
        if belief is None:
            continue
        places = np.full((log.count, 2), np.nan)
        places[robot] = belief.position
        for peer in belief.peers:
            assert peer.robot != robot
            if peer.planned_with:
                places[peer.robot] = peer.x, peer.y
            assert (peer.age_ticks <= log.parameters.peer_age_ticks_max) == peer.planned_with
        assert np.array_equal(places, log.believed[tick, robot], equal_nan=True)
        known = not np.isnan(log.estimates[tick, robot, 0])
        assert (belief.estimate is not None) == known == bool(belief.prediction)
        if belief.estimate is not None:
            assert belief.estimate == tuple(log.estimates[tick, robot])
            assert belief.covariance == tuple(log.covariances[tick, robot])
