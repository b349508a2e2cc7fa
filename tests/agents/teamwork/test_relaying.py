"""Detections that take a way round: a chain, a triangle, and what is passed on by whom.

The oracle of what a robot should believe is the filter fed directly with the detections it can have
heard of; the oracle of what is passed on is a sort of all of them.
"""

from dataclasses import replace

import pytest
from helpers_agents import BODIES, TEAM, TICK_S, config, observation, pose, run_actions, run_brain
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.agents.brain.brain import initial, step
from encircle.agents.brain.robot_core import RobotCore
from encircle.agents.estimation import kalman
from encircle.agents.teamwork.relaying import detections_to_relay, relayed_detections
from encircle.protocol.codec import decode_pose, encode
from encircle.protocol.keys import robot_key
from encircle.protocol.messages import Setup
from encircle.protocol.parameters import Parameters
from encircle.protocol.wire.limits import RELAYED_MAX

CHEAP = settings(max_examples=60, deadline=None, derandomize=True)
RUN = "g1"
P = Parameters()
PLACES = {robot: place for place, robot in enumerate(TEAM)}
CHAIN = (("r1", "r2"), ("r2", "r1"), ("r2", "r3"), ("r3", "r2"))
TRIANGLE = (*CHAIN, ("r1", "r3"), ("r3", "r1"))
places = st.tuples(st.floats(-9.0, 9.0), st.floats(-9.0, 9.0))


def hunt(links, sightings, ticks, lost=lambda link, tick: False, **changed):
    """Robot cores joined by links that deliver at the next tick; the state of each at the end.

    ``sightings``: where which robot detects the target at which tick, by ``(robot, tick)``.
    """
    team = ("r1", "r2", "r3")
    cores = {robot: RobotCore(robot, RUN) for robot in team}
    for robot, core in cores.items():
        setup = Setup(robot, team, TICK_S, "xi-star", BODIES | changed)
        core.receive(robot_key(RUN, robot, "setup"), encode(setup, RUN))
    sent = {}
    for tick in range(ticks):
        packets = {}
        for robot, core in cores.items():
            inbox = tuple(
                sent[sender]
                for sender, receiver in links
                if receiver == robot and sender in sent and not lost((sender, robot), tick)
            )
            sensed = observation(robot, tick, target=sightings.get((robot, tick)), inbox=inbox)
            action = core.decide(sensed)
            if action.pose is not None:
                packets[robot] = encode(action.pose, RUN)
        sent = packets
    assert [core.refused for core in cores.values()] == [{}] * 3
    return {robot: core.state for robot, core in cores.items()}


def directly(detections, ticks, parameters=P):
    """The track of a filter that got each detection at its own tick."""
    track = kalman.EMPTY_TRACK
    for tick in range(ticks):
        now = [detection for detection in detections if detection[0] == tick]
        track = kalman.incorporate(track, now, tick, TICK_S, parameters)
    return track


SENT_ONCE = {("r1", 2): (4.0, 3.0)}
OFTEN = {("r1", tick): (4.0, 0.25 * tick) for tick in range(2, 12)}


def test_down_a_chain_a_detection_comes_by_relaying_only():
    for ticks, known in ((3, "1"), (4, "12"), (5, "123"), (9, "123")):
        states = hunt(CHAIN, SENT_ONCE, ticks, detections="relay")
        assert "".join(r[1] for r in states if states[r].track.estimate is not None) == known
        states = hunt(CHAIN, SENT_ONCE, ticks)
        assert "".join(r[1] for r in states if states[r].track.estimate is not None) == known[:2]


def test_at_the_end_of_a_chain_the_target_is_known_as_if_it_had_been_told_directly():
    states = hunt(CHAIN, OFTEN, 20, detections="relay")
    told = directly([(tick, 0, *place) for (_, tick), place in OFTEN.items()], 20)
    for state in states.values():
        assert state.track == told


def test_hearing_of_a_detection_twice_and_late_changes_nothing_to_the_last_bit():
    relayed = hunt(TRIANGLE, OFTEN, 20, detections="relay")
    direct = hunt(TRIANGLE, OFTEN, 20)
    for robot in relayed:
        assert relayed[robot].track == direct[robot].track


