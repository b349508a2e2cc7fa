"""The example: its training can be repeated, and the file that it writes is a policy that hunts."""

import importlib.util
import subprocess
import sys
from math import cos, pi, sin

import numpy as np
import pytest
from helpers_paths import ROOT

import encircle
from encircle.conformance import check_policy
from encircle.learning import Layout, observation, parallel_env
from encircle.studies.plan_files import load_plan
from encircle.world.loading.load import load

EXAMPLE = ROOT / "examples" / "learned"
SHIPPED = EXAMPLE / "learned.py"
NAME = "learned.py:learned"
HELD_OUT = range(5001, 5011)


def module_of(path):
    spec = importlib.util.spec_from_file_location(f"example_{path.stem}", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


learned, train = module_of(SHIPPED), module_of(EXAMPLE / "train.py")


@pytest.fixture
def scene(monkeypatch):
    """What it is trained on, hunted with the shipped file."""
    monkeypatch.setenv("ENCIRCLE_POLICIES", str(EXAMPLE))
    return load(train.SCENE, [f"team.strategy={NAME}"])


SHORT = ("--generations", "2", "--pairs", "2", "--hunts", "1")


def trained(out, *more):
    assert train.main(["--out", str(out), *SHORT, "--workers", "1", *more]) == 0
    return out.read_text()


def test_the_same_seed_gives_the_same_file_with_however_many_workers(tmp_path):
    alone, two = trained(tmp_path / "alone.py"), tmp_path / "two.py"
    program = [sys.executable, str(EXAMPLE / "train.py"), "--out", str(two), *SHORT]
    done = subprocess.run(program, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert two.read_text() == alone
    assert trained(tmp_path / "other.py", "--seed", "2") != alone
    assert "--seed 1 --generations 2 --pairs 2 --hunts 1\n" in alone
    module = module_of(tmp_path / "alone.py")
    assert not np.array_equal(module.NETWORK[0], learned.NETWORK[0])
    assert alone.split(train.MARK)[0] == SHIPPED.read_text().split(train.MARK)[0]


def test_a_file_that_is_there_stays(tmp_path, capsys):
    out = tmp_path / "mine.py"
    out.write_text("precious")
    assert train.main(["--out", str(out)]) == 2
    assert out.read_text() == "precious"
    assert "is there already; name a new file" in capsys.readouterr().err


def test_where_nothing_can_be_written_nothing_is_trained(tmp_path, capsys):
    assert train.main(["--out", str(tmp_path / "nowhere" / "mine.py")]) == 2
    assert capsys.readouterr().err.endswith("nowhere is no directory\n")


def test_the_shipped_file_is_as_train_writes_it():
    weights = np.array([float(weight) for weight in learned.WEIGHTS.split()])
    text = SHIPPED.read_text()
    command = text.split(train.MARK)[1].split("\n")[0].removeprefix("# ")
    assert train.with_weights(text, weights, command) == text
    assert command.startswith("train.py --seed ")


def test_weights_move_against_what_was_worse():
    assert train.ranked(np.array([3.0, -1.0, 7.0])).tolist() == [0.0, -0.5, 0.5]


def observed(**numbers):
    """An observation of a robot of three: those that are not given are 0."""
    names = [field.name for field in Layout(3).fields()]
    assert numbers.keys() <= set(names)
    return np.array([numbers.get(name, 0.0) for name in names], np.float32)


def turned(numbers, angle_rad, mirror=1.0):
    """The same situation seen along other axes; ``mirror``: -1 to mirror it first."""
    names, after = [field.name for field in Layout(3).fields()], numbers.copy()
    for place, name in enumerate(names[:-1]):
        if name.endswith("x"):
            x, y = float(numbers[place]), mirror * float(numbers[place + 1])
            after[place] = cos(angle_rad) * x - sin(angle_rad) * y
            after[place + 1] = sin(angle_rad) * x + cos(angle_rad) * y
    return after


SITUATION = {
    "present": 1.0, "step_x": 0.3, "step_y": 0.4, "target_known": 1.0, "target_x": 0.8,
    "target_y": -0.3, "target_vx": 0.5, "target_vy": 0.7, "target_age": 0.1, "peer1_known": 1.0,
    "peer1_x": 1.1, "peer1_y": 0.4, "peer2_known": 1.0, "peer2_x": 0.2, "peer2_y": -1.4,
}  # fmt: skip


@pytest.mark.parametrize("mirror", [1.0, -1.0])
@pytest.mark.parametrize("angle_rad", [0.4, 2.0, -2.9])
def test_where_north_is_and_which_hand_is_right_do_not_matter(angle_rad, mirror):
    layers = learned.network(np.random.default_rng(3).standard_normal(learned.SIZE))
    x, y = learned.act(observed(**SITUATION), layers)
    other = learned.act(turned(observed(**SITUATION), angle_rad, mirror), layers)
    y *= mirror
    wanted = (cos(angle_rad) * x - sin(angle_rad) * y, sin(angle_rad) * x + cos(angle_rad) * y)
    assert other == pytest.approx(wanted, abs=1e-5)


def test_which_peer_is_which_does_not_matter():
    layers = learned.network(np.random.default_rng(4).standard_normal(learned.SIZE))
    swapped = {
        name.translate(str.maketrans("12", "21")) if name.startswith("peer") else name: number
        for name, number in SITUATION.items()
    }
    assert learned.act(observed(**SITUATION), layers) == learned.act(observed(**swapped), layers)


def test_what_the_network_sees_is_right_for_a_ring_worked_out_by_hand():
    """West of the target, heading for it; one peer is north of it, one twice as far south."""
    numbers = observed(
        target_known=1.0,
        target_x=1.0,
        target_vx=0.5,
        target_vy=-0.25,
        step_x=1.0,
        peer1_known=1.0,
        peer1_x=1.0,
        peer1_y=1.0,
        peer2_known=1.0,
        peer2_x=1.0,
        peer2_y=-2.0,
    )
    seen = learned.features(numbers.tolist(), 1.0)
    quarter = 0.5 - 0.5
    wanted = [1.0, 1.0, 1 / 3, 0.5, 0.25, 1.0, 0.0, np.hypot(0.5, 0.25)]
    # Counter-clockwise from the west comes the south.
    wanted += [quarter, quarter, 1.0, 0.0, 1.0 - 0.5, 0.0]
    assert seen == pytest.approx(wanted)
    assert next(learned.peers(numbers.tolist(), 1.0, 0.0))[0] == pytest.approx(1.5 * pi)


def test_without_peers_the_gap_is_the_whole_turn():
    seen = learned.features(observed(target_known=1.0, target_x=1.0).tolist(), 1.0)
    assert seen[8:13] == pytest.approx([1.5, 1.5, 0.0, 0.0, 1.5])


def test_it_sees_the_numbers_where_the_layout_has_them():
    names = [field.name for field in Layout(2).fields()]
    assert names[learned.STEP] == "step_x"
    assert names[learned.TARGET] == "target_known"
    assert names[learned.TARGET + 5] == "target_age"
    assert (Layout(2).first_peer, Layout(2).peer_size) == (learned.PEERS, learned.PEER_SIZE)


@pytest.mark.usefixtures("scene")
def test_it_is_a_policy(capsys, monkeypatch):
    # Workers that another test has started know no other folder by the environment.
    monkeypatch.chdir(EXAMPLE)
    assert check_policy.main([NAME]) == 0, capsys.readouterr()


def test_what_hunts_in_the_environment_hunts_the_same_in_processes(scene):
    env = parallel_env(scene)
    observations, _ = env.reset(seed=HELD_OUT[0])
    while env.agents:
        actions = {
            agent: learned.act(seen, learned.NETWORK) for agent, seen in observations.items()
        }
        observations, _, _, _, infos = env.step(actions)
    for link in ("memory", "zenoh"):
        hunt = encircle.run(scene, seed=HELD_OUT[0], link=link)
        assert hunt.digest == infos["r1"]["digest"]


def test_it_captures_what_its_start_never_does(scene):
    """Before training it heads straight for the target, as ``pursuit`` does."""
    captures = {}
    for strategy in (NAME, "pursuit"):
        change = [f"team.strategy={strategy}"]
        hunts = [encircle.run(scene, seed=s, link="memory", overrides=change) for s in HELD_OUT]
        captures[strategy] = sum(hunt.captured for hunt in hunts)
    assert captures["pursuit"] == 0
    assert captures[NAME] >= len(HELD_OUT) // 2


@pytest.mark.nightly
@pytest.mark.timeout(7200)
def test_the_command_in_the_shipped_file_writes_it(tmp_path):
    command = SHIPPED.read_text().split(train.MARK)[1].split("\n")[0]
    arguments = command.removeprefix("# train.py ").split()
    program = [sys.executable, str(EXAMPLE / "train.py"), "--out", str(tmp_path / "again.py")]
    subprocess.run([*program, *arguments], check=True)
    assert (tmp_path / "again.py").read_text() == SHIPPED.read_text()


def test_the_study_is_of_the_same_scene_and_other_seeds(scene):
    plan = load_plan(EXAMPLE / "study.toml")
    assert not set(plan.seed_list) & set(train.SEEDS)
    assert load(plan.scenario).target == scene.target
    assert 0.5 in plan.axes[0].values


def test_an_action_in_the_environment_is_that_of_the_view():
    """The function of the file is given the same array in both."""
    assert learned.observation is observation
