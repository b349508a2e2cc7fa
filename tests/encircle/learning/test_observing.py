"""What each number of an observation is, held against views made by hand."""

from math import sqrt

import numpy as np
import pytest

from encircle.agents.estimation.kalman import Estimate
from encircle.agents.policies.interface import Decision, View
from encircle.learning import Layout, decision, observation
from encircle.learning.acting import spoken, told_as
from encircle.learning.observing import BOUND, MASK, others_of
from encircle.protocol.messages import Pose
from encircle.protocol.parameters import Parameters
from encircle.protocol.wire.payload import payload

TEAM = ("r1", "r2", "r3", "r4")
PARAMETERS = Parameters(sensing_range_m=5.0, step_m_max=0.4, peer_age_ticks_max=20)


def pose_of(robot, tick, say):
    return Pose(
        robot, tick, tick, (0.0, 0.0), (0.0, 0.0), None, "learned", None, None, say=payload(say)
    )


def view_of(**changes):
    """The view of r3 at tick 10: r4 seen now, r1 known by a packet of tick 5, r2 unknown."""
    known = ((5, 1.0, 1.0, 0.2, -0.1), None, (10, 2.0, 1.0, 0.0, 0.0), (10, 7.0, 1.0, 0.0, 0.4))
    view = View(
        tick=10,
        tick_s=0.1,
        robot="r3",
        team=TEAM,
        position=(2.0, 1.0),
        own=1,
        positions=((2.0, 0.5), (2.0, 1.0), (7.0, 1.0)),
        target=Estimate(4.5, -1.5, 2.0, -1.0, (0.25, 0.2, 4.0)),
        predict=lambda _grid: None,
        parameters=PARAMETERS,
        last_step=(0.1, -0.4),
        members=(0, 2, 3),
        target_age_ticks=3,
        scan=(5.0, 2.5),
        seen=(("r4", 7.0, 1.0),),
        known=known,
        packets=(pose_of("r1", 5, {"learned": bytes([127, 129])}), None, None, None),
    )
    return view._replace(**changes)


def numbers_of(view, **options):
    layout = Layout(4, options.get("payload", 0), len(view.scan) if options.get("scan") else 0)
    seen = observation(view, **options)
    assert seen.shape == (layout.size,)
    assert seen.dtype == np.float32
    return dict(zip([field.name for field in layout.fields()], seen.tolist(), strict=True))


def assert_numbers(numbers, **wanted):
    for name, value in wanted.items():
        assert numbers[name] == pytest.approx(value, abs=1e-6), name


def test_itself_and_the_target_in_named_scales():
    assert_numbers(
        numbers_of(view_of()),
        present=1.0,
        step_x=0.25,
        step_y=-1.0,
        target_known=1.0,
        target_x=0.5,
        target_y=-0.5,
        target_vx=0.5,
        target_vy=-0.25,
        target_age=3 / 30,
        target_std=0.5 / 5.0,
        target_v_std=2.0 / 4.0,
        target_correlation=0.2 / sqrt(0.25 * 4.0),
    )


def test_peers_begin_with_the_next_one_and_go_round():
    numbers = numbers_of(view_of())
    r4, r1, r2 = ("peer1_", "peer2_", "peer3_")
    assert_numbers(numbers, **{f"{r4}known": 1.0, f"{r4}x": 1.0, f"{r4}y": 0.0, f"{r4}age": 0.0})
    assert_numbers(numbers, **{f"{r4}vx": 0.0, f"{r4}vy": 1.0, f"{r4}seen": 1.0})
    assert_numbers(numbers, **{f"{r1}known": 1.0, f"{r1}x": 0.0, f"{r1}y": -0.1})
    assert_numbers(numbers, **{f"{r1}vx": 0.5, f"{r1}vy": -0.25, f"{r1}age": 0.25})
    assert_numbers(numbers, **{f"{r1}seen": 0.0})
    assert all(value == 0.0 for name, value in numbers.items() if name.startswith(r2))
    assert others_of("r1", TEAM) == (1, 2, 3)
    assert others_of("r4", TEAM) == (0, 1, 2)


def test_what_peers_told_comes_with_its_age_and_mask():
    numbers = numbers_of(view_of(), payload=2)
    assert_numbers(numbers, peer2_said=1.0, peer2_said_age=0.25, peer2_told0=1.0, peer2_told1=-1.0)
    assert_numbers(numbers, peer1_said=0.0, peer1_told0=0.0)
    assert_numbers(numbers_of(view_of(), payload=3), peer2_said=0.0, peer2_told0=0.0)


@pytest.mark.parametrize("say", [{"learned": 5}, {"learned": "ab"}, {"other": b"ab"}, {}])
def test_what_a_stranger_says_is_nothing(say):
    packets = (pose_of("r1", 5, say), None, None, None)
    assert_numbers(numbers_of(view_of(packets=packets), payload=2), peer2_said=0.0)


def test_the_scan_comes_last():
    assert observation(view_of(), scan=True)[-2:].tolist() == [1.0, 0.5]


def test_without_an_estimate_the_target_is_masked():
    numbers = numbers_of(view_of(target=None, target_age_ticks=None))
    assert all(value == 0.0 for name, value in numbers.items() if name.startswith("target"))


def test_nothing_is_beyond_the_bound():
    far = view_of(target=Estimate(1e9, -1e9, 0.0, 0.0, (1e12, 0.0, 0.0)))
    seen = observation(far)
    assert np.abs(seen).max() == BOUND
    assert numbers_of(far)["target_correlation"] == 0.0


def test_the_layout_says_its_scales_and_names_each_number_once():
    fields = list(Layout(4, 2, 3).fields())
    assert len({field.name for field in fields}) == len(fields) == Layout(4, 2, 3).size
    for field in fields:
        names = field.scale.replace("tick_s", "").replace("/", " ").split()
        assert field.scale in (MASK, "1") or all(hasattr(PARAMETERS, name) for name in names)


def test_an_action_is_a_step_in_the_longest_ones():
    assert decision(view_of(), [0.5, -1.0]) == Decision("learned", (0.2, -0.4), (2.2, 0.6))


def test_a_searching_robot_searches_and_still_tells():
    search = Decision("search", (0.3, 0.0), (9.0, 9.0))
    view = view_of(target=None, search=search)
    assert decision(view, [1.0, 1.0]) == search
    assert decision(view, [1.0, 1.0, -1.0]).say == {"learned": bytes([129])}
    assert decision(view, [1.0, 1.0], searches=False).mode == "learned"


@pytest.mark.parametrize("number", [-1.0, -0.5, 0.0, 1 / 127, 0.999, 1.0])
def test_a_number_told_comes_back_as_the_nearest_level(number):
    (back,) = spoken(told_as([number]), 1)
    assert abs(back - number) <= 0.5 / 127 + 1e-12
    assert spoken({"learned": bytes([128])}, 1) == [-1.0]
