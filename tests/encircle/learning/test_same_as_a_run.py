"""An episode is the run of the policy that does the same: the digests are equal."""

import pytest
from helpers_learning import NAME, POLICY, mixed, played, run_of
from helpers_scenarios import scenario_of

from encircle.learning import parallel_env
from encircle.world.loading.load import load

SEEDS = range(24)
NIGHTLY_SEEDS = range(5_000, 5_400)
LOSSY = {
    "ticks_max": 60,
    "team": {"robots": 3, "strategy": NAME},
    "target": {"step_m_max": 0.27},
    "sensing": {"noise_m_std": 0.05},
    "channel": {
        "loss": {"model": "bernoulli", "rate": 0.5},
        "delay": {"model": "gamma", "mean_s": 0.3, "std_s": 0.2},
    },
}


@pytest.fixture(autouse=True)
def policy_file(tmp_path, monkeypatch):
    (tmp_path / "mixing.py").write_text(POLICY)
    monkeypatch.setenv("ENCIRCLE_POLICIES", str(tmp_path))


def drawn(seed):
    """A scenario drawn at random, most of whose robots have the policy."""
    tree = scenario_of(seed).model_dump(mode="json", exclude_unset=True)
    tree["team"] |= {"strategy": NAME, "policy_parameters": {}}
    return load(tree)


def assert_same(scenario, seed):
    mixing = [robot for robot in scenario.ids if scenario.strategy_of(robot) == NAME]
    if not mixing:
        return
    _, _, terminated, truncated, infos = played(scenario, seed, mixing)
    hunt = run_of(scenario, seed)
    for agent in mixing:
        assert infos[agent]["digest"] == hunt.digest
        assert infos[agent]["tick"] == hunt.result.ticks
        assert infos[agent]["captured"] == terminated[agent] == hunt.captured
        assert truncated[agent] != terminated[agent]


def test_under_loss_and_delay_an_episode_has_the_digest_of_the_run():
    assert_same(load(LOSSY), 7)


def test_another_action_at_one_tick_is_another_run():
    env = parallel_env(LOSSY, payload=3, scan=True)
    observations, _ = env.reset(seed=7)
    infos = {}
    while env.agents:
        actions = {agent: mixed(observations[agent]) for agent in env.agents}
        if infos.get("r2", {}).get("tick") == 5:
            actions["r2"][4] = -actions["r2"][4]
        observations, _, _, _, infos = env.step(actions)
    assert infos["r2"]["digest"] != run_of(LOSSY, 7).digest


@pytest.mark.parametrize("seed", SEEDS)
def test_so_it_is_in_any_scenario(seed):
    assert_same(drawn(seed), seed)


@pytest.mark.nightly
@pytest.mark.parametrize("first", NIGHTLY_SEEDS[::50])
def test_so_it_is_in_many_more(first):
    for seed in range(first, first + 50):
        assert_same(drawn(seed), seed)
