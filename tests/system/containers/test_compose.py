"""Hunts in containers, on a real engine: ``make containers``, as root on Debian."""

import json
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from helpers_compose import Project
from helpers_engine import (
    ADDRESS,
    Daemon,
    building,
    fetch_compose_v2,
    install,
    make_base_image,
    remove,
    running,
)
from helpers_paths import ROOT

import encircle
from encircle.network.certificates import make_certificates
from encircle.protocol.codec import decode
from encircle.protocol.messages import Command
from encircle.replay.replaying import replay
from encircle.world.recording.recording import read_recording

pytestmark = [
    pytest.mark.skipif("ENCIRCLE_CONTAINERS" not in os.environ, reason="run by make containers"),
    pytest.mark.timeout(3600),
]
ONE = ("docker-compose.yml",)
SCALED = (*ONE, "docker-compose.scale.yml")
IMPAIRED = (*ONE, "docker-compose.impaired.yml")
HOST = ("docker-compose.host.yml",)
ROBOTS = ("r1", "r2", "r3", "r4")
NODE_KINDS = {"router", "world", *ROBOTS}
ENDLESS = ";".join(
    (
        "ticks_max=1000000",
        "team.sensing_range_m=500.0",
        "target.step_m_max=0.5",
        'target.behaviour="patrol"',
        "target.parameters={waypoints=[[60,0],[60,60],[0,60],[0,0]]}",
    )
)
"""The target is faster than the robots, and to start or stop a container may take long."""


@pytest.fixture(scope="module")
def engine() -> Iterator[Daemon]:
    """An engine with the image of this project; all that it leaves is in one directory."""
    install()
    root = Path(tempfile.mkdtemp(prefix="encircle-engine-"))
    try:
        with building(root) as builder:
            make_base_image(root, builder)
            build = ("build", "--network", "host", "--tag")
            builder.docker(*build, "encircle", str(ROOT))
            builder.docker(*build, "laboratory", "--target", "laboratory", str(ROOT))
        with running(root) as daemon:
            yield daemon
    finally:
        remove(root)


@pytest.fixture(scope="module")
def compose_v2(engine: Daemon) -> Iterator[str]:
    """Compose v2; the machine's own is 1.29."""
    root = Path(tempfile.mkdtemp(prefix="encircle-compose-"))
    yield str(fetch_compose_v2(root))
    shutil.rmtree(root)


@pytest.fixture(params=["1.29", "v2"])
def compose(request: pytest.FixtureRequest) -> str:
    """Either Compose."""
    return request.getfixturevalue("compose_v2") if request.param == "v2" else "docker-compose"


@pytest.fixture
def runs() -> Iterator[Path]:
    """A directory that another user may write to, which those of pytest do not let through."""
    path = Path(tempfile.mkdtemp(prefix="encircle-runs-"))
    path.chmod(0o755)
    yield path
    shutil.rmtree(path)


def summary(runs: Path) -> dict:
    (directory,) = runs.iterdir()
    return json.loads((directory / "summary.json").read_text())


@pytest.mark.parametrize("files", [ONE, SCALED, IMPAIRED, HOST], ids=lambda files: files[-1])
def test_the_compose_files_are_accepted(engine, compose, files):
    Project(engine, "valid", files, {}, compose).compose("config", "--quiet")


def test_both_versions_of_compose_are_tried(engine, compose_v2):
    for program, version in (("docker-compose", "1.29."), (compose_v2, "2.")):
        said = Project(engine, "version", ONE, {}, program).compose("version", "--short")
        assert said.startswith(version)


def size_mb(engine: Daemon, image: str) -> float:
    return int(engine.docker("inspect", "--format", "{{.Size}}", image)) / 1e6


def test_the_image_for_nodes_is_small_enough_and_runs_as_nobody_special(engine):
    base_mb, node_mb = size_mb(engine, "python:3.11-slim"), size_mb(engine, "encircle")
    laboratory_mb = size_mb(engine, "laboratory")
    print(f"node {node_mb:.0f} MB, {node_mb - base_mb:.0f} MB above its base;", end=" ")
    print(f"laboratory {laboratory_mb:.0f} MB, {laboratory_mb - base_mb:.0f} MB above its base")
    assert node_mb - base_mb < 280
    user = engine.docker("inspect", "--format", "{{.Config.User}}", "encircle").strip()
    assert user == "1000:1000"
    listed = engine.docker("run", "--rm", "--network", "none", "encircle", "scenarios")
    assert listed.startswith("sim1")


