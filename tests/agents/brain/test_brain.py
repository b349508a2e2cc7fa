"""The brain as a pure function: what it knows, from whom, how long, and what it does with it."""

import pickle
from dataclasses import replace
from math import cos, hypot, sin

import pytest
from helpers_agents import (
    TEAM,
    TICK_S,
    config,
    observation,
    pose,
    ring_of_rays,
    run_actions,
    run_brain,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.agents.brain.brain import act, initial, perceive, step
from encircle.agents.policies.interface import Decision
from encircle.agents.policies.registry import policy_named
from encircle.protocol.messages import QUANTUM_M, Observation
from encircle.protocol.parameters import Parameters
from encircle.protocol.plugins import SHIPPED_POLICIES

CHEAP = settings(max_examples=60, deadline=None, derandomize=True)
P = Parameters()
coordinates = st.floats(-12.0, 12.0)
places = st.tuples(coordinates, coordinates)


@st.composite
def situations(draw, tick=12):
    """A robot's observation at a tick, and packets from its peers at several earlier ones."""
    near = st.lists(st.tuples(places, st.floats(0.1, 1.0)), max_size=3)
    discs = [(x, y, radius) for (x, y), radius in draw(near)]
    own = draw(places)
    seen = [(robot, *draw(places)) for robot in TEAM[1:] if draw(st.booleans())]
    sensed = observation(
        tick=tick,
        position=own,
        target=draw(st.none() | places),
        seen=tuple(seen),
        scan=ring_of_rays(own, discs, 24),
    )
    senders = st.tuples(st.sampled_from(TEAM[1:]), st.integers(0, tick - 1))
    packets = [
        pose(robot, sent, draw(places), draw(places), draw(st.none() | places))
        for robot, sent in draw(st.lists(senders, max_size=10, unique=True))
    ]
    return sensed, packets


def state_at(part, tick):
    """A brain that has lived up to a tick, with its target in sight now and then."""
    lived = [
        observation(tick=t, position=(0.1 * t, 0.0), target=(5.0, 0.2 * t) if t % 3 == 0 else None)
        for t in range(tick)
    ]
    return run_brain(part, lived, None)[0]


@CHEAP
@given(situations(), st.sampled_from(sorted(SHIPPED_POLICIES)))
def test_the_same_inputs_give_the_same_outputs_and_stay_as_they_are(situation, name):
    sensed, packets = situation
    part = config(policy_named(name))
    state = state_at(part, 12)
    before = pickle.dumps((state, sensed, packets))
    first = step(state, sensed, packets, part)
    assert step(state, sensed, packets, part) == first
    assert pickle.dumps((state, sensed, packets)) == before


@CHEAP
@given(situations(), st.data())
def test_the_order_and_number_of_copies_of_packets_do_not_matter(situation, data):
    sensed, packets = situation
    part = config()
    state = state_at(part, 12)
    again = [p for p in packets if data.draw(st.booleans())]
    shuffled = data.draw(st.permutations(packets + again))
    assert step(state, sensed, shuffled, part) == step(state, sensed, packets, part)


def test_of_two_packets_of_one_robot_and_tick_the_lower_sequence_counts_in_any_order():
    strategy, views = spy()
    first = pose("r2", 0, (5.0, 5.0), detection=(4.0, 0.0))
    second = replace(first, sequence=1, position=(7.0, 7.0), detection=(3.0, 0.0))
    commands = []
    for packets in ([first, second], [second, first]):
        heard = packets_at(1, *packets)
        commands.append(run_brain(config(strategy), waiting(2), heard)[1][-1])
    assert views[0].positions == views[1].positions
    assert views[0].positions[1] == (5.0, 5.0)
    assert commands[0] == commands[1]


@CHEAP
@given(situations(), st.sampled_from(sorted(SHIPPED_POLICIES)))
def test_no_step_is_longer_than_the_robot_can_make(situation, name):
    sensed, packets = situation
    part = config(policy_named(name))
    _, action = step(state_at(part, 12), sensed, packets, part)
    # Rounding to the wire's resolution may add up to one quantum.
    assert hypot(*action.command.step) <= P.step_m_max + QUANTUM_M


@CHEAP
@given(st.tuples(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3)), st.floats(0.01, 2.0))
def test_whatever_a_strategy_wants_is_shortened_and_keeps_its_direction(wanted, longest):
    part = config(always("leap", wanted), step_m_max=longest)
    _, commands = run_brain(part, [observation(target=(500.0, 0.0))], None)
    scale = min(1.0, longest / max(hypot(*wanted), 1e-12))
    expected = (wanted[0] * scale, wanted[1] * scale)
    assert commands[0].step == pytest.approx(expected, abs=QUANTUM_M)
    assert [(c * 2**20).is_integer() for c in commands[0].step] == [True, True]


