"""The arena's step: limits, solid bodies, capture, events, noise, placement, purity."""

from itertools import pairwise
from math import dist, pi

import numpy as np
import pytest
from helpers_scenarios import scenario_of
from helpers_world import SQUARE, arena, overlapping, packets, walked

from encircle.world.arena import engine
from encircle.world.channel.channel import CAUSES

ALPHA = 1e-3
QUANTUM_M = 2.0**-20
DISCS = [{"position": [3.0, 3.0], "radius_m": 0.8}, {"position": [-3.0, 1.5], "radius_m": 1.1}]


@pytest.mark.parametrize("motion", ["holonomic", "unicycle"])
@pytest.mark.parametrize("behaviour", ["flee", "gap", "straight"])
def test_no_body_goes_farther_in_a_tick_than_it_can(motion, behaviour):
    hunted = arena(
        f"team.motion={motion}",
        f"target.behaviour={behaviour}",
        "target.step_m_max=0.39",
        obstacles=DISCS,
    )
    draws = np.random.default_rng(1).normal(0.0, 3.0, (60, 4, 2))
    states = walked(hunted, 60, lambda tick: draws[tick])
    for before, after in pairwise(states):
        gone = np.hypot(*(after.positions - before.positions).T)
        assert (gone[:4] <= 0.3 + QUANTUM_M).all()
        assert gone[4] <= 0.39 + QUANTUM_M
        assert (gone[5:] == 0.0).all()
        assert (after.positions == engine.quantised(after.positions)).all()


def test_a_unicycle_turns_no_faster_than_it_can():
    hunted = arena("team.motion=unicycle", "team.turn_rad_max=0.2")
    draws = np.random.default_rng(1).normal(0.0, 1.0, (50, 4, 2))
    states = walked(hunted, 50, lambda tick: draws[tick])
    for before, after in pairwise(states):
        turned = np.remainder(after.headings - before.headings + pi, 2 * pi) - pi
        assert (abs(turned[:4]) <= 0.2 + 1e-12).all()
        step = after.positions[:4] - before.positions[:4]
        forward = (step * np.stack([np.cos(after.headings), np.sin(after.headings)], 1)[:4]).sum(1)
        assert (forward >= -QUANTUM_M).all()


def moved_to(wanted, tick=3, **changes):
    event = f"events=[{{kind='move-target', tick={tick}, position=[{wanted[0]}, {wanted[1]}]}}]"
    hunted = arena(event, **changes)
    return hunted, walked(hunted, tick + 1)


def test_the_target_stands_where_it_is_put_at_the_very_tick():
    _, states = moved_to((2.25, -1.5))
    places = [tuple(state.positions[4].tolist()) for state in states]
    assert places == [(0.0, 0.0)] * 3 + [(2.25, -1.5)] * 2


def nearest_free(hunted, state, wanted):
    """Distance from ``wanted`` to the nearest place that is free, on a fine polar grid."""
    target = len(hunted.ids)
    others = np.delete(state.positions, target, axis=0)
    apart = np.delete(hunted.radii, target) + hunted.radii[target]
    for radius in np.arange(0.0, 30.0, 0.01):
        bearings = np.linspace(0, 2 * pi, 360, endpoint=False)
        ring = np.array(wanted) + radius * np.stack([np.cos(bearings), np.sin(bearings)], 1)
        away = np.hypot(*(ring[:, None] - others).transpose(2, 0, 1))
        if (away > apart).all(axis=1).any():
            return radius
    return np.inf


@pytest.mark.parametrize(
    ("wanted", "discs"),
    [
        ((4.0, 0.0), []),
        ((3.9, 0.3), []),
        ((3.1, 3.0), DISCS),
        ((2.0, 3.4), [*DISCS, {"position": [2.0, 5.0], "radius_m": 0.7}]),
        ((14.0, 14.0), [{"position": [14.0, 14.0], "radius_m": 3.5}]),
        ((30.0, 30.0), [{"position": [30.0, 30.0], "radius_m": 9.0}]),
    ],
)
def test_where_it_does_not_fit_it_is_put_as_near_as_it_fits(wanted, discs):
    hunted, states = moved_to(wanted, obstacles=discs)
    state = states[3]
    assert overlapping(state.positions, hunted.radii, 5) == []
    off = dist(state.positions[4], wanted)
    # The places tried are about 0.09 m apart.
    assert off <= nearest_free(hunted, state, wanted) + 0.1


def test_a_silent_robots_packets_are_lost_in_its_ticks_and_no_others():
    hunted = arena("events=[{kind='silence', tick=2, ticks=3, robot='r2'}]")
    state = engine.initial(hunted)
    for tick in range(8):
        state, (fates, _) = engine.advance(hunted, state, np.zeros((4, 2)), packets(tick))
        causes = {CAUSES[-f] for f in fates[fates < 0].tolist()}
        if 2 <= tick < 5:
            assert causes == {"sender-silent", "receiver-silent"}
            assert (fates < 0).sum() == 6
            assert (fates[1] < 0).sum() == (fates[:, 1] < 0).sum() == 3
        else:
            assert causes == set()


