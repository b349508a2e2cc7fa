"""The environment as learners use it: PettingZoo's own tests, seeds, ends, losses, mistakes."""

import subprocess
import sys

import numpy as np
import pytest
from pettingzoo.test import parallel_api_test, parallel_seed_test

import encircle
from encircle.learning import Reward, parallel_env
from encircle.protocol.plugins import PluginFailed
from encircle.world.scenario.errors import ScenarioError

SCENE = {
    "ticks_max": 40,
    "team": {"robots": 3},
    "target": {"step_m_max": 0.27},
    "channel": {"loss": {"model": "bernoulli", "rate": 0.5}},
}
ALL_ROUND = [
    {},
    {"payload": 4},
    {"scan": True, "payload": 1},
    {"agents": ["r3", "r1"]},
    {"searches": False},
]
STILL = np.zeros(2)


def stills(env):
    return dict.fromkeys(env.agents, STILL)


def to_the_end(env, seed):
    env.reset(seed=seed)
    steps = []
    while env.agents:
        steps.append(env.step(stills(env)))
    return steps


@pytest.mark.parametrize("options", ALL_ROUND, ids=str)
def test_it_passes_the_test_of_the_interface(options):
    parallel_api_test(parallel_env(SCENE, **options), num_cycles=100)


@pytest.mark.parametrize("options", ALL_ROUND, ids=str)
def test_it_passes_the_test_of_seeds(options):
    parallel_seed_test(lambda: parallel_env(SCENE, **options), num_cycles=100)


@pytest.mark.parametrize("options", ALL_ROUND, ids=str)
def test_observations_lie_in_their_space(options):
    env = parallel_env(SCENE, **options)
    observations, _ = env.reset(seed=3)
    while env.agents:
        for agent, seen in observations.items():
            assert seen.dtype == np.float32
            assert seen in env.observation_space(agent)
        actions = {agent: env.action_space(agent).sample() for agent in env.agents}
        observations, *_ = env.step(actions)


def test_a_seed_is_one_hunt_and_another_is_another():
    env, again = parallel_env(SCENE), parallel_env(SCENE)
    ends = [to_the_end(e, s)[-1][4]["r1"] for e, s in ((env, 5), (again, 5), (env, 6), (env, 5))]
    digests = [end["digest"] for end in ends]
    assert digests[0] == digests[1] == digests[3] != digests[2]
    assert [end["seed"] for end in ends] == [5, 5, 6, 5]


def test_without_a_seed_hunts_go_on_counting_from_the_scenarios():
    env = parallel_env({**SCENE, "seed": 20})
    seeds = []
    for seed in (None, None, 7, None):
        env.reset(seed=seed)
        seeds.append(env.seed)
    assert seeds == [20, 21, 7, 8]


def test_at_the_time_limit_it_is_truncated_and_all_are_done_with():
    steps = to_the_end(parallel_env(SCENE), 1)
    assert len(steps) == SCENE["ticks_max"]
    for *_, terminated, truncated, infos in steps[:-1]:
        assert not any([*terminated.values(), *truncated.values()])
        assert all("digest" not in info for info in infos.values())
    observations, _, terminated, truncated, _ = steps[-1]
    assert set(terminated.values()) == {False}
    assert set(truncated.values()) == {True}
    assert all(seen[0] == 1.0 for seen in observations.values()), "the last view is there"


def test_a_capture_terminates_it():
    """Three robots stand all around a target that stands still."""
    places = [[1.29, 0.0], [-0.65, 1.1], [-0.65, -1.1]]
    scene = {"team": {"positions": places}, "target": {"behaviour": "still"}}
    scene["capture"] = {"stop_distance_m": 1.28}
    env = parallel_env(scene)
    env.reset(seed=1)
    _, rewards, terminated, truncated, infos = env.step({**stills(env), "r1": [-0.1, 0.0]})
    assert set(terminated.values()) == {True}
    assert set(truncated.values()) == {False}
    assert env.agents == []
    assert infos["r2"]["captured"]
    assert infos["r2"]["reward"]["capture"] == Reward().capture
    assert rewards["r2"] == sum(infos["r2"]["reward"].values())