def always(mode, step, **others):
    """A strategy that always wants the same."""
    return lambda memory, view: (memory, Decision(mode, step, (0.0, 0.0), **others))


def spy():
    """A strategy that notes the views it is given of a target."""
    views = []

    def strategy(memory, view):
        if view.target is not None:
            views.append(view)
        return memory, view.search or Decision("spy", (0.0, 0.0), view.target.position)

    return strategy, views


def packets_at(tick, *packets):
    return lambda now: list(packets) if now == tick else []


def waiting(ticks, target=None):
    return [observation(tick=tick, target=target) for tick in range(ticks)]


@pytest.mark.parametrize(("policy", "place"), [("hold", (5.0, 5.0)), ("extrapolate", (7.0, 4.0))])
def test_a_stale_peer_is_planned_for_as_the_policy_says(policy, place):
    strategy, views = spy()
    part = config(strategy, peer_policy=policy)
    heard = packets_at(3, pose("r3", 0, (5.0, 5.0), (4.0, -2.0)))
    run_brain(part, waiting(6, target=(4.0, 0.0)), heard)
    # Sent at tick 0 with 4 m/s, read at tick 5: half a second later.
    assert views[-1].positions[1] == pytest.approx(place)


def test_a_peer_not_heard_of_for_longer_than_the_limit_is_planned_without():
    part = config(peer_age_ticks_max=5)
    heard = packets_at(2, pose("r3", 1), pose("r2", 0))
    _, commands = run_brain(part, waiting(9, target=(4.0, 0.0)), heard)
    teams = [command.team for command in commands]
    assert teams[:2] == [("r1",)] * 2
    assert teams[2:6] == [("r1", "r2", "r3")] * 4
    assert teams[6] == ("r1", "r3")
    assert teams[7:] == [("r1",)] * 2


def test_an_even_older_peer_in_sight_belongs_to_the_team():
    part = config(peer_age_ticks_max=5)
    seen = replace(observation(tick=9, target=(4.0, 0.0)), seen=(("r4", 3.0, 3.0),))
    _, action = step(state_at(part, 9), seen, [], part)
    assert action.command.team == ("r1", "r4")


@pytest.mark.parametrize("search", ["hold", "spiral"])
def test_before_anything_is_known_of_the_target_the_robot_searches(search):
    _, commands = run_brain(config(search=search), waiting(5), None)
    assert {command.mode for command in commands} == {"search"}
    assert all(c.estimate is c.xi is c.point is c.predictor is None for c in commands)
    lengths = [hypot(*command.step) for command in commands]
    assert (max(lengths) == 0.0) if search == "hold" else (min(lengths) > 0.2)


def test_robots_that_search_from_one_place_go_apart():
    steps = [
        run_brain(config(robot=robot), [observation(robot)], None)[1][0].step for robot in TEAM
    ]
    total = (sum(x for x, _ in steps), sum(y for _, y in steps))
    assert total == pytest.approx((0.0, 0.0), abs=4 * QUANTUM_M)
    assert len(set(steps)) == len(TEAM)


@pytest.mark.parametrize("silent_ticks", [1, 20, 40, 100])
def test_a_target_heard_of_only_through_a_peer_is_tracked(silent_ticks):
    heard = packets_at(silent_ticks, pose("r2", silent_ticks - 1, detection=(8.0, 9.0)))
    _, commands = run_brain(config(), waiting(silent_ticks + 1), heard)
    assert commands[-2].mode == "search"
    assert commands[-1].mode == "encircle"
    assert commands[-1].estimate == pytest.approx((8.0, 9.0))


@pytest.mark.parametrize("silent_ticks", [0, 20, 40, 100])
def test_a_target_that_comes_into_sight_after_any_search_is_tracked(silent_ticks):
    sensed = [*waiting(silent_ticks), observation(tick=silent_ticks, target=(4.0, 0.0))]
    _, commands = run_brain(config(), sensed, None)
    assert commands[-1].mode == "encircle"
    assert commands[-1].estimate == (4.0, 0.0)


def test_a_target_lost_for_longer_than_the_limit_is_searched_for_anew():
    part = config(track_age_ticks_max=6)
    sensed = [observation(tick=t, target=(4.0, 0.0) if t == 2 else None) for t in range(12)]
    _, commands = run_brain(part, sensed, None)
    modes = [command.mode for command in commands]
    assert modes == ["search"] * 2 + ["encircle"] * 7 + ["search"] * 3


