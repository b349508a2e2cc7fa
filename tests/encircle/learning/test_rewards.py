"""The reward, held against what its formula gives by hand, and against what shaping must not do."""

from math import pi

import numpy as np
import pytest

from encircle.learning import Reward, parallel_env
from encircle.learning.rewards import measures_of
from encircle.world.arena import engine
from encircle.world.loading.load import load


def state_of(positions, **more):
    scene = {"team": {"positions": positions}, "target": {"behaviour": "still"}, **more}
    arena = engine.build(load(scene), 1)
    return arena, engine.initial(arena)


def test_four_around_it_have_no_gap_too_wide_and_their_mean_distance_counts():
    """Sensing range 6 m, stop distance 1.3 m."""
    near, around = measures_of(*state_of([[7.3, 0], [0, 4.3], [-4.3, 0], [0, -1.3]]))
    assert near == pytest.approx((6.0 + 3.0 + 3.0 + 0.0) / 4 / 6.0, abs=1e-6)
    assert around == pytest.approx(0.0, abs=1e-6)


def test_all_on_one_side_is_the_widest_gap():
    _, around = measures_of(*state_of([[3.0, 0.0], [6.0, 0.0], [9.0, 0.0]]))
    assert around == pytest.approx(1.0, abs=1e-6)
    half = measures_of(*state_of([[3.0, 0.0], [0.0, 3.0], [-3.0, 0.0]]))[1]
    assert half == pytest.approx((pi - 2 * pi / 3) / (2 * pi - 2 * pi / 3), abs=1e-6)


def test_only_those_that_a_capture_takes_count_for_the_distance():
    arena, state = state_of([[4.3, 0], [0, 4.3], [-30.0, 0]], capture={"count": 2})
    assert measures_of(arena, state)[0] == pytest.approx(3.0 / 6.0, abs=1e-6)


def test_a_lost_robot_counts_for_nothing():
    arena, state = state_of([[4.3, 0], [0, 4.3], [-30.0, 0]])
    lost = state._replace(away=np.array([0, 0, 5]))
    assert measures_of(arena, lost)[0] == pytest.approx(3.0 / 6.0, abs=1e-6)
    assert measures_of(arena, state._replace(away=np.array([1, 1, 1]))) == (1.0, 1.0)


def test_one_robot_leaves_the_whole_turn_open():
    arena, state = state_of([[4.3, 0.0], [0.0, 9.0]])
    assert measures_of(arena, state._replace(away=np.array([0, 1])))[1] == 1.0


WEIGHTS = {"capture": 3.0, "tick": 0.25, "near": 0.7, "around": 1.3, "discount": 0.9}


@pytest.mark.parametrize("captured", [True, False])
def test_shaping_adds_to_a_return_what_the_start_alone_decides(captured):
    """The discounted sum of the shaping is -Phi(start), but for what a truncated end still has."""
    places = [[3.0, 0.0], [-1.5, 2.6], [-1.5, -2.6]]
    scene = {"team": {"positions": places}, "target": {"behaviour": "still"}, "ticks_max": 12}
    env = parallel_env(scene, reward=WEIGHTS)
    env.reset(seed=1)
    weights, arena = env.settings.reward, env.world.arena
    start, shaped, unshaped, factor = weights.potential(arena, env.world.state), 0.0, 0.0, 1.0
    while env.agents:
        places = env.world.state.positions
        inward = {agent: -places[k] / np.hypot(*places[k]) for k, agent in enumerate(env.agents)}
        actions = inward if captured else dict.fromkeys(env.agents, (0.0, 0.0))
        _, _, terminated, _, infos = env.step(actions)
        parts = infos["r1"]["reward"]
        shaped += factor * parts["shaping"]
        unshaped += factor * (parts["capture"] + parts["tick"])
        factor *= weights.discount
    end = weights.potential(arena, env.world.state)
    assert terminated["r1"] == captured
    assert shaped == pytest.approx(factor * end - start)
    ticks = infos["r1"]["tick"]
    costs = 0.25 * (1 - 0.9**ticks) / (1 - 0.9)
    assert unshaped == pytest.approx((3.0 * 0.9 ** (ticks - 1) if captured else 0.0) - costs)
    assert end == (0.0 if captured else start)


def test_a_potential_of_no_weight_is_no_shaping():
    env = parallel_env({"team": {"robots": 3}}, reward=Reward(near=0.0, around=0.0))
    env.reset(seed=1)
    rewards = env.step(dict.fromkeys(env.agents, (0.5, 0.5)))[1]
    assert set(rewards.values()) == {0.0}
