"""When to speak: cases worked out by hand, and a real receiver that must not be misled.

The closed loop runs a second brain on the packets alone, over a link without loss or delay. It
shares nothing with the sender's own reckoning of what was told, which it is there to check.
"""

from math import dist

import pytest
from helpers_agents import TICK_S, config, observation, run_actions
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.agents.brain.brain import initial, step
from encircle.agents.teamwork.peers import planning_team
from encircle.agents.teamwork.publishing import ReceiverModel, should_publish
from encircle.protocol.messages import QUANTUM_M, quantise_m
from encircle.protocol.parameters import Parameters

CHEAP = settings(max_examples=60, deadline=None, derandomize=True)
TICKS = 31


def published(positions, targets=(None,) * TICKS, **changed):
    """The ticks at which a robot publishes that is moved along and detects the target so."""
    sensed = [
        observation(tick=tick, position=place, target=target)
        for tick, (place, target) in enumerate(zip(positions, targets, strict=True))
    ]
    _, actions = run_actions(config(**changed), sensed)
    for tick, action in enumerate(actions):
        assert action.command.published == (action.pose is not None)
        assert action.command.tick == tick
    return [tick for tick, action in enumerate(actions) if action.pose is not None]


def along(step_m, ticks=TICKS):
    """A robot that makes the same step along x at every tick."""
    return [(quantise_m(step_m * tick), 0.0) for tick in range(ticks)]


ZERO_STEP = along(0.0)


def test_by_default_every_tick_is_published():
    assert published(along(0.3)) == list(range(TICKS))


@pytest.mark.parametrize("every", [2, 3, 7, 30, 100])
def test_every_nth_tick_is_published_from_the_first_on(every):
    assert published(along(0.3), publish_every_ticks=every) == list(range(0, TICKS, every))


@pytest.mark.parametrize(("age", "ticks"), [(10, [0, 10, 20, 30]), (25, [0, 25]), (1, range(31))])
def test_a_robot_at_rest_that_sees_nothing_speaks_only_for_the_age_of_its_last_packet(age, ticks):
    assert published(ZERO_STEP, publish="event", publish_age_ticks_max=age) == list(ticks)


@pytest.mark.parametrize(
    ("step_m", "ticks"),
    [
        # The first packet says it stands. It has moved by 0.2, then 0.4 > 0.3: the second says how
        # fast, and from there on the peers are right until that is ten ticks old.
        (0.2, [0, 2, 12, 22]),
        # Moved by 0.3, as a quantum of the wire may show a little more: not more than 0.3.
        (0.3, [0, 2, 12, 22]),
        (0.1, [0, 4, 14, 24]),
        (0.4, [0, 1, 11, 21]),
    ],
)
def test_a_steady_robot_is_extrapolated_and_speaks_once_it_is_known_how_it_goes(step_m, ticks):
    assert published(along(step_m), publish="event") == ticks


@pytest.mark.parametrize("changed", [{"peer_policy": "hold"}, {"extrapolate_ticks_max": 0}])
def test_where_peers_hold_a_robot_it_speaks_whenever_it_has_gone_far_enough(changed):
    assert published(along(0.2), publish="event", **changed) == list(range(0, TICKS, 2))
    assert published(along(0.1), publish="event", **changed) == [0, 4, 8, 12, 16, 20, 24, 28]


def test_where_peers_extrapolate_for_a_while_it_speaks_when_they_have_stopped_to():
    # Known from tick 2 on to make 0.2 per tick, moved on by 3 ticks of that: at tick 5 peers have
    # it right, at 6 by 0.2 short, at 7 by 0.4.
    ticks = published(along(0.2), publish="event", extrapolate_ticks_max=3)
    assert ticks == [0, *range(2, TICKS, 5)]


def test_a_robot_that_stops_or_turns_says_so():
    stops = [*along(0.2, 7), *[(quantise_m(1.2), 0.0)] * 9]
    # On its way until tick 6; peers put it 0.2 too far at 7, 0.4 at 8. What it sends then has no
    # velocity, and the next is ten ticks off.
    assert published(stops, [None] * 16, publish="event") == [0, 2, 8]
    turns = [*along(0.2, 7), *[(quantise_m(1.2), quantise_m(0.2 * k)) for k in range(1, 10)]]
    # Peers have it at (1.4, 0) at tick 7, where it is at (1.2, 0.2): 0.28 off; at 8 twice that.
    assert published(turns, [None] * 16, publish="event") == [0, 2, 8]


@pytest.mark.parametrize(("error_m", "ticks"), [(0.15, [0, 1]), (0.5, [0, 3]), (1.9, [0, 10])])
def test_the_error_that_matters_is_a_parameter(error_m, ticks):
    assert published(along(0.2, 11), [None] * 11, publish="event", publish_error_m=error_m) == ticks


HERE, NEAR, FAR = (4.0, 0.0), (4.0, 0.25), (4.0, 1.0)


def sightings(**spans):
    """Detections at every tick: ``here=(3, 9)`` puts the target there from tick 3 to 8."""
    places, found = {"here": HERE, "near": NEAR, "far": FAR}, [None] * TICKS
    for name, (begin, end) in spans.items():
        found[begin:end] = [places[name]] * (end - begin)
    return found


