"""Who only looks on holds up nobody, however it fails to read: hunts as processes, on every key.

The gate's queues and buffers are small here, the onlooker's connections never expire, and a gate
that waited for room would wait for ten minutes. So a hunt that comes to its end, to the digest that
it has in peace and with nobody lost, has waited for no onlooker.
"""

import itertools
import json
import os
import signal
import sys
from contextlib import ExitStack, nullcontext

import pytest
from helpers_hosts import NodeProcess
from helpers_hunt import LONG
from helpers_page_client import flooding
from helpers_paths import STRANGER
from helpers_security import ROBOTS, Lab, free_endpoint
from helpers_waiting import ample_s, until

import encircle
from encircle.protocol.keys import robot_key, world_key

ONLOOKER = STRANGER / "onlooker.py"
RUN = "watched"
TICKS = 500
SCENARIO = LONG | {"ticks_max": TICKS}
BY_CLOCK = ("clock=wall", "tick_s=0.005")
SMALL = {
    "transport": {
        "link": {
            "tcp": {"so_sndbuf": 4096},
            "tls": {"so_sndbuf": 4096},
            "tx": {
                "batch_size": 2048,
                "queue": {"congestion_control": {"block": {"wait_before_close": 600_000_000}}},
            },
        }
    }
}
PAUSE_S = 0.5
EVERYTHING = ("hear:encircle/**", "watch:encircle/**", "answer:encircle/**")
WITHOUT_CERTIFICATES = [
    *(f"anyone:{what}" for what in EVERYTHING),
    *(f"anyone:hear:{robot_key(RUN, '*', c)}" for c in ("setup", "end", "pose", "command")),
    f"anyone:hear:{robot_key(RUN, 'r1', 'observation')}",
    f"anyone:hear:{world_key(RUN, 'state')}",
    f"anyone:ask:{world_key(RUN, 'scenario')}",
]
WITH_CERTIFICATES = [
    f"viewer:hear:{world_key(RUN, 'state')}",
    f"viewer:hear:{world_key(RUN, 'radio')}",
    f"viewer:hear:{robot_key(RUN, '*', '*')}",
    f"viewer:ask:{world_key(RUN, 'scenario')}",
    f"viewer:watch:{world_key(RUN, 'alive')}",
    f"viewer:watch:{robot_key(RUN, '*', 'alive')}",
    f"r1:hear:{robot_key(RUN, 'r1', '*')}",
    f"r1:answer:{robot_key(RUN, 'r1', 'about')}",
]


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    return Lab(tmp_path_factory.mktemp("watched"))


@pytest.fixture(scope="module")
def digest():
    """That of the hunt in peace."""
    return encircle.run(SCENARIO, link="memory").digest