def test_a_new_search_begins_where_the_robot_is_then():
    part = config(track_age_ticks_max=3, search="hold")
    sensed = [
        observation(tick=t, position=(float(t), 0.0), target=(9.0, 0.0) if t == 2 else None)
        for t in range(9)
    ]
    _, commands = run_brain(part, sensed, None)
    assert [command.goal for command in commands[:2]] == [(0.0, 0.0)] * 2
    assert [command.goal for command in commands[-3:]] == [(6.0, 0.0)] * 3


def test_a_lost_target_that_is_seen_again_is_tracked_again():
    part = config(track_age_ticks_max=6)
    seen_at = {2: (4.0, 0.0), 40: (-3.0, 1.0)}
    sensed = [observation(tick=t, target=seen_at.get(t)) for t in range(42)]
    _, commands = run_brain(part, sensed, None)
    assert commands[39].mode == "search"
    assert commands[40].mode != "search"
    assert commands[40].estimate == (-3.0, 1.0)


def test_the_detections_of_all_are_used_together():
    heard = packets_at(1, pose("r2", 0, detection=(4.0, 2.0)), pose("r3", 0, detection=(4.0, 4.0)))
    _, commands = run_brain(config(), waiting(2), heard)
    assert commands[-1].estimate == pytest.approx((4.0, 3.0))


def test_a_detection_said_to_be_of_now_or_later_is_not_believed():
    heard = packets_at(1, pose("r2", 1, detection=(4.0, 2.0)), pose("r3", 5, detection=(4.0, 4.0)))
    _, commands = run_brain(config(), waiting(2), heard)
    assert commands[-1].mode == "search"


def test_the_pose_tells_position_velocity_and_the_own_detection_only():
    part = config()
    state, _ = run_brain(part, [observation(position=(1.0, 1.0))], None)
    sensed = observation(tick=1, position=(1.2, 0.9))
    heard = [pose("r2", 0, detection=(4.0, 2.0))]
    _, (told, command) = step(state, sensed, heard, part)
    assert (told.robot, told.tick, told.position) == ("r1", 1, (1.2, 0.9))
    assert told.velocity == pytest.approx((0.2 / TICK_S, -0.1 / TICK_S))
    assert told.detection is None, "a peer's detection is not passed on as one's own"
    assert command.estimate == pytest.approx((4.0, 2.0))
    assert (told.mode, told.xi, told.point) == (command.mode, command.xi, command.point)


def test_a_silent_tick_has_a_command_and_is_lived_like_any_other():
    loud, quiet = config(), config(publish_every_ticks=5)
    sensed = [observation(tick=t, position=(0.1 * t, 0.0), target=(5.0, 0.2 * t)) for t in range(9)]
    heard = packets_at(3, pose("r2", 2, detection=(5.0, 0.5)))
    (state, said), (quiet_state, rarely) = [
        run_actions(part, sensed, heard) for part in (loud, quiet)
    ]
    assert quiet_state == state
    for tick, (action, other) in enumerate(zip(rarely, said, strict=True)):
        assert action.pose == (other.pose if tick in (0, 5) else None)
        assert action.command == replace(other.command, published=tick in (0, 5))


def test_the_velocity_told_is_that_of_the_last_tick_whenever_the_last_packet_was():
    sensed = [observation(tick=t, position=(0.1 * t * t, 0.0)) for t in range(4)]
    _, actions = run_actions(config(publish_every_ticks=3), sensed)
    assert actions[3].pose.velocity == pytest.approx((0.5 / TICK_S, 0.0))


def test_a_strategy_is_told_the_encirclement_point_it_chose_last():
    views = []
    points = iter([0, 3, None, 2])

    def strategy(memory, view):
        views.append(view)
        return memory, Decision("ring", (0.0, 0.0), (1.5, 2.0 * len(views)), 0.0, next(points))

    run_brain(config(strategy), waiting(4, target=(4.0, 0.0)), None)
    assert [view.previous_goal for view in views] == [None, (1.5, 2.0), (1.5, 4.0), None]


def test_a_point_headed_for_is_forgotten_when_the_target_is_lost():
    strategy, views = spy()
    part = config(
        lambda memory, view: (None, replace_point(strategy(memory, view)[1], view)),
        track_age_ticks_max=2,
    )
    seen_at = {0: (4.0, 0.0), 6: (4.0, 0.0)}
    run_brain(part, [observation(tick=t, target=seen_at.get(t)) for t in range(8)], None)
    assert [view.previous_goal is None for view in views] == [True, False, False, True, False]


def replace_point(choice, view):
    return choice if view.target is None else choice._replace(point=1)


def test_the_first_pose_has_no_velocity_and_sequences_go_up_by_one():
    state, sent = initial(config()), []
    for tick in range(3):
        state, action = step(state, observation(tick=tick, target=(3.0, 3.0)), [], config())
        sent.append(action.pose)
    assert sent[0].velocity == (0.0, 0.0)
    assert [told.sequence for told in sent] == [0, 1, 2]
    assert sent[0].detection == (3.0, 3.0)