def test_one_packet_that_gets_through_makes_up_for_those_that_did_not():
    # r3 hears r2 once, at tick 13, and what it hears was sent at tick 12.
    def lost(link, tick):
        return link == ("r2", "r3") and tick != 13

    track = hunt(CHAIN, OFTEN, 14, lost, detections="relay")["r3"].track
    heard = sorted(detection[0] for entry in track.entries for detection in entry.detections)
    assert heard == list(range(2, 12))
    short = hunt(CHAIN, OFTEN, 14, lost, detections="relay", relay_age_ticks_max=4)["r3"].track
    heard = sorted(detection[0] for entry in short.entries for detection in entry.detections)
    assert heard == [8, 9, 10, 11]


def test_where_late_detections_are_ignored_so_are_all_that_were_relayed():
    states = hunt(CHAIN, OFTEN, 20, detections="relay", late_detections="ignore")
    assert states["r2"].track.estimate is not None
    assert states["r3"].track.estimate is None
    assert states["r3"].track.dropped > 0
    states = hunt(TRIANGLE, OFTEN, 20, detections="relay", late_detections="ignore")
    assert states["r3"].track.dropped == 0, "what is known already is not counted as ignored"


def test_what_was_heard_is_passed_on_with_the_next_packet_and_causes_none():
    relaying = {"detections": "relay", "publish": "event", "publish_age_ticks_max": 8}
    assert hunt(CHAIN, SENT_ONCE, 9, **relaying)["r3"].track.estimate is None
    assert hunt(CHAIN, SENT_ONCE, 10, **relaying)["r3"].track.estimate is not None


def actions_after(packets, tick, **changed):
    """What r1 sends at a tick, having heard the packets at it and detected the target before."""
    sensed = [observation(tick=t, target=(1.0, float(t))) for t in range(tick + 1)]
    part = config(detections="relay", **changed)
    return run_actions(part, sensed, lambda now: packets if now == tick else [])[1][-1]


def test_neither_the_own_detections_nor_the_freshest_are_repeated():
    heard = [pose("r2", 4, detection=(4.0, 2.0), relayed=(("r1", 3, 9.0, 9.0),))]
    sent = actions_after(heard, 5).pose
    assert sent.detection == (1.0, 5.0)
    assert sent.relayed == (("r2", 4, 4.0, 2.0),)


def test_by_default_nothing_is_passed_on():
    heard = [pose("r2", 4, detection=(4.0, 2.0), relayed=(("r3", 3, 9.0, 9.0),))]
    sensed = [observation(tick=t) for t in range(6)]
    state, actions = run_actions(config(), sensed, lambda now: heard if now == 5 else [])
    assert actions[-1].pose.relayed == ()
    assert state.track.estimate is not None, "but it is used"


@CHEAP
@given(
    st.dictionaries(st.tuples(st.sampled_from(TEAM), st.integers(0, 39)), places, max_size=60),
    st.integers(1, 50),
)
def test_passed_on_are_the_newest_of_others_newest_first_then_in_robot_order(known, age):
    detections = [(tick, PLACES[robot], *place) for (robot, tick), place in known.items()]
    parameters = replace(P, window_ticks=60, track_age_ticks_max=60)
    track = directly(detections, 41, parameters)
    expected = [
        (robot, tick, *place)
        for (robot, tick), place in sorted(
            known.items(), key=lambda item: (-item[0][1], TEAM.index(item[0][0]))
        )
        if robot != "r2" and 40 - tick <= age
    ]
    assert detections_to_relay(track, 40, 1, TEAM, age) == tuple(expected[:RELAYED_MAX])


def test_a_detection_that_left_the_window_is_not_passed_on():
    track = directly([(t, 0, 4.0, 0.0) for t in range(12)], 12, replace(P, window_ticks=5))
    assert [report[1] for report in detections_to_relay(track, 11, 1, TEAM, 10)] == [
        11,
        10,
        9,
        8,
        7,
    ]


