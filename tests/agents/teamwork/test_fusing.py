"""Estimates told and fused: by whom, when, how old, and how consistent what comes of it is.

Oracles: the filter fed directly; covariance intersection written out on numpy's matrices; the
chi-square law of the normalised estimation error.
"""

from dataclasses import replace

import numpy as np
import pytest
from helpers_agents import BODIES, TEAM, TICK_S, config, observation, pose, run_actions
from helpers_fusion import ALONE, errors_of
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from encircle.agents.brain.brain import initial, step
from encircle.agents.brain.robot_core import RobotCore
from encircle.agents.estimation import kalman
from encircle.agents.estimation.covariance_intersection import intersection
from encircle.agents.estimation.kalman import Estimate
from encircle.measures.belief import STATES
from encircle.protocol.codec import decode_pose, encode
from encircle.protocol.keys import robot_key
from encircle.protocol.messages import QUANTUM_M, Setup
from encircle.protocol.parameters import Parameters
from encircle.protocol.wire.target_estimate import TargetEstimate

CHEAP = settings(max_examples=60, deadline=None, derandomize=True)
RUN = "g1"
FUSE = Parameters(detections="fuse")
CHAIN = (("r1", "r2"), ("r2", "r1"), ("r2", "r3"), ("r3", "r2"))
TOLD = TargetEstimate(4, 4.0, 0.5, -1.0, 2.0, 0.0025, 0.01, 1.5)


def telling(robot, tick, estimate=TOLD):
    return replace(pose(robot, tick), estimate=estimate)


def believed(estimate):
    """A told estimate as the filter's."""
    return Estimate(*estimate[1:5], tuple(estimate[5:]))


def hunt(links, sightings, ticks, **changed):
    """Three robot cores joined by links that deliver at the next tick; each one's state."""
    team = ("r1", "r2", "r3")
    cores = {robot: RobotCore(robot, RUN) for robot in team}
    for robot, core in cores.items():
        setup = Setup(robot, team, TICK_S, "xi-star", BODIES | {"detections": "fuse"} | changed)
        core.receive(robot_key(RUN, robot, "setup"), encode(setup, RUN))
    sent = {}
    for tick in range(ticks):
        packets = {}
        for robot, core in cores.items():
            inbox = tuple(sent[a] for a, b in links if b == robot and a in sent)
            sensed = observation(robot, tick, target=sightings.get((robot, tick)), inbox=inbox)
            packets[robot] = encode(core.decide(sensed).pose, RUN)
        sent = packets
    assert [set(core.refused) <= {"late-detection"} for core in cores.values()] == [True] * 3
    return {robot: core.state.track for robot, core in cores.items()}


def test_who_hears_nothing_has_the_filter_of_its_own_detections():
    sightings = {("r1", tick): (4.0, 0.25 * tick) for tick in range(2, 12)}
    track = hunt((), sightings, 20)["r1"]
    alone = kalman.EMPTY_TRACK
    for tick in range(20):
        seen = sightings.get(("r1", tick))
        alone = kalman.incorporate(alone, [(tick, 0, *seen)] if seen else [], tick, TICK_S, FUSE)
    assert track == alone


def test_an_estimate_goes_down_a_chain_a_link_a_tick():
    for ticks, known in ((3, "1"), (4, "12"), (5, "123")):
        tracks = hunt(CHAIN, {("r1", 2): (4.0, 3.0)}, ticks)
        assert "".join(r[1] for r in tracks if tracks[r].estimate is not None) == known


def test_a_rumour_dies_when_the_last_detection_is_too_old():
    tracks = hunt(CHAIN, {("r1", 2): (4.0, 3.0)}, 33)
    assert all(track.estimate is not None for track in tracks.values())
    assert {track.detected_tick for track in tracks.values()} == {2}
    tracks = hunt(CHAIN, {("r1", 2): (4.0, 3.0)}, 34)
    assert all(track.estimate is None for track in tracks.values())
    again = {("r1", 2): (4.0, 3.0), ("r3", 40): (9.0, 3.0)}
    tracks = hunt(CHAIN, again, 43)
    assert {track.detected_tick for track in tracks.values()} == {40}