@pytest.mark.parametrize("command", [("run", "sim1"), ("study", "loss"), ("reproduce",)])
def test_an_image_for_nodes_says_that_it_is_no_laboratory(engine, command):
    with pytest.raises(AssertionError, match="take the image of the laboratory"):
        engine.docker("run", "--rm", "--network", "none", "encircle", *command)


def test_the_laboratory_runs_draws_and_replays_a_hunt(engine, runs):
    runs.chmod(0o777)
    there = ("run", "--rm", "--network", "none", "--volume", f"{runs}:/runs", "laboratory")
    done = json.loads(engine.docker(*there, "run", "sim1", "--json", "--out", "/runs/one"))
    assert done["digest"] == encircle.run("sim1", link="memory").digest
    assert (runs / "one" / "trajectory.png").stat().st_size > 0
    assert "0 decided differently" in engine.docker(*there, "replay", "/runs/one", "--check")
    study = ("study", "loss", "--seeds", "1", "--out", "/runs/study", "--set", "ticks_max=3")
    assert json.loads(engine.docker(*there, *study, "--json"))["failed"] == 0


def test_up_runs_simulation_1_as_in_memory_and_leaves_the_recording(engine, compose, runs):
    memory = encircle.run("sim1", link="memory")
    with Project(engine, "one", ONE, {"ENCIRCLE_HOST_RUNS": str(runs)}, compose) as project:
        project.up()
        assert project.statuses() == dict.fromkeys([*NODE_KINDS, "runs"], 0), project.logs("router")
        users = project.inspected(".Config.User")
        assert {users[node] for node in NODE_KINDS} == {"1000:1000"}
        assert all(project.inspected(".HostConfig.ReadonlyRootfs").values())
        assert not any(project.inspected(".HostConfig.PortBindings").values())
    assert summary(runs)["digest"] == memory.digest
    check = replay(runs / "sim1-seed1-1")
    assert (check.same, check.complete, check.ticks) == (True, True, memory.result.ticks)
    assert (runs / "sim1-seed1-1" / "recording.mcap").stat().st_uid == 1000


POLICY = """
from encircle.agents.policies.paper import xi_star


def counts(memory, view, *, start: int = 0):
    asked = start if memory is None else memory + 1
    decision = xi_star(None, view)[1]
    return asked, decision._replace(say={"asked": asked})
"""


def test_a_policy_in_the_mounted_folder_needs_no_packaging(
    engine, compose, runs, tmp_path, monkeypatch
):
    """And it must be the same file for all, which it is when all of them mount the same folder."""
    folder = tmp_path / "files"
    folder.mkdir()
    folder.chmod(0o755)
    (folder / "mine.py").write_text(POLICY)
    (folder / "mine.py").chmod(0o644)
    monkeypatch.chdir(folder)
    changes = ["team.strategy=mine.py:counts", "team.policy_parameters.start=3"]
    memory = encircle.run("sim1", link="memory", overrides=changes)
    settings = {
        "ENCIRCLE_HOST_RUNS": str(runs),
        "ENCIRCLE_FILES": str(folder),
        "ENCIRCLE_SET": ";".join(changes),
    }
    with Project(engine, "policy", ONE, settings, compose) as project:
        project.up()
        assert project.statuses() == dict.fromkeys([*NODE_KINDS, "runs"], 0), project.logs("r1")
    assert summary(runs)["digest"] == memory.digest


def test_a_learned_policy_hunts_in_containers_from_the_file_that_training_wrote(
    engine, runs, tmp_path, monkeypatch
):
    folder = tmp_path / "files"
    folder.mkdir()
    folder.chmod(0o755)
    for name in ("learned.py", "scene.toml"):
        shutil.copyfile(ROOT / "examples" / "learned" / name, folder / name)
        (folder / name).chmod(0o644)
    monkeypatch.chdir(folder)
    strategy = "team.strategy=learned.py:learned"
    memory = encircle.run("scene.toml", link="memory", overrides=[strategy])
    settings = {
        "ENCIRCLE_HOST_RUNS": str(runs),
        "ENCIRCLE_FILES": str(folder),
        "ENCIRCLE_SCENARIO": "/files/scene.toml",
        "ENCIRCLE_SET": strategy,
    }
    with Project(engine, "learned", ONE, settings) as project:
        project.up()
        assert project.statuses() == dict.fromkeys([*NODE_KINDS, "runs"], 0), project.logs("r1")
    assert summary(runs)["digest"] == memory.digest
    assert summary(runs)["packets_lost"]["loss"] > 0


