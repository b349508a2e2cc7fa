"""Robots of one team with steps and sensing ranges of their own."""

import numpy as np
import pytest
from helpers_world import SQUARE, arena, overlapping, small
from hypothesis import given
from hypothesis import strategies as st

from encircle.protocol.messages import QUANTUM_M
from encircle.world.arena import engine

PACKETS = [b"a", b"b", b"c", b"d"]


def singles(key, values):
    return [f"team.robots.r{k + 1}.{key}={v}" for k, v in enumerate(values) if v is not None]


@pytest.mark.parametrize("motion", ["holonomic", "unicycle"])
def test_each_robot_goes_as_far_as_it_can(motion):
    own = (0.1, None, 0.7, 0.01)
    hunted = arena(
        *singles("step_m_max", own), f"team.motion={motion}", "team.turn_rad_max=3.1415926"
    )
    # Apart from each other, so that none is in another's way.
    steps = np.array(SQUARE) * 2.0
    before = engine.initial(hunted)
    after, _ = engine.advance(hunted, before, steps, PACKETS)
    moved = np.hypot(*(after.positions[:4] - before.positions[:4]).T)
    np.testing.assert_allclose(moved, [0.1, 0.3, 0.7, 0.01], atol=2 * QUANTUM_M)


def test_each_robot_sees_as_far_as_it_can():
    """All are 4 m from the target, and 5.66 m or 8 m from each other."""
    hunted = arena(*singles("sensing_range_m", (3.9, 4.1, 5.7, None)), "team.sensing_range_m=9.0")
    observations = engine.observe(hunted, engine.initial(hunted))
    assert [o.target is not None for o in observations] == [False, True, True, True]
    seen = [[robot for robot, _, _ in o.seen] for o in observations]
    assert seen == [[], [], ["r2", "r4"], ["r1", "r2", "r3"]]
    assert [max(o.scan) for o in observations] == pytest.approx([3.9, 4.1, 5.7, 9.0], abs=1e-6)


@given(
    st.lists(st.floats(0.01, 2.0), min_size=4, max_size=4),
    st.floats(0.01, 2.0),
    st.sampled_from(["holonomic", "unicycle"]),
    st.integers(0, 2**32),
)
def test_bodies_of_unequal_steps_never_overlap_nor_go_farther_than_each_can(
    own, of_target, motion, seed
):
    scenario = small(
        *singles("step_m_max", own),
        f"target.step_m_max={of_target}",
        f"team.motion={motion}",
        "target.behaviour=gap",
        obstacles=[{"position": [2.0, 2.0], "radius_m": 0.5}],
    )
    hunted = engine.build(scenario, seed)
    state, draws = engine.initial(hunted), np.random.default_rng(seed)
    for _ in range(25):
        # Towards the target, with detours: they meet there.
        target, places = state.positions[4], state.positions[:4]
        wanted = target - places + draws.normal(0.0, 0.5, (4, 2))
        after, _ = engine.advance(hunted, state, wanted, PACKETS)
        assert overlapping(after.positions, hunted.radii, 5) == []
        moved = np.hypot(*(after.positions - state.positions)[:5].T)
        assert (moved - 64 * QUANTUM_M <= [*own, of_target]).all()
        state = after
