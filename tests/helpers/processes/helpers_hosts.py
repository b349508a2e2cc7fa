"""Hosts of their own for tests: network namespaces joined by a bridge, and what runs in them."""

import contextlib
import itertools
import json
import os
import shutil
import subprocess
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from helpers_commands import ours, process_of
from helpers_waiting import LONGEST_S, completed, ended, until

from encircle.protocol.keys import robot_key
from encircle.protocol.zenoh.endpoints import Endpoints
from encircle.protocol.zenoh.liveliness import alive_keys
from encircle.protocol.zenoh.session import open_session

_numbers = itertools.count()


def possible() -> bool:
    """Whether this user may make network namespaces here."""
    if os.geteuid() != 0 or not (shutil.which("ip") and shutil.which("nsenter")):
        return False
    name = f"encircle-{os.getpid()}-try"
    made = subprocess.run(["ip", "netns", "add", name], capture_output=True, check=False)
    if made.returncode == 0:
        ip("netns", "delete", name)
    return made.returncode == 0


def wait_for_robots(endpoint: str, run: str, count: int) -> None:
    """Until so many robots of a run are there: who comes then has not long to wait for them."""
    access = Endpoints(connect=(endpoint,), connect_s_max=LONGEST_S)
    with open_session(access) as session:
        there = partial(alive_keys, session, robot_key(run, "*", "alive"), LONGEST_S)
        until(lambda: len(there()) >= count, f"{count} robots of run {run}")


def ip(*arguments: str) -> None:
    done = completed(["ip", *arguments])
    if done.returncode:
        raise OSError(f"ip {' '.join(arguments)}: {done.stderr.strip()}")


class Hosts:
    """Hosts on one network of the tests' own: addresses 10.99.0.1 and so on, in the order named."""

    def __init__(self, names: Sequence[str], logs: Path) -> None:
        self._logs = logs
        self._base = f"encircle-{os.getpid()}-{next(_numbers)}"
        self._switch = f"{self._base}-switch"
        self.addresses = {name: f"10.99.0.{k}" for k, name in enumerate(names, 1)}
        self._spaces: list[str] = []
        self.started: list[NodeProcess] = []
        try:
            self._space(self._switch)
            ip("-n", self._switch, "link", "add", "bridge", "type", "bridge")
            ip("-n", self._switch, "link", "set", "bridge", "up")
            for name, address in self.addresses.items():
                self._host(name, address)
        except BaseException:
            self.close()
            raise

    def _space(self, space: str) -> None:
        ip("netns", "add", space)
        self._spaces.append(space)
        ip("-n", space, "link", "set", "lo", "up")

    def _host(self, name: str, address: str) -> None:
        space = f"{self._base}-{name}"
        self._space(space)
        ends = ("link", "add", name, "type", "veth", "peer", "name", "net0", "netns", space)
        ip("-n", self._switch, *ends)
        ip("-n", self._switch, "link", "set", name, "master", "bridge", "up")
        ip("-n", space, "address", "add", f"{address}/24", "dev", "net0")
        ip("-n", space, "link", "set", "net0", "up")

    def endpoint(self, name: str) -> str:
        return f"tcp/{self.addresses[name]}:7447"

    def start(
        self, host: str, *arguments: str, settings: dict[str, str] | None = None
    ) -> "NodeProcess":
        """A command of ours on a host, as ``python -m``, with these environment variables."""
        within = ["nsenter", f"--net=/run/netns/{self._base}-{host}"]
        log = self._logs / f"{len(self.started)}-{host}"
        node = NodeProcess([*within, *ours(*arguments)], log, settings or {})
        self.started.append(node)
        return node

    @contextlib.contextmanager
    def cut_off(self, name: str) -> Iterator[None]:
        """A host whose cable is pulled as long as this lasts."""
        ip("-n", self._switch, "link", "set", name, "down")
        try:
            yield
        finally:
            ip("-n", self._switch, "link", "set", name, "up")

    def close(self) -> None:
        for node in self.started:
            node.kill()
        for space in reversed(self._spaces):
            subprocess.run(["ip", "netns", "delete", space], check=False, capture_output=True)


class NodeProcess:
    """A world, robot or router as a process. Its output goes to files, so that it never waits."""

    def __init__(self, command: Sequence[str], log: Path, settings: dict[str, str]) -> None:
        self._out, self._err = log.with_suffix(".out"), log.with_suffix(".err")
        environment = os.environ | {"ENCIRCLE_JSON": "yes"} | settings
        with (
            open(os.devnull, "rb") as nothing,
            open(self._out, "wb") as out,
            open(self._err, "wb") as err,
        ):
            self._process = process_of(command, (nothing, out, err), environment)

    @property
    def pid(self) -> int:
        return self._process.pid

    @property
    def running(self) -> bool:
        return self._process.poll() is None

    @property
    def said(self) -> str:
        return self._err.read_text()

    def printed_text(self) -> str:
        """What it has printed so far."""
        return self._out.read_text()

    def printed(self) -> dict[str, Any]:
        """The one JSON object that a command has printed."""
        found: dict[str, Any] = json.loads(self.printed_text())
        return found

    def reports(self) -> list[dict[str, Any]]:
        """What a world has told so far."""
        lines = self._out.read_text().split("\n")[:-1]
        return [json.loads(line) for line in lines]

    @property
    def tick(self) -> int:
        """How far a world has come."""
        return max((report.get("tick", -1) for report in self.reports()), default=-1)

    def result(self) -> dict[str, Any]:
        return next(report["result"] for report in self.reports() if "result" in report)

    def wait_until(self, happened: Callable[["NodeProcess"], bool]) -> None:
        def holds() -> bool:
            over = self._process.poll() is not None
            if happened(self):
                return True
            assert not over, f"ended too early: {self.said}"
            return False

        until(holds, f"{self._process.args} to go on", self._lengths)

    def wait_for_tick(self, tick: int) -> None:
        """Until a world has come so far."""
        self.wait_until(lambda world: world.tick >= tick)

    def wait_for_listening(self) -> None:
        """Until a router has said that it listens."""
        self.wait_until(lambda router: "listening on" in router.said)

    def end(self) -> int:
        """Wait for the end; the exit status."""
        return ended(self._process, self._lengths)

    def _lengths(self) -> tuple[int, int]:
        """How much it has said."""
        return self._out.stat().st_size, self._err.stat().st_size

    def terminate(self) -> int:
        self._process.terminate()
        return self.end()

    def kill(self) -> None:
        if self._process.poll() is None:
            self._process.kill()
        self._process.wait()