def test_a_hunt_that_begins_with_a_capture_is_over_with_the_first_step():
    places = [[1.2, 0.0], [-0.6, 1.04], [-0.6, -1.04]]
    env = parallel_env({"team": {"positions": places}, "target": {"behaviour": "still"}})
    observations, infos = env.reset(seed=1)
    assert set(observations) == {"r1", "r2", "r3"}
    assert infos["r1"]["captured"]
    _, rewards, terminated, _, infos = env.step(stills(env))
    assert set(terminated.values()) == {True}
    assert rewards["r1"] == Reward().capture
    assert infos["r1"]["tick"] == 0
    assert infos["r1"]["digest"] == encircle.run(env.scenario, seed=1, link="memory").digest


def test_a_lost_robot_is_an_agent_that_knows_nothing():
    crash = {"kind": "crash", "tick": 3, "robot": "r2", "ticks": 4}
    env = parallel_env({**SCENE, "events": [crash]})
    env.reset(seed=1)
    lost = {}
    while env.agents:
        observations, _, _, _, infos = env.step(stills(env))
        info = infos["r2"]
        lost[info["tick"]] = info["lost"]
        assert observations["r2"].any() != info["lost"]
        assert not infos["r1"]["lost"]
    assert [tick for tick, so in lost.items() if so] == [3, 4, 5, 6]


def test_who_knows_nothing_of_the_target_searches_unless_told_not_to():
    far = {**SCENE, "team": {"positions": [[30.0, 0.0], [33.0, 0.0]]}}
    for searches in (True, False):
        env = parallel_env(far, searches=searches)
        env.reset(seed=1)
        for _ in range(5):
            observations, *_ = env.step(stills(env))
        moved = observations["r1"][1:3]
        assert bool(np.abs(moved).max() > 0.5) == searches


def test_a_robot_that_is_asked_for_too_much_makes_its_longest_step():
    env = parallel_env({**SCENE, "team": {"positions": [[4.0, 0.0], [0.0, 30.0]]}})
    env.reset(seed=1)
    observations, *_ = env.step({"r1": [1.0, 1.0], "r2": STILL})
    assert np.hypot(*observations["r1"][1:3]) == pytest.approx(1.0, abs=1e-5)


def test_the_state_is_of_one_size_and_tells_places():
    env = parallel_env({**SCENE, "team": {"positions": [[6.0, 0.0], [0.0, 3.0]]}})
    env.reset(seed=1)
    assert env.state()[:5].tolist() == [1.0, 1.0, 0.0, 0.0, 0.0]
    assert env.state()[5:10].tolist() == [1.0, 0.0, 0.5, 0.0, 0.0]
    assert env.state()[10:].tolist() == [1.0, 0.0, 0.0, 0.0]


def test_it_draws_the_hunt_so_far():
    env = parallel_env(SCENE, render_mode="rgb_array")
    env.reset(seed=1)
    first = env.render()
    for _ in range(10):
        env.step(stills(env))
    later = env.render()
    for picture in (first, later):
        assert picture.dtype == np.uint8
        assert picture.shape == (800, 640, 3)
        assert len(np.unique(picture)) > 10, "something is drawn"
        assert (picture[-1] == 255).all(), "nothing is cut off below"
    assert (first != later).any()
    assert parallel_env(SCENE).render() is None