@pytest.mark.parametrize(
    ("targets", "ticks"),
    [
        # The target comes into sight and stands: said once, then for its age only.
        (sightings(here=(3, 31)), [0, 3, 13, 23]),
        # Out of sight is no event, nor is in sight again where it is believed to stand still.
        (sightings(here=(3, 5)), [0, 3, 13, 23]),
        ([*sightings(here=(3, 5))[:7], *sightings(here=(3, 31))[7:]], [0, 3, 13, 23]),
        # But it is if the last packet, that of tick 13, told of nothing in sight.
        ([*sightings(here=(3, 5))[:15], *sightings(here=(3, 31))[15:]], [0, 3, 13, 15, 25]),
        # Elsewhere than peers believe it: by 0.25 m no, by 1 m at once.
        (sightings(here=(3, 6), near=(6, 7), far=(7, 8)), [0, 3, 7, 17, 27]),
    ],
)
def test_a_robot_at_rest_speaks_of_the_target_when_peers_would_be_wrong(targets, ticks):
    assert published(ZERO_STEP, targets, publish="event") == ticks


def test_a_target_that_peers_have_given_up_is_spoken_of_wherever_it_is():
    changed = {"publish": "event", "publish_age_ticks_max": 100, "track_age_ticks_max": 5}
    gap = [*[HERE] * 2, *[None] * 29]
    # Last said to be there at tick 0, and given up by peers at tick 6.
    assert published(ZERO_STEP, [*gap[:5], HERE, *gap[6:]], **changed) == [0]
    assert published(ZERO_STEP, [*gap[:6], HERE, *gap[7:]], **changed) == [0, 6]


def test_events_are_looked_for_only_at_ticks_at_which_a_robot_may_publish():
    changed = {"publish": "event", "publish_every_ticks": 3}
    assert published(ZERO_STEP, sightings(here=(4, 31)), **changed) == [0, 6, 18, 30]
    assert published(ZERO_STEP, sightings(here=(4, 6)), **changed) == [0, 12, 24]


def test_a_packet_carries_only_what_is_detected_at_its_own_tick():
    sensed = [observation(tick=t, target=HERE if t in (0, 1, 2) else None) for t in range(11)]
    _, actions = run_actions(config(publish="event"), sensed)
    sent = [action.pose for action in actions if action.pose]
    assert [(p.tick, p.sequence, p.detection) for p in sent] == [(0, 0, HERE), (10, 10, None)]


def test_nothing_is_kept_of_what_was_told_where_nobody_asks_for_it():
    for every in (1, 3):
        state, _ = run_actions(config(publish_every_ticks=every), [observation(target=HERE)])
        assert state.receiver_model is None


def test_an_error_of_a_quantum_is_none():
    parameters = Parameters(publish="event", publish_error_m=0.25)
    receiver_model = ReceiverModel((0, 0.0, 0.0, 0.0, 0.0), False, None, -1)
    for x, due in ((0.25 + QUANTUM_M, False), (0.25 + 2 * QUANTUM_M, True)):
        assert should_publish(receiver_model, 1, (x, 0.0), None, TICK_S, parameters) == due


def test_a_target_that_goes_steadily_is_spoken_of_until_peers_know_how_it_goes():
    # By 0.2 m per tick from tick 0 on: told where it is at 0, and at 2 (0.4 off). By then a filter
    # has seen it make 0.4 m in 0.2 s and, the prior being wide, takes it to go on at 1.98 m/s:
    # 0.02 m off after ten ticks.
    steadily = [(quantise_m(4.0 + 0.2 * tick), 0.0) for tick in range(TICKS)]
    assert published(ZERO_STEP, steadily, publish="event") == [0, 2, 12, 22]
    # One that stands still from tick 15 on is 0.2 off then, 0.4 at 16.
    stops = [*steadily[:15], *[steadily[14]] * 16]
    assert published(ZERO_STEP, stops, publish="event")[:4] == [0, 2, 12, 16]


steps = st.tuples(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3))
walks = st.lists(st.tuples(steps, steps, st.booleans()), min_size=5, max_size=40)


@CHEAP
@given(
    walks,
    st.sampled_from([0.0, 0.1, 0.3, 1.0]),
    st.sampled_from(["hold", "extrapolate"]),
    st.sampled_from([0, 2, 100_000]),
    st.sampled_from([4, 30]),
    st.sampled_from([0.0, 1.0]),
    steps,
)
def test_a_peer_that_hears_every_packet_is_not_misled_by_silence(
    walk, error_m, policy, extrapolate, track_age, robot_moves, target_drift
):
    changed = {
        "publish": "event",
        "publish_error_m": error_m,
        "peer_policy": policy,
        "extrapolate_ticks_max": extrapolate,
        "track_age_ticks_max": track_age,
    }
    sender, receiver = config(robot="r1", **changed), config(robot="r2", **changed)
    telling, hearing, inbox = initial(sender), initial(receiver), []
    place, target = (0.0, 0.0), (5.0, 0.0)
    since = 0
    for tick, (robot_step, target_step, sees) in enumerate(walk):
        # A robot that stands leaves it to the target to give the events.
        place = tuple(
            quantise_m(p + robot_moves * d) for p, d in zip(place, robot_step, strict=True)
        )
        target = tuple(
            quantise_m(p + drift + 0.2 * d)
            for p, drift, d in zip(target, target_drift, target_step, strict=True)
        )
        sensed = observation("r1", tick, place, target if sees else None)
        telling, action = step(telling, sensed, [], sender)
        hearing, _ = step(hearing, observation("r2", tick, (50.0, 0.0)), inbox, receiver)
        inbox = [action.pose] if action.pose else []
        since = 0 if action.pose else since + 1
        assert since < sender.parameters.publish_age_ticks_max
        if action.pose is None:
            mates = planning_team(hearing.peers, 1, (50.0, 0.0), tick, receiver.parameters)
            assert dist(mates.positions[0], place) <= error_m + 2 * QUANTUM_M
            if sees:
                believed = hearing.track.estimate
                assert believed is not None
                assert dist((believed.x, believed.y), target) <= error_m + 2 * QUANTUM_M