def test_each_detection_is_taken_from_packets_once_and_never_the_own_or_one_of_now():
    packets = [
        pose("r2", 4, relayed=(("r3", 3, 1.0, 1.0), ("r1", 3, 2.0, 2.0), ("r4", 2, 3.0, 3.0))),
        pose("r4", 4, relayed=(("r3", 3, 1.0, 1.0), ("r2", 5, 4.0, 4.0))),
    ]
    assert relayed_detections(packets, 5, 0, PLACES) == [(3, 2, 1.0, 1.0), (2, 3, 3.0, 3.0)]


def test_what_a_robot_says_itself_counts_before_what_others_say_of_it():
    said = pose("r2", 4, detection=(4.0, 2.0))
    rumour = pose("r3", 4, relayed=(("r2", 4, 9.0, 9.0),))  # no robot can have heard it by then
    late_rumour = pose("r3", 5, relayed=(("r2", 4, 9.0, 9.0),))
    for packets in ([said, rumour], [rumour, said], [late_rumour, said]):
        sensed = [observation(tick=t) for t in range(7)]
        state, _ = run_brain(config(), sensed, lambda now, heard=packets: heard if now == 6 else [])
        assert [d for entry in state.track.entries for d in entry.detections] == [(4, 1, 4.0, 2.0)]


@st.composite
def relaying_packets(draw, tick):
    """Packets of r2 to r4, in which one detection is the same wherever it is told of."""
    truth = {}
    packets = []
    senders = st.tuples(st.sampled_from(TEAM[1:]), st.integers(0, tick - 1))
    for robot, sent in draw(st.lists(senders, max_size=8, unique=True)):
        origins = st.tuples(st.sampled_from(TEAM), st.integers(0, max(0, sent - 1)))
        chosen = draw(st.lists(origins, max_size=6, unique=True)) if sent else []
        for key in [*chosen, (robot, sent)]:
            truth.setdefault(key, draw(places))
        reports = tuple((*key, *truth[key]) for key in chosen)
        detection = truth[robot, sent] if draw(st.booleans()) else None
        packets.append(pose(robot, sent, draw(places), draw(places), detection, reports))
    return packets


@CHEAP
@given(relaying_packets(12), st.data())
@pytest.mark.parametrize(
    "changed",
    [
        {"detections": "relay"},
        {"detections": "relay", "late_detections": "ignore"},
        {"detections": "relay", "publish": "event", "switch_gain_m": 1.0},
    ],
    ids=["refilter", "ignore", "event"],
)
def test_neither_order_nor_copies_of_relaying_packets_matter(changed, packets, data):
    part = config(**changed)
    sensed = [
        observation(tick=t, target=(5.0, 0.25 * t) if t % 4 == 0 else None) for t in range(13)
    ]
    state = initial(part)
    for seen in sensed[:12]:
        state, _ = step(state, seen, [], part)
    again = [p for p in packets if data.draw(st.booleans())]
    shuffled = data.draw(st.permutations(packets + again))
    assert step(state, sensed[12], shuffled, part) == step(state, sensed[12], packets, part)


@CHEAP
@given(relaying_packets(12))
def test_the_filter_is_fed_with_all_that_was_relayed_as_if_told_by_the_origins(packets):
    part = config()
    sensed = [observation(tick=t) for t in range(13)]
    state, _ = run_brain(part, sensed, lambda now: packets if now == 12 else [])
    heard = {
        (p.tick, PLACES[p.robot], *p.detection) for p in packets if p.detection is not None
    } | {(t, PLACES[o], x, y) for p in packets for o, t, x, y in p.relayed if o != "r1"}
    assert state.track == directly(sorted(heard), 13)


def test_a_full_packet_crosses_the_wire():
    heard = [pose(r, t, detection=(4.0, 0.5 * t)) for r in TEAM[1:] for t in range(10)]
    sent = actions_after(heard, 10).pose
    assert len(sent.relayed) == RELAYED_MAX
    assert decode_pose(encode(sent, RUN), RUN) == sent