def test_the_packet_carries_the_estimate_of_its_tick_and_no_detection():
    sensed = [observation(tick=t, target=(1.0, 0.3 * t)) for t in range(6)]
    state, actions = run_actions(config(detections="fuse"), sensed)
    sent, estimate = actions[-1].pose, state.track.estimate
    assert sent.detection is None
    assert sent.relayed == ()
    assert sent.estimate.detected_tick == 5
    assert believed(sent.estimate)[:4] == pytest.approx(estimate[:4], abs=QUANTUM_M)
    assert sent.estimate[5:] == pytest.approx(estimate.covariance, rel=1e-7)
    assert all(value / QUANTUM_M == int(value / QUANTUM_M) for value in sent.estimate[1:5])
    assert decode_pose(encode(sent, RUN), RUN) == sent
    _, actions = run_actions(config(detections="fuse"), [observation(tick=0)])
    assert actions[-1].pose.estimate is None


@pytest.mark.parametrize("way", ["own", "relay"])
def test_robots_that_do_not_fuse_neither_tell_estimates_nor_use_them(way):
    sensed = [observation(tick=t) for t in range(6)]
    state, actions = run_actions(
        config(detections=way), sensed, lambda now: [telling("r2", 4)] if now == 5 else []
    )
    assert state.track.estimate is None
    assert actions[-1].pose.estimate is None


def after(packets, tick, seen_at=(), **changed):
    """r1's track at a tick, having heard the packets at it; the target stood at (4, 0.5)."""
    part = config(**({"detections": "fuse"} | changed))
    sensed = [
        observation(tick=t, target=(4.0, 0.5) if t in seen_at else None) for t in range(tick + 1)
    ]
    return run_actions(part, sensed, lambda now: packets if now == tick else [])[0].track


def by_matrices(estimate, ticks, parameters=FUSE):
    """The prediction, step by step on matrices."""
    transition = np.array([[1.0, TICK_S], [0.0, 1.0]])
    push = np.array([[TICK_S**2 / 2], [TICK_S]]) * parameters.acceleration_mps2_std
    p00, p01, p11 = estimate.covariance
    mean, p = np.array([estimate[:2], estimate[2:4]]), np.array([[p00, p01], [p01, p11]])
    for _ in range(ticks):
        mean, p = transition @ mean, transition @ p @ transition.T + push @ push.T
    return [*mean.ravel(), p[0, 0], p[0, 1], p[1, 1]]


@pytest.mark.parametrize("age", [1, 2, 7, 29])
def test_what_comes_late_is_predicted_to_the_present(age):
    track = after([telling("r2", 5)], 5 + age)
    expected = by_matrices(believed(TOLD), age)
    assert [*track.estimate[:4], *track.estimate.covariance] == pytest.approx(expected, rel=1e-12)
    assert track.detected_tick == 4


def test_it_is_fused_with_the_own_estimate_after_the_own_detection():
    own = after([], 6, seen_at=range(7)).estimate
    track = after([telling("r2", 5)], 6, seen_at=range(7))
    fused = intersection(own, kalman.predicted(believed(TOLD), 1, TICK_S, FUSE))
    assert track.estimate == fused
    assert track.detected_tick == 6


def test_several_are_fused_by_tick_then_robot_order():
    # Found again by hand, one by one; another order gives another result here.
    others = [
        telling("r3", 4, TOLD._replace(x=5.0, p00=0.5)),
        telling("r4", 3, TOLD._replace(detected_tick=3, x=6.0, p11=0.1)),
        telling("r2", 4, TOLD._replace(x=7.0, p01=-0.01)),
    ]
    expected = None
    for index, late in ((1, 2), (2, 1), (0, 1)):
        now = kalman.predicted(believed(others[index].estimate), late, TICK_S, FUSE)
        expected = now if expected is None else intersection(expected, now)
    assert after(others, 5).estimate == expected
    assert after(others[::-1], 5).estimate == expected


def test_too_old_is_dropped_and_counted():
    assert after([telling("r2", 5)], 35).dropped == 1, "left the window"
    assert after([telling("r2", 5)], 35).estimate is None
    assert after([telling("r2", 5)], 34).dropped == 0
    old = TOLD._replace(detected_tick=1)
    assert after([telling("r2", 31, old)], 32).dropped == 1, "nobody has detected for too long"
    assert after([telling("r2", 30, old)], 31).dropped == 0
    late = after([telling("r2", 5)], 7, late_detections="ignore")
    assert (late.dropped, late.estimate) == (1, None)
    assert after([telling("r2", 6)], 7, late_detections="ignore").dropped == 0
    vague = telling("r2", 5, TOLD._replace(p11=9e8))
    assert after([vague], 20).dropped == 1, "no more than a guess by now"


