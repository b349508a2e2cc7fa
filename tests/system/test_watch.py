"""``encircle watch`` and ``run --watch`` as commands: what they say and show, how they end."""

import json
import os
import signal
import socket

import pytest
from helpers_commands import command, ours
from helpers_hosts import NodeProcess
from helpers_page_client import read, read_until_ended, resumed, run
from helpers_waiting import until

import encircle
from encircle.runner.launch import free_endpoint

FAST = ("--pace", "50")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    out = tmp_path_factory.mktemp("recorded") / "run"
    encircle.run("sim1", link="memory", out=out)
    return out


class At:
    """Where the page of a command is."""

    def __init__(self, node):
        node.wait_until(lambda n: "the page is at" in n.said)
        line = next(line for line in node.said.splitlines() if "the page is at" in line)
        self.address = line.split()[-1]
        self.port = int(self.address.split(":")[2].partition("/")[0])


@pytest.fixture
def started(tmp_path):
    nodes = []

    def start(*words):
        log = tmp_path / f"log{len(nodes)}"
        nodes.append(NodeProcess(ours("encircle", *map(str, words)), log, {}))
        return nodes[-1]

    yield start
    for node in nodes:
        node.kill()


@pytest.mark.parametrize(
    ("words", "status", "line"),
    [
        ((), 2, "give a recorded RUN, or --connect ENDPOINT and --run NAME"),
        (("--connect", "tcp/127.0.0.1:1"), 2, "--run is missing"),
        (("RECORDED", "--run", "x"), 2, "is a recording: --connect, --listen and --run do not go"),
        (("sim1",), 2, "sim1 is a scenario, not a recording: encircle run sim1 --watch"),
        (("nowhere",), 2, "nowhere cannot be read: No such file or directory"),
        (("RECORDED", "--port", "0"), 2, "--port: '0' is not a whole number from 1 to 65535"),
        (("RECORDED", "--host", "a b"), 2, "'a b' is not an address or name of this machine"),
        (("RECORDED", "--watch-end", "soon"), 2, "--watch-end: 'soon'"),
        (
            ("RECORDED", "--host", "203.0.113.1"),
            1,
            "encircle: 203.0.113.1 cannot be used for the page",
        ),
        (
            ("--connect", "tcp/127.0.0.1:1", "--run", "x", "--join-timeout", "0.2"),
            1,
            "cannot connect to tcp/127.0.0.1:1",
        ),
        (
            ("--connect", "tcp/127.0.0.1:1", "--run", "x", "--listen", "tcp/127.0.0.1:2"),
            2,
            "--listen tcp/127.0.0.1:2: who looks on connects",
        ),
    ],
)
def test_what_cannot_be_watched_is_one_line(recorded, words, status, line):
    words = [str(recorded) if word == "RECORDED" else word for word in words]
    done = command("watch", *words, "--no-browser")
    assert (done.returncode, done.stdout) == (status, "")
    assert line in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_a_run_that_is_not_there_is_one_line(started):
    endpoint = free_endpoint()
    router = started("router", "--listen", endpoint)
    router.wait_for_listening()
    done = command("watch", "--connect", endpoint, "--run", "x", "--join-timeout", "0.5")
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == (
        f"encircle: no world of run x answers at {endpoint} for 0.5 s; no run is there\n"
    )


@pytest.mark.parametrize("what", [("watch", "RECORDED"), ("run", "sim1", "--watch")])
def test_a_port_in_use_is_one_line_about_the_page(recorded, tmp_path, what):
    words = [str(recorded) if word == "RECORDED" else word for word in what]
    words += ["--out", str(tmp_path / "run")] if "run" in what else []
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = str(other.getsockname()[1])
        done = command(*words, "--port", port, "--no-browser")
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == (
        f"encircle: port {port} of 127.0.0.1 cannot be used for the page: Address already in use\n"
    )
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    "option",
    [("--port", "8000"), ("--no-browser",), ("--watch-end", "run"), ("--watch-start", "3")],
)
def test_options_of_the_page_go_with_watch(option):
    done = command("run", "sim1", "--link", "memory", *option)
    assert (done.returncode, done.stdout) == (2, "")
    assert f"{option[0]} goes with --watch" in done.stderr


def test_a_recording_is_served_until_its_page_is_closed(recorded, started):
    node = started("watch", recorded, "--no-browser", "--watch-end", "closed")
    at = At(node)

    async def look():
        whole = await read_until_ended(await resumed(at))
        assert len(whole["frames"]) == 33
        assert whole["status"]["complete"]
        assert node.running

    run(look)
    assert node.end() == 0
    assert len(node.said.splitlines()) == 1