def test_a_second_up_records_beside_the_first(engine, runs):
    settings = {"ENCIRCLE_HOST_RUNS": str(runs), "ENCIRCLE_SEED": "7"}
    with Project(engine, "twice", ONE, settings) as project:
        project.up()
        project.up()
        assert set(project.statuses().values()) == {0}
    assert sorted(path.name for path in runs.iterdir()) == ["sim1-seed7-1", "sim1-seed7-2"]


def test_six_robots(engine, compose, runs):
    memory = encircle.run("sim1", link="memory", overrides=["team={robots=6}"])
    with Project(engine, "six", SCALED, {"ENCIRCLE_HOST_RUNS": str(runs)}, compose) as project:
        project.up()
        statuses = project.statuses()
        said = project.logs("router")
    assert statuses == dict.fromkeys([*NODE_KINDS, "runs", "more", "more2"], 0), said
    assert summary(runs)["digest"] == memory.digest


def test_every_container_with_a_loss_and_a_delay_of_its_own(engine, compose, runs):
    rows = [("r1", 0.0, 0.0), ("r2", 0.1, 0.1), ("r3", 0.2, 0.2), ("r4", 0.9, 0.3)]
    links = ",".join(
        f'{{sender="{robot}",loss={{model="bernoulli",rate={loss}}},'
        f'delay={{model="constant",mean_s={delay}}}}}'
        for robot, loss, delay in rows
    )
    memory = encircle.run("sim1", link="memory", overrides=[f"channel.links=[{links}]"])
    settings = {"ENCIRCLE_HOST_RUNS": str(runs), "R4_LOSS": "0.9"}
    with Project(engine, "impaired", IMPAIRED, settings, compose) as project:
        project.up()
        assert set(project.statuses().values()) == {0}
    found = summary(runs)
    assert found["digest"] == memory.digest
    assert found["packets_lost"] == memory.result.packets_lost != {}


def test_a_hunt_goes_on_while_one_robots_container_is_stopped(engine, compose, runs):
    """It is lost, the other three go on, and started again it is counted in."""
    settings = {"ENCIRCLE_HOST_RUNS": str(runs), "ENCIRCLE_SET": ENDLESS}
    with Project(engine, "stopped", ONE, settings, compose) as project:
        project.start()
        project.wait_for_tick(100)
        project.compose("stop", "r2")
        project.wait_for_line("world", "robot r2 is lost")
        project.compose("start", "r2")
        project.wait_for_line("world", "robot r2 is back")
        project.wait_for_tick(project.tick() + 100)
        project.compose("stop", "world")
        statuses = project.statuses()
    # The world was stopped, and told the robots; the router has done its work.
    assert statuses == dict.fromkeys(("world", *ROBOTS), 1) | {"router": 0, "runs": 0}
    found = summary(runs)
    assert found["ended"] == "failed: stopped by SIGTERM"
    assert [part[1:] for part in found["departures"]] == [
        ["r2", "lost: it is gone"],
        ["r2", "back"],
    ]
    (lost, *_), (back, *_) = found["departures"]
    (directory,) = runs.iterdir()
    assert replay(directory).same
    planned = {
        tick: decode(Command, payload, "hunt").team
        for tick, robot, payload in read_recording(directory).of_channel("command")
        if robot == "r1"
    }
    assert lost < back < found["ticks"] - 1
    assert all("r2" not in planned[tick] for tick in range(lost + 1, back))
    assert all("r2" in planned[tick] for tick in range(back + 1, found["ticks"]))


def test_a_hunt_may_be_told_to_end_when_a_container_is_stopped(engine, runs):
    """And before that the doctor, asked in a container, finds all well there."""
    settings = {
        "ENCIRCLE_HOST_RUNS": str(runs),
        "ENCIRCLE_SET": ENDLESS,
        "ENCIRCLE_WHEN_LOST": "end",
    }
    with Project(engine, "ended", ONE, settings) as project:
        project.start()
        project.wait_for_tick(100)
        examined = json.loads(project.compose("exec", "-T", "r3", "encircle", "doctor", "--json"))
        project.compose("kill", "r2")
        statuses = project.statuses()
        assert "robot r2 is gone" in project.logs("world")
    assert examined["well"], examined
    assert "run hunt: world, r1, r2, r3, r4" in [f["said"] for f in examined["findings"]]
    ended = dict.fromkeys(("world", *ROBOTS), 1)
    assert statuses == ended | {"router": 0, "runs": 0, "r2": 137}
    (directory,) = runs.iterdir()
    assert replay(directory).same