def test_copies_and_what_comes_out_of_order_is_passed_over_not_counted():
    part = config(detections="fuse-naive")
    sensed = [observation(tick=t) for t in range(9)]
    once, new = telling("r2", 4), telling("r2", 6, TOLD._replace(detected_tick=6))
    inboxes = {5: [once], 6: [once], 7: [new, once, new], 8: [once, new]}
    without = {5: [once], 7: [new]}
    state, _ = run_actions(part, sensed, lambda now: inboxes.get(now, []))
    expected, _ = run_actions(part, sensed, lambda now: without.get(now, []))
    assert state.track == expected.track
    assert state.track.dropped == 0


def test_a_detection_by_who_does_not_fuse_counts_as_a_first_estimate():
    heard = pose("r2", 4, detection=(4.0, 2.0), relayed=(("r3", 3, 5.0, 1.0),))
    first = (FUSE.measurement_m_std**2, 0.0, FUSE.velocity_mps_std**2)
    older = kalman.predicted(Estimate(5.0, 1.0, 0.0, 0.0, first), 2, TICK_S, FUSE)
    newer = kalman.predicted(Estimate(4.0, 2.0, 0.0, 0.0, first), 1, TICK_S, FUSE)
    track = after([heard], 5)
    assert track.estimate == intersection(older, newer)
    assert track.detected_tick == 4


estimates = st.builds(
    lambda x, y, vx, vy, a, r, b, age: TargetEstimate(age, x, y, vx, vy, a * a, r * a * b, b * b),
    *[st.floats(-9.0, 9.0)] * 4,
    st.floats(0.01, 3.0),
    st.floats(-0.95, 0.95),
    st.floats(0.1, 3.0),
    st.integers(0, 4),
)
packets_of_peers = st.lists(
    st.builds(telling, st.sampled_from(TEAM[1:]), st.integers(4, 11), estimates),
    max_size=8,
    unique_by=lambda packet: (packet.robot, packet.tick),
)


@CHEAP
@given(packets_of_peers, st.data())
@pytest.mark.parametrize("way", ["fuse", "fuse-naive"])
def test_neither_order_nor_copies_of_packets_matter(way, packets, data):
    part = config(detections=way)
    sensed = [observation(tick=t, target=(5.0, 0.2 * t) if t % 4 == 0 else None) for t in range(13)]
    state = initial(part)
    for seen in sensed[:12]:
        state, _ = step(state, seen, [], part)
    again = [packet for packet in packets if data.draw(st.booleans())]
    shuffled = data.draw(st.permutations(packets + again))
    assert step(state, sensed[12], shuffled, part) == step(state, sensed[12], packets, part)


@CHEAP
@given(estimates, st.integers(1, 40))
def test_predicting_at_once_is_predicting_tick_by_tick(told, ticks):
    estimate = believed(told)
    found = kalman.predicted(estimate, ticks, TICK_S, FUSE)
    for _ in range(ticks):
        estimate = kalman.next_estimate(estimate, (), TICK_S, FUSE)
    assert found[:4] == pytest.approx(estimate[:4], rel=1e-9, abs=1e-9)
    assert found.covariance == pytest.approx(estimate.covariance, rel=1e-9, abs=1e-9)


RUNS, ROBOTS = 40, 4


def mean_nees(way, loss):
    """(ROBOTS,) at the end of runs in which all tell all what they know."""
    return np.mean([errors_of(way, seed, ROBOTS, 40, loss)[0][-1] for seed in range(RUNS)], axis=0)


@pytest.mark.parametrize("loss", [0.0, 0.5])
def test_where_all_tell_all_naive_fusion_is_far_too_sure_and_intersection_is_not(loss):
    # Runs are independent, so the mean of one robot's NEES over them is chi-square over their
    # number. Bounds that a consistent filter leaves in one of 10^4 tries, for each robot.
    low, high = chi2(STATES * RUNS).ppf([5e-5, 1.0 - 5e-5]) / RUNS
    detections = mean_nees("own", loss)
    assert np.all((low < detections) & (detections < high)), "detections are counted once"
    assert np.all(mean_nees("fuse", loss) < high)
    assert np.all(mean_nees("fuse-naive", loss) > 10.0 * high)


def test_estimates_told_and_intersected_are_better_than_none_and_detections_better_still():
    def error(way):
        return np.nanmean([errors_of(way, seed, ROBOTS, 40)[1] for seed in range(RUNS)])

    assert error("own") < error("fuse") < error(ALONE)