def test_and_otherwise_until_it_is_stopped(recorded, started):
    node = started("watch", recorded, "--no-browser")
    At(node)
    os.kill(node.pid, signal.SIGINT)
    assert node.end() == 0
    assert node.said.splitlines()[1:] == ["encircle: stopped by SIGINT"]


def test_a_browser_that_is_not_there_is_one_line_and_no_failure(recorded, tmp_path):
    node = NodeProcess(
        ours("encircle", "watch", str(recorded)),
        tmp_path / "log",
        {"DISPLAY": ":77", "PATH": str(tmp_path), "BROWSER": ""},
    )
    try:
        At(node)
        node.wait_until(lambda n: "no browser was found here" in n.said)
        assert node.running
        assert len(node.said.splitlines()) == 2
    finally:
        node.kill()


@pytest.mark.parametrize("link", ["memory", "zenoh"])
def test_a_hunt_is_seen_as_it_goes_on_and_the_page_stays_until_it_is_closed(
    started, tmp_path, link
):
    out = tmp_path / "run"
    how = ("--link", link, "--watch", "--no-browser", "--watch-end", "closed", *FAST)
    node = started("run", "sim1", *how, "--out", out, "--json")
    at = At(node)

    async def look():
        whole = await read_until_ended(await resumed(at))
        assert [frame["t"] for frame in whole["frames"]] == list(range(33))
        assert (whole["status"]["text"], whole["status"]["complete"]) == ("", True)
        until(lambda: node.printed_text(), "the result")
        assert node.running
        # Who comes when the hunt is over sees all of it.
        assert len((await read_until_ended(await resumed(at)))["frames"]) == 33

    run(look)
    assert node.end() == 0, node.said
    assert node.printed()["digest"] == encircle.run("sim1", link="memory").digest
    assert (out / "trajectory.png").exists()


@pytest.mark.parametrize("link", ["memory", "zenoh"])
def test_a_hunt_begins_when_a_page_is_open(started, tmp_path, link):
    how = ("--link", link, "--watch", "--no-browser", "--watch-end", "run", "--watch-start", "3600")
    node = started("run", "sim1", *how, "--out", tmp_path / "run", "--json", *FAST)
    at = At(node)

    async def look():
        assert len((await read_until_ended(await resumed(at)))["frames"]) == 33

    run(look)
    assert node.end() == 0, node.said


@pytest.mark.parametrize("link", ["memory", "zenoh"])
def test_and_is_stopped_before_it_has_begun(started, tmp_path, link):
    how = ("--link", link, "--watch", "--no-browser", "--watch-start", "3600")
    node = started("run", "sim1", *how, "--out", tmp_path / "run")
    At(node)
    os.kill(node.pid, signal.SIGINT)
    assert node.end() == 1
    assert "stopped by SIGINT before the run began" in node.said
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("link", ["memory", "zenoh"])
def test_a_hunt_that_is_stopped_takes_its_page_with_it(started, tmp_path, link):
    how = ("--link", link, "--watch", "--no-browser", "--pace", "0.5")
    node = started("run", "sim1", *how, "--out", tmp_path / "run")
    at = At(node)

    async def look():
        feed = await resumed(at)
        while not (await read(feed)).get("frames"):
            pass
        os.kill(node.pid, signal.SIGINT)
        while await read(feed) is not None:
            pass

    run(look)
    assert node.end() == 1
    assert "stopped by SIGINT at tick" in node.said
    assert "to go on: encircle run --resume" in node.said.splitlines()[-1]


def test_with_nobody_there_a_hunt_ends_by_itself(started, tmp_path):
    how = ("--link", "memory", "--watch", "--no-browser", "--watch-end", "closed", *FAST)
    node = started("run", "sim1", *how, "--out", tmp_path / "run", "--json")
    assert node.end() == 0, node.said
    assert json.loads(node.printed_text())["captured"]


def test_a_run_on_other_hosts_is_seen_from_its_start(started, tmp_path):
    endpoint = free_endpoint()
    world = started("world", "sim1", "--listen", endpoint, "--run", "lab", *FAST)
    world.wait_until(lambda node: "waiting for" in node.said)
    page = started(
        "watch", "--connect", endpoint, "--run", "lab", "--no-browser", "--watch-end", "closed"
    )
    at = At(page)

    async def look():
        feed = await resumed(at)
        first = await read(feed)
        assert first["stage"]["run"] == "lab"
        for robot in ("r1", "r2", "r3", "r4"):
            started("robot", robot, "--connect", endpoint, "--run", "lab")
        whole = await read_until_ended(feed)
        assert [frame["t"] for frame in whole["frames"]] == list(range(33))
        assert not any(frame["unsure"] for frame in whole["frames"])

    run(look)
    assert page.end() == 0, page.said