def test_three_hosts_each_with_the_part_that_its_environment_says(engine, runs):
    middle = {
        "COMPOSE_PROFILES": "router,world",
        "ENCIRCLE_PUBLISH": f"{ADDRESS}:7447",
        "ENCIRCLE_WITHOUT_AUTHENTICATION": "yes",
        "ENCIRCLE_FOR_RUN": "hunt",
        "ENCIRCLE_HOST_RUNS": str(runs),
    }
    far = {"ENCIRCLE_CONNECT": f"tcp/{ADDRESS}:7447"}
    with (
        Project(engine, "middle", HOST, middle) as first,
        Project(engine, "left", HOST, far | {"COMPOSE_PROFILES": "r1,r2"}) as second,
        Project(engine, "right", HOST, far | {"COMPOSE_PROFILES": "r3,r4"}) as third,
    ):
        for project in (first, second, third):
            project.start()
        assert first.statuses() == {"router": 0, "world": 0, "runs": 0}
        assert second.statuses() == {"r1": 0, "r2": 0}
        assert third.statuses() == {"r3": 0, "r4": 0}
    assert summary(runs)["digest"] == encircle.run("sim1", link="memory").digest


@pytest.fixture
def certificates() -> Iterator[dict[str, Path]]:
    """A directory for each host, with the certificates of its own nodes and no other key."""
    root = Path(tempfile.mkdtemp(prefix="encircle-lab-"))
    lab = make_certificates(root / "lab", 4, ["router", ADDRESS], 1).directory
    placed = {"middle": ("router", "world"), "left": ("r1", "r2"), "right": ("r3", "r4")}
    for host, nodes in placed.items():
        (root / host).mkdir(mode=0o700)
        own = [f"{node}.{part}" for node in nodes for part in ("pem", "key")]
        for name in ("authority.pem", *own):
            shutil.copy(lab / name, root / host / name)
        for path in (root / host, *(root / host).iterdir()):
            os.chown(path, 1000, 1000)
    yield {host: root / host for host in placed}
    shutil.rmtree(root)


def test_three_hosts_with_certificates(engine, runs, certificates):
    """Nobody is asked to do without authentication, and each host has its own keys alone."""
    common = {"ENCIRCLE_CERTIFICATES": "/files", "ENCIRCLE_HOST_RUNS": str(runs)}
    middle = common | {
        "COMPOSE_PROFILES": "router,world",
        "ENCIRCLE_PUBLISH": f"{ADDRESS}:7447",
        "ENCIRCLE_LISTEN": "tls/0.0.0.0:7447",
        "ENCIRCLE_CONNECT": "tls/router:7447",
        "ENCIRCLE_FOR_RUN": "hunt",
        "ENCIRCLE_FILES": str(certificates["middle"]),
    }
    far = common | {"ENCIRCLE_CONNECT": f"tls/{ADDRESS}:7447"}
    left = far | {"COMPOSE_PROFILES": "r1,r2", "ENCIRCLE_FILES": str(certificates["left"])}
    right = far | {"COMPOSE_PROFILES": "r3,r4", "ENCIRCLE_FILES": str(certificates["right"])}
    with (
        Project(engine, "middle", HOST, middle) as first,
        Project(engine, "left", HOST, left) as second,
        Project(engine, "right", HOST, right) as third,
    ):
        for project in (first, second, third):
            project.start()
        assert first.statuses() == {"router": 0, "world": 0, "runs": 0}, first.logs("world")
        assert second.statuses() == {"r1": 0, "r2": 0}, second.logs("r1")
        assert third.statuses() == {"r3": 0, "r4": 0}, third.logs("r3")
    assert summary(runs)["digest"] == encircle.run("sim1", link="memory").digest


def test_a_router_for_other_hosts_starts_only_when_asked_for_by_name(engine):
    with Project(engine, "asked", HOST, {"COMPOSE_PROFILES": "router"}) as project:
        project.start()
        assert project.statuses() == {"router": 2}
        assert "--without-authentication" in project.logs("router")