def test_robots_in_sight_and_walls_are_kept_clear_of():
    part = config(always("ahead", (0.3, 0.0)))
    ahead = observation(target=(50.0, 0.0), seen=(("r2", 1.3, 0.0),))
    walled = observation(target=(50.0, 0.0), scan=ring_of_rays((0, 0), [(1.2, 0.0, 0.5)], 24))
    for sensed in (ahead, walled):
        _, commands = run_brain(part, [sensed], None)
        assert hypot(1.2 - commands[0].step[0], commands[0].step[1]) >= 1.0


def test_four_robots_that_hear_each_other_close_in_on_a_target_that_stands():
    target, positions = (3.0, 2.0), [(-2.0, 0.0), (5.0, -6.0), (9.0, 3.0), (1.0, 9.0)]
    roles = [config(robot=robot) for robot in TEAM]
    states, told = [initial(part) for part in roles], []
    for tick in range(80):
        actions = []
        for k, (robot, place) in enumerate(zip(TEAM, positions, strict=True)):
            apart = hypot(place[0] - target[0], place[1] - target[1])
            sensed = Observation(
                robot, tick, place, 0.0, target if apart <= 6.0 else None, (6.0,) * 24, (), ()
            )
            heard = [p for p in told if p.robot != robot]
            states[k], action = step(states[k], sensed, heard, roles[k])
            actions.append(action)
        told = [action.pose for action in actions]
        positions = [
            (x + a.command.step[0], y + a.command.step[1])
            for (x, y), a in zip(positions, actions, strict=True)
        ]
    distances = [hypot(x - target[0], y - target[1]) for x, y in positions]
    assert max(distances) <= P.stop_distance_m + 0.01
    assert {action.command.mode for action in actions} == {"shrink"}


@pytest.mark.parametrize("bearing", [0.0, 1.0, 3.0])
def test_the_hunt_is_the_same_wherever_it_takes_place(bearing):
    target = (4.0 * cos(bearing), 4.0 * sin(bearing))
    near, far = [
        run_brain(
            config(),
            [observation(position=(s, 2 * s), target=(target[0] + s, target[1] + 2 * s))],
            None,
        )[1][0].step
        for s in (0.0, 512.0)
    ]
    assert near == pytest.approx(far, abs=4 * QUANTUM_M)


def test_by_the_clock_a_brain_that_missed_ticks_knows_what_time_it_is():
    part = config()
    state, _ = run_brain(part, [observation(tick=k, target=(3.0, 0.3 * k)) for k in range(6)], None)
    after, action = step(
        state, observation(tick=10, position=(1.0, 0.0), target=(3.0, 3.0)), [], part
    )
    # From (0, 0) at tick 5, in five ticks of 0.1 s.
    assert action.pose.velocity == pytest.approx((2.0, 0.0))
    # The target has gone on as it did, 3 m/s along y.
    assert after.track.estimate.vy == pytest.approx(3.0, abs=0.3)
    again, _ = step(after, observation(tick=11), [], part)
    assert again.track.first_tick + len(again.track.entries) == 12


@pytest.mark.parametrize("missed", [0, 1, 4])
def test_by_the_clock_the_last_step_is_one_of_a_tick(missed):
    seen = []

    def watching(memory, view):
        seen.append(view.last_step)
        return memory, Decision("watch", (0.0, 0.0), view.position)

    part = replace(config(), policy=watching)
    state, _ = run_brain(part, [observation(tick=0, position=(1.0, 2.0))], None)
    moved = (1.0 + 0.25 * (1 + missed), 2.0 - 0.125 * (1 + missed))
    step(state, observation(tick=1 + missed, position=moved), [], part)
    assert seen == [(0.0, 0.0), (0.25, -0.125)]


def test_by_the_clock_event_triggered_packets_are_due_as_if_the_ticks_had_passed():
    part = config(publish="event", publish_age_ticks_max=10)
    state, _ = run_brain(part, [observation(tick=k) for k in range(3)], None)
    for tick, due in ((9, False), (10, True)):
        assert (step(state, observation(tick=tick), [], part)[1].pose is not None) is due


@CHEAP
@given(situations())
def test_its_halves_with_the_policys_decision_between_them_are_the_step(situation):
    sensed, packets = situation
    part = config()
    state = state_at(part, 12)
    perception = perceive(state, sensed, packets, part)
    memory, decision = part.policy(state.memory, perception.view)
    assert act(perception, memory, decision, part) == step(state, sensed, packets, part)
