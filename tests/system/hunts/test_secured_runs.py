"""Who belongs, by the commands: certificates made, and hunts with them as processes, on loopback.

What is refused at the gate, and counted, is in ``test_intruders``; this is what a user types.
"""

import itertools
import json
import shutil
import stat
from contextlib import ExitStack
from datetime import timedelta

import pytest
from helpers_commands import command, ours, run_forked
from helpers_hosts import NodeProcess
from helpers_security import ROBOTS, Lab, free_endpoint
from helpers_waiting import LONGEST_S, ample_s

import encircle
from encircle.runner.launch import free_endpoint as free_tcp_endpoint

RUN = "belonging"


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    return Lab(tmp_path_factory.mktemp("belonging"))


@pytest.fixture
def started(tmp_path):
    """Start a command, ``python -m`` with these arguments; all are ended with the test."""
    numbers = itertools.count()
    with ExitStack() as stack:

        def start(*arguments, **settings):
            settings = {f"ENCIRCLE_{name.upper()}": str(value) for name, value in settings.items()}
            log = tmp_path / f"{next(numbers)}"
            node = NodeProcess(ours(*arguments), log, settings)
            stack.callback(node.kill)
            return node

        yield start


def only(lab, folder, name):
    """A directory as a host gets it: the authority's certificate, and the node's own two files."""
    folder = folder / f"of-{name}"
    folder.mkdir()
    for file in ("authority.pem", f"{name}.pem", f"{name}.key"):
        shutil.copy(lab.directory / file, folder / file)
    return folder


def failed(*arguments, status=2, **settings):
    """The last line of a command that does not even start."""
    environment = {f"ENCIRCLE_{name.upper()}": str(value) for name, value in settings.items()}
    done = run_forked(ours(*arguments), environment=environment)
    assert done.returncode == status, done.stderr
    return done.stderr.splitlines()[-1]


def test_a_hunt_through_a_router_is_the_one_in_memory(lab, started, tmp_path):
    """Each with its own files alone; a stranger is counted, and health checks know who asks."""
    gate = free_endpoint("tls")
    router = started(
        "encircle.protocol.programs.router",
        "--count-refusals",
        listen=gate,
        certificates=only(lab, tmp_path, "router"),
    )
    router.wait_for_listening()
    assert "without authentication" not in router.said
    where = {"connect": gate, "run": RUN}
    alive = ("encircle.protocol.programs.alive", "router", "--check-timeout")
    known = started(*alive, f"{LONGEST_S}", connect=gate, certificates=tmp_path / "of-router")
    assert known.end() == 0
    # Zenoh does not say why; that it is no certificate is the gate's to count.
    assert started(*alive, "0.3", connect=gate).end() == 1
    nodes = [started("world", "sim1", **where, certificates=only(lab, tmp_path, "world"))]
    nodes += [
        started("agents", robot, **where, certificates=only(lab, tmp_path, robot))
        for robot in ROBOTS
    ]
    assert [node.end() for node in nodes] == [0] * 5, nodes[0].said
    assert nodes[0].result()["digest"] == encircle.run("sim1", link="memory").digest
    assert nodes[0].result()["refused"] == {}
    assert router.terminate() == 0
    last = router.said.splitlines()[-1]
    assert last.startswith("router: refused: ")
    assert " connections: " in last


@pytest.mark.realtime
@pytest.mark.parametrize("direct", [True, False])
def test_robots_hear_each_other_where_the_router_lets_them(lab, started, tmp_path, direct):
    gate = free_endpoint("tls")
    settings = {"certificates": lab.directory}
    flag = ("--direct-radio",) if direct else ()
    started(
        "encircle.protocol.programs.router", *flag, listen=gate, **settings
    ).wait_for_listening()
    settings |= {"connect": gate, "run": RUN}
    by_clock = f"clock=wall;tick_s={ample_s() / 50.0};radio=direct;ticks_max=150"
    nodes = [started("world", "sim1", out=tmp_path / "run", set=by_clock, **settings)]
    nodes += [started("agents", robot, **settings) for robot in ROBOTS]
    assert [node.end() for node in nodes] == [0] * 5, nodes[0].said
    links = json.loads((tmp_path / "run" / "summary.json").read_text())["transport"]["links"]
    pairs = [link for link in links if "world" not in (link["sender"], link["receiver"])]
    assert len(pairs) == 12
    assert all(link["sent"] > 10 for link in pairs)
    assert {link["lost"] / link["sent"] for link in pairs} == {0.0 if direct else 1.0}