def test_a_robot_without_a_packet_sends_nothing_and_the_others_as_before():
    changes = (
        "channel.loss={model='burst', rate=0.3, burst_packets=3}",
        "channel.delay={model='exponential', mean_s=0.2}",
        "channel.duplication.rate=0.3",
    )
    hunted = arena(*changes)
    silent, spoken = engine.initial(hunted), engine.initial(hunted)
    for tick in range(30):
        some = [p if (tick + k) % 3 else None for k, p in enumerate(packets(tick))]
        silent, fates = engine.advance(hunted, silent, np.zeros((4, 2)), some)
        spoken, before = engine.advance(hunted, spoken, np.zeros((4, 2)), packets(tick))
        for k, packet in enumerate(some):
            for found, full in zip(fates, before, strict=True):
                assert (found[k] == (0 if packet is None else full[k])).all()
        inboxes = [set(o.inbox) for o in engine.observe(hunted, silent)]
        assert all(packet is not None for inbox in inboxes for packet in inbox)


@pytest.mark.parametrize("seed", range(12))
def test_what_was_foreseen_is_what_happens_whoever_then_sends(seed):
    scenario = scenario_of(seed)
    hunted = engine.build(scenario, scenario.seed)
    count, state = len(hunted.ids), engine.initial(hunted)
    draws = np.random.default_rng(seed)
    foreseen_ticks = 0
    for tick in range(30):
        some = [None if draws.random() < 0.02 else packet for packet in packets(tick, count)]
        lost = draws.random(count) < 0.5 if draws.random() < 0.1 else None
        if lost is not None:
            some = [None if away else packet for packet, away in zip(some, lost, strict=True)]
        given = (hunted, state, draws.normal(0.0, 0.1, (count, 2)), some, 0, lost)
        foreseen = engine.foresee(hunted, state)
        assert (foreseen is None) == hunted.channel.rated
        after, fates = engine.advance(*given)
        again, same = engine.advance(*given, foreseen)
        assert (again.positions == after.positions).all()
        assert repr(again.channel_state) == repr(after.channel_state)
        assert repr(same) == repr(fates)
        foreseen_ticks += foreseen is not None and same is foreseen.fates
        state = after
    assert hunted.channel.rated or foreseen_ticks > 5


def test_a_copy_is_delivered_besides_its_packet_with_the_same_bytes():
    hunted = arena("channel.duplication.rate=1.0", "channel.delay.mean_s=0.2")
    state = engine.initial(hunted)
    for tick in range(6):
        inbox = engine.observe(hunted, state)[0].inbox
        sent = [p for p in packets(tick - 2)[1:] for _ in (0, 1)] if tick >= 2 else []
        assert sorted(inbox) == sorted(sent)
        state, _ = engine.advance(hunted, state, np.zeros((4, 2)), packets(tick))


def test_who_is_in_range_is_asked_where_the_robots_are_as_they_send():
    # r1 walks away from the others, who stand still, at 0.3 m a tick.
    hunted = arena("channel.loss={model='range', cutoff_m=9.0}", target={"position": [0.0, 9.0]})
    steps = np.array([[0.3, 0.0], *[[0.0, 0.0]] * 3])
    state = engine.initial(hunted)
    for tick in range(12):
        places = state.positions[:4]
        state, (due, _) = engine.advance(hunted, state, steps, packets(tick))
        for s in range(4):
            for r in range(4):
                if s != r:
                    far = dist(places[s], places[r]) > 9.0
                    assert due[s, r] == (-5 if far else tick + 1)
    assert (due < 0).any()


def test_packets_arrive_when_the_radio_said_in_the_order_sent_with_their_bytes():
    hunted = arena(
        "channel.delay={model='uniform', low_s=0.0, high_s=0.6}",
        "channel.loss={model='bernoulli', rate=0.3}",
    )
    state, expected = engine.initial(hunted), {}
    for tick in range(40):
        for robot, observation in enumerate(engine.observe(hunted, state)):
            assert observation.tick == tick
            due = sorted(expected.pop((tick, robot), []))
            assert list(observation.inbox) == [packets(sent)[sender] for sent, sender in due]
        state, (fates, _) = engine.advance(hunted, state, np.zeros((4, 2)), packets(tick))
        for sender, receiver in np.argwhere(fates > 0).tolist():
            due = int(fates[sender, receiver])
            assert due > tick
            expected.setdefault((due, receiver), []).append((tick, sender))


def test_an_observation_is_what_is_in_range_and_in_sight_in_robot_order():
    wall = [{"position": [0.0, 2.0], "radius_m": 0.5}]
    hunted = arena(
        "team.sensing_range_m=6.0", team={"positions": [*SQUARE, [9.5, 0.0]]}, obstacles=wall
    )
    observations = engine.observe(hunted, engine.initial(hunted))
    seen = {o.robot: [name for name, _, _ in o.seen] for o in observations}
    assert seen == {
        "r1": ["r2", "r4", "r5"],
        "r2": ["r1", "r3"],
        "r3": ["r2", "r4"],
        "r4": ["r1", "r3"],
        "r5": ["r1"],
    }
    assert [o.target for o in observations] == [(0.0, 0.0), None, (0.0, 0.0), (0.0, 0.0), None]
    assert observations[4].seen == (("r1", 4.0, 0.0),)
    assert [o.position for o in observations] == [*SQUARE, (9.5, 0.0)]
    assert observations[1].scan[18] == 1.5  # straight down, to the obstacle