class Watched:
    """A hunt as processes, through a router or not, with certificates or not."""

    def __init__(self, folder, closing, through_router, certificates, overrides=()):
        self._folder, self._closing, self._numbers = folder, closing, itertools.count()
        self._directory = certificates or ""
        self.endpoint = free_endpoint("tls" if certificates else "tcp")
        small = folder / "small.json5"
        small.write_text(json.dumps(SMALL))
        scenario = folder / "scenario.json"
        scenario.write_text(json.dumps(SCENARIO))
        self._known = ["--certificates", certificates] if certificates else []
        gate = ["--listen", self.endpoint, "--zenoh-config", small, *self._known]
        self.nodes = []
        if through_router:
            # It ends with the run, and fails if it cannot.
            self.nodes.append(
                self.start("-m", "encircle.protocol.programs.router", *gate, "--for-run", RUN)
            )
            self.nodes[0].wait_for_listening()
            gate = ["--connect", self.endpoint, *self._known]
        changed = [word for override in overrides for word in ("--set", override)]
        self.world = self.start(
            *("-m", "encircle.world", scenario, *gate, *changed),
            *("--run", RUN, "--out", folder / "run", "--answer-timeout", 4.0 * ample_s()),
        )
        self.nodes.append(self.world)

    def start(self, *arguments):
        log = self._folder / f"{next(self._numbers)}"
        node = NodeProcess(
            [sys.executable, *map(str, arguments)], log, {"OPENBLAS_NUM_THREADS": "1"}
        )
        self._closing.callback(node.kill)
        return node

    def watch(self, whats, pause_s=0.0):
        onlooker = self.start(ONLOOKER, self.endpoint, pause_s, self._directory, *whats)
        onlooker.wait_until(lambda node: "looking on" in node.said)
        return onlooker

    def show(self):
        """Have a page show the hunt; the process that serves it, and its address."""
        where = ("--connect", self.endpoint, "--run", RUN, *self._known)
        page = self.start("-m", "encircle", "watch", *where, "--no-browser", "--watch-end", "run")
        page.wait_until(lambda node: "the page is at" in node.said)
        return page, page.said.split()[-1]

    def begin(self):
        where = ("--connect", self.endpoint, "--run", RUN, *self._known)
        self.nodes += [self.start("-m", "encircle.agents", robot, *where) for robot in ROBOTS]

    def end(self):
        """Wait for all to end by themselves, as long as anything goes on; the world's result."""
        until(
            lambda: not any(node.running for node in self.nodes),
            "the hunt's end",
            lambda: (self.world.tick, [node.running for node in self.nodes]),
        )
        assert [node.end() for node in self.nodes] == [0] * len(self.nodes), self.world.said
        return self.world.result()


@pytest.fixture
def watched(tmp_path, request):
    with ExitStack() as closing:
        yield lambda *how: Watched(tmp_path, closing, *how)


GATES = pytest.mark.parametrize("through_router", [False, True], ids=["world", "router"])


@GATES
@pytest.mark.parametrize("secured", [False, True], ids=["open", "secured"])
@pytest.mark.parametrize("how", ["frozen", "slow", "dead"])
def test_a_hunt_goes_on_as_if_nobody_looked_on(lab, watched, digest, through_router, secured, how):
    hunt = watched(through_router, lab.directory if secured else None)
    whats = WITH_CERTIFICATES if secured else WITHOUT_CERTIFICATES
    onlooker = hunt.watch(whats, PAUSE_S if how == "slow" else 0.0)
    if how == "frozen":
        os.kill(onlooker.pid, signal.SIGSTOP)
    hunt.begin()
    if how == "dead":
        hunt.world.wait_for_tick(20)
        onlooker.kill()
    result = hunt.end()
    assert result["digest"] == digest
    assert (result["departures"], result["refused"]) == ([], {})


@pytest.mark.parametrize(
    ("how", "through_router", "secured"),
    [
        *(("frozen", router, secured) for router in (False, True) for secured in (False, True)),
        *(("seen", router, True) for router in (False, True)),
        ("dead", True, False),
        ("flooded", False, False),
    ],
)
def test_nor_does_it_matter_whether_a_page_shows_it(
    lab, watched, digest, through_router, secured, how
):
    hunt = watched(through_router, lab.directory if secured else None)
    page, address = hunt.show()
    if how == "frozen":
        os.kill(page.pid, signal.SIGSTOP)
    with flooding(address) if how == "flooded" else nullcontext():
        hunt.begin()
        if how == "dead":
            hunt.world.wait_for_tick(20)
            page.kill()
        result = hunt.end()
    assert result["digest"] == digest
    assert (result["departures"], result["refused"]) == ([], {})
    if how in ("seen", "flooded"):
        assert page.end() == 0, page.said


@GATES
@pytest.mark.parametrize("how", ["frozen", "slow"])
def test_nor_does_a_hunt_by_the_clock_wait(watched, through_router, how):
    hunt = watched(through_router, None, BY_CLOCK)
    onlooker = hunt.watch(WITHOUT_CERTIFICATES, PAUSE_S if how == "slow" else 0.0)
    if how == "frozen":
        os.kill(onlooker.pid, signal.SIGSTOP)
    hunt.begin()
    result = hunt.end()
    assert (result["ended"], result["departures"]) == ("ticks", [])