def test_a_world_that_listens_is_the_gate_itself(lab, started):
    gate = free_endpoint("tls")
    settings = {"run": RUN, "certificates": lab.directory}
    world = started("world", "sim1", "--count-refusals", listen=gate, **settings)
    robots = [started("agents", robot, connect=gate, **settings) for robot in ROBOTS]
    assert [node.end() for node in (world, *robots)] == [0] * 5, world.said
    assert world.result()["digest"] == encircle.run("sim1", link="memory").digest
    assert world.said.splitlines()[-1].startswith("world: refused: ")


def test_beyond_this_machine_only_who_shows_certificates_listens_unasked(lab, started):
    wide = free_tcp_endpoint().replace("127.0.0.1", "0.0.0.0")
    said = failed("encircle.protocol.programs.router", listen=wide)
    assert "other machines may reach it" in said
    assert "--certificates" in said
    secured = wide.replace("tcp/", "tls/")
    router = started(
        "encircle.protocol.programs.router", listen=secured, certificates=lab.directory
    )
    router.wait_for_listening()
    assert router.said == f"router: listening on {secured}\n"
    assert router.terminate() == 0


@pytest.mark.parametrize(
    ("node", "name"), [(("world", "sim1"), "world"), (("agents", "r2"), "r2")], ids=["world", "r2"]
)
def test_what_is_wrong_with_certificates_is_said_at_the_start(lab, tmp_path, node, name):
    directory = only(lab, tmp_path, name)
    where = {"connect": "tls/127.0.0.1:1", "run": RUN, "certificates": directory}
    assert "must be tls/127.0.0.1:1" in failed(*node, **where | {"connect": "tcp/127.0.0.1:1"})
    expired = lab.dated(name, timedelta(days=-3), timedelta(days=-1))
    (directory / f"{name}.pem").write_bytes(expired.certificate.read_bytes())
    assert f"{name}.pem: certificate has expired" in failed(*node, **where)


def certificates(*arguments):
    return command("certificates", *arguments)


def test_certificates_are_made_once(tmp_path):
    wanted = (str(tmp_path / "lab"), "--robots", "2", "--host", "hub.local", "--days", "3")
    done = certificates(*wanted)
    assert (done.returncode, done.stderr) == (0, "")
    assert "router, world, viewer and r1 to r2" in done.stdout
    key = tmp_path / "lab" / "r2.key"
    assert stat.S_IMODE(key.stat().st_mode) == 0o600
    before = key.read_bytes()
    done = certificates(*wanted)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == (
        f"encircle: {tmp_path / 'lab'} is not empty: nothing is overwritten, name a new one\n"
    )
    assert key.read_bytes() == before


def test_certificates_that_cannot_be_made_are_one_line(tmp_path, monkeypatch):
    done = certificates(str(tmp_path / "lab"), "--robots", "0")
    assert done.returncode == 2
    assert done.stderr == "encircle: robots = 0: must be 1 to 256\n"
    # As if the package were not installed.
    (tmp_path / "cryptography.py").write_text(
        "raise ModuleNotFoundError('no', name='cryptography')\n"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    done = certificates(str(tmp_path / "lab"), "--robots", "1")
    assert done.returncode == 2
    assert done.stderr == (
        'encircle: making certificates needs cryptography: pip install "encircle[security]"\n'
    )
    assert not (tmp_path / "lab").exists()