@pytest.mark.parametrize(
    ("options", "line"),
    [
        ({"payload": -1}, "payload = -1: must be a whole number from 0 to 1000"),
        ({"payload": 1.5}, "payload = 1.5: must be a whole number from 0 to 1000"),
        ({"render_mode": "human"}, "render_mode = 'human': must be None or rgb_array"),
        ({"agents": ["r4"]}, "agents: 'r4' is no robot"),
        ({"agents": []}, "agents = []: must name one robot of r1, r2, r3 at least"),
        ({"scan": 1}, "scan = 1: must be True or False"),
        ({"reward": {"capture": -1.0}}, "reward.capture = -1.0: must be a number that is not"),
        ({"reward": {"discount": 1.1}}, "reward.discount = 1.1: must be from 0 to 1"),
        ({"reward": {"nearr": 1.0}}, "reward.nearr = 1.0: unknown weight (did you mean 'near'?)"),
        ({"reward": {"near": float("inf")}}, "reward.near = inf: must be a number that is not"),
        ({"payloads": 2}, "payloads = 2: unknown option (did you mean 'payload'?)"),
    ],
)
def test_an_option_that_makes_no_sense_is_named(options, line):
    with pytest.raises(ValueError, match=r"must|no robot|unknown") as caught:
        parallel_env(SCENE, **options)
    assert str(caught.value).startswith(line)


@pytest.mark.parametrize(
    ("actions", "line"),
    [
        ({"r2": [0.0, 1.5]}, "action of r2: [1] = 1.5: must be from -1 to 1"),
        ({"r3": [float("nan"), 0.0]}, "action of r3: [0] = nan: must be from -1 to 1"),
        ({"r1": [0.0]}, "action of r1: shape (1,): must be (2,)"),
        ({"r1": "left"}, "action of r1: 'left': must be numbers from -1 to 1"),
        ({"r9": [0.0, 0.0]}, "actions['r9']: is of no agent; they are: r1, r2, r3"),
    ],
)
def test_an_action_that_is_none_is_named_with_its_agent_and_nothing_happens(actions, line):
    env = parallel_env(SCENE)
    env.reset(seed=1)
    with pytest.raises(ValueError, match=r"must|no agent") as caught:
        env.step({**stills(env), **actions})
    assert str(caught.value) == line
    with pytest.raises(ValueError, match="actions: lack that of r2"):
        env.step({"r1": STILL})
    assert env.step(stills(env))[4]["r1"]["tick"] == 1


def test_before_reset_and_after_the_end_nothing_can_be_done():
    env = parallel_env(SCENE)
    with pytest.raises(ValueError, match="call reset first"):
        env.step({})
    to_the_end(env, 1)
    with pytest.raises(ValueError, match="call reset first"):
        env.step({})
    with pytest.raises(ValueError, match="seed = -1: must be a whole number"):
        env.reset(seed=-1)


def test_a_target_whose_behaviour_fails_ends_it_with_its_line(tmp_path, monkeypatch):
    text = "def sits(memory, view):\n    return 1, (0.0, 0.1 / (0 if memory else 1))\n"
    (tmp_path / "sits.py").write_text(text)
    monkeypatch.setenv("ENCIRCLE_POLICIES", str(tmp_path))
    env = parallel_env({**SCENE, "target": {"behaviour": "sits.py:sits"}})
    env.reset(seed=1)
    env.step(stills(env))
    with pytest.raises(PluginFailed, match=r"'sits.py:sits' failed at tick 1: ZeroDivisionError"):
        env.step(stills(env))
    with pytest.raises(ValueError, match="call reset first"):
        env.step({})


@pytest.mark.parametrize("radio", ["world", "direct"])
def test_by_the_clock_there_is_no_environment(radio):
    with pytest.raises(ScenarioError, match="clock = 'wall': no time passes in an environment"):
        parallel_env({**SCENE, "clock": "wall", "radio": radio, "channel": {}})


def test_without_pettingzoo_one_line_says_how_to_get_it():
    """What a robot needs of this room does without."""
    program = (
        "import sys; sys.modules['pettingzoo'] = None\n"
        "from encircle.learning import observation, decision, Reward, Layout\n"
        "try:\n    from encircle.learning import parallel_env\n"
        "except ImportError as error: print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    line = 'encircle.learning needs pettingzoo: pip install "encircle[learning]"'
    assert done.stdout.splitlines() == [line], done.stderr


def test_a_robot_that_observes_imports_no_environment():
    program = (
        "import sys; from encircle.learning import observation, decision\n"
        "print(sorted({'pettingzoo', 'gymnasium', 'matplotlib', 'pydantic'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.stdout == "[]\n", done.stderr
